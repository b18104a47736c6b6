"""The unacknowledged packets of a flow of datagrams. No sockets, no clocks."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import NamedTuple

from mocha_link.datagram.pacing import Stamp
from mocha_link.datagram.packet import MAX_NUMBER, WINDOW, Ack


class Sent(NamedTuple):
    """A packet in flight."""

    content: int | None  # the number of the first packet with its frames; None: a probe
    stamp: Stamp


class Acknowledged(NamedTuple):
    """The packets that an acknowledgement newly covers."""

    stamps: list[Stamp]  # in the order of their numbers
    newest: Stamp | None  # the last of them, if it is newer than all acknowledged before


class Outbox:
    """Packets in flight by number, and their contents until these are acknowledged.

    A retransmission gets a new number, so that an acknowledgement always identifies the copy. A
    content keeps the number of the first packet that carried it. Packets and contents are in the
    order of their numbers.

    Args:
        first: the number of the first packet.

    Attributes:
        next: the number of the next packet.
        in_flight_bytes: bytes of the packets in flight.
    """

    def __init__(self, first: int = 0) -> None:
        self.next = first
        self.in_flight_bytes = 0
        self._under_way: dict[int, Sent] = {}
        self._contents: dict[int, bytes] = {}  # encoded frames that are not acknowledged
        self._again: dict[int, None] = {}  # lost contents to retransmit, in order
        self._newest = first - 1  # the highest acknowledged number

    @property
    def base(self) -> int:
        """The number below which everything is settled."""
        first_sent = next(iter(self._under_way), self.next)
        return min(first_sent, next(iter(self._contents), self.next))

    @property
    def under_way(self) -> bool:
        """Whether any packet is in flight."""
        return bool(self._under_way)

    @property
    def settled(self) -> bool:
        """Whether all contents have arrived."""
        return not self._contents

    @property
    def full(self) -> bool:
        """Whether no number is free at the moment."""
        return self.next - self.base >= WINDOW or self.exhausted

    @property
    def exhausted(self) -> bool:
        """Whether all numbers are used up: the flow can send nothing more."""
        return self.next > MAX_NUMBER

    def content(self, body: bytes) -> int:
        """Register new frames for the next packet; returns their number."""
        self._contents[self.next] = body
        return self.next

    def body(self, content: int) -> bytes:
        """The frames of an unacknowledged content."""
        return self._contents[content]

    def bodies(self) -> list[bytes]:
        """All unacknowledged contents, in the order in which they were first sent."""
        return list(self._contents.values())

    @property
    def again(self) -> int | None:
        """The content to retransmit next."""
        return next(iter(self._again), None)

    def oldest(self) -> int | None:
        """The content of the oldest packet in flight, if it is not acknowledged."""
        content = next((sent.content for sent in self._under_way.values()), None)
        return content if content in self._contents else None

    def add(self, content: int | None, stamp: Stamp) -> None:
        """Note that the packet with the number `next` is sent."""
        if content is not None:
            self._again.pop(content, None)
        self._under_way[self.next] = Sent(content, stamp)
        self.next += 1
        self.in_flight_bytes += stamp.size

    # --- acknowledgements

    def credible(self, ack: Ack) -> bool:
        """Whether an acknowledgement covers only packets that were sent."""
        return ack.end <= self.next

    def acknowledged(self, ack: Ack) -> Acknowledged:
        """Process an acknowledgement."""
        arrived = _covered(self._under_way, ack)
        sent = [self._remove(number) for number in arrived]
        # A packet that was given up may arrive after all: its number identifies its content.
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
        """Give up packets that were sent before `before_s` and that later ones have overtaken."""
        while (sent_s := self.overtaken_s()) is not None and sent_s <= before_s:
            self._lose(next(iter(self._under_way)))

    def overtaken_s(self) -> float | None:
        """When the oldest packet was sent, if a later one was acknowledged."""
        number = next(iter(self._under_way), self.next)
        return self._under_way[number].stamp.sent_s if number < self._newest else None

    def give_up(self) -> None:
        """Give up all packets in flight; they are retransmitted in their original order."""
        for number in list(self._under_way):
            self._lose(number)
        self._again = dict.fromkeys(sorted(self._again))

    def _lose(self, number: int) -> None:
        content = self._remove(number).content
        if content is not None and content in self._contents:
            self._again[content] = None


def _covered(numbers: Iterable[int], ack: Ack) -> list[int]:
    """Those of the ascending numbers that an acknowledgement covers."""
    return [n for n in itertools.takewhile(lambda each: each < ack.end, numbers) if ack.covers(n)]
