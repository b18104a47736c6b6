"""Flows of datagrams over a model of a link: rate, round trip, queue, losses, times when it is up.

No sockets and no clock, so a run gives the same bytes every time. The tests use it as well.
"""

import heapq
import itertools
import random
from collections.abc import Callable, Sequence
from typing import Any

from mocha_link.datagram import Flow

TOKEN = b"token1"
OVER_UDP = 28  # bytes of IPv4 and UDP headers
MBIT = 125_000


class World:
    """Time, and what happens when."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()

    def at(self, time_s: float, do: Callable[[], None]) -> None:
        heapq.heappush(self._events, (time_s, next(self._order), do))

    def run(self, until_s: float) -> None:
        while self._events and self._events[0][0] <= until_s:
            self.now_s, _, do = heapq.heappop(self._events)
            do()
        self.now_s = until_s


class Way:
    """One direction of a link, with a queue that drops at its end.

    `rate` in bytes/s may be a function of time; `up`: the times when it carries anything.
    """

    def __init__(  # noqa: PLR0913 - a link has so many faults
        self,
        world: World,
        rate: float | Callable[[float], float],
        delay_s: float,
        *,
        queue_bytes: float = 200_000,
        loss: float = 0.0,
        up: Sequence[tuple[float, float]] | None = None,
        jitter_s: float = 0.0,
        twice: float = 0.0,
        seed: int = 1,
    ) -> None:
        self.world, self.rate, self.delay_s, self.queue_bytes = world, rate, delay_s, queue_bytes
        self.loss, self.up, self.jitter_s, self.twice = loss, up, jitter_s, twice
        self.random = random.Random(seed)
        self.free_s = 0.0
        self.offered = self.dropped = 0
        self._queued_s = 0.0  # sum over all packets

    @property
    def queued_s(self) -> float:
        """How long a packet waited, in the mean."""
        return self._queued_s / max(self.offered - self.dropped, 1)

    def _up(self, begin_s: float, end_s: float) -> bool:
        return self.up is None or any(a <= begin_s and end_s < b for a, b in self.up)

    def send(self, packet: bytes, to: Callable[[bytes], None]) -> None:
        now_s = self.world.now_s
        self.offered += 1
        if not self._up(now_s, now_s):
            self.free_s = now_s
            return
        rate = self.rate(now_s) if callable(self.rate) else self.rate
        waiting_s = max(self.free_s - now_s, 0.0)
        if waiting_s * rate > self.queue_bytes:
            self.dropped += 1
            return
        self._queued_s += waiting_s
        self.free_s = now_s + waiting_s + (len(packet) + OVER_UDP) / rate
        for _ in range(2 if self.random.random() < self.twice else 1):
            if self.random.random() >= self.loss:
                at_s = self.free_s + self.delay_s + self.random.random() * self.jitter_s
                if self._up(now_s, at_s):
                    self.world.at(at_s, lambda: to(packet))


class End:
    """Runs a flow as a node does, waking up at whole milliseconds."""

    def __init__(
        self,
        world: World,
        way: Way,
        source: Callable[[int], bytes | None] = lambda _: None,
        got: list[bytes] | None = None,
        **known: Any,
    ) -> None:
        self.world, self.way = world, way
        self.flow = Flow(TOKEN, source, **known)
        self.got: list[bytes] = [] if got is None else got
        self.got_s: list[float] = []
        self.closed = False
        self.other: End | None = None
        self._wake_s: float | None = None

    def join(self, other: "End") -> "End":
        self.other, other.other = other, self
        return self

    def arrive(self, packet: bytes) -> None:
        if not self.closed:
            frames = self.flow.receive(packet, self.world.now_s)
            self.got += frames
            self.got_s += [self.world.now_s] * len(frames)
            self.go()

    def go(self) -> None:
        if self.closed or self.other is None:
            return
        for packet in self.flow.transmit(self.world.now_s):
            self.way.send(packet, self.other.arrive)
        wake_s = self.flow.wake_s
        if wake_s is None:
            self._wake_s = None
            return
        wake_s = (int(max(wake_s, self.world.now_s) * 1000) + 1) / 1000
        if self._wake_s is None or wake_s < self._wake_s or self._wake_s <= self.world.now_s:
            self._wake_s = wake_s
            self.world.at(wake_s, lambda: self.go() if self._wake_s == wake_s else None)

    @property
    def bytes(self) -> int:
        return sum(map(len, self.got))
