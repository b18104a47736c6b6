"""What every radio serves, the radio that says what it is told to, and what the others share."""

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

LOG = logging.getLogger("mocha_link")

Report = Callable[[str, Reading | float | None], None]
"""Takes a peer and how it is heard: a reading, a bare number in dBm, or None (not heard)."""


class Radio(Protocol):
    """Reports how peers are heard while it is started."""

    def start(self, report: Report) -> None:
        """Begin: call `report(peer, reading)`, from any thread; None: the peer is not heard.

        `report` raises UnknownRobotError for a name that is not linked to the robot, RadioError
        for a bare number that cannot be one in dBm.
        """

    def close(self) -> None:
        """Stop reporting and give up what is held; may be called twice."""


class ManualRadio:
    """A radio that says what it is told to; for embedding and tests."""

    def __init__(self) -> None:
        self._report: Report | None = None  # while it is started

    def start(self, report: Report) -> None:
        """Begin to pass reports on."""
        self._report = report

    def close(self) -> None:
        """Stop passing reports on."""
        self._report = None

    def report(self, peer: str, reading: Reading | float | None) -> None:
        """Report how a peer is heard: a reading, an RSSI in dBm, None for not at all.

        Lost while the node is not started.

        Raises:
            UnknownRobotError: the peer is not linked to the robot.
            RadioError: no number, or not within -1000 to 1000.
        """
        if self._report:
            self._report(peer, reading)


class BackgroundRadio:
    """Listens on an event loop and a thread of its own; both end at once, whatever it waits for.

    Attributes:
        refused: How many reports were none, or not accepted by the node. That stops nothing.
    """

    def __init__(self) -> None:
        self.refused = 0
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
        """Report to the node; what it does not accept is refused."""
        try:
            self._report(peer, reading)
        except MochaLinkError as error:
            self.refuse(error)

    def pass_on_best(self, found: Mapping[str, Reading | None], peers: Mapping[str, str]) -> None:
        """Report how peers are heard, given by the ids of their radios: the best one of each."""
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
        """Count a report that is none; the first one is logged for people, the rest for debug."""
        level = logging.DEBUG if self.refused else logging.WARNING
        self.refused += 1
        LOG.log(level, "radio report refused: %s", error)

    async def lines(self, stream: asyncio.StreamReader) -> AsyncIterator[bytes]:
        """The lines of a stream without blank ones; what is longer than its limit is refused."""
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
