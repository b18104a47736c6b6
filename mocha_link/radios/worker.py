"""A thread of a radio that ends when it is told to, whatever it waits for."""

from __future__ import annotations

import os
import select
import selectors
import socket
import threading
from collections.abc import Callable

READ_BYTES = 4096


class Worker:
    """Runs a function on a thread; `stopped` becomes readable when the thread is to end."""

    def __init__(self) -> None:
        self._stop: socket.socket | None = None
        self._thread: threading.Thread | None = None

    def start(self, run: Callable[[socket.socket], None]) -> None:
        """Call `run(stopped)` on a thread; it must return soon after `stopped` is readable."""
        self._stop, stopped = socket.socketpair()
        self._thread = threading.Thread(
            target=self._run, args=(run, stopped), name="mocha-link radio", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """End the thread and wait for it; may be called twice."""
        if self._thread and self._stop:
            self._stop.close()
            self._thread.join()
            self._thread = self._stop = None

    @staticmethod
    def _run(run: Callable[[socket.socket], None], stopped: socket.socket) -> None:
        with stopped:
            run(stopped)


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
