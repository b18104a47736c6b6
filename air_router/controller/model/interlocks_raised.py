"""Anomalies found by monitors that block motions: one part of the mission's context."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Final


class Anomaly(Enum):
    """An anomaly that a monitor finds; each is a row of `INTERLOCKS`."""

    ALTITUDE_JUMP = "the altitude has jumped"
    CONDITIONS = "GPS accuracy or wind is worse than planned"
    FOREIGN_ORDER = "the vehicle seems to follow a foreign command"


OFF_PLAN: Final = tuple(anomaly for anomaly in Anomaly if anomaly is not Anomaly.FOREIGN_ORDER)
"""Anomalies checked only while the mission cruises. `Deviations` raises and clears them.
"""


@dataclass(slots=True, eq=False)
class RaisedInterlocks:
    """The interlocks that block motions now. Only its methods change it.

    Attributes:
        motion_deferred: A row with `defers` blocked a motion, or a foreign command blocked a stop.
            The motion is replanned with the next telemetry in which no row blocks it.
        climb_required: Climb to the mission's altitude before the next leg, because the vehicle was
            taken back, may have descended, or left a zone below. Stays until it is there.
    """

    motion_deferred: bool = False
    climb_required: bool = False
    _raised: set[Anomaly] = field(default_factory=set)

    def is_raised(self, *anomalies: Anomaly) -> bool:
        """Whether one of them is raised."""
        return not self._raised.isdisjoint(anomalies)

    def first_raised(self, *anomalies: Anomaly) -> str | None:
        """The first of these that is raised, as text; None: none is."""
        return next((anomaly.value for anomaly in anomalies if anomaly in self._raised), None)

    def put(self, anomaly: Anomaly, *, raised: bool) -> None:
        """Raise it, or clear it."""
        if raised:
            self._raised.add(anomaly)
        else:
            self._raised.discard(anomaly)

    def defer_motion(self) -> None:
        """A motion was blocked."""
        self.motion_deferred = True

    def take_deferred(self) -> bool:
        """Whether a motion was blocked; reports it once."""
        deferred, self.motion_deferred = self.motion_deferred, False
        return deferred

    def climb_first(self) -> None:
        """Start the next leg only at the mission's altitude."""
        self.climb_required = True

    def climbed(self) -> None:
        """The vehicle is at the mission's altitude."""
        self.climb_required = False
