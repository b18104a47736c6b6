"""The model of a link, fed by a link that does exactly what its numbers are."""

from collections import deque

import pytest

from mocha_link.datagram.pacing import (
    BURST_S,
    START_PACKETS,
    START_RATE,
    Pacing,
)

PACKET = 1_000
MBIT = 125_000


class Bench:
    """A sender that always has something, over a link with one acknowledgement per packet."""

    def __init__(self, rate=MBIT, rtt_s=0.05, queue_s=10.0, **known):
        self.rate, self.rtt_s, self.queue_s = rate, rtt_s, queue_s
        self.pacing = Pacing(PACKET, **known)
        self.now_s = 0.0
        self.count = self.delivered = self.in_flight = 0
        self._free_s = 0.0
        self._back = deque()

    def run(self, seconds):
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            while self._back and self._back[0][0] <= self.now_s:
                self._acknowledged(*self._back.popleft()[1:])
            while self.may_send():
                self.send()
            self.now_s += 0.0005
        return self

    def may_send(self):
        return self.pacing.room(self.in_flight) and self.pacing.due_s <= self.now_s

    def send(self):
        stamp = self.pacing.sent(PACKET, self.now_s, self.in_flight)
        self.in_flight += PACKET
        self.count += 1
        self._free_s = max(self._free_s, self.now_s)
        lost = self._free_s - self.now_s > self.queue_s
        if not lost:
            self._free_s += PACKET / self.rate
        self._back.append((max(self._free_s, self.now_s) + self.rtt_s, stamp, lost))

    def _acknowledged(self, stamp, lost):
        self.in_flight -= PACKET
        if not lost:
            self.delivered += PACKET
            self.pacing.arrived([stamp], self.now_s - stamp.sent_s, self.now_s)

    def used(self, seconds):
        """The share of the link that is used in the next seconds."""
        before = self.delivered
        return (self.run(seconds).delivered - before) / self.rate / seconds

    @property
    def waiting_s(self):
        return max(self._free_s - self.now_s, 0.0)


@pytest.mark.parametrize("rate", [MBIT / 4, 8 * MBIT])
@pytest.mark.parametrize("rtt_s", [0.005, 0.3])
def test_an_unknown_link_is_soon_known(rate, rtt_s):
    bench = Bench(rate, rtt_s)
    assert bench.pacing.rate_bytes_s is None
    bench.run(0.004)
    assert 1 <= bench.count <= START_PACKETS
    bench.run(8 * rtt_s + 20 * PACKET / rate)
    assert bench.pacing.rate_bytes_s == pytest.approx(rate, rel=0.1)
    assert bench.used(3) > 0.95


def test_a_known_link_is_used_at_once():
    bench = Bench(rate_bytes_s=MBIT, rtt_s=0.05)
    assert bench.pacing.rate_bytes_s == MBIT
    assert bench.used(0.5) > (0.5 - 0.05 - 2 * PACKET / MBIT) / 0.5 - 0.02
    assert bench.waiting_s < 0.06


def test_a_longer_way_is_taken_for_a_queue_only_for_a_while():
    bench = Bench(rtt_s=0.05).run(2)
    bench.rtt_s = 0.2
    bench.run(3)
    assert bench.pacing.rtt.min_s == pytest.approx(0.2, rel=0.2)
    assert bench.used(3) > 0.85


def test_a_late_call_does_not_make_a_flood():
    bench = Bench(8 * MBIT, rate_bytes_s=8 * MBIT, rtt_s=0.3).run(1)
    bench.now_s += 0.2
    before = bench.count
    while bench.may_send():
        bench.send()
    assert bench.count - before <= BURST_S * 8 * MBIT / PACKET + 1


def test_there_is_room_for_all_packets_of_the_start_and_for_no_more():
    pacing = Pacing(PACKET)
    assert pacing.room((START_PACKETS - 1) * PACKET)
    assert not pacing.room((START_PACKETS - 1) * PACKET + 1)


def test_a_fast_link_that_is_far_is_tried_as_fast_as_the_first_packets_came():
    bench = Bench(800 * MBIT, rtt_s=0.3).run(0.31)
    assert 10 * START_PACKETS * PACKET / 0.3 < bench.pacing.pace <= START_RATE
