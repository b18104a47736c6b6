"""What radios with a thread of their own have in common: its end, and what they refuse."""

from __future__ import annotations

import logging
import os
import select
import selectors
import socket
import threading
from collections.abc import Callable

from mocha_link.errors import MochaLinkError, RadioError
from mocha_link.links.reading import Reading
from mocha_link.radios.port import Report
from mocha_link.radios.reports import parse_report

READ_BYTES = 4096

LOG = logging.getLogger("mocha_link")


class ThreadRadio:
    """Listens on a thread, which ends when it is told to, whatever it waits for.

    Attributes:
        refused: How many reports were none, or not accepted by the node. That stops nothing.
    """

    def __init__(self) -> None:
        self.refused = 0
        self._stop: socket.socket | None = None  # closed to end the thread
        self._thread: threading.Thread | None = None  # while it is started

    def close(self) -> None:
        """End the thread and wait for it; may be called twice."""
        if self._thread and self._stop:
            self._stop.close()
            self._thread.join()
            self._thread = self._stop = None

    def pass_on(self, report: Report, peer: str, reading: Reading | None) -> None:
        """Report to the node; what it does not accept is refused."""
        try:
            report(peer, reading)
        except MochaLinkError as error:
            self.refuse(error)

    def accept(self, report: Report, raw: bytes, source: str) -> None:
        """Pass one report of a program on to the node, or refuse it."""
        try:
            peer, reading = parse_report(raw, source)
        except RadioError as error:
            self.refuse(error)
        else:
            self.pass_on(report, peer, reading)

    def refuse(self, error: MochaLinkError) -> None:
        """Count a report that is none; the first one is logged for people, the rest for debug."""
        level = logging.DEBUG if self.refused else logging.WARNING
        self.refused += 1
        LOG.log(level, "radio report refused: %s", error)

    def _begin(self, run: Callable[[socket.socket], None]) -> None:
        """Call `run(stopped)` on a thread; it must return soon after `stopped` is readable."""
        self._stop, stopped = socket.socketpair()

        def work() -> None:
            with stopped:
                run(stopped)

        self._thread = threading.Thread(target=work, name="mocha-link radio", daemon=True)
        self._thread.start()


def pause(stopped: socket.socket, seconds: float) -> bool:
    """Wait; True if the thread is to end."""
    return bool(select.select([stopped], [], [], seconds)[0])


def pump(fd: int, stopped: socket.socket, take: Callable[[bytes], None]) -> bool:
    """Hand on what can be read from a file, a pipe or a socket, until it ends.

    True if the thread is to end.
    """
    with selectors.PollSelector() as selector:  # takes plain files as well
        selector.register(fd, selectors.EVENT_READ)
        selector.register(stopped, selectors.EVENT_READ)
        while True:
            if stopped.fileno() in {key.fd for key, _ in selector.select()}:
                return True
            try:
                data = os.read(fd, READ_BYTES)
            except OSError:  # e.g. its terminal is gone, or the connection broke
                return False
            if not data:
                return False
            take(data)
