"""The interface of every radio, the manual radio, and the base of the others."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import selectors
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from typing import Any, Protocol

from mocha_link.errors import MochaLinkError, RadioError
from mocha_link.links import Reading
from mocha_link.logs import Log

LOG = logging.getLogger("mocha_link")

Report = Callable[[str, Reading | float | None], None]
"""Takes a peer and its signal: a reading, a bare number in dBm, or None (no signal)."""


class Radio(Protocol):
    """Reports the signal of peers while it is started."""

    def start(self, report: Report) -> None:
        """Begin to report.

        Args:
            report: call it as `report(peer, reading)`, from any thread; None: no signal of the
                peer. It raises UnknownRobotError for a name that is not linked to the robot, and
                RadioError for a bare number that is out of range in dBm.
        """

    def close(self) -> None:
        """Stop reporting and release all resources; may be called twice."""


class ManualRadio:
    """A radio that reports the readings a program gives it; for embedding and tests."""

    def __init__(self) -> None:
        self._report: Report | None = None  # while it is started

    def start(self, report: Report) -> None:
        """Begin to forward reports.

        Args:
            report: receives them.
        """
        self._report = report

    def close(self) -> None:
        """Stop forwarding reports."""
        self._report = None

    def report(self, peer: str, reading: Reading | float | None) -> None:
        """Report the signal of a peer. The report is lost while the node is not started.

        Args:
            peer: the name of a linked robot.
            reading: a reading, an RSSI in dBm, or None: no signal.

        Raises:
            UnknownRobotError: the peer is not linked to the robot.
            RadioError: the value is not a number, or not within -1000 to 1000.
        """
        if self._report:
            self._report(peer, reading)


class BackgroundRadio:
    """Runs an event loop on a thread of its own; `close` ends both at once.

    Args:
        log: where it logs: the log of its robot's node.

    Attributes:
        log: where it logs.
        refused: the number of reports that were invalid or that the node did not accept. The radio
            keeps running after them.
    """

    def __init__(self, log: Log = LOG) -> None:
        self.refused = 0
        self.log = log
        self._report: Report  # to the node; set when it is started
        self._end: Callable[[], object] | None = None  # cancels what listens
        self._thread: threading.Thread | None = None  # while it is started

    def close(self) -> None:
        """End the thread and wait for it; may be called twice."""
        if self._thread and self._end:
            with contextlib.suppress(RuntimeError):  # it has ended by itself
                self._end()
            self._thread.join()
            self._thread = self._end = None

    def pass_on(self, peer: str, reading: Reading | None) -> None:
        """Report to the node; count a report that the node does not accept.

        Args:
            peer: the name of a robot.
            reading: its signal; None: none.
        """
        try:
            self._report(peer, reading)
        except MochaLinkError as error:
            self.refuse(error)

    def pass_on_best(self, found: Mapping[str, Reading | None], peers: Mapping[str, str]) -> None:
        """Report the best reading of each peer.

        Args:
            found: readings by the ids of radios.
            peers: names of robots by the ids of their radios.
        """
        best: dict[str, Reading | None] = {}
        for radio_id, reading in found.items():
            peer = peers.get(radio_id)
            if peer is not None:
                known = best.setdefault(peer, reading)
                if reading and (known is None or reading.value > known.value):
                    best[peer] = reading
        for peer, reading in best.items():
            self.pass_on(peer, reading)

    def refuse(self, error: MochaLinkError) -> None:
        """Count an invalid report; the first one is logged as a warning, later ones as debug.

        Args:
            error: why it was refused.
        """
        level = logging.DEBUG if self.refused else logging.WARNING
        self.refused += 1
        self.log.log(level, "radio report refused: %s", error)

    async def lines(self, stream: asyncio.StreamReader) -> AsyncIterator[bytes]:
        """The lines of a stream, without blank ones; a line above the stream's limit is refused.

        Args:
            stream: its limit is the longest line in bytes.
        """
        whole = True  # nothing of this line was left out
        while True:
            try:
                line = await stream.readuntil()
            except asyncio.LimitOverrunError as error:
                await stream.readexactly(error.consumed)
                whole = False
                continue
            except asyncio.IncompleteReadError as error:
                line = error.partial  # the last one may lack its end
            except OSError:  # e.g. the connection was reset
                return
            if not whole:
                self.refuse(RadioError("a line that is too long"))
            elif line.strip():
                yield line
            whole = True
            if not line.endswith(b"\n"):
                return

    def _begin(self, report: Report, listen: Coroutine[Any, Any, None]) -> None:
        """Run a coroutine in the background until it ends, or is cancelled by `close`."""
        self._report = report
        loop = asyncio.SelectorEventLoop(selectors.PollSelector())  # poll takes plain files, too
        task = loop.create_task(listen)
        self._end = lambda: loop.call_soon_threadsafe(task.cancel)

        def work() -> None:
            with asyncio.Runner(loop_factory=lambda: loop) as runner:  # ends what `listen` began
                runner.run(_ended(task))

        self._thread = threading.Thread(target=work, name="mocha-link radio", daemon=True)
        self._thread.start()


async def _ended(task: asyncio.Task[None]) -> None:
    with contextlib.suppress(asyncio.CancelledError):
        await task
