"""What was sent over a flow of datagrams and has not arrived yet. No sockets, no clocks."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from mocha_link.datagram.pacing import Stamp
from mocha_link.datagram.packet import MAX_NUMBER, WINDOW, Ack

REORDERED = 3  # packets that may overtake another before it counts as lost
MAX_REORDERED = 128


@dataclass(slots=True, eq=False)
class Content:
    """Frames as they stand in a packet."""

    number: int  # of the first packet that carried them
    last: int  # the number of the last one
    body: bytes
    arrived: bool = False  # by any of the packets that carried it
    waiting: bool = False  # to be sent again


@dataclass(slots=True, eq=False)
class _Sent:
    """One packet under way; without content it is a probe."""

    number: int
    content: Content | None
    stamp: Stamp
    settled: bool = False  # arrived or lost


class Acknowledged(NamedTuple):
    """What an acknowledgement brought."""

    stamps: list[Stamp]  # of the packets that arrived, in the order of their numbers
    newest: Stamp | None  # the last of them, if it is newer than all that were known before


class Outbox:
    """Packets under way by number, and contents that have to arrive.

    A packet that is sent again gets a new number, so an acknowledgement always identifies the copy.
    `first` is the number of the first one.
    """

    def __init__(self, first: int = 0) -> None:
        self.next = first  # number of the next packet
        self.base = first  # everything below is settled
        self.in_flight_bytes = 0  # of unsettled packets
        self._open = 0  # bit n: packet base + n is under way, or its content has not arrived
        self._flying: deque[_Sent] = deque()  # in the order of sending
        self._sent: dict[int, _Sent] = {}  # not acknowledged, by number
        self._contents: dict[int, Content] = {}  # to arrive yet, by number
        self._again: deque[Content] = deque()  # lost, to be sent once more
        self._newest = first - 1  # the highest number that was acknowledged
        self._reordered = REORDERED  # so far packets overtake each other

    def under_way(self) -> bool:
        """Whether an acknowledgement may still come."""
        return bool(self._sent)

    @property
    def settled(self) -> bool:
        """Whether all contents have arrived."""
        return not self._contents

    @property
    def full(self) -> bool:
        """Whether there are no more numbers, for the moment."""
        return self.next - self.base >= WINDOW or self.exhausted

    @property
    def exhausted(self) -> bool:
        """Whether there are no more numbers for good: the flow can send nothing."""
        return self.next > MAX_NUMBER

    @property
    def some_again(self) -> bool:
        """Whether something is to be sent again."""
        return bool(self._again)

    def content(self, body: bytes) -> Content:
        """New frames, which the next packet will carry."""
        content = self._contents[self.next] = Content(self.next, self.next, body)
        return content

    def bodies(self) -> list[bytes]:
        """Everything that has not arrived, in the order in which it went first."""
        return [self._contents[number].body for number in sorted(self._contents)]

    def again(self) -> Content | None:
        """The next content that has to be sent again."""
        while self._again:
            content = self._again.popleft()
            content.waiting = False
            if not content.arrived:
                return content
        return None

    def oldest(self) -> Content | None:
        """The content of the oldest packet under way, if it needs to arrive."""
        for sent in self._flying:
            if not sent.settled:
                return None if sent.content is None or sent.content.arrived else sent.content
        return None

    def add(self, content: Content | None, stamp: Stamp) -> None:
        """The packet with the number `next` leaves."""
        number = self.next
        self.next += 1
        if content is not None:
            content.last = number
        sent = self._sent[number] = _Sent(number, content, stamp)
        self._flying.append(sent)
        self._open |= 1 << (number - self.base)
        self.in_flight_bytes += stamp.size

    # --- what arrived

    def credible(self, ack: Ack) -> bool:
        """Whether an acknowledgement speaks only of packets that were sent."""
        return ack.start + ack.bits.bit_length() <= self.next and ack.below <= self.next

    def acknowledged(self, ack: Ack) -> Acknowledged:
        """Take in what arrived."""
        base = self.base
        ahead = ack.start - base
        fresh = (1 << (ack.below - base)) - 1 if ack.below > base else 0
        fresh |= ack.bits << ahead if ahead >= 0 else ack.bits >> -ahead
        bits = fresh
        fresh &= self._open
        stamps: list[Stamp] = []
        newest = -1
        while fresh:
            low = fresh & -fresh
            fresh ^= low
            number = base + low.bit_length() - 1
            self._open &= ~low
            sent = self._sent.pop(number, None)
            if sent is None:
                content = self._contents.get(number)
                if content is not None:
                    if not bits >> (content.last - base) & 1:
                        self._premature(number)
                    self._arrived(content)
                continue
            sent.settled = True
            newest = number
            self.in_flight_bytes -= sent.stamp.size
            stamps.append(sent.stamp)
            if sent.content is not None:
                self._arrived(sent.content)
        self._settle()
        if newest <= self._newest:
            return Acknowledged(stamps, None)
        self._newest = newest
        return Acknowledged(stamps, stamps[-1])

    def _premature(self, number: int) -> None:
        """A packet came that had been taken for lost: it was only overtaken, more than usual."""
        overtaken = self._newest - number + 1
        self._reordered = min(max(self._reordered, overtaken), MAX_REORDERED)

    def _arrived(self, content: Content) -> None:
        if content.arrived:
            return
        content.arrived = True
        del self._contents[content.number]
        if content.number not in self._sent:
            self._open &= ~(1 << (content.number - self.base))

    def _settle(self) -> None:
        if not self._open:
            self.base = self.next
        elif not self._open & 1:
            low = (self._open & -self._open).bit_length() - 1
            self.base += low
            self._open >>= low

    # --- losses

    def lose(self, before_s: float) -> list[Stamp]:
        """Give up packets that later ones overtook: by several numbers, or when long sent."""
        flying = self._flying
        last = self._newest - self._reordered
        lost = []
        while flying:
            sent = flying[0]
            if not sent.settled:
                if sent.number > last and (
                    sent.number > self._newest or sent.stamp.sent_s > before_s
                ):
                    break
                lost.append(sent.stamp)
                self._drop(sent)
            flying.popleft()
        if lost:
            self._settle()
        return lost

    def overtaken_s(self) -> float | None:
        """When the oldest packet was sent, if a later one has arrived."""
        flying = self._flying
        while flying and flying[0].settled:
            flying.popleft()
        if flying and flying[0].number < self._newest:
            return flying[0].stamp.sent_s
        return None

    def give_up(self) -> None:
        """Everything under way is lost; it goes again in the order in which it went first."""
        for sent in self._flying:
            if not sent.settled:
                self._drop(sent)
        self._flying.clear()
        self._settle()
        self._again = deque(sorted(self._again, key=lambda content: content.number))

    def _drop(self, sent: _Sent) -> None:
        sent.settled = True
        self.in_flight_bytes -= sent.stamp.size
        del self._sent[sent.number]
        content = sent.content
        if content is None or content.arrived or content.number != sent.number:
            self._open &= ~(1 << (sent.number - self.base))
        if content is not None and not content.arrived and not content.waiting:
            content.waiting = True
            self._again.append(content)
