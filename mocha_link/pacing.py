"""How fast to send: a model of the link, made from what arrives and when. No clock here.

The model is that of BBR (draft-ietf-ccwg-bbr): the highest delivery rate of the last rounds and the
lowest round-trip time say how much the link holds. Single losses say nothing, as radios lose
packets without being full. A queue that stands or losses that come with more sending say that the
link is full; then what is delivered at that moment is its rate, however fast it was before.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum, auto

START_PACKETS = 10  # in the first flight to an unknown link
START_RATE = 1_250_000.0  # bytes/s at which that flight leaves
UNKNOWN_RTT_S = 0.2
ROUND_S = 0.02  # a round is at least so long, however short the way
PEAK_ROUNDS = 10  # the delivery rate is the highest of so many rounds
RTT_WINDOW_S = 10.0
BURST_S = 0.01  # sending that was missed by a late call and may be caught up at once
AHEAD_S = 0.001  # a packet may leave so much early: fewer wake-ups
MIN_PACKETS = 4
MAX_RATE = 125e6
LOSS_PACKETS = 64  # a share of losses is taken from at least so many
LOSS_BINS = 6
MAX_LOSS = 0.3
TRAIN_PACKETS = 5  # their distances show the rate of the link, if they left close together
TRAIN_S = 0.05  # the distances are added up over this time, if packets are not fewer
STRETCHED = 1.5  # so much longer for the same packets, coming than going, means a full link
STRETCHED_S = 0.01
START_LOSS = 0.1  # so many losses together with a risen round-trip time end the fast start
FIRST = START_PACKETS + 1  # the packets that leave close together, and one
UP_LOSS = 0.05  # so many more than without a queue end the probing
RISEN_S = 0.005
MAX_LEAP = 16  # times as much in the next round, at most, because of distances alone


class Phase(Enum):
    """What the controller is doing."""

    START = auto()  # an unknown link: as much more every round as it takes
    CRUISE = auto()  # at the rate of the link
    UP = auto()  # a little more, to see if the link has become faster
    DOWN = auto()  # a little less, until what was too much has left the queue


@dataclass(slots=True)
class Stamp:
    """What was known when a packet left; it comes back with its acknowledgement."""

    size: int
    sent_s: float
    delivered: int
    delivered_s: float
    first_s: float
    limited: bool


class Pacing:
    """Says when the next packet may leave, and learns from every acknowledgement.

    rate_bytes_s, rtt_s: what the last contact over this link showed, if there was one.
    """

    def __init__(
        self, packet_bytes: int, *, rate_bytes_s: float | None = None, rtt_s: float | None = None
    ) -> None:
        self.srtt_s: float | None = rtt_s
        self.rttvar_s = 0.0 if rtt_s is None else rtt_s / 8
        self.min_rtt_s: float | None = rtt_s
        self.phase = Phase.START
        self.next_s = 0.0
        self._packet = packet_bytes
        self._min_rtt_at_s: float | None = None
        self._delivered = 0
        self._delivered_s = 0.0
        self._first_s = 0.0
        self._limited_until = -1
        self._peaks: deque[tuple[int, float]] = deque()
        self._round = 0
        self._round_ends = 0  # when this much is delivered
        self._round_s = 0.0
        self._round_rtt_s: float | None = None
        self._round_rate = 0.0
        self._round_limited = True
        self._round_lost = 0
        self._round_delivered = 0
        self._since = 0  # rounds in this phase
        self._still = 0  # rounds without growth, at the start
        self._before = 0.0  # the rate before this round, or before the phase
        self._train: deque[tuple[float, float, int, int]] = deque()
        self._spread = 0.0
        self._group_rtt_s: float | None = None
        self._missing = 0
        self._burst = START_PACKETS  # leave close together: their distances show the rate
        self._began = 0  # what had been delivered before this contact
        self._burst_s = 0.0
        self._trusted: int | None = None if rate_bytes_s is None else 0
        self._lost = self._arrived = 0
        self._losses: deque[float] = deque(maxlen=LOSS_BINS)
        self._full = False
        self.rate = 0.0
        if rate_bytes_s is not None:
            self.rate = min(max(rate_bytes_s, 1.0), MAX_RATE)
            self._peaks.append((0, self.rate))
            self._enter(Phase.CRUISE)
        self._set()

    # --- what the sender asks

    def room(self, in_flight: int) -> bool:
        """Whether the link holds another packet."""
        return in_flight + self._packet <= self.cap_bytes

    def due(self, now_s: float) -> bool:
        """Whether a packet may leave now."""
        return self.gate_s <= now_s + AHEAD_S

    @property
    def gate_s(self) -> float:
        """When the next packet may leave."""
        return min(self._burst_s, self.next_s) if self._burst else self.next_s

    def sent(self, size: int, now_s: float, in_flight: int) -> Stamp:
        """A packet leaves."""
        if in_flight == 0:
            self._first_s = self._delivered_s = now_s
            self._train.clear()
        self.next_s = max(self.next_s, now_s - BURST_S) + size / self.pace
        if self._burst:
            self._burst -= 1
            self._burst_s = now_s + size / START_RATE
        return Stamp(
            size,
            now_s,
            self._delivered,
            self._delivered_s,
            self._first_s,
            self._delivered < self._limited_until,
        )

    def idle(self, in_flight: int) -> None:
        """There was nothing to send: what is delivered next says little about the link."""
        self._limited_until = self._delivered + in_flight

    def resume(self, now_s: float) -> None:
        """The link is back after a gap: start again from what it was."""
        self.next_s = now_s
        self._limited_until = -1
        self._burst, self._burst_s = START_PACKETS, now_s
        self._began = self._delivered
        self._round_ends = self._delivered
        self._train.clear()
        self._clear_round(now_s)
        self._full = False
        if self.phase is not Phase.START:
            self._enter(Phase.CRUISE)
        self._set()

    # --- what the acknowledgements say

    def arrived(
        self, stamps: list[Stamp], rtt_s: float | None, lost: int, now_s: float, in_flight: int
    ) -> None:
        """Packets were acknowledged (the newest is the last one), `lost` bytes are missing."""
        self._round_lost += lost
        self._missing += lost
        if rtt_s is not None:
            self._rtt(rtt_s, now_s)
        if not stamps:
            return
        self._burst = 0
        size = 0
        for stamp in stamps:
            size += stamp.size
        self._delivered += size
        self._delivered_s = now_s
        self._round_delivered += size
        newest = stamps[-1]
        self._first_s = newest.sent_s
        self._measure(newest, now_s)
        self._watch_train(newest, now_s)
        if newest.delivered >= self._round_ends and now_s >= self._round_s + ROUND_S:
            self._end_round(newest, now_s, in_flight)
        elif self.phase is Phase.DOWN and in_flight <= self._held():
            self._enter(Phase.CRUISE)
        self._set()

    def _rtt(self, rtt_s: float, now_s: float) -> None:
        if self.srtt_s is None:
            self.srtt_s, self.rttvar_s = rtt_s, rtt_s / 2
        else:
            self.rttvar_s += (abs(rtt_s - self.srtt_s) - self.rttvar_s) / 4
            self.srtt_s += (rtt_s - self.srtt_s) / 8
        if self._round_rtt_s is None or rtt_s < self._round_rtt_s:
            self._round_rtt_s = rtt_s
        if self._group_rtt_s is None or rtt_s < self._group_rtt_s:
            self._group_rtt_s = rtt_s
        at_s = self._min_rtt_at_s  # what is remembered has none: the first sample replaces it
        low = self.min_rtt_s
        if low is None or at_s is None or rtt_s <= low or now_s > at_s + RTT_WINDOW_S:
            self.min_rtt_s = rtt_s
            self._min_rtt_at_s = now_s

    def _measure(self, newest: Stamp, now_s: float) -> None:
        taken_s = max(newest.sent_s - newest.first_s, now_s - newest.delivered_s)
        if self.min_rtt_s is None or taken_s < self.min_rtt_s * 0.9 or taken_s <= 0:
            return
        rate = min((self._delivered - newest.delivered) / taken_s, MAX_RATE)
        if not newest.limited:
            self._round_limited = False
        elif rate <= self.rate:
            return
        if rate > self._round_rate:
            self._round_rate = rate
            if rate > self.rate:
                self._peak(rate)

    def _watch_train(self, newest: Stamp, now_s: float) -> None:
        """See by the distances of the last packets what the link does with them."""
        train = self._train
        if not train:
            train.append((now_s, newest.sent_s, self._delivered, self._missing))
            return
        last_s, _, before, _ = train[-1]
        if self._delivered - before < TRAIN_PACKETS * self._packet or now_s <= last_s:
            return
        self._spread = min((self._delivered - before) / (now_s - last_s), MAX_RATE)
        train.append((now_s, newest.sent_s, self._delivered, self._missing))
        while len(train) > 2 and now_s - train[1][0] >= TRAIN_S:
            train.popleft()
        began_s, sent_s, before, missing = train[0]
        taken_s = now_s - began_s
        size = self._delivered - before
        full = taken_s > STRETCHED * (newest.sent_s - sent_s) + STRETCHED_S
        lost = self._missing - missing
        if not full and self.phase is Phase.START:  # a short queue drops instead
            full = lost > START_LOSS * (lost + size) and self._risen(self._group_rtt_s)
        self._group_rtt_s = None
        if self.phase is Phase.CRUISE and self._delivered < self._began + FIRST * self._packet:
            if self._spread > 2 * self.rate:  # much faster than in the last contact
                self._enter(Phase.START)
            elif self._spread > 1.2 * self.rate:
                self._enter(Phase.UP)
        if self.phase is Phase.UP and lost > (UP_LOSS + self.base_loss) * (lost + size):
            self._enter(Phase.DOWN)
        if full:
            train.clear()
            self._bottleneck(size / taken_s)

    def _risen(self, rtt_s: float | None) -> bool:
        """Whether packets wait somewhere, be it for a moment only."""
        if rtt_s is None or self.min_rtt_s is None:
            return False
        return rtt_s > self.min_rtt_s + max(RISEN_S, 3 * self._packet / self.rate)

    def _bottleneck(self, rate: float) -> None:
        """What we send leaves the link more slowly than it enters: now its rate is known."""
        self._peaks.clear()
        self._peak(min(rate, MAX_RATE))
        if self.phase is not Phase.DOWN:
            self._enter(Phase.DOWN)

    def _peak(self, rate: float) -> None:
        peaks = self._peaks
        while peaks and peaks[-1][1] <= rate:
            peaks.pop()
        peaks.append((self._round, rate))
        self.rate = peaks[0][1]

    # --- rounds and phases

    def _clear_round(self, now_s: float) -> None:
        self._round_s = now_s
        self._round_rtt_s = None
        self._round_rate = 0.0
        self._round_limited = True
        self._round_lost = self._round_delivered = 0

    def _end_round(self, newest: Stamp, now_s: float, in_flight: int) -> None:
        if not self._risen(self._round_rtt_s):
            self._lost += self._round_lost
            self._arrived += self._round_delivered
            if self._lost + self._arrived >= LOSS_PACKETS * self._packet:
                self._losses.append(self._lost / (self._lost + self._arrived))
                self._lost = self._arrived = 0
        rate, limited = self._round_rate, self._round_limited
        if not limited:
            self._round += 1
            if rate:
                self._peak(rate)
            while len(self._peaks) > 1 and self._peaks[0][0] <= self._round - PEAK_ROUNDS:
                self._peaks.popleft()
            self.rate = self._peaks[0][1] if self._peaks else self.rate
            self._since += 1
            if newest.delivered > self._began:
                self._trusted = None
            self._judge(rate, in_flight)
        self._round_ends = self._delivered
        self._clear_round(now_s)

    def _queue_stands(self) -> bool:
        low = self.min_rtt_s
        if low is None or self._round_rtt_s is None:
            return False
        slack_s = max(low / 4, 0.03, 4 * self._packet / self.rate if self.rate else 0.0)
        return self._round_rtt_s - low > slack_s

    def _judge(self, rate: float, in_flight: int) -> None:  # noqa: C901 - a table of phases
        total = self._round_lost + self._round_delivered
        excess = self._round_lost / total - self.base_loss if total else 0.0
        if rate and (self._queue_stands() or (excess > 0.05 and self._risen(self._round_rtt_s))):
            if self.phase is Phase.DOWN and self._since >= 4:  # sending less did not help
                self.min_rtt_s = self._round_rtt_s
                self._enter(Phase.CRUISE)
                return
            self._peaks.clear()
            self._peak(rate)
            self._full = True
            if self.phase is not Phase.DOWN:
                self._enter(Phase.DOWN)
            return
        self._full = False
        if self.phase is Phase.START:
            self._still = self._still + 1 if self.rate < self._before * 1.25 else 0
            if self._still >= 2 or (self._still and excess > 0.1):
                self._enter(Phase.DOWN)
            self._before = self.rate
        elif self.phase is Phase.UP:
            if self.rate > self._before * 1.1 and excess < 0.05:
                self._before = self.rate  # it takes more: go on, and soon faster
                self._still += 1
                if self._still >= 2:
                    self._enter(Phase.START)
            elif self._since >= 2 or excess > 0.05:
                self._enter(Phase.DOWN)
        elif self.phase is Phase.DOWN:
            if self._since >= 2 or in_flight <= self._held():
                self._enter(Phase.CRUISE)
        elif self._since >= 6:
            self._enter(Phase.UP)

    def _enter(self, phase: Phase) -> None:
        self.phase = phase
        self._since = 0
        self._still = 0
        self._before = self.rate

    @property
    def base_loss(self) -> float:
        """The share of packets that is lost without any queue."""
        return min(*self._losses, MAX_LOSS) if len(self._losses) > 1 else 0.0

    def _held(self) -> float:
        """How much the link holds without a queue, in bytes."""
        return self.rate * (self.min_rtt_s or UNKNOWN_RTT_S) + 2 * self._packet

    def _set(self) -> None:
        if not self.rate:
            self.pace = START_RATE
            self.cap_bytes = START_PACKETS * self._packet
            return
        gain, cap = _GAINS[self.phase]
        held = self.rate * (self.min_rtt_s or UNKNOWN_RTT_S)
        if self.phase is Phase.UP:
            packets = max(held / self._packet, 1.0)
            gain = 1 + min(max(8.0, 2 * packets**0.5) / packets, 0.5)
        elif self.phase is Phase.START:
            gain = max(gain, min(self._spread / self.rate, MAX_LEAP))
            cap = 1.2 * gain
        pace = gain * self.rate / (1 - self.base_loss) ** 0.75
        if self._full:
            cap = 1.0
        slack = max(MIN_PACKETS * self._packet, self.rate * 0.03)
        self.pace = max(pace, self._packet / 2)
        self.cap_bytes = int(cap * held + slack)
        if self._trusted is not None:  # until a round has shown that what is remembered holds
            self._trusted = self._trusted or self.cap_bytes
            self.cap_bytes = min(
                self.cap_bytes, self._trusted + 2 * (self._delivered - self._began)
            )


_GAINS = {
    Phase.START: (2.5, 3.0),
    Phase.CRUISE: (1.0, 2.0),
    Phase.UP: (1.2, 2.0),
    Phase.DOWN: (0.8, 1.0),
}
