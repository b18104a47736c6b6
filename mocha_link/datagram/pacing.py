"""How fast datagrams leave: the first window of a contact, or all of it where TCP stalls.

After BBR (draft-ietf-ccwg-bbr), and no more of it than that takes: packets leave at the highest
delivery rate of late, and not many more are under way than the link holds. Single losses carry no
information, as radios lose packets without being full. A queue that stands shows that the link is
full; then what it delivers at that moment is its rate. Unlike BBR, the distances of the first
packets show the rate at once. Bulk is left to TCP. No clock here.
docs/sync-protocol.md has what each part of it is worth.
"""

from __future__ import annotations

from dataclasses import dataclass

START_PACKETS = 12  # leave close together when a contact begins: their distances show the rate
START_RATE = 1_250_000.0  # bytes/s at which they leave
UNKNOWN_RTT_S = 0.2
BURST_S = 0.01  # sending that was missed by a late call and may be caught up at once
AHEAD_S = 0.001  # a packet may leave so much early: fewer wake-ups
SLACK_PACKETS = 4  # under way besides what the link holds, as acknowledgements may be late
TRUSTED_BYTES = 512 * 1024  # and never more than this and twice what has arrived
MAX_RATE = 125e6
RTT_WINDOW_S = 10.0  # the lowest round trip of so long
ROUND_S = 0.02  # a round is at least so long, however short the way
KEPT = 0.99  # of the rate after a round that delivered less
START_GAIN, PROBE_GAIN, DRAIN_GAIN = 2.9, 1.05, 0.75  # of the rate; a queue drains while it stands
START_HOLDS, PROBE_HOLDS, DRAIN_HOLDS = 3.5, 1.5, 1.0  # times what the link holds under way
GROWTH = 1.25  # with less in two rounds a fast start ends
SPREAD_PACKETS = 6  # whose distances show a rate
BURST_OVER_S = 0.05  # packets that left farther apart show nothing
STRETCHED, STRETCHED_S = 1.5, 0.01  # so much later than they left they have come out of a full link
STANDS_S, STANDS_PACKETS = 0.03, 2  # a round trip that is so much longer throughout is a queue
DRAIN_ROUNDS = 3  # a queue that lasts longer is not ours


@dataclass(frozen=True, slots=True)
class Stamp:
    """What was known when a packet left; it comes back when the packet has arrived."""

    size: int  # bytes
    sent_s: float  # when it left
    delivered: int  # bytes that had arrived by then
    delivered_s: float  # when the last of these arrived


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
    """What was measured in one round trip."""

    ends: int = 0  # when this much has arrived
    began_s: float = 0.0
    rate: float = 0.0  # the highest, bytes/s
    rtt_s: float | None = None  # the lowest
    limited: bool = False  # there was too little to send to see the rate

    def queue_stands(self, least_rtt_s: float, packet_bytes: int) -> bool:
        """Whether all packets of it waited for long."""
        if self.rtt_s is None or not self.rate:
            return False
        least_s = max(least_rtt_s / 4, STANDS_S, STANDS_PACKETS * packet_bytes / self.rate)
        return self.rtt_s - least_rtt_s > least_s


