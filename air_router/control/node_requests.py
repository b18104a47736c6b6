"""Requests for the UAV's gossip node at the flight's endpoint: `publish`, `latest`, `links` ...

docs/ros.md describes them. A separate thread answers them, so no message, however large, delays the
flight.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from mocha_link.links import LinkEvent, MessageStored
from mocha_link.node import Node
from mocha_link.service import Service, requests

MOST_PENDING = 64
"""Most requests waiting for the thread; further ones are refused."""

Send = Callable[[requests.Frames], None]


class NodeRequests:
    """Answers requests about one node. Create and use it in the flight's event loop.

    Raises:
        RosError: The team has an invalid message definition.
    """

    def __init__(self, node: Node) -> None:
        self._service = Service(node)  # used on the thread only
        self.verbs = frozenset(self._service.verbs)
        self._loop = asyncio.get_running_loop()
        self._thread = ThreadPoolExecutor(1, "air_router node requests")
        self._pending = 0  # requests that wait for the thread; changed in the loop only
        self._timer: asyncio.TimerHandle | None = None  # for the next time-out
        self._ticking = False  # the thread will check those that wait; changed in the loop only
        self._unsubscribe = node.subscribe(self._stored)

    def handle(self, frames: requests.Frames, number: object, send: Send) -> None:
        """Answer the request with id `number` by `send`: in the event loop, now or later."""
        if self._pending >= MOST_PENDING:
            why = f"{MOST_PENDING} requests wait already; try again later"
            send(requests.refusal(number, why, again=True))
            return
        self._pending += 1
        self._thread.submit(self._request, frames, send)

    def close(self) -> None:
        """End the thread; requests that wait for a message get an empty answer."""
        self._unsubscribe()
        if self._timer is not None:
            self._timer.cancel()
        self._thread.submit(self._service.tick, time.monotonic(), ending=True)
        self._thread.shutdown(wait=True)

    # On the thread.

    def _request(self, frames: requests.Frames, send: Send) -> None:
        def reply(answer: requests.Frames) -> None:
            self._loop.call_soon_threadsafe(send, answer)

        self._service.request(frames, reply, time.monotonic())
        self._loop.call_soon_threadsafe(self._replied, self._service.until_s, 1)

    def _tick(self) -> None:
        self._service.tick(time.monotonic())
        self._loop.call_soon_threadsafe(self._replied, self._service.until_s, 0)

    # In the loop.

    def _replied(self, until_s: float | None, requests_done: int) -> None:
        self._pending -= requests_done
        if requests_done == 0:
            self._ticking = False
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if until_s is not None:
            wait_s = max(0.0, until_s - time.monotonic())
            self._timer = self._loop.call_later(wait_s, self._due)

    def _due(self) -> None:
        if not self._ticking:
            self._ticking = True
            self._thread.submit(self._tick)

    # On the node's thread.

    def _stored(self, event: LinkEvent) -> None:
        if isinstance(event, MessageStored):
            self._loop.call_soon_threadsafe(self._due)
