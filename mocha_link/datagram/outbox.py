"""What was sent over a flow of datagrams and has not arrived yet. No sockets, no clocks."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import NamedTuple

from mocha_link.datagram.pacing import Stamp
from mocha_link.datagram.packet import MAX_NUMBER, WINDOW, Ack


class Sent(NamedTuple):
    """A packet under way."""

    content: int | None  # the number of the packet that carried its frames first; None: a probe
    stamp: Stamp


class Acknowledged(NamedTuple):
    """What an acknowledgement brought."""

    stamps: list[Stamp]  # of the packets that arrived, in the order of their numbers
    newest: Stamp | None  # the last of them, if it is newer than all that were known before


class Outbox:
    """Packets under way by number, and contents that have to arrive.

    A packet that is sent again gets a new number, so an acknowledgement always identifies the copy.
    Contents keep the number of the first packet with them. Packets and contents are in the order of
    their numbers.

    Args:
        first: the number of the first packet.

    Attributes:
        next: the number of the next packet.
        in_flight_bytes: of packets under way.
    """

    def __init__(self, first: int = 0) -> None:
        self.next = first
        self.in_flight_bytes = 0
        self._under_way: dict[int, Sent] = {}
        self._contents: dict[int, bytes] = {}  # frames as they stand in a packet, to arrive yet
        self._again: dict[int, None] = {}  # contents that are lost, to be sent once more
        self._newest = first - 1  # the highest number that was acknowledged

    @property
    def base(self) -> int:
        """Everything below is settled."""
        first_sent = next(iter(self._under_way), self.next)
        return min(first_sent, next(iter(self._contents), self.next))

    @property
    def under_way(self) -> bool:
        """Whether an acknowledgement may still come."""
        return bool(self._under_way)

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

    def content(self, body: bytes) -> int:
        """New frames, which the next packet will carry."""
        self._contents[self.next] = body
        return self.next

    def body(self, content: int) -> bytes:
        """The frames of a content that has not arrived."""
        return self._contents[content]

    def bodies(self) -> list[bytes]:
        """Everything that has not arrived, in the order in which it went first."""
        return list(self._contents.values())

    @property
    def again(self) -> int | None:
        """The content to be sent again next."""
        return next(iter(self._again), None)

    def oldest(self) -> int | None:
        """The content of the oldest packet under way, if it needs to arrive."""
        content = next((sent.content for sent in self._under_way.values()), None)
        return content if content in self._contents else None

    def add(self, content: int | None, stamp: Stamp) -> None:
        """The packet with the number `next` leaves."""
        if content is not None:
            self._again.pop(content, None)
        self._under_way[self.next] = Sent(content, stamp)
        self.next += 1
        self.in_flight_bytes += stamp.size

    # --- what arrived

    def credible(self, ack: Ack) -> bool:
        """Whether an acknowledgement speaks only of packets that were sent."""
        return ack.end <= self.next

    def acknowledged(self, ack: Ack) -> Acknowledged:
        """Take in what arrived."""
        arrived = _covered(self._under_way, ack)
        sent = [self._remove(number) for number in arrived]
        # A packet that was given up may have been overtaken only: its number is that of a content.
        contents = [each.content for each in sent if each.content is not None]
        for content in contents + _covered(self._contents, ack):
            self._contents.pop(content, None)
            self._again.pop(content, None)
        stamps = [each.stamp for each in sent]
        if not arrived or arrived[-1] <= self._newest:
            return Acknowledged(stamps, None)
        self._newest = arrived[-1]
        return Acknowledged(stamps, stamps[-1])

    def _remove(self, number: int) -> Sent:
        sent = self._under_way.pop(number)
        self.in_flight_bytes -= sent.stamp.size
        return sent

    # --- losses

    def lose(self, before_s: float) -> None:
        """Give up packets that were sent earlier, and that later ones overtook."""
        while (sent_s := self.overtaken_s()) is not None and sent_s <= before_s:
            self._lose(next(iter(self._under_way)))

    def overtaken_s(self) -> float | None:
        """When the oldest packet was sent, if a later one has arrived."""
        number = next(iter(self._under_way), self.next)
        return self._under_way[number].stamp.sent_s if number < self._newest else None

    def give_up(self) -> None:
        """Everything under way is lost; it goes again in the order in which it went first."""
        for number in list(self._under_way):
            self._lose(number)
        self._again = dict.fromkeys(sorted(self._again))

    def _lose(self, number: int) -> None:
        content = self._remove(number).content
        if content is not None and content in self._contents:
            self._again[content] = None


def _covered(numbers: Iterable[int], ack: Ack) -> list[int]:
    """Those of rising numbers that have arrived."""
    return [n for n in itertools.takewhile(lambda each: each < ack.end, numbers) if ack.covers(n)]
