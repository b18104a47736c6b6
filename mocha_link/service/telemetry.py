"""A node's link metrics and events for other processes, as JSON over ZeroMQ.

One XPUB socket. A subscriber gets a snapshot at once, then every event, and a snapshot
every second. Messages have two frames: ``links`` or ``event``, and a JSON object.
"""

from __future__ import annotations

import dataclasses
import enum
import json
import math
import queue
import time
from typing import Any

import zmq

from mocha_link.links.metrics import Contact, LinkEvent, LinkMetrics
from mocha_link.links.reading import Reading
from mocha_link.node.node import Node
from mocha_link.service.server import EndpointServer
from mocha_link.store.record import Header

LINKS, EVENT = b"links", b"event"
SNAPSHOT_S = 1.0
MAX_SUBSCRIPTION_BYTES = 1024


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
        # of any thread, to be sent
        self._events: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()
        self._due_s = time.monotonic() + SNAPSHOT_S  # the next snapshot, monotonic

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
