"""Responds to lags of this program: announces them, holds, and checks the missed track.

Pure. The missed track is the straight line between the vehicle's positions before and after.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from air_router.controller.limits import LAG_HOLD_S, LAG_RECENT_S, LAG_STEP_M, TELEMETRY_GAP_S
from air_router.controller.model import CompanionLagged, MissionContext
from air_router.controller.safety_monitor import Deviation, Response
from air_router.routing import names_of
from air_router.vehicle import BE_READY, FREE_PROCESSOR, Telemetry
from geo.frame import Point


@dataclass(slots=True, eq=False)
class LagMonitor:
    """Checks what a lag missed.

    Args:
        context: The airspace; receives announcements.
    """

    _context: MissionContext
    _before: Telemetry | None = None  # the previous telemetry
    _gap: tuple[Point, Point, float] | None = None  # the unchecked track, and its end
    _to_check: bool = False  # a lag to respond to
    _stall_s: float = 0.0  # the longest stall of it; 0: only short lags
    _lagged_at_s: float = -math.inf  # time of the last lag, vehicle's clock

    @property
    def recent(self) -> bool:
        """Whether this program has just lagged: missing inputs may wait in its own sockets."""
        return self._context.now_s <= self._lagged_at_s + LAG_RECENT_S

    def note(self, telemetry: Telemetry) -> None:
        """Update from every telemetry, also while a pilot flies."""
        before, self._before = self._before, telemetry
        if (
            before is not None
            and telemetry.received_s - before.received_s > TELEMETRY_GAP_S
            and telemetry.in_air
        ):
            self._gap = (before.position, telemetry.position, telemetry.received_s)

    def lagged(self, event: CompanionLagged) -> None:
        """Announce that this program stalled, or lacked the processor."""
        self._lagged_at_s = self._context.now_s
        telemetry = self._context.telemetry
        if telemetry is None or not (telemetry.armed or telemetry.in_air):
            return  # nothing moved
        self._to_check = True
        if event.within_s is not None:  # it checked in between: no reason to hold
            words = (
                f"the companion lacked the processor for {event.lag_s:.1f} s "
                f"of the last {event.within_s:.0f} s"
            )
        else:
            words = f"the companion stalled for {event.lag_s:.1f} s and checked nothing meanwhile"
            self._stall_s = max(self._stall_s, event.lag_s)
        self._context.warn(words, FREE_PROCESSOR)

    def update(self, telemetry: Telemetry) -> tuple[Deviation, ...]:
        """The deviations of a vehicle that this program commands; once per lag."""
        if not self._to_check:
            return ()
        stall_s, self._stall_s, self._to_check = self._stall_s, 0.0, False
        missed = self._missed(telemetry)
        if stall_s >= LAG_HOLD_S:
            words = f"unmonitored for {stall_s:.1f} s"
            held = Deviation(Response.HOLD, words, FREE_PROCESSOR, counts=True)
            return (held,) if missed is None else (held, missed)
        return () if missed is None else (missed,)

    def _missed(self, telemetry: Telemetry) -> Deviation | None:
        """The smallest clearance of the unchecked track, if it was too small."""
        gap, self._gap = self._gap, None
        if gap is None or telemetry.received_s - gap[2] > LAG_RECENT_S:
            return None
        start, end, _ = gap
        airspace = self._context.airspace.mission.airspace_at(telemetry.altitude_m)
        steps = max(1, math.ceil(math.dist(start, end) / LAG_STEP_M))
        shares = (step / steps for step in range(steps + 1))
        places = [
            Point(
                start.east_m + share * (end.east_m - start.east_m),
                start.north_m + share * (end.north_m - start.north_m),
            )
            for share in shares
        ]
        clearance_left_m, name = min(airspace.clearance_left_m(place) for place in places)
        if clearance_left_m >= 0.0:
            return None
        required_m = airspace.required_m(name)
        left_m = max(clearance_left_m + required_m, 0.0)
        words = (
            f"meanwhile it may have been too near to {names_of((name,))}: {left_m:.1f} m, "
            f"{required_m:g} m are required"
        )
        return Deviation(Response.ANNOUNCE, words, BE_READY)
