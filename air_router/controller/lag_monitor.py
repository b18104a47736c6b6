"""What follows where this program itself stood still: it is told, held for, and looked back on.

Pure. What the vehicle did meanwhile is known by where it was before and where it is now; between
two positions it is taken to have flown straight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from air_router.controller.model import CompanionLagged, MissionContext
from air_router.controller.safety_monitor import Deviation, Response
from air_router.routing import names_of
from air_router.vehicle import BE_READY, FREE_PROCESSOR, Telemetry
from geo.frame import Point

HOLD_S: Final = 2.0
"""A program that stood still for so long has the vehicle hold before it goes on: 10 m at 5 m/s were
flown unwatched, more than the clearance of most missions."""

GAP_S: Final = 0.5
"""Two telemetries that are farther apart, on the vehicle's clock, have a way between them that was
not looked at."""

RECENT_S: Final = 5.0
"""What is missing so soon after a lag may wait in this program's own sockets: no warning of it."""

_STEP_M: Final = 0.5


@dataclass(slots=True, eq=False)
class LagMonitor:
    """Looks back on what was missed.

    Args:
        context: The airspace; where it is told.
    """

    _context: MissionContext
    _before: Telemetry | None = None  # the telemetry before the newest
    _gap: tuple[Point, Point, float] | None = None  # the way that was not looked at, and until when
    _lag_s: float = 0.0  # to be held for; 0: nothing
    _lagged_at_s: float = -math.inf  # when it was told last, vehicle's clock

    @property
    def recent(self) -> bool:
        """Whether the program has just stood still: what seems to be missing may be its own."""
        return self._context.now_s <= self._lagged_at_s + RECENT_S

    def note(self, telemetry: Telemetry) -> None:
        """Take every telemetry in, also while a pilot has the vehicle."""
        before, self._before = self._before, telemetry
        if before is not None and telemetry.told_s - before.told_s > GAP_S and telemetry.in_air:
            self._gap = (before.position, telemetry.position, telemetry.told_s)

    def lagged(self, event: CompanionLagged) -> None:
        """This program stood still, or was starved: say so."""
        self._lagged_at_s = self._context.now_s
        telemetry = self._context.telemetry
        if telemetry is None or not (telemetry.armed or telemetry.in_air):
            return  # nothing moved
        self._context.warn(
            f"this program stood still for {event.lag_s:.1f} s: it looked at nothing meanwhile",
            FREE_PROCESSOR,
        )
        self._lag_s = max(self._lag_s, event.lag_s)

    def look(self, telemetry: Telemetry) -> tuple[Deviation, ...]:
        """What follows, of a vehicle that is ours; once for each lag."""
        lag_s, self._lag_s = self._lag_s, 0.0
        if lag_s == 0.0:
            return ()
        missed = self._missed(telemetry)
        if lag_s >= HOLD_S:
            words = f"unwatched for {lag_s:.1f} s"
            held = Deviation(Response.HOLD, words, FREE_PROCESSOR, counts=True)
            return (held,) if missed is None else (held, missed)
        return () if missed is None else (missed,)

    def _missed(self, telemetry: Telemetry) -> Deviation | None:
        """The least clearance of the way that was not looked at, if it was too little."""
        gap, self._gap = self._gap, None
        if gap is None or telemetry.told_s - gap[2] > RECENT_S:
            return None
        start, end, _ = gap
        airspace = self._context.mission.airspace_at(telemetry.altitude_m)
        steps = max(1, math.ceil(math.dist(start, end) / _STEP_M))
        shares = (step / steps for step in range(steps + 1))
        places = [
            Point(
                start.east_m + share * (end.east_m - start.east_m),
                start.north_m + share * (end.north_m - start.north_m),
            )
            for share in shares
        ]
        spare_m, name = min(airspace.spare_m(place) for place in places)
        if spare_m >= 0.0:
            return None
        kept_m = airspace.kept_m(name)
        left_m = max(spare_m + kept_m, 0.0)
        words = (
            f"meanwhile it may have been too near to {names_of((name,))}: {left_m:.1f} m, "
            f"{kept_m:g} m are to be kept"
        )
        return Deviation(Response.TELL, words, BE_READY)
