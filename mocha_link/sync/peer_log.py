"""The reports of the syncs with a peer: events for listeners, refusals for the operator, bytes."""

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
    """The reports of the syncs with one peer, until the node fetches them.

    Attributes:
        events: for listeners, in order.
        refusals: reasons of refused input.
    """

    def __init__(self, name: str) -> None:
        self.events: list[LinkEvent] = []
        self.refusals: list[str] = []
        self._name = name  # of the peer
        self._bytes_in = 0  # received since the last `take_bytes_in`

    def started(self, direction: Direction, now: Instant) -> None:
        """Report that a sync begins."""
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
        """Report that a sync has ended; `began_s`: when it began, steady seconds."""
        taken_s = now.steady_s - began_s
        self.events.append(
            SyncEnded(self._name, now.unix_s, direction, messages, size, taken_s, complete)
        )

    def timed_out(self, direction: Direction, reason: str, now: Instant) -> None:
        """Report that a sync was aborted or rejected."""
        self.events.append(SyncTimedOut(self._name, now.unix_s, direction, reason))

    def stored(self, known: tuple[Robot, Topic], record: Record) -> None:
        """Report that a new message of the peer was stored."""
        robot, topic = known
        at_s, size = record.received_s, len(record.body)
        self.events.append(
            MessageStored(self._name, at_s, robot.name, topic.name, record.header, size)
        )

    def refuse(self, reason: str) -> None:
        """Report that input from the peer was refused."""
        self.refusals.append(reason)

    def received(self, size: int) -> None:
        """Count bytes received from the peer."""
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
