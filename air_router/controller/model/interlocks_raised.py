"""What monitors have found that stands against a motion: one part of the mission's context."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Final


class Doubt(Enum):
    """What a monitor finds; each is a row of `INTERLOCKS`."""

    ALTITUDE_JUMP = "the altitude has jumped"
    CONDITIONS = "satellites or wind are worse than planned for"
    FOREIGN_ORDER = "a foreign command is active"


OFF_PLAN: Final = tuple(doubt for doubt in Doubt if doubt is not Doubt.FOREIGN_ORDER)
"""What watches find while the mission cruises: raised and cleared by `Deviations`, void when it
does not cruise.
"""


@dataclass(slots=True, eq=False)
class RaisedInterlocks:
    """What stands against a motion. Only its methods change it.

    Attributes:
        motion_deferred: A motion was kept back by a row with `defers`, or a stop because another
            order showed: it is planned again at the next telemetry without one.
        climbs_first: Climb to the mission's altitude before the next leg: the vehicle was taken
            back, or may have sunk, or left a zone below. Stays until it is there.
    """

    motion_deferred: bool = False
    climbs_first: bool = False
    _up: set[Doubt] = field(default_factory=set)

    def up(self, *doubts: Doubt) -> bool:
        """Whether one of them is raised."""
        return not self._up.isdisjoint(doubts)

    def words(self, *doubts: Doubt) -> str | None:
        """The first of them that is raised, in words; None: none is."""
        return next((doubt.value for doubt in doubts if doubt in self._up), None)

    def put(self, doubt: Doubt, *, raised: bool) -> None:
        """Raise it, or clear it."""
        if raised:
            self._up.add(doubt)
        else:
            self._up.discard(doubt)

    def defer_motion(self) -> None:
        """A motion was kept back."""
        self.motion_deferred = True

    def take_deferred(self) -> bool:
        """Whether a motion was kept back; says so once."""
        deferred, self.motion_deferred = self.motion_deferred, False
        return deferred

    def climb_first(self) -> None:
        """The next leg is begun at the mission's altitude."""
        self.climbs_first = True

    def climbed(self) -> None:
        """The vehicle is at the mission's altitude."""
        self.climbs_first = False
