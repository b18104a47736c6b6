"""Flows of frames over a model of a link: rate, round trip, queue, losses, times when it is up."""

from __future__ import annotations

import heapq
import itertools
import random

import pytest

from mocha_link import packet as wire
from mocha_link.datagram import PACKET_BYTES, Flow

TOKEN = b"token1"
OVER_UDP = 28  # bytes of IPv4 and UDP headers
MBIT = 125_000


class World:
    """Time, and what happens when."""

    def __init__(self):
        self.now_s = 0.0
        self._events = []
        self._order = itertools.count()

    def at(self, time_s, do):
        heapq.heappush(self._events, (time_s, next(self._order), do))

    def run(self, until_s):
        while self._events and self._events[0][0] <= until_s:
            self.now_s, _, do = heapq.heappop(self._events)
            do()
        self.now_s = until_s


class Way:
    """One direction of a link, with a queue that drops at its end."""

    def __init__(  # noqa: PLR0913 - a link has so many faults
        self,
        world,
        rate,
        delay_s,
        *,
        queue_bytes=200_000,
        loss=0.0,
        up=None,
        jitter_s=0.0,
        twice=0.0,
        seed=1,
    ):
        self.world, self.rate, self.delay_s, self.queue_bytes = world, rate, delay_s, queue_bytes
        self.loss, self.up, self.jitter_s, self.twice = loss, up, jitter_s, twice
        self.random = random.Random(seed)
        self.free_s = 0.0
        self.asked = self.dropped = 0

    def _up(self, begin_s, end_s):
        return self.up is None or any(a <= begin_s and end_s < b for a, b in self.up)

    def send(self, packet, to):
        now_s = self.world.now_s
        self.asked += 1
        if not self._up(now_s, now_s):
            self.free_s = now_s
            return
        rate = self.rate(now_s) if callable(self.rate) else self.rate
        waiting_s = max(self.free_s - now_s, 0.0)
        if waiting_s * rate > self.queue_bytes:
            self.dropped += 1
            return
        self.free_s = now_s + waiting_s + (len(packet) + OVER_UDP) / rate
        for _ in range(2 if self.random.random() < self.twice else 1):
            if self.random.random() >= self.loss:
                at_s = self.free_s + self.delay_s + self.random.random() * self.jitter_s
                if self._up(now_s, at_s):
                    self.world.at(at_s, lambda: to(packet))


class End:
    """Runs a flow as a shell does, waking up at whole milliseconds."""

    def __init__(self, world, way, source=lambda _: None, **known):
        self.world, self.way = world, way
        self.flow = Flow(TOKEN, source, **known)
        self.got = []
        self.got_s = []
        self.closed = False
        self.other = None
        self._wake_s = None

    def join(self, other):
        self.other, other.other = other, self
        return self

    def arrive(self, packet):
        if not self.closed:
            frames = self.flow.receive(packet, self.world.now_s)
            self.got += frames
            self.got_s += [self.world.now_s] * len(frames)
            self.go()

    def go(self):
        if self.closed:
            return
        for packet in self.flow.transmit(self.world.now_s):
            assert len(packet) <= PACKET_BYTES
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
    def bytes(self):
        return sum(map(len, self.got))


def endless(room):
    return bytes(room)


def numbered(count, size=None):
    """A source of so many different frames."""
    numbers = iter(range(count))

    def source(room):
        number = next(numbers, None)
        return None if number is None else number.to_bytes(4, "big") * ((size or room) // 4)

    return source


def link(rate=MBIT, rtt_s=0.05, **faults):
    world = World()
    faults.setdefault("queue_bytes", max(20 * 1220, rate / 10 if not callable(rate) else 0))
    return world, Way(world, rate, rtt_s / 2, **faults), Way(world, rate, rtt_s / 2, **faults)


@pytest.mark.parametrize("loss", [0.0, 0.05, 0.2, 0.5])
def test_every_frame_arrives_once(loss):
    world, there, back = link(loss=loss, jitter_s=0.03, twice=0.1)
    a = End(world, there, numbered(300)).join(b := End(world, back))
    a.go()
    world.run(60)
    assert sorted(int.from_bytes(frame[:4], "big") for frame in b.got) == list(range(300))
    assert a.flow.settled
    assert a.flow.in_flight_bytes == 0
    assert (a.flow.refused, b.flow.refused) == (0, 0)


def test_the_first_packet_leaves_at_once_with_data():
    flow = Flow(TOKEN, numbered(1, 100))
    (packet,) = flow.transmit(10.0)
    assert Flow(TOKEN, lambda _: None).receive(packet, 10.0) == [bytes(100)]


def test_what_is_no_packet_is_counted():
    flow = Flow(TOKEN, lambda _: None)
    for bad in (
        b"",
        b"\0" * 50,
        bytes([wire.VERSION]) + TOKEN,
        b"\x51other1" + bytes(6),
    ):
        assert flow.receive(bad, 0.0) == []
    assert flow.refused == 4
