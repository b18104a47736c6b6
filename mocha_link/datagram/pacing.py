"""How fast datagrams leave: the first window of a contact, or all of it where TCP stalls.

After BBR (draft-ietf-ccwg-bbr), and no more of it than that takes: the rate is the highest delivery
rate of ten rounds, and not much more is under way than the link holds. Single losses carry no
information, as radios lose packets without being full. A queue that stands shows that the link is
full; then what it delivers at that moment is its rate. Unlike BBR, the distances of the first
packets let a fast start leap. Bulk is left to TCP. No clock here.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

START_PACKETS = 12  # leave close together when a contact begins: their distances show the rate
START_RATE = 1_250_000.0  # bytes/s at which they leave
UNKNOWN_RTT_S = 0.2
BURST_S = 0.01  # sending that was missed by a late call and may be caught up at once
AHEAD_S = 0.001  # a packet may leave so much early: fewer wake-ups
MIN_PACKETS = 4  # under way, however little the link holds
SLACK_S = 0.03  # and what it takes in this time, as acknowledgements may be late
MAX_RATE = 125e6
MIN_RTT_S = 1e-4
RTT_WINDOW_S = 10.0  # the lowest round trip of so long
PEAK_ROUNDS = 10  # the rate of the link is the highest of so many rounds
ROUND_S = 0.02  # a round is at least so long, however short the way
START_GAIN = 2.9
MAX_LEAP = 16  # times as much in the next round, at most, because of distances alone
SPREAD_PACKETS = 6  # whose distances show a rate
BURST_OVER_S = 0.05  # packets that left farther apart show nothing
STRETCHED, STRETCHED_S = 1.5, 0.01  # so much later than they left they have come out of a full link
MUCH = 2.0  # times another rate than the remembered one
TRUSTED_BYTES = 512 * 1024  # of a remembered window at most
GROWTH = 1.25  # a round with less growth is none, in a fast start
STILL_ROUNDS = 2
START_LOSS = 0.1  # with so much of it a link that does not grow is full
GAINS = (1.25, 0.75, 1.0, 1.0, 1.0, 1.0)  # of the rate in the rounds of a cycle
HOLDS = 1.5  # times what the link holds may be under way
STANDS_S, STANDS_PACKETS = 0.03, 4  # a round trip that is so much longer throughout is a queue
DRAIN_ROUNDS = 3  # a queue that lasts longer though little is under way is not ours


@dataclass(slots=True)
class Stamp:
    """What was known when a packet left; it comes back when the packet has arrived or is lost."""

    size: int  # bytes
    sent_s: float  # when it left
    delivered: int  # bytes that had arrived by then
    delivered_s: float  # when the last of these arrived
    first_s: float  # when the packet left that arrived last
    limited: bool  # the sender had less to send than the link takes


@dataclass(slots=True)
class RoundTrip:
    """The round trip of a link, from its samples."""

    smoothed_s: float | None = None
    deviation_s: float = 0.0  # mean deviation from the smoothed one
    min_s: float | None = None  # the lowest of late
    _min_at_s: float | None = None  # when that was measured; None: it is only remembered

    def add(self, rtt_s: float, now_s: float) -> None:
        """Take in a sample."""
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
    """The sums of one round trip."""

    ends: int = 0  # when this much has arrived
    began_s: float = 0.0
    delivered: int = 0  # bytes
    lost: int = 0  # bytes
    rate: float = 0.0  # the highest measured, bytes/s
    rtt_s: float | None = None  # the lowest of this round
    limited: bool = True  # there was too little to send to see the rate

    @property
    def loss(self) -> float:
        """The share that was lost."""
        return self.lost / (self.lost + self.delivered) if self.lost else 0.0


@dataclass(slots=True)
class Delivery:
    """What arrives: the rate of a link, bytes/s."""

    rate: float = 0.0  # 0: not known
    before: float = 0.0  # the same when the last round ended
    total: int = 0  # bytes that arrived
    total_s: float = 0.0  # when the newest of them did
    first_s: float = 0.0  # when that was sent
    limited_until: int = -1  # a total: earlier arrivals were limited by the sender
    rounds: int = 0  # that were not limited
    peaks: deque[tuple[int, float]] = field(default_factory=deque)  # round, rate

    def peak(self, rate: float) -> None:
        """A rate was measured."""
        peaks = self.peaks
        while peaks and peaks[-1][1] <= rate:
            peaks.pop()
        peaks.append((self.rounds, rate))
        while peaks[0][0] <= self.rounds - PEAK_ROUNDS:
            peaks.popleft()
        self.rate = peaks[0][1]

    def replace(self, rate: float) -> None:
        """The link is full, so what it delivers is its rate, whatever it was before."""
        self.peaks.clear()
        self.peak(rate)


class Pacing:
    """Says when the next packet may leave, and learns from every acknowledgement.

    rate_bytes_s, rtt_s: what the last contact over this link showed, if there was one.

    Attributes:
        rtt: the round trip.
        proven: there was enough to send to see the rate.
        judged: the first packets have shown whether the link is slower than they left.
        pace: bytes/s at which packets leave.
        cap_bytes: most that is under way.
    """

    def __init__(
        self, packet_bytes: int, *, rate_bytes_s: float | None = None, rtt_s: float | None = None
    ) -> None:
        rate = min(max(rate_bytes_s, 1.0), MAX_RATE) if rate_bytes_s else 0.0
        self.rtt = RoundTrip(rtt_s, rtt_s / 8 if rtt_s else 0.0, rtt_s)
        self.proven = rate > 0.0
        self.pace = START_RATE
        self.cap_bytes = START_PACKETS * packet_bytes
        self._packet = packet_bytes  # bytes of a full packet
        self._link = Delivery(rate, rate, peaks=deque([(0, rate)] if rate else []))
        self._round = Round()
        # When the next packet may leave by the pace, and in the first burst.
        self._next_s = self._burst_s = 0.0
        self._burst = START_PACKETS  # packets of the first burst to be sent yet
        self._starting = not rate  # as much more every round as the link takes
        self._cycle = 2  # place in GAINS; in a fast start, rounds without growth
        # Of the first packet: when it came, when it left, the total then.
        self._spread: tuple[float, float, int] | None = None
        self.judged = False  # that has shown what it shows
        self._leap = 0.0  # how many times the rate it was
        self._trusted: int | None = 0 if rate else None  # limit while the rate is only remembered
        self._full = 0  # rounds for which packets have waited in the link
        self._set(0.0)

    @property
    def rate_bytes_s(self) -> float | None:
        """What the link takes; None: too little was sent to know."""
        return self._link.rate if self.proven else None

    # --- limits of the sender

    def room(self, in_flight: int) -> bool:
        """Whether the link holds another packet."""
        return in_flight + self._packet <= self.cap_bytes

    @property
    def due_s(self) -> float:
        """When the next packet may leave."""
        return min(self._burst_s, self._next_s) if self._burst else self._next_s

    def sent(self, size: int, now_s: float, in_flight: int) -> Stamp:
        """A packet leaves."""
        self._next_s = max(self._next_s, now_s - BURST_S) + size / self.pace
        if self._burst:
            self._burst -= 1
            self._burst_s = now_s + size / START_RATE
        link = self._link
        if in_flight == 0:
            link.first_s = link.total_s = now_s
        limited = link.total <= link.limited_until
        return Stamp(size, now_s, link.total, link.total_s, link.first_s, limited)

    def limited(self, in_flight: int) -> None:
        """There is nothing to send: the next arrivals do not measure the link."""
        if self._link.total or in_flight:
            self._link.limited_until = self._link.total + in_flight

    def lost(self, stamp: Stamp) -> None:
        """A packet did not arrive."""
        self._round.lost += stamp.size

    def resume(self, now_s: float) -> None:
        """The link is back after a gap: start again from what it was."""
        self._link.limited_until = -1
        self._round = Round(self._link.total, now_s)
        self._next_s = self._burst_s = now_s
        self._burst = START_PACKETS
        self._spread, self.judged, self._leap = None, False, 0.0
        self._full = 0
        self._set(now_s)

    # --- acknowledgements

    def arrived(
        self, stamps: list[Stamp], rtt_s: float | None, now_s: float, in_flight: int
    ) -> None:
        """Packets were acknowledged; the newest is the last one, and arrived about `now_s`.

        The delay of the peer before its acknowledgement is not in it, nor in `rtt_s`.
        """
        link, round_ = self._link, self._round
        now_s = max(now_s, link.total_s)
        if rtt_s is not None:
            rtt_s = max(rtt_s, MIN_RTT_S)
            self.rtt.add(rtt_s, now_s)
            round_.rtt_s = min(rtt_s, round_.rtt_s or rtt_s)
        size = sum(stamp.size for stamp in stamps)
        link.total += size
        link.total_s = now_s
        round_.delivered += size
        newest = stamps[-1]
        link.first_s = newest.sent_s
        self._burst = 0
        self._measure(newest, now_s)
        if not newest.limited:
            self._judge_spread(newest, now_s)
        if newest.delivered >= round_.ends and now_s >= round_.began_s + ROUND_S:
            self._end_round(in_flight, now_s)
        self._set(now_s)

    def _measure(self, newest: Stamp, now_s: float) -> None:
        link, round_ = self._link, self._round
        taken_s = max(newest.sent_s - newest.first_s, now_s - newest.delivered_s)
        if self.rtt.min_s is None or taken_s < self.rtt.min_s * 0.9 or taken_s <= 0:
            return
        rate = min((link.total - newest.delivered) / taken_s, MAX_RATE)
        if not newest.limited:
            round_.limited = False
        elif rate <= link.rate:
            return
        round_.rate = max(round_.rate, rate)
        if rate > link.rate:
            link.peak(rate)

    def _judge_spread(self, newest: Stamp, now_s: float) -> None:
        """See from the distances of the first packets how fast the link is."""
        link = self._link
        if self._spread is None:
            self._spread = now_s, newest.sent_s, link.total
        came_s, left_s, before = self._spread
        size = link.total - before
        if self.judged or size < SPREAD_PACKETS * self._packet or now_s <= came_s:
            return
        self.judged = True
        if newest.sent_s - left_s > BURST_OVER_S:
            return
        rate = min(size / (now_s - came_s), MAX_RATE)
        if now_s - came_s > STRETCHED * (newest.sent_s - left_s) + STRETCHED_S:
            # They came out more slowly than they went in: that is what the link takes.
            link.replace(rate)
            self.proven, self._starting, self._cycle = True, False, 2
        elif rate > MUCH * link.rate:
            self._starting, self._cycle = True, 0
            self._leap = min(rate / link.rate, MAX_LEAP) if link.rate else 0.0

    def _end_round(self, in_flight: int, now_s: float) -> None:
        link, round_ = self._link, self._round
        self._round = Round(link.total, now_s)
        if round_.limited:
            return
        link.rounds += 1
        if round_.rate:
            link.peak(round_.rate)
        self.proven = self.proven or link.total >= SPREAD_PACKETS * self._packet
        self._trusted = None
        self._leap = 0.0
        if self._stands(round_):
            self._give_way(round_, in_flight)
        else:
            self._full = 0
        if not self._starting:
            self._cycle = (self._cycle + 1) % len(GAINS)
            return
        grew = link.rate > link.before * GROWTH
        link.before = link.rate
        self._cycle = 0 if grew else self._cycle + 1
        if self._full or self._cycle >= STILL_ROUNDS or (not grew and round_.loss > START_LOSS):
            self._starting, self._cycle = False, 1

    def _stands(self, round_: Round) -> bool:
        """Whether all packets of a round waited for long."""
        low_s, rtt_s = self.rtt.min_s, round_.rtt_s
        if low_s is None or rtt_s is None or not round_.rate:
            return False
        least_s = max(low_s / 4, STANDS_S, STANDS_PACKETS * self._packet / round_.rate)
        return rtt_s - low_s > least_s

    def _give_way(self, round_: Round, in_flight: int) -> None:
        """The link is full: what it delivers now is our share of it."""
        if not self._full:
            self._link.replace(round_.rate)
        self._full += in_flight <= self.cap_bytes
        if self._full > DRAIN_ROUNDS:  # it is not our queue
            self.rtt.min_s = round_.rtt_s
            self._full = 0

    # --- what follows

    def _set(self, now_s: float) -> None:
        """Pace and limit for the present round."""
        rate = self._link.rate
        if not rate:
            return
        holds = rate * (self.rtt.min_s or UNKNOWN_RTT_S)
        gain, cap = GAINS[self._cycle % len(GAINS)], HOLDS
        if self._starting:
            gain = max(START_GAIN, self._leap)
            cap = 1.2 * gain
        elif self._full:
            gain, cap = GAINS[1], 1.0
        pace = max(gain * rate, self._packet / 2)
        slack = max(MIN_PACKETS * self._packet, rate * SLACK_S)
        self._next_s = now_s + (self._next_s - now_s) * self.pace / pace
        self.pace = pace
        self.cap_bytes = int(cap * holds + slack)
        if self._trusted is not None:  # until a round has confirmed the remembered rate
            self._trusted = self._trusted or min(self.cap_bytes, TRUSTED_BYTES)
            self.cap_bytes = min(self.cap_bytes, self._trusted + 2 * self._link.total)
