"""Pacing of datagrams: the first window of a contact, or all of it where TCP stalls.

A small subset of BBR (draft-ietf-ccwg-bbr). Packets are sent at the highest recent delivery rate,
with little more than the bandwidth-delay product in flight. Single losses are ignored, as radios
lose packets without congestion. A standing queue shows congestion; the delivery rate at that moment
is the rate of the link. Unlike BBR, the dispersion of the first packets gives the rate at once.
Bulk data is left to TCP. No clock here. docs/evidence/goals.md has the measured benefit of each
part.
"""

from __future__ import annotations

from dataclasses import dataclass

START_PACKETS = 12  # the initial burst of a contact, whose dispersion gives the rate
START_RATE = 1_250_000.0  # bytes/s of the initial burst
UNKNOWN_RTT_S = 0.2
BURST_S = 0.01  # the pacing delay that may be caught up at once after a late call
AHEAD_S = 0.001  # a packet may be sent this early: fewer wake-ups
SLACK_PACKETS = 4  # in flight beyond the bandwidth-delay product, for late acknowledgements
TRUSTED_BYTES = 512 * 1024  # limit in flight, plus twice the bytes delivered so far
MAX_RATE = 125e6
RTT_WINDOW_S = 10.0  # the window of the lowest round trip
ROUND_S = 0.02  # the minimum duration of a round
KEPT = 0.99  # factor on the rate after a round that delivered less
START_GAIN, PROBE_GAIN, DRAIN_GAIN = 2.9, 1.05, 0.75  # pacing gains: fast start, steady, draining
START_HOLDS, PROBE_HOLDS, DRAIN_HOLDS = 3.5, 1.5, 1.0  # in-flight gains, likewise
GROWTH = 1.25  # the fast start ends after two rounds with a smaller growth of the rate
SPREAD_PACKETS = 6  # the minimum number of packets for an estimate from dispersion
BURST_OVER_S = 0.05  # packets sent over a longer time give no estimate
STRETCHED, STRETCHED_S = 1.5, 0.01  # a burst that arrives this much dispersed has filled the link
STANDS_S, STANDS_PACKETS = 0.03, 2  # a round trip longer by this much for a whole round: a queue
DRAIN_ROUNDS = 3  # a queue that lasts longer is not ours


@dataclass(frozen=True, slots=True)
class Stamp:
    """The state when a packet was sent, for measurements when it is acknowledged."""

    size: int  # bytes
    sent_s: float  # when it was sent
    delivered: int  # bytes delivered by then
    delivered_s: float  # when the last of these were delivered


@dataclass(slots=True)
class RoundTrip:
    """The round-trip time of a link, from samples."""

    smoothed_s: float | None = None
    deviation_s: float = 0.0  # mean deviation from the smoothed one
    min_s: float | None = None  # the lowest recent one
    _min_at_s: float | None = None  # when that was measured; None: in an earlier contact

    def add(self, rtt_s: float, now_s: float) -> None:
        """Add a sample."""
        if self.smoothed_s is None:
            self.smoothed_s, self.deviation_s = rtt_s, rtt_s / 2
        else:
            self.deviation_s += (abs(rtt_s - self.smoothed_s) - self.deviation_s) / 4
            self.smoothed_s += (rtt_s - self.smoothed_s) / 8
        at_s = self._min_at_s
        if self.min_s is None or at_s is None or rtt_s <= self.min_s or now_s > at_s + RTT_WINDOW_S:
            self.min_s, self._min_at_s = rtt_s, now_s


@dataclass(slots=True)
class Round:
    """What was measured in one round trip."""

    ends: int = 0  # when a packet arrives that was sent after this many bytes were delivered
    began_s: float = 0.0
    rate: float = 0.0  # the highest, bytes/s
    rtt_s: float | None = None  # the lowest
    limited: bool = False  # application-limited: there was too little to send to measure the rate

    def queue_stands(self, least_rtt_s: float, packet_bytes: int) -> bool:
        """Whether every packet of the round waited in a queue."""
        if self.rtt_s is None or not self.rate:
            return False
        least_s = max(least_rtt_s / 4, STANDS_S, STANDS_PACKETS * packet_bytes / self.rate)
        return self.rtt_s - least_rtt_s > least_s


