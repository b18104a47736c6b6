"""A node's link metrics and events for other processes, as JSON over ZeroMQ.

One XPUB socket. Whoever subscribes gets a snapshot at once, then every event, and a snapshot
every second. Messages have two frames: ``links`` or ``event``, and a JSON object.
"""

from __future__ import annotations

import dataclasses
import enum
import json
import math
import queue
import time
from typing import TYPE_CHECKING, Any

import zmq

from mocha_link import endpoint_key
from mocha_link.endpoint_key import EndpointKeyError
from mocha_link.endpoint_server import EndpointServer
from mocha_link.errors import MochaLinkError
from mocha_link.header import Header
from mocha_link.lifetime import Closeable
from mocha_link.metrics import Contact
from mocha_link.reading import Reading

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mocha_link.metrics import LinkEvent, LinkMetrics
    from mocha_link.node import Node

LINKS, EVENT = b"links", b"event"
SNAPSHOT_S = 1.0
MAX_MESSAGE_BYTES = 64 * 1024 * 1024  # a snapshot of 255 links with all their topics is 8 MB
MAX_SUBSCRIPTION_BYTES = 1024
_LOOK_S = 0.05  # so often it is looked whether a node has begun to serve


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


class MetricsServer(EndpointServer):
    """Serves the metrics of a started node at an endpoint, e.g. ``tcp://127.0.0.1:24500``."""

    def __init__(self, node: Node, endpoint: str) -> None:
        super().__init__(node, endpoint, "metrics")
        self._events: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()
        self._due_s = time.monotonic() + SNAPSHOT_S

    def _socket(self, context: zmq.Context[zmq.Socket[bytes]]) -> zmq.Socket[bytes]:
        publisher = context.socket(zmq.XPUB)
        publisher.setsockopt(zmq.XPUB_VERBOSE, 1)  # every newcomer gets its snapshot
        publisher.setsockopt(zmq.MAXMSGSIZE, MAX_SUBSCRIPTION_BYTES)
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
            fields = {"event": type(event).__name__, **as_fields(event)}
            server.send_multipart([EVENT, json.dumps(fields).encode()])
        if ready or time.monotonic() >= self._due_s:
            server.send_multipart([LINKS, json.dumps(snapshot(self._node)).encode()])
            self._due_s = time.monotonic() + SNAPSHOT_S


class Subscription(Closeable):
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
            self._connected = endpoint_key.connect(self._socket, endpoint)
        except EndpointKeyError as error:
            self._context.destroy(0)
            raise MetricsError(str(error)) from None
        except zmq.ZMQError as error:
            self._context.destroy(0)
            why = zmq.strerror(error.errno or 0)
            raise MetricsError(
                f"'{endpoint}' is no endpoint ({why}); write tcp://127.0.0.1:port or ipc://path"
            ) from None

    def next(self, timeout_s: float) -> tuple[str, dict[str, Any]] | None:
        """("links", snapshot) or ("event", event); None if nothing comes for so long.

        Raises MetricsError if what comes is not a node's metrics.
        """
        until_s = time.monotonic() + timeout_s
        while not self._connected:
            if time.monotonic() > until_s:
                return None
            time.sleep(min(_LOOK_S, timeout_s))
            self._connected = endpoint_key.connect(self._socket, self._endpoint)
        if not self._socket.poll(max(0, int((until_s - time.monotonic()) * 1000))):
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

    def close(self) -> None:
        """Give up the connection."""
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
