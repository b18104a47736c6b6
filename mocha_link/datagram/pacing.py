"""How fast to send over a link: as much as it takes, at once if it is known. No clock here.

After BBR (draft-ietf-ccwg-bbr): packets leave at the highest rate that the link delivered lately,
and no more are under way than it holds. Single losses carry no information, as radios lose packets
without being full. A queue that stands, packets that come out at longer distances than they went
in, or losses together with a longer round trip show that it is full; then what it delivers at that
moment is its rate, however fast it was before. Unlike BBR, the distances of the first packets let a
fast start leap, and losses that stay when less is sent are made up for by sending more.
"""

from __future__ import annotations

from enum import Enum, auto

from mocha_link.datagram.delivery import MAX_RATE, Delivery, Stamp, Train

START_PACKETS = 12  # leave close together when a contact begins: their distances show the rate
FIRST = START_PACKETS + 1
START_RATE = 1_250_000.0  # bytes/s at which they leave
UNKNOWN_RTT_S = 0.2
BURST_S = 0.01  # sending that was missed by a late call and may be caught up at once
AHEAD_S = 0.001  # a packet may leave so much early: fewer wake-ups
MIN_PACKETS = 4  # under way, however little the link holds
SLACK_S = 0.03  # and what it takes in this time, as acknowledgements may be late
MAX_LEAP = 16  # times as much in the next round, at most, because of distances alone
LITTLE_FASTER, MUCH_FASTER = 1.2, 2.0  # than in the last contact, as the first packets show
GROWTH = 1.25  # a round with less growth is none, in a fast start
STILL_ROUNDS = 2
CRUISE_ROUNDS = 6
UP_ROUNDS = 2
DOWN_ROUNDS = 2  # with no more under way than the link holds; then a queue is not ours
START_LOSS = 0.1
EXCESS_LOSS = 0.05
LOSSY = 0.02  # above this share the pacing examines the cause of losses
MAX_LOSS = 0.25  # not more than that is made up for


class Phase(Enum):
    """What the controller is doing."""

    START = auto()  # an unknown link: as much more every round as it takes
    CRUISE = auto()  # at the rate of the link
    UP = auto()  # a little more, to see if the link has become faster
    DOWN = auto()  # a little less, until what was too much has left the queue
    LOW = auto()  # less for a round, where packets are lost: what is lost now is not our doing


_GAINS = {  # of the rate, and how many times what the link holds may be under way
    Phase.START: (2.9, 3.5),
    Phase.CRUISE: (1.0, 1.5),
    Phase.UP: (1.2, 1.5),
    Phase.DOWN: (0.8, 1.0),
    Phase.LOW: (0.8, 1.5),
}


