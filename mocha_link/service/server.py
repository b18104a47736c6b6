"""A node served to other programs at a ZeroMQ endpoint, from a thread of its own; its metrics.

`MetricsServer` has one XPUB socket. A subscriber gets a snapshot at once, then every event, and a
snapshot every second. Messages have two frames: ``links`` or ``event``, and a JSON object.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import json
import math
import queue
import socket
import threading
import time
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import zmq

from mocha_link.errors import Guard
from mocha_link.links.metrics import Contact, LinkEvent, LinkMetrics
from mocha_link.links.reading import Reading
from mocha_link.node.lifetime import Startable
from mocha_link.node.node import Node
from mocha_link.service.endpoint import bind
from mocha_link.store.wire import Header

READ_BYTES = 4096
LINKS, EVENT = b"links", b"event"
SNAPSHOT_S = 1.0
MAX_SUBSCRIPTION_BYTES = 1024
HEARTBEAT_MS = 4_000  # subscribers are asked for a sign of life at this distance
STOPPED_MS = 12_000  # a subscriber that gives none for so long is cut off; it may come again


class EndpointServer(Startable):
    """Serves a started node at an endpoint, e.g. ``tcp://127.0.0.1:24500`` or ``ipc://path``.

    Port ``*`` takes a free one; `endpoint` then says which.
    """

    def __init__(self, node: Node, endpoint: str, what: str) -> None:
        self.endpoint = endpoint
        self._node = node
        self._what = what
        self._guard = Guard(f"serving {what}: an error")
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
                with self._guard:
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


def as_fields(value: LinkEvent | LinkMetrics | Reading | Contact) -> dict[str, Any]:
    """An event or metrics as plain values for JSON: enums by value, headers as hex digits."""
    return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}


def _plain(value: object) -> object:
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, Header):
        return str(value)
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    if isinstance(value, Reading | Contact):
        return as_fields(value)
    return value


def snapshot(node: Node) -> dict[str, Any]:
    """All link metrics of a node, and why its messages do not get to the disk, if so.

    ``{"robot": ..., "at_s": ..., "storage_fault": ..., "links": {peer: {...}}}``.
    """
    return {
        "robot": node.name,
        "at_s": node.clock.now_s(),
        "storage_fault": node.storage_fault,
        "links": {peer: as_fields(link) for peer, link in node.links().items()},
    }


class MetricsServer(EndpointServer):
    """Serves the metrics of a started node at an endpoint, e.g. ``tcp://127.0.0.1:24500``."""

    def __init__(self, node: Node, endpoint: str) -> None:
        super().__init__(node, endpoint, "metrics")
        # of any thread, to be sent
        self._events: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()
        self._due_s = time.monotonic() + SNAPSHOT_S  # the next snapshot, monotonic

    def _socket(self, context: zmq.Context[zmq.Socket[bytes]]) -> zmq.Socket[bytes]:
        publisher = context.socket(zmq.XPUB)
        publisher.setsockopt(zmq.XPUB_VERBOSE, 1)  # every newcomer gets its snapshot
        publisher.setsockopt(zmq.MAXMSGSIZE, MAX_SUBSCRIPTION_BYTES)
        # Else a subscriber that has stopped has 1,000 snapshots wait for it here. To let fewer
        # messages wait would lose events to one that reads, when many come at once.
        publisher.setsockopt(zmq.HEARTBEAT_IVL, HEARTBEAT_MS)
        publisher.setsockopt(zmq.HEARTBEAT_TIMEOUT, STOPPED_MS)
        return publisher

    def _note(self, event: LinkEvent) -> None:
        self._events.put(event)
        self._wake()

    def _wait_ms(self) -> int:
        return max(0, math.ceil((self._due_s - time.monotonic()) * 1000))

    def _turn(self, server: zmq.Socket[bytes], *, ready: bool) -> None:
        if ready:
            server.recv_multipart()  # a subscription: answered with a snapshot
        while not self._events.empty():
            event = self._events.get()
            with self._guard:  # one that is wrong is left out
                fields = {"event": type(event).__name__, **as_fields(event)}
                server.send_multipart([EVENT, json.dumps(fields).encode()])
        if ready or time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + SNAPSHOT_S
            server.send_multipart([LINKS, json.dumps(snapshot(self._node)).encode()])