class Pacing:
    """Schedules the packets, and updates its estimates with every acknowledgement.

    rate_bytes_s, rtt_s: measured in the last contact over this link; None: not known.

    Attributes:
        packet_bytes: the size of a full packet.
        rtt: the round-trip time.
        rate_estimated: the first packets of the contact have been used to estimate the rate.
    """

    def __init__(
        self, packet_bytes: int, *, rate_bytes_s: float | None = None, rtt_s: float | None = None
    ) -> None:
        self.packet_bytes = packet_bytes
        self.rtt = RoundTrip(rtt_s, rtt_s / 8 if rtt_s else 0.0, rtt_s)
        self.rate_estimated = False
        self._rate = min(max(rate_bytes_s, 1.0), MAX_RATE) if rate_bytes_s else 0.0  # 0: not known
        self._known = self._rate > 0.0  # enough was sent to measure the rate
        self._delivered = 0  # bytes delivered
        self._delivered_s = 0.0  # when the newest of them were delivered
        self._round = Round()
        self._start_rounds = 0 if self._known else 2  # rounds of fast start left without growth
        self._start_rate = self._rate  # at the end of the last round of the fast start
        self._full_rounds = 0  # consecutive rounds with a standing queue
        self._burst = START_PACKETS  # packets of the initial burst still to send
        self._last = Stamp(0, 0.0, 0, 0.0)  # of the last packet
        self._owed = 0.0  # bytes sent ahead of the pace at the last packet; negative: behind it
        # The first acknowledgement: its arrival, when the packet was sent, bytes delivered then.
        self._spread: tuple[float, float, int] | None = None

    @property
    def rate_bytes_s(self) -> float | None:
        """The rate of the link; None: too little was sent to measure it."""
        return self._rate if self._known else None

    # --- limits of the sender

    @property
    def _gains(self) -> tuple[float, float]:
        """The pacing gain, and the gain on the bandwidth-delay product in flight."""
        if self._start_rounds:
            return START_GAIN, START_HOLDS
        return (DRAIN_GAIN, DRAIN_HOLDS) if self._full_rounds else (PROBE_GAIN, PROBE_HOLDS)

    @property
    def pace(self) -> float:
        """The pacing rate in bytes/s."""
        return max(self._gains[0] * self._rate, self.packet_bytes / 2) if self._rate else START_RATE

    @property
    def due_s(self) -> float:
        """When the next packet may be sent."""
        wait_s = max(self._owed, 0.0) / self.pace
        if self._burst:
            wait_s = min(wait_s, self._last.size / START_RATE)
        return self._last.sent_s + wait_s

    @property
    def cap_bytes(self) -> int:
        """The limit on bytes in flight."""
        if not self._rate:
            return START_PACKETS * self.packet_bytes
        holds = self._gains[1] * self._rate * (self.rtt.min_s or UNKNOWN_RTT_S)
        holds += SLACK_PACKETS * self.packet_bytes
        return int(min(holds, TRUSTED_BYTES + 2 * self._delivered))

    def room(self, in_flight: int) -> bool:
        """Whether another packet may be in flight."""
        return in_flight + self.packet_bytes <= self.cap_bytes

    def sent(self, size: int, now_s: float, in_flight: int) -> Stamp:
        """Note that a packet is sent; returns its stamp."""
        pace = self.pace
        idle_s = now_s - self._last.sent_s
        self._owed = max(self._owed - idle_s * pace, -BURST_S * pace) + size
        self._burst = max(self._burst - 1, 0)
        if in_flight == 0:
            self._delivered_s = now_s
        self._last = Stamp(size, now_s, self._delivered, self._delivered_s)
        return self._last

    def limited(self) -> None:
        """Note that there is nothing to send: this round does not measure the rate."""
        self._round.limited = True

    def resume(self, now_s: float) -> None:
        """Restart with the last estimates: a contact begins, or the link is back after a gap."""
        self._round = Round(self._delivered, now_s)
        self._burst, self._owed = START_PACKETS, 0.0
        self._spread, self.rate_estimated = None, False
        self._full_rounds = 0

    # --- acknowledgements

    def arrived(self, stamps: list[Stamp], rtt_s: float | None, now_s: float) -> None:
        """Process an acknowledgement of packets; the last one arrived at about `now_s`.

        Neither `now_s` nor `rtt_s` includes the delay of the peer before its acknowledgement.
        """
        now_s = max(now_s, self._delivered_s)
        round_, newest = self._round, stamps[-1]
        self._delivered += sum(stamp.size for stamp in stamps)
        self._delivered_s = now_s
        self._burst = 0
        if rtt_s is not None:
            self.rtt.add(rtt_s, now_s)
            round_.rtt_s = min(rtt_s, round_.rtt_s or rtt_s)
        taken_s = now_s - newest.delivered_s
        if taken_s > 0 and taken_s >= 0.9 * (self.rtt.min_s or 0.0):
            rate = min((self._delivered - newest.delivered) / taken_s, MAX_RATE)
            round_.rate = max(round_.rate, rate)
            self._rate = max(self._rate, rate)
        self._judge_spread(newest, now_s)
        if newest.delivered >= round_.ends and now_s >= round_.began_s + ROUND_S:
            self._round = Round(self._delivered, now_s)
            if not round_.limited:
                self._learn(round_)

    def _judge_spread(self, newest: Stamp, now_s: float) -> None:
        """Estimate the rate from the dispersion of the first packets."""
        if self._spread is None:
            self._spread = now_s, newest.sent_s, self._delivered
        first_arrived_s, first_sent_s, before = self._spread
        size = self._delivered - before
        if (
            self.rate_estimated
            or size < SPREAD_PACKETS * self.packet_bytes
            or now_s <= first_arrived_s
        ):
            return
        self.rate_estimated = True
        if newest.sent_s - first_sent_s > BURST_OVER_S:
            return
        rate = min(size / (now_s - first_arrived_s), MAX_RATE)
        if now_s - first_arrived_s > STRETCHED * (newest.sent_s - first_sent_s) + STRETCHED_S:
            # They arrived more slowly than they were sent: the link is the bottleneck.
            self._rate, self._known, self._start_rounds = rate, True, 0
        elif rate > 2 * self._rate:  # the sending rate limited the burst: only a lower bound
            self._rate = max(self._rate, min(rate, START_RATE) / START_GAIN)
            self._start_rounds = 2

    def _learn(self, round_: Round) -> None:
        """Update the rate after a round with enough to send."""
        self._known = self._known or self._delivered >= SPREAD_PACKETS * self.packet_bytes
        queued = round_.queue_stands(self.rtt.min_s or 0.0, self.packet_bytes)
        self._full_rounds = self._full_rounds + 1 if queued else 0
        if self._start_rounds:
            grew = self._rate > GROWTH * self._start_rate
            self._start_rounds = 0 if queued else 2 if grew else self._start_rounds - 1
            self._start_rate = self._rate
        if self._full_rounds > DRAIN_ROUNDS:  # not our queue: the path has become longer
            self.rtt.min_s, self._full_rounds, self._start_rounds = round_.rtt_s, 0, 2
        elif self._full_rounds:
            self._rate = round_.rate  # the delivery rate with a queue is our share of the link
        else:
            self._rate = max(round_.rate, KEPT * self._rate)