class Pacing:
    """Says when the next packet may leave, and learns from every acknowledgement.

    rate_bytes_s, rtt_s: what the last contact over this link showed, if there was one.
    """

    def __init__(
        self, packet_bytes: int, *, rate_bytes_s: float | None = None, rtt_s: float | None = None
    ) -> None:
        rate = min(max(rate_bytes_s, 1.0), MAX_RATE) if rate_bytes_s else 0.0
        self.link = Delivery(packet_bytes, rate, rtt_s)  # its measurements
        self.phase = Phase.CRUISE if rate else Phase.START  # decides gain and limit
        self.pace = START_RATE  # bytes/s at which packets leave
        self.cap_bytes = START_PACKETS * packet_bytes  # most that is under way
        self._packet = packet_bytes  # bytes of a full packet
        # when the next may leave, by the pace and in the first burst
        self._next_s = self._burst_s = 0.0
        self._burst = START_PACKETS  # packets of it to be sent yet
        self._began = 0  # what had arrived before this contact
        self._trusted: int | None = 0 if rate else None  # limit while the rate is only remembered
        self.proven = rate > 0.0  # there was enough to send to see the rate
        self._since = 0  # rounds in this phase
        self._still = 0  # rounds without growth at the start, rounds with growth when probing
        self._before = rate  # the rate when the phase began
        self._loss = 0.0  # of the last rounds
        self._leap = 0.0  # the rate that the distances of the first packets showed
        self._full = False  # packets wait in the link
        self._more = 1.0  # the gain of the last probing
        self._set(0.0)

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
        return self.link.sent(size, now_s, idle=in_flight == 0, low=self.phase is Phase.LOW)

    def resume(self, now_s: float) -> None:
        """The link is back after a gap: start again from what it was."""
        self.link.resume(now_s)
        self._next_s = self._burst_s = now_s
        self._burst = START_PACKETS
        self._began = self.link.total
        self._leap = 0.0
        self._full = False
        if self.phase is not Phase.START:
            self._enter(Phase.CRUISE)
        self._set(now_s)

    # --- acknowledgements

    def arrived(
        self, stamps: list[Stamp], rtt_s: float | None, now_s: float, in_flight: int
    ) -> None:
        """Packets were acknowledged; the newest is the last one, and arrived about `now_s`.

        The delay of the peer before its acknowledgement is not in it, nor in `rtt_s`.
        """
        link = self.link
        self._burst = 0
        train = link.arrived(stamps, rtt_s, now_s)
        if train:
            self._judge_train(train)
        newest = stamps[-1]
        if link.round_over(newest, now_s):
            link.close_round()
            if not link.round.limited:
                self._since += 1
                if newest.delivered > self._began:
                    self._trusted = None
                    self.proven = True
                self._judge_round(in_flight)
            link.next_round(now_s)
        elif self.phase is Phase.DOWN and not self._full and in_flight <= self._held():
            self._drained()
        self._set(now_s)

    def _judge_train(self, train: Train) -> None:
        link, phase = self.link, self.phase
        first = link.total < self._began + FIRST * self._packet
        if first:
            self._leap = max(self._leap, link.spread)
        if train.stretched or (phase is Phase.START and train.risen and train.loss > START_LOSS):
            link.replace(train.rate)
            self.proven = True
            if phase is not Phase.DOWN:
                self._enter(Phase.DOWN)
        elif phase is Phase.UP and train.risen and train.loss > EXCESS_LOSS + link.base_loss:
            self._enter(Phase.DOWN)
        elif phase is Phase.CRUISE and first and link.spread > LITTLE_FASTER * link.rate:
            self._trusted = None
            much = link.spread > MUCH_FASTER * link.rate
            self._enter(Phase.START if much else Phase.UP)

    def _judge_round(self, in_flight: int) -> None:
        link, phase = self.link, self.phase
        loss = link.round.loss
        excess = loss - link.base_loss
        self._loss += (loss - self._loss) / 4
        short = excess > EXCESS_LOSS and phase is not Phase.LOW and link.risen(link.round.rtt_s)
        self._full = bool(link.round.rate) and (short or link.queue_stands())
        if self._full:
            self._give_way(in_flight)
        elif phase is Phase.START:
            self._still = self._still + 1 if link.rate < self._before * GROWTH else 0
            self._before = link.rate
            if self._still >= STILL_ROUNDS or (self._still and excess > START_LOSS):
                self._enter(Phase.DOWN)
        elif phase is Phase.UP:
            self._judge_probe(excess)
        elif phase is Phase.DOWN:
            if self._since >= UP_ROUNDS or in_flight <= self._held():
                self._drained()
        elif phase is Phase.LOW:
            self._enter(Phase.CRUISE)
        elif not link.base_known and self._loss > LOSSY and self._since >= UP_ROUNDS:
            self._enter(Phase.LOW)
        elif self._since >= CRUISE_ROUNDS:
            self._enter(Phase.UP)

    def _give_way(self, in_flight: int) -> None:
        """The link is full: what it delivers now is our share of it."""
        if self.phase is not Phase.DOWN:
            if self.phase is not Phase.LOW:
                self.link.replace(self.link.round.rate)
            self._enter(Phase.DOWN)
            return
        self._still += in_flight <= self.cap_bytes
        if self._still > DOWN_ROUNDS:  # it is not our queue
            self.link.accept_rtt()
            self._full = False
            self._enter(Phase.CRUISE)

    def _judge_probe(self, excess: float) -> None:
        if self.link.rate > self._before * (1 + self._more) / 2 and excess < EXCESS_LOSS:
            self._before = self.link.rate
            self._still += 1
            if self._still >= STILL_ROUNDS:  # it has become much faster
                self._enter(Phase.START)
        elif self._since >= UP_ROUNDS or excess > EXCESS_LOSS:
            self._enter(Phase.DOWN)

    def _drained(self) -> None:
        self._enter(Phase.LOW if self._loss > LOSSY else Phase.CRUISE)

    def _enter(self, phase: Phase) -> None:
        self.phase = phase
        self._since = self._still = 0
        self._before = self.link.rate

    # --- what follows

    def _holds(self) -> float:
        return self.link.rate * (self.link.min_rtt_s or UNKNOWN_RTT_S)

    def _held(self) -> float:
        """With so many bytes under way nothing waits."""
        return self._holds() + 2 * self._packet

    def _set(self, now_s: float) -> None:
        """Pace and limit for the present phase."""
        link, phase = self.link, self.phase
        if not link.rate:
            return
        gain, cap = _GAINS[phase]
        holds = self._holds()
        if phase is Phase.UP:  # the smaller its share, the more a flow adds: shares become equal
            packets = max(holds / self._packet, 1.0)
            gain = self._more = 1 + min(max(4.0, 2 * packets**0.5) / packets, 1.0)
        elif phase is Phase.START:
            gain /= 1 - min(self._loss, MAX_LOSS)
            gain = max(gain, min(self._leap / link.rate, MAX_LEAP))
            cap = 1.2 * gain
        pace = gain * link.rate
        slack: float = MIN_PACKETS * self._packet
        if phase is not Phase.LOW:
            pace /= 1 - min(link.base_loss, MAX_LOSS)
        if phase is not Phase.DOWN:
            slack = max(slack, link.rate * SLACK_S)
        if self._full:
            cap = 1.0
        pace = max(pace, self._packet / 2)
        self._next_s = now_s + (self._next_s - now_s) * self.pace / pace
        self.pace = pace
        self.cap_bytes = int(cap * holds + slack)
        if self._trusted is not None:  # until a round has confirmed the remembered rate
            self._trusted = self._trusted or self.cap_bytes
            grown = self._trusted + 2 * (link.total - self._began)
            self.cap_bytes = min(self.cap_bytes, grown)
