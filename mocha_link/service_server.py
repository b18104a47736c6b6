"""Serves a node's messages to programs on the same machine: the socket around `service`.

One ROUTER. REQ, DEALER and ROUTER sockets may ask, with or without the empty frame that REQ sends.
Whoever reaches the endpoint may publish in the robot's name: keep it on this machine.
"""

from __future__ import annotations

import contextlib
import logging
import math
import socket
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Self

import zmq

from mocha_link.endpoint import bind
from mocha_link.metrics import MessageStored
from mocha_link.payload import MAX_BYTES
from mocha_link.service import MAX_HEADER_BYTES, Service

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from mocha_link.metrics import LinkEvent
    from mocha_link.node import Node

MAX_UNREAD = 16  # answers that a client may leave unread before more of them are dropped
MAX_FRAMES = 8

LOG = logging.getLogger("mocha_link")


class ServiceServer:
    """Serves a started node at an endpoint: ``ipc://path`` or ``tcp://127.0.0.1:port``.

    Port ``*`` takes a free one; `endpoint` then says which. Use as a context manager, or call
    `start` and `close`.

    Raises:
        RosError: the team brings along a definition that cannot be used.
    """

    def __init__(self, node: Node, endpoint: str) -> None:
        self.endpoint = endpoint
        self._node = node
        self._service = Service(node)
        self._stopping = False
        self._waker: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._unsubscribe: Callable[[], None] | None = None

    def start(self) -> None:
        """Begin to serve. Raises PortInUseError or ListenError."""
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        router = context.socket(zmq.ROUTER)
        router.setsockopt(zmq.LINGER, 0)
        router.setsockopt(zmq.SNDHWM, MAX_UNREAD)
        router.setsockopt(zmq.RCVHWM, MAX_UNREAD)
        router.setsockopt(zmq.MAXMSGSIZE, MAX_BYTES + MAX_HEADER_BYTES)
        try:
            self.endpoint = bind(router, self.endpoint)
        except BaseException:
            context.destroy(0)
            raise
        self._waker, woken = socket.socketpair()
        self._waker.setblocking(False)
        self._thread = threading.Thread(
            target=self._run, args=(context, router, woken), name="mocha-link service", daemon=True
        )
        self._unsubscribe = self._node.subscribe(self._note)
        self._thread.start()

    def close(self) -> None:
        """Answer those who wait, and stop; may be called twice."""
        self._stopping = True
        self._wake()
        if self._thread and self._waker and self._unsubscribe:
            self._unsubscribe()
            self._thread.join()
            self._waker.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _note(self, event: LinkEvent) -> None:
        if isinstance(event, MessageStored):
            self._wake()

    def _wake(self) -> None:
        if self._waker:
            with contextlib.suppress(OSError):  # full: awake anyway; closed: too late
                self._waker.send(b"\0")

    def _run(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        router: zmq.Socket[bytes],
        woken: socket.socket,
    ) -> None:
        poller = zmq.Poller()
        poller.register(router, zmq.POLLIN)
        poller.register(woken, zmq.POLLIN)
        with context, router, woken:
            while not self._stopping:
                until_s = self._service.until_s
                left_s = 0.0 if until_s is None else max(0.0, until_s - time.monotonic())
                wait_ms = None if until_s is None else math.ceil(left_s * 1000)
                ready = dict(poller.poll(wait_ms))
                if woken.fileno() in ready:
                    woken.recv(4096)
                if router in ready:
                    self._take(router, router.recv_multipart())
                self._service.tick(time.monotonic())
            self._service.tick(time.monotonic(), ending=True)

    def _take(self, router: zmq.Socket[bytes], frames: list[bytes]) -> None:
        delimiter = 2 if len(frames) > 1 and not frames[1] else 1
        envelope, body = frames[:delimiter], frames[delimiter : delimiter + MAX_FRAMES]
        self._service.request(body, partial(_send, router, envelope), time.monotonic())


def _send(router: zmq.Socket[bytes], envelope: list[bytes], answer: list[bytes]) -> None:
    with contextlib.suppress(zmq.Again):  # it does not read what it asks for
        router.send_multipart([*envelope, *answer], zmq.NOBLOCK)
