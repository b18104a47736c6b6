"""What acknowledgements show of a link: its rate, its round trip, its losses. No clock here."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

PEAK_ROUNDS = 10  # the rate of the link is the highest of so many rounds
ROUND_S = 0.02  # a round is at least so long, however short the way
RTT_WINDOW_S = 10.0  # the lowest round trip of so long
MIN_RTT_S = 1e-4
MAX_RATE = 125e6
GROUP_PACKETS = 5  # the distances between so many packets show a rate
TRAIN_S = 0.05  # distances are added up over this time
STRETCHED = 1.5  # so much longer for the same packets, coming than going, means a full link
STRETCHED_S = 0.01
RISEN_S = 0.005
RISEN_PACKETS = 3
STANDS_S = 0.03
STANDS_PACKETS = 4
LOW_PACKETS = 20  # a share of losses is taken from at least so many


@dataclass(slots=True)
class Stamp:
    """What was known when a packet left; it comes back when the packet has arrived or is lost."""

    size: int  # bytes
    sent_s: float  # when it left
    delivered: int  # bytes that had arrived by then
    delivered_s: float  # when the last of these arrived
    first_s: float  # when the packet left that arrived last
    limited: bool  # the sender had less to send than the link takes
    low: bool  # the sender sent less on purpose


class Train(NamedTuple):
    """What became of the last packets that left one behind the other."""

    rate: float  # bytes/s at which they came out of the link
    stretched: bool  # they came out more slowly than they went in: the link is full
    loss: float  # share of bytes
    risen: bool  # even the fastest of the last ones had to wait somewhere


@dataclass(slots=True)
class Round:
    """The sums of one round trip."""

    began_s: float
    delivered: int = 0  # bytes
    lost: int = 0  # bytes
    rate: float = 0.0  # the highest measured, bytes/s
    rtt_s: float | None = None  # the lowest of this round
    limited: bool = True  # there was too little to send to see the rate

    @property
    def loss(self) -> float:
        """The share that was lost."""
        return self.lost / (self.lost + self.delivered) if self.lost else 0.0


class Delivery:
    """Measures a link by what it delivers.

    The rate is measured as BBR does (draft-ietf-ccwg-bbr): what arrived from the time on when a
    packet left until it was acknowledged, over the longer of the times that sending and arriving
    took. `spread` is the rate that the distances of the last few packets show.
    """

    def __init__(self, packet_bytes: int, rate: float, rtt_s: float | None) -> None:
        self.rate = rate  # of the link, bytes/s; 0: not known
        self.srtt_s = self.min_rtt_s = rtt_s  # smoothed; the lowest of late
        self.rttvar_s = rtt_s / 8 if rtt_s else 0.0  # mean deviation from `srtt_s`
        self.spread = 0.0
        self.total = 0  # bytes that arrived
        self.base_loss = 0.0  # the share of packets that is lost without our doing
        self.base_known = False  # `base_loss` was measured
        self.round = Round(0.0)
        self._packet = packet_bytes  # bytes of a full packet
        self._floor_rtt_s: float | None = None  # the lowest of all
        self._min_rtt_at_s: float | None = None  # None for a remembered value
        self._total_s = self._first_s = 0.0  # of the newest arrival, of its sending
        self._limited_until = -1  # a total: earlier arrivals were limited by the sender
        self._peaks: deque[tuple[int, float]] = deque([(0, rate)] if rate else [])  # round, rate
        self._rounds = 0  # that were not limited
        self._round_ends = 0  # when this much has arrived
        self._marks: deque[tuple[float, float, int, int]] = deque()  # arrived, sent, total, missing
        self._group_rtt_s: float | None = None  # the lowest since the last train
        self._missing = 0  # bytes lost
        self._low_lost = self._low_arrived = 0  # packets in the phase LOW

    def sent(self, size: int, now_s: float, *, idle: bool, low: bool) -> Stamp:
        """A packet leaves; `idle`: nothing else is under way."""
        if idle:
            self._first_s = self._total_s = now_s
            self._marks.clear()
        limited = self.total <= self._limited_until
        return Stamp(size, now_s, self.total, self._total_s, self._first_s, limited, low)

    def limited(self, in_flight: int) -> None:
        """There is nothing to send: the next arrivals do not measure the link."""
        if self.total or in_flight:
            self._limited_until = self.total + in_flight

    def lost(self, stamp: Stamp) -> None:
        """A packet did not arrive."""
        self.round.lost += stamp.size
        self._missing += stamp.size
        if stamp.low:
            self._low_lost += 1

    def arrived(self, stamps: list[Stamp], rtt_s: float | None, now_s: float) -> Train | None:
        """Packets arrived, the newest is the last one. A train, if enough came for one."""
        now_s = max(now_s, self._total_s)
        if rtt_s is not None:
            self._round_trip(max(rtt_s, MIN_RTT_S), now_s)
        size = 0
        for stamp in stamps:
            size += stamp.size
            if stamp.low:
                self._low_arrived += 1
        self.total += size
        self._total_s = now_s
        self.round.delivered += size
        newest = stamps[-1]
        self._first_s = newest.sent_s
        self._measure(newest, now_s)
        return self._measure_train(newest, now_s)

    def resume(self, now_s: float) -> None:
        """Nothing came for a long time: measure anew."""
        self._limited_until = -1
        self._marks.clear()
        self.next_round(now_s)

    def _round_trip(self, rtt_s: float, now_s: float) -> None:
        if self.srtt_s is None:
            self.srtt_s, self.rttvar_s = rtt_s, rtt_s / 2
        else:
            self.rttvar_s += (abs(rtt_s - self.srtt_s) - self.rttvar_s) / 4
            self.srtt_s += (rtt_s - self.srtt_s) / 8
        if self.round.rtt_s is None or rtt_s < self.round.rtt_s:
            self.round.rtt_s = rtt_s
        if self._group_rtt_s is None or rtt_s < self._group_rtt_s:
            self._group_rtt_s = rtt_s
        at_s, low_s = self._min_rtt_at_s, self.min_rtt_s
        if low_s is None or at_s is None or rtt_s <= low_s or now_s > at_s + RTT_WINDOW_S:
            self.min_rtt_s = rtt_s
            self._min_rtt_at_s = now_s
        if self._floor_rtt_s is None or rtt_s < self._floor_rtt_s:
            self._floor_rtt_s = rtt_s

    def _measure(self, newest: Stamp, now_s: float) -> None:
        taken_s = max(newest.sent_s - newest.first_s, now_s - newest.delivered_s)
        if self.min_rtt_s is None or taken_s < self.min_rtt_s * 0.9 or taken_s <= 0:
            return
        rate = min((self.total - newest.delivered) / taken_s, MAX_RATE)
        if not newest.limited:
            self.round.limited = False
        elif rate <= self.rate:
            return
        self.round.rate = max(self.round.rate, rate)
        if rate > self.rate:
            self._peak(rate)

    def _peak(self, rate: float) -> None:
        peaks = self._peaks
        while peaks and peaks[-1][1] <= rate:
            peaks.pop()
        peaks.append((self._rounds, rate))
        while peaks[0][0] <= self._rounds - PEAK_ROUNDS:
            peaks.popleft()
        self.rate = peaks[0][1]

    def replace(self, rate: float) -> None:
        """The link is full, so what it delivers is its rate, whatever it was before."""
        self._peaks.clear()
        self._peak(min(rate, MAX_RATE))

    def _measure_train(self, newest: Stamp, now_s: float) -> Train | None:
        marks = self._marks
        if not marks:
            marks.append((now_s, newest.sent_s, self.total, self._missing))
            return None
        last_s, _, before, _ = marks[-1]
        if self.total - before < GROUP_PACKETS * self._packet or now_s <= last_s:
            return None
        self.spread = min((self.total - before) / (now_s - last_s), MAX_RATE)
        marks.append((now_s, newest.sent_s, self.total, self._missing))
        while len(marks) > 2 and now_s - marks[1][0] >= TRAIN_S:
            marks.popleft()
        began_s, sent_s, before, missing = marks[0]
        size, lost, taken_s = self.total - before, self._missing - missing, now_s - began_s
        stretched = taken_s > STRETCHED * (newest.sent_s - sent_s) + STRETCHED_S
        if stretched:
            marks.clear()
        risen = self.risen(self._group_rtt_s)
        self._group_rtt_s = None
        return Train(size / taken_s, stretched, lost / (lost + size), risen)

    def risen(self, rtt_s: float | None) -> bool:
        """Whether packets with this round trip waited somewhere, be it for a moment only."""
        if rtt_s is None or self._floor_rtt_s is None or not self.rate:
            return False
        return rtt_s > self._floor_rtt_s + max(RISEN_S, RISEN_PACKETS * self._packet / self.rate)

    def queue_stands(self) -> bool:
        """Whether all packets of this round waited for long."""
        low_s, rtt_s = self.min_rtt_s, self.round.rtt_s
        if low_s is None or rtt_s is None or not self.rate:
            return False
        return rtt_s - low_s > max(low_s / 4, STANDS_S, STANDS_PACKETS * self._packet / self.rate)

    def accept_rtt(self) -> None:
        """Sending less did not shorten the round trip, so it is no queue of ours."""
        self.min_rtt_s = self.round.rtt_s

    # --- rounds

    def round_over(self, newest: Stamp, now_s: float) -> bool:
        """Whether what was sent after the last round began has arrived."""
        return newest.delivered >= self._round_ends and now_s >= self.round.began_s + ROUND_S

    def close_round(self) -> None:
        """The rates and losses of the round count from now on."""
        low = self._low_lost + self._low_arrived
        if self.risen(self.round.rtt_s):
            self._low_lost = self._low_arrived = 0
        elif low >= LOW_PACKETS:
            share = self._low_lost / low
            self.base_loss += (share - self.base_loss) / (3 if self.base_known else 1)
            self.base_known = True
            self._low_lost = self._low_arrived = 0
        if not self.round.limited:
            self._rounds += 1
            if self.round.rate:
                self._peak(self.round.rate)

    def next_round(self, now_s: float) -> None:
        """A round begins."""
        self.round = Round(now_s)
        self._round_ends = self.total
