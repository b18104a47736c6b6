"""Wakes a thread that waits in a poller."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Container

import zmq

from mocha_link.node.kernel import Polled, Poller


class Waker:
    """A socket pair: a byte written to one end wakes the poller that waits for the other."""

    def __init__(self) -> None:
        self._in, self._out = socket.socketpair()
        self._in.setblocking(False)
        self._out.setblocking(False)

    def watch(self, poller: Poller) -> None:
        """Register it with the poller."""
        poller.register(self._out.fileno(), zmq.POLLIN)

    def wake(self) -> None:
        """Wake the poller; from any thread."""
        with contextlib.suppress(OSError):  # full: it wakes anyway; closed: too late
            self._in.send(b"\0")

    def clear(self, ready: Container[Polled]) -> None:
        """Read the bytes that have woken the poller."""
        if self._out.fileno() in ready:
            with contextlib.suppress(BlockingIOError):
                self._out.recv(4096)

    def close(self) -> None:
        """Close both ends."""
        self._in.close()
        self._out.close()
