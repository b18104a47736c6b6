"""What the syncs with a peer report: events for listeners, refusals for the operator, bytes."""

from __future__ import annotations

from mocha_link.clock import Instant
from mocha_link.links import (
    Direction,
    LinkEvent,
    MessageStored,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.store import Record
from mocha_link.team import Robot, Topic


class PeerLog:
    """The reports of the syncs with one peer, until the node takes them out.

    Attributes:
        events: for listeners, in order.
        refusals: reasons of refused input.
    """

    def __init__(self, name: str) -> None:
        self.events: list[LinkEvent] = []
        self.refusals: list[str] = []
        self._name = name  # of the peer
        self._bytes_in = 0  # received since they were taken last

    def started(self, direction: Direction, now: Instant) -> None:
        """A sync begins."""
        self.events.append(SyncStarted(self._name, now.unix_s, direction))

    def ended(  # noqa: PLR0913 - the fields of the event
        self,
        direction: Direction,
        now: Instant,
        *,
        began_s: float,
        messages: int,
        size: int,
        complete: bool = True,
    ) -> None:
        """A sync that began at that steady time has come to its end with so many bytes."""
        taken_s = now.steady_s - began_s
        self.events.append(
            SyncEnded(self._name, now.unix_s, direction, messages, size, taken_s, complete)
        )

    def timed_out(self, direction: Direction, reason: str, now: Instant) -> None:
        """A sync has broken off, or was turned away."""
        self.events.append(SyncTimedOut(self._name, now.unix_s, direction, reason))

    def stored(self, known: tuple[Robot, Topic], record: Record) -> None:
        """A message of the peer was new, and was stored."""
        robot, topic = known
        at_s, size = record.received_s, len(record.body)
        self.events.append(
            MessageStored(self._name, at_s, robot.name, topic.name, record.header, size)
        )

    def refuse(self, reason: str) -> None:
        """Something that the peer sent was refused."""
        self.refusals.append(reason)

    def received(self, size: int) -> None:
        """So many bytes were received from the peer."""
        self._bytes_in += size

    def take_events(self) -> list[LinkEvent]:
        """The events since the last call."""
        events, self.events = self.events, []
        return events

    def take_refusals(self) -> list[str]:
        """The refusals since the last call."""
        refusals, self.refusals = self.refusals, []
        return refusals

    def take_bytes_in(self) -> int:
        """The bytes that were received since the last call."""
        bytes_in, self._bytes_in = self._bytes_in, 0
        return bytes_in