class Pacing:
    """Says when the next packet may leave, and learns from every acknowledgement.

    rate_bytes_s, rtt_s: what the last contact over this link showed, if there was one.

    Attributes:
        packet_bytes: of a full packet.
        rtt: the round trip.
        judged: the first packets of a contact have shown how fast the link is.
    """

    def __init__(
        self, packet_bytes: int, *, rate_bytes_s: float | None = None, rtt_s: float | None = None
    ) -> None:
        self.packet_bytes = packet_bytes
        self.rtt = RoundTrip(rtt_s, rtt_s / 8 if rtt_s else 0.0, rtt_s)
        self.judged = False
        self._rate = min(max(rate_bytes_s, 1.0), MAX_RATE) if rate_bytes_s else 0.0  # 0: not known
        self._known = self._rate > 0.0  # there was enough to send to see the rate
        self._delivered = 0  # bytes that arrived
        self._delivered_s = 0.0  # when the newest of them did
        self._round = Round()
        self._start_rounds = 0 if self._known else 2  # rounds of a fast start, if nothing grows
        self._start_rate = self._rate  # when it last grew
        self._full_rounds = 0  # for which a queue has stood
        self._burst = START_PACKETS  # packets of the first burst to be sent yet
        self._last = Stamp(0, 0.0, 0, 0.0)  # of the last packet
        self._owed = 0.0  # bytes that had left too early by then; below 0: too late
        # Of the first packet: when it came, when it left, the bytes delivered then.
        self._spread: tuple[float, float, int] | None = None

    @property
    def rate_bytes_s(self) -> float | None:
        """What the link takes; None: too little was sent to know."""
        return self._rate if self._known else None

    # --- limits of the sender

    @property
    def _gains(self) -> tuple[float, float]:
        """Times the rate at which packets leave, and times what the link holds under way."""
        if self._start_rounds:
            return START_GAIN, START_HOLDS
        return (DRAIN_GAIN, DRAIN_HOLDS) if self._full_rounds else (PROBE_GAIN, PROBE_HOLDS)

    @property
    def pace(self) -> float:
        """Bytes/s at which packets leave."""
        return max(self._gains[0] * self._rate, self.packet_bytes / 2) if self._rate else START_RATE

    @property
    def due_s(self) -> float:
        """When the next packet may leave."""
        wait_s = max(self._owed, 0.0) / self.pace
        if self._burst:
            wait_s = min(wait_s, self._last.size / START_RATE)
        return self._last.sent_s + wait_s

    @property
    def cap_bytes(self) -> int:
        """Most that is under way."""
        if not self._rate:
            return START_PACKETS * self.packet_bytes
        holds = self._gains[1] * self._rate * (self.rtt.min_s or UNKNOWN_RTT_S)
        holds += SLACK_PACKETS * self.packet_bytes
        return int(min(holds, TRUSTED_BYTES + 2 * self._delivered))

    def room(self, in_flight: int) -> bool:
        """Whether the link holds another packet."""
        return in_flight + self.packet_bytes <= self.cap_bytes

    def sent(self, size: int, now_s: float, in_flight: int) -> Stamp:
        """A packet leaves."""
        pace = self.pace
        idle_s = now_s - self._last.sent_s
        self._owed = max(self._owed - idle_s * pace, -BURST_S * pace) + size
        self._burst = max(self._burst - 1, 0)
        if in_flight == 0:
            self._delivered_s = now_s
        self._last = Stamp(size, now_s, self._delivered, self._delivered_s)
        return self._last

    def limited(self) -> None:
        """There is nothing to send: this round does not show the rate."""
        self._round.limited = True

    def resume(self, now_s: float) -> None:
        """A contact begins, or the link is back after a gap: start again from what it was."""
        self._round = Round(self._delivered, now_s)
        self._burst, self._owed = START_PACKETS, 0.0
        self._spread, self.judged = None, False
        self._full_rounds = 0

    # --- acknowledgements

    def arrived(self, stamps: list[Stamp], rtt_s: float | None, now_s: float) -> None:
        """Packets were acknowledged; the newest is the last one, and arrived about `now_s`.

        The delay of the peer before its acknowledgement is not in it, nor in `rtt_s`.
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
        """See from the distances of the first packets how fast the link is."""
        if self._spread is None:
            self._spread = now_s, newest.sent_s, self._delivered
        came_s, left_s, before = self._spread
        size = self._delivered - before
        if self.judged or size < SPREAD_PACKETS * self.packet_bytes or now_s <= came_s:
            return
        self.judged = True
        if newest.sent_s - left_s > BURST_OVER_S:
            return
        rate = min(size / (now_s - came_s), MAX_RATE)
        if now_s - came_s > STRETCHED * (newest.sent_s - left_s) + STRETCHED_S:
            # They came out more slowly than they went in: that is what the link takes.
            self._rate, self._known, self._start_rounds = rate, True, 0
        elif rate > 2 * self._rate:  # that is no more than they left at: they do not show it
            self._rate = max(self._rate, min(rate, START_RATE) / START_GAIN)
            self._start_rounds = 2

    def _learn(self, round_: Round) -> None:
        """A round has ended in which there was enough to send."""
        self._known = self._known or self._delivered >= SPREAD_PACKETS * self.packet_bytes
        stands = round_.queue_stands(self.rtt.min_s or 0.0, self.packet_bytes)
        self._full_rounds = self._full_rounds + 1 if stands else 0
        if self._start_rounds:
            grew = self._rate > GROWTH * self._start_rate
            self._start_rounds = 0 if stands else 2 if grew else self._start_rounds - 1
            self._start_rate = self._rate
        if self._full_rounds > DRAIN_ROUNDS:  # it is not our queue, but a longer way
            self.rtt.min_s, self._full_rounds, self._start_rounds = round_.rtt_s, 0, 2
        elif self._full_rounds:
            self._rate = round_.rate  # what it delivers now is our share of it
        else:
            self._rate = max(round_.rate, KEPT * self._rate)
