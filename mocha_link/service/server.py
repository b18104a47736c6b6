"""A node served to other programs at a ZeroMQ endpoint, from a thread of its own; its metrics.

`MetricsServer` is an XPUB socket to its clients. A subscriber gets a snapshot at once, then every
event, and a snapshot every second. Messages have two frames: ``links`` or ``event``, and a JSON
object.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import json
import math
import queue
import selectors
import socket
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from mocha_link.errors import Guard
from mocha_link.forks import parents_only
from mocha_link.lifetime import Startable
from mocha_link.links import Contact, LinkEvent, LinkMetrics, Reading
from mocha_link.node import Node
from mocha_link.service.listener import Listener
from mocha_link.store import Header

READ_BYTES = 4096
LINKS, EVENT = b"links", b"event"
SNAPSHOT_S = 1.0
MAX_SUBSCRIPTION_BYTES = 1024
MAX_SUBSCRIPTIONS = 16  # of one client
MAX_UNREAD_BYTES = 64 * 1024 * 1024  # of all clients: a snapshot of 255 links is 8 MB
STOPPED_S = 12.0  # a subscriber that takes nothing for so long is cut off; it may come again


class EndpointServer(Startable):
    """Serves a started node at an endpoint, e.g. ``tcp://127.0.0.1:24500`` or ``ipc://path``.

    Port ``*`` takes a free one; `endpoint` then has its number.
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
        parents_only(self)

    def start(self) -> None:
        """Begin to serve. Raises PortInUseError or ListenError."""
        listener = self._listen(self.endpoint, f"cannot serve {self._what}")
        self.endpoint = listener.endpoint
        self._waker, woken = socket.socketpair()
        self._waker.setblocking(False)
        self._thread = threading.Thread(
            target=self._run,
            args=(listener, woken),
            name=f"mocha-link {self._what}",
            daemon=True,
        )
        self._unsubscribe = self._node.subscribe(self._note)
        try:
            self._thread.start()
        except BaseException:
            self._thread = None
            self._unsubscribe()
            for each in (listener, self._waker, woken):
                each.close()
            raise

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

    def _run(self, listener: Listener, woken: socket.socket) -> None:
        with selectors.DefaultSelector() as selector, contextlib.closing(listener), woken:
            selector.register(listener, selectors.EVENT_READ)
            selector.register(woken, selectors.EVENT_READ)
            while not self._stopping:
                wait_ms = min(self._wait_ms(), listener.wait_ms)
                ready = [key.fileobj for key, _ in selector.select(wait_ms / 1000)]
                if woken in ready:
                    woken.recv(READ_BYTES)
                with self._guard:
                    self._turn(listener)
            self._end()

    @abstractmethod
    def _listen(self, endpoint: str, what: str) -> Listener:
        """Take the endpoint. Raises PortInUseError or ListenError."""

    @abstractmethod
    def _note(self, event: LinkEvent) -> None:
        """Take in what happened at the node, on the node's thread."""

    @abstractmethod
    def _wait_ms(self) -> int:
        """How long there is nothing to do if nothing comes."""

    @abstractmethod
    def _turn(self, listener: Listener) -> None:
        """Run one turn."""

    def _end(self) -> None:
        """Send the last messages, before the socket is closed."""


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
        self._subscribed: dict[bytes, list[bytes]] = {}  # what messages begin with, by client

    def _listen(self, endpoint: str, what: str) -> Listener:
        return Listener(
            endpoint,
            what,
            max_bytes=MAX_SUBSCRIPTION_BYTES,
            most_bytes=MAX_UNREAD_BYTES,
            kind=b"XPUB",
            burst=MAX_SUBSCRIPTIONS,
        )

    def _note(self, event: LinkEvent) -> None:
        self._events.put(event)
        self._wake()

    def _wait_ms(self) -> int:
        return max(0, math.ceil((self._due_s - time.monotonic()) * 1000))

    def _turn(self, listener: Listener) -> None:
        newcomers = [client for client in self._newcomers(listener) if client in self._subscribed]
        while not self._events.empty():
            event = self._events.get()
            with self._guard:  # one that is wrong is left out
                fields = {"event": type(event).__name__, **as_fields(event)}
                self._publish(listener, EVENT, fields, self._subscribed)
        if time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + SNAPSHOT_S
            listener.drop_stopped(STOPPED_S)
            closed = [client for client in self._subscribed if not listener.stands(client)]
            for client in closed:
                del self._subscribed[client]
            newcomers = list(self._subscribed)
        if newcomers:
            self._publish(listener, LINKS, snapshot(self._node), newcomers)

    def _newcomers(self, listener: Listener) -> Iterator[bytes]:
        """Take in subscriptions; those who made one."""
        for (client, *_), frames in listener.requests():
            wanted = frames[0] if frames else b""
            known = self._subscribed.setdefault(client, [])
            if wanted[:1] == b"\1" and len(known) < MAX_SUBSCRIPTIONS:
                known.append(wanted[1:])
                yield client
            elif wanted[:1] == b"\0" and wanted[1:] in known:
                known.remove(wanted[1:])

    def _publish(
        self, listener: Listener, kind: bytes, fields: dict[str, Any], clients: Iterable[bytes]
    ) -> None:
        frames = [kind, json.dumps(fields).encode()]
        for client in clients:
            if any(kind.startswith(begin) for begin in self._subscribed[client]):
                listener.publish(client, frames)
