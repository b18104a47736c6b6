"""Delivers events to all listeners: callbacks, and bounded streams for asyncio."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from typing import Self

from mocha_link.errors import LOG, Guard
from mocha_link.forks import parents_only
from mocha_link.links import LinkEvent
from mocha_link.logs import Log

QUEUE_EVENTS = 1000


class EventStream:
    """An asynchronous iterator over events, from its construction until the node closes.

    Args:
        limit: the most events that wait; a slow reader loses the oldest.
        kind: only events of this class.

    Attributes:
        dropped: the number of events that the reader lost.
    """

    def __init__(self, limit: int, kind: type = object) -> None:
        self.dropped = 0
        self._limit = limit
        self._kind = kind
        self._events: deque[LinkEvent] = deque()  # not read yet
        self._closed = False  # the node has closed
        self._lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None  # of the reading task
        self._ready = asyncio.Event()  # set when an event is queued, or the stream is closed
        parents_only(self)

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> LinkEvent:
        self._loop = asyncio.get_running_loop()
        while True:
            self._ready.clear()
            with self._lock:
                if self._events:
                    return self._events.popleft()
                if self._closed:
                    raise StopAsyncIteration
            await self._ready.wait()

    def push(self, event: LinkEvent) -> None:
        """Add an event, from any thread.

        Args:
            event: the event to deliver.
        """
        if not isinstance(event, self._kind):
            return
        with self._lock:
            if self._closed:
                return
            if len(self._events) >= self._limit:
                self._events.popleft()
                self.dropped += 1
            self._events.append(event)
        self._wake()

    def close(self) -> None:
        """End the iteration after the waiting events, from any thread."""
        with self._lock:
            self._closed = True
        self._wake()

    def _wake(self) -> None:
        if self._loop:
            with contextlib.suppress(RuntimeError):  # the reader's event loop is closed
                self._loop.call_soon_threadsafe(self._ready.set)


class Broadcast:
    """The listeners of a node.

    Args:
        log: receives the errors of callbacks, at most one line per callback in ten seconds.
        clock: steady seconds.
    """

    def __init__(self, log: Log = LOG, clock: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._clock = clock
        parents_only(self, "Node")
        # By subscription. An error in a listener must not stop the node.
        self._callbacks: dict[object, tuple[Callable[[LinkEvent], None], Guard]] = {}
        self._streams: weakref.WeakSet[EventStream] = weakref.WeakSet()  # while they are in use
        self._closed = False  # no more events are delivered
        self._lock = threading.Lock()

    def subscribe(self, callback: Callable[[LinkEvent], None]) -> Callable[[], None]:
        """Call a function for every event from now on.

        Args:
            callback: takes the event.

        Returns:
            A function that ends the subscription.

        Raises:
            TypeError: the callback cannot be called, or is a coroutine function.
        """
        given: object = callback  # the annotation is not enforced
        if not callable(given) or inspect.iscoroutinefunction(given):
            raise TypeError(
                f"{given!r} is no plain function that takes an event; "
                "a coroutine iterates over Node.events()"
            )
        key = object()
        name = getattr(callback, "__qualname__", type(callback).__name__)
        guard = Guard(f"a listener failed: {name}", self._clock, self._log)
        with self._lock:
            self._callbacks[key] = callback, guard

        def unsubscribe() -> None:
            with self._lock:
                self._callbacks.pop(key, None)

        return unsubscribe

    def stream(self, limit: int = QUEUE_EVENTS, kind: type = object) -> EventStream:
        """A stream of every event from now on.

        Args:
            limit: the most events that wait for the reader.
            kind: only events of this class.

        Returns:
            The stream; it has ended already if the node is closed.
        """
        stream = EventStream(limit, kind)
        with self._lock:
            self._streams.add(stream)
            closed = self._closed
        if closed:
            stream.close()
        return stream

    def send(self, event: LinkEvent) -> None:
        """Deliver an event to all listeners, until `close`; an exception of a callback is logged.

        Args:
            event: the event to deliver.
        """
        with self._lock:
            if self._closed:
                return
            callbacks, streams = list(self._callbacks.values()), list(self._streams)
        for callback, guard in callbacks:
            with guard:
                callback(event)
        for stream in streams:
            stream.push(event)

    def close(self) -> None:
        """Deliver no further event, and end all streams."""
        with self._lock:
            self._closed = True
            streams = list(self._streams)
        for stream in streams:
            stream.close()
