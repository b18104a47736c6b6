"""A node's link metrics and events for other processes, as JSON over ZeroMQ.

One XPUB socket. Whoever subscribes gets a snapshot at once, then every event, and a snapshot
every second. Messages have two frames: ``links`` or ``event``, and a JSON object.
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
from typing import TYPE_CHECKING, Any, Self

import zmq

from mocha_link.endpoint import bind
from mocha_link.errors import MochaLinkError
from mocha_link.header import Header
from mocha_link.metrics import Contact
from mocha_link.reading import Reading

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType

    from mocha_link.metrics import LinkEvent, LinkMetrics
    from mocha_link.node import Node

LINKS, EVENT = b"links", b"event"
SNAPSHOT_S = 1.0
MAX_MESSAGE_BYTES = 64 * 1024 * 1024  # a snapshot of 255 links with all their topics is 8 MB
MAX_SUBSCRIPTION_BYTES = 1024


class MetricsError(MochaLinkError):
    """No metrics can be had from an endpoint."""


def as_fields(value: LinkEvent | LinkMetrics) -> dict[str, Any]:
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
        return {part.name: _plain(getattr(value, part.name)) for part in dataclasses.fields(value)}
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


class MetricsServer:
    """Serves the metrics of a started node at an endpoint, e.g. ``tcp://127.0.0.1:24500``.

    Port ``*`` takes a free one; `endpoint` then says which. Use as a context manager, or call
    `start` and `close`.
    """

    def __init__(self, node: Node, endpoint: str) -> None:
        self.endpoint = endpoint
        self._node = node
        self._events: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()
        self._stopping = False
        self._waker: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._unsubscribe: Callable[[], None] | None = None

    def start(self) -> None:
        """Begin to serve. Raises PortInUseError or ListenError."""
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        publisher = context.socket(zmq.XPUB)
        publisher.setsockopt(zmq.LINGER, 0)
        publisher.setsockopt(zmq.XPUB_VERBOSE, 1)  # every newcomer gets its snapshot
        publisher.setsockopt(zmq.MAXMSGSIZE, MAX_SUBSCRIPTION_BYTES)
        try:
            self.endpoint = bind(publisher, self.endpoint, "cannot serve metrics")
        except BaseException:
            context.destroy(0)
            raise
        self._waker, woken = socket.socketpair()
        self._waker.setblocking(False)
        self._thread = threading.Thread(
            target=self._run, args=(context, publisher, woken), name="mocha-link metrics"
        )
        self._thread.daemon = True
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
        self._events.put(event)
        self._wake()

    def _wake(self) -> None:
        if self._waker:
            with contextlib.suppress(OSError):  # full: awake anyway; closed: too late
                self._waker.send(b"\0")

    def _run(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        publisher: zmq.Socket[bytes],
        woken: socket.socket,
    ) -> None:
        poller = zmq.Poller()
        poller.register(publisher, zmq.POLLIN)
        poller.register(woken, zmq.POLLIN)
        due_s = time.monotonic() + SNAPSHOT_S
        with context, publisher, woken:
            while not self._stopping:
                left_s = due_s - time.monotonic()
                ready = dict(poller.poll(max(0, math.ceil(left_s * 1000))))
                if woken.fileno() in ready:
                    woken.recv(4096)
                if publisher in ready:
                    publisher.recv_multipart()  # a subscription: answered with a snapshot
                while not self._events.empty():
                    event = self._events.get()
                    fields = {"event": type(event).__name__, **as_fields(event)}
                    publisher.send_multipart([EVENT, json.dumps(fields).encode()])
                if publisher in ready or time.monotonic() >= due_s:
                    publisher.send_multipart([LINKS, json.dumps(snapshot(self._node)).encode()])
                    due_s = time.monotonic() + SNAPSHOT_S


class Subscription:
    """What a node's metrics endpoint sends, from a snapshot on. Use as a context manager.

    Raises MetricsError if the endpoint is none.
    """

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES)
        self._socket.setsockopt(zmq.SUBSCRIBE, b"")
        try:
            self._socket.connect(endpoint)
        except zmq.ZMQError as error:
            self._context.destroy(0)
            why = zmq.strerror(error.errno or 0)
            raise MetricsError(
                f"'{endpoint}' is no endpoint ({why}); write tcp://address:port"
            ) from None

    def next(self, timeout_s: float) -> tuple[str, dict[str, Any]] | None:
        """("links", snapshot) or ("event", event); None if nothing comes for so long.

        Raises MetricsError if what comes is not a node's metrics.
        """
        if not self._socket.poll(int(timeout_s * 1000)):
            return None
        frames = self._socket.recv_multipart()
        try:
            kind, fields = frames[0].decode(), json.loads(frames[1])
        except (ValueError, IndexError, RecursionError):
            raise self.strange() from None
        if not isinstance(fields, dict):
            raise self.strange()
        return kind, fields

    def strange(self) -> MetricsError:
        """The error for what is not a node's metrics."""
        return MetricsError(f"what {self._endpoint} sends is not a node's metrics")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._context.destroy(0)


def watch(endpoint: str, *, timeout_s: float = 5.0) -> Iterator[tuple[str, dict[str, Any]]]:
    """Follow a node's metrics: ("links", snapshot) first, then events and snapshots.

    Raises:
        MetricsError: nothing comes from the endpoint for `timeout_s` (real seconds), or what
            comes is not a node's metrics.
    """
    with Subscription(endpoint) as subscription:
        while news := subscription.next(timeout_s):
            yield news
        raise MetricsError(
            f"nothing from {endpoint} for {timeout_s:g} s; is a node running there with "
            f"--metrics {endpoint}?"
        )
