"""Whether data have been exchanged with the robot that we hover over, in both directions."""

from __future__ import annotations

from dataclasses import dataclass, field

from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted


@dataclass(slots=True)
class SyncProgress:
    """One meeting with one robot.

    Only a sync that began after the robot was found counts: it alone carries all that both had
    by then.
    """

    robot: str | None = None
    _open: set[Direction] = field(default_factory=set)
    _done: set[Direction] = field(default_factory=set)

    def started(self, event: SyncStarted) -> None:
        """A sync began."""
        if event.peer == self.robot:
            self._open.add(event.direction)

    def ended(self, event: SyncEnded) -> None:
        """A sync is complete."""
        if event.peer == self.robot and event.direction in self._open:
            self._open.discard(event.direction)
            self._done.add(event.direction)

    @property
    def complete(self) -> bool:
        """Both directions have synced."""
        return self._done == set(Direction)
