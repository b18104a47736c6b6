"""What monitors have found that stands against a motion: one part of the mission's context."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Final


class Anomaly(Enum):
    """What a monitor finds; each is a row of `INTERLOCKS`."""

    ALTITUDE_JUMP = "the altitude has jumped"
    CONDITIONS = "satellites or wind are worse than planned for"
    FOREIGN_ORDER = "a foreign command is active"


OFF_PLAN: Final = tuple(anomaly for anomaly in Anomaly if anomaly is not Anomaly.FOREIGN_ORDER)
"""What watches find while the mission cruises: raised and cleared by `Deviations`, void when it
does not cruise.
"""


@dataclass(slots=True, eq=False)
class RaisedInterlocks:
    """What stands against a motion. Only its methods change it.

    Attributes:
        motion_deferred: A motion was kept back by a row with `defers`, or a stop because another
            order showed: it is planned again at the next telemetry without one.
        climb_required: Climb to the mission's altitude before the next leg: the vehicle was taken
            back, or may have sunk, or left a zone below. Stays until it is there.
    """

    motion_deferred: bool = False
    climb_required: bool = False
    _raised: set[Anomaly] = field(default_factory=set)

    def is_raised(self, *anomalies: Anomaly) -> bool:
        """Whether one of them is raised."""
        return not self._raised.isdisjoint(anomalies)

    def words(self, *anomalies: Anomaly) -> str | None:
        """The first of them that is raised, as text; None: none is."""
        return next((anomaly.value for anomaly in anomalies if anomaly in self._raised), None)

    def put(self, anomaly: Anomaly, *, raised: bool) -> None:
        """Raise it, or clear it."""
        if raised:
            self._raised.add(anomaly)
        else:
            self._raised.discard(anomaly)

    def defer_motion(self) -> None:
        """A motion was kept back."""
        self.motion_deferred = True

    def take_deferred(self) -> bool:
        """Whether a motion was kept back; reports it once."""
        deferred, self.motion_deferred = self.motion_deferred, False
        return deferred

    def climb_first(self) -> None:
        """The next leg is begun at the mission's altitude."""
        self.climb_required = True

    def climbed(self) -> None:
        """The vehicle is at the mission's altitude."""
        self.climb_required = False
