"""A node served to other programs at a ZeroMQ endpoint, from a thread of its own."""

from __future__ import annotations

import contextlib
import socket
import threading
from abc import abstractmethod
from collections.abc import Callable

import zmq

from mocha_link.links.link_events import LinkEvent
from mocha_link.node.lifetime import Startable
from mocha_link.node.node import Node
from mocha_link.service.endpoint import bind

READ_BYTES = 4096


class EndpointServer(Startable):
    """Serves a started node at an endpoint, e.g. ``tcp://127.0.0.1:24500`` or ``ipc://path``.

    Port ``*`` takes a free one; `endpoint` then says which.
    """

    def __init__(self, node: Node, endpoint: str, what: str) -> None:
        self.endpoint = endpoint
        self._node = node
        self._what = what
        self._stopping = False  # set by `close`
        self._waker: socket.socket | None = None  # ends the wait
        self._thread: threading.Thread | None = None  # while it serves
        self._unsubscribe: Callable[[], None] | None = None  # from the node's events

    def start(self) -> None:
        """Begin to serve. Raises PortInUseError or ListenError."""
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        server = self._socket(context)
        server.setsockopt(zmq.LINGER, 0)
        try:
            self.endpoint = bind(server, self.endpoint, f"cannot serve {self._what}")
        except BaseException:
            context.destroy(0)
            raise
        self._waker, woken = socket.socketpair()
        self._waker.setblocking(False)
        self._thread = threading.Thread(
            target=self._run,
            args=(context, server, woken),
            name=f"mocha-link {self._what}",
            daemon=True,
        )
        self._unsubscribe = self._node.subscribe(self._note)
        self._thread.start()

    def close(self) -> None:
        """Stop serving; may be called twice."""
        self._stopping = True
        self._wake()
        if self._thread and self._waker and self._unsubscribe:
            self._unsubscribe()
            self._thread.join()
            self._waker.close()

    def _wake(self) -> None:
        if self._waker:
            with contextlib.suppress(OSError):  # full: awake anyway; closed: too late
                self._waker.send(b"\0")

    def _run(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        server: zmq.Socket[bytes],
        woken: socket.socket,
    ) -> None:
        poller = zmq.Poller()
        poller.register(server, zmq.POLLIN)
        poller.register(woken, zmq.POLLIN)
        with context, server, woken:
            while not self._stopping:
                ready = dict(poller.poll(self._wait_ms()))
                if woken.fileno() in ready:
                    woken.recv(READ_BYTES)
                self._turn(server, ready=server in ready)
            self._end()

    @abstractmethod
    def _socket(self, context: zmq.Context[zmq.Socket[bytes]]) -> zmq.Socket[bytes]:
        """The socket to bind, with its options."""

    @abstractmethod
    def _note(self, event: LinkEvent) -> None:
        """Take in what happened at the node, on the node's thread."""

    @abstractmethod
    def _wait_ms(self) -> int | None:
        """How long there is nothing to do if nothing comes; None: for ever."""

    @abstractmethod
    def _turn(self, server: zmq.Socket[bytes], *, ready: bool) -> None:
        """Do what is to be done; `ready`: something has come."""

    def _end(self) -> None:
        """Say the last things, before the socket is closed."""
