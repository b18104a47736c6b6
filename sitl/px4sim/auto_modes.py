"""PX4's Hold, Takeoff, Return and Land modes. Pure; one object per mode."""

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from enum import Enum
from typing import Final

from sitl.px4sim.motion import Setpoint, SetpointKind, braking_distance
from sitl.px4sim.state import Situation

_SLOW_M_S: Final = 0.05
_REPOSITION_S: Final = (
    0.5  # [s] so old a DO_REPOSITION may be when PX4 enters Hold (navigator, loiter)
)


class Flight(ABC):
    """How one flight mode flies."""

    def activate(self, situation: Situation) -> None:  # noqa: B027 - most modes need nothing
        """The mode is entered; `situation.setpoint` is what was flown to before."""

    @abstractmethod
    def update(self, situation: Situation) -> Setpoint:
        """What to fly to now."""


class HoldFlight(Flight):
    """AUTO.LOITER: stop, and stay or go where DO_REPOSITION commands."""

    def __init__(self) -> None:
        self._target: Setpoint = Setpoint()
        self._reposition: Setpoint | None = None  # requested, not taken up yet
        self._reposition_s = math.inf  # when it was requested; inf: it does not expire
        self._speed_m_s: float | None = None  # to take up with it; None: as before

    def reposition(
        self, target: Setpoint, speed_m_s: float | None = None, *, time_s: float = math.inf
    ) -> None:
        """Go to a point; taken up with the next step, in this mode or on entering it.

        As in PX4, Hold that is entered more than 0.5 s after the request does not go there.
        """
        self._reposition, self._speed_m_s = target, speed_m_s
        self._reposition_s = time_s

    def move_to(
        self,
        point: tuple[float, float] | None,
        altitude_m: float | None,
        speed_m_s: float | None,
        situation: Situation,
    ) -> None:
        """DO_REPOSITION: north and east in metres, altitude AMSL; None is not given.

        Without a point it goes on to where it was going, at the altitude that is given; without
        anything it stops.
        """
        setpoint = situation.setpoint
        if point is None and altitude_m is None:
            stop = stop_ahead(situation)
            takes_off = setpoint.kind is SetpointKind.TAKEOFF
            point = situation.here if takes_off else (stop.north_m, stop.east_m)
        elif point is None:
            flies = setpoint.kind is SetpointKind.POSITION
            point = (setpoint.north_m, setpoint.east_m) if flies else situation.here
        target_m = situation.altitude_m if altitude_m is None else altitude_m
        target = replace(go_to(*point, target_m, situation), yaw_rad=None)
        self.reposition(target, speed_m_s, time_s=situation.time_s)

    def forget(self) -> None:
        """Drop a target that was not taken up."""
        self._reposition = None

    def activate(self, situation: Situation) -> None:
        """See `Flight`; after a take-off the vehicle stays where that was to end."""
        last = situation.setpoint
        if situation.time_s - self._reposition_s > _REPOSITION_S:
            self.forget()
        if self._reposition is not None:
            return
        if situation.landed:
            self._target = Setpoint()
        elif last.kind is SetpointKind.TAKEOFF:
            self._target = go_to(last.north_m, last.east_m, last.altitude_m, situation)
        else:
            self._target = stop_ahead(situation)

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        if self._reposition is not None and situation.armed:
            self._target, self._reposition = self._reposition, None
            if self._speed_m_s is not None:
                situation.speed_m_s = self._speed_m_s
        if situation.landed:
            self._target = Setpoint()
        return self._target


class TakeoffFlight(Flight):
    """AUTO.TAKEOFF: straight up, then done."""

    def __init__(self) -> None:
        self._wanted_m: float | None = None  # AMSL; None: MIS_TAKEOFF_ALT above here
        self._requested = False  # and not taken up yet
        self._target = Setpoint()
        self.done = False

    def request(self, altitude_amsl_m: float) -> None:
        """NAV_TAKEOFF was commanded; a NaN altitude means MIS_TAKEOFF_ALT above here."""
        self._wanted_m = altitude_amsl_m if math.isfinite(altitude_amsl_m) else None
        self._requested = True

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        if self._requested:
            self.activate(situation)
        acceptance_m = situation.altitude_acceptance_m
        climb_m = self._target.altitude_m - situation.home_altitude_m
        if 0 < climb_m < acceptance_m:
            acceptance_m = climb_m / 2.0
        if situation.altitude_m > self._target.altitude_m - acceptance_m and not situation.landed:
            self.done = True
        return self._target

    def activate(self, situation: Situation) -> None:
        """See `Flight`."""
        altitude_m = self._wanted_m
        if altitude_m is None:
            climb_m = situation.parameters.limited("MIS_TAKEOFF_ALT", 0.0, 1000.0)
            altitude_m = situation.altitude_m + climb_m
            situation.announce("navigator_takeoff_default_alt", climb_m)
        if altitude_m < situation.altitude_m:
            altitude_m = situation.altitude_m
            situation.announce("navigator_takeoff_already_higher")
        self._target = Setpoint(SetpointKind.TAKEOFF, *situation.here, altitude_m)
        self._wanted_m, self._requested, self.done = None, False, False


class LandFlight(Flight):
    """AUTO.LAND: down where it is."""

    def __init__(self) -> None:
        self._target = Setpoint()

    def activate(self, situation: Situation) -> None:
        """See `Flight`."""
        ahead = stop_ahead(situation)
        self._target = Setpoint(SetpointKind.LAND, ahead.north_m, ahead.east_m)

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        return Setpoint() if situation.landed else self._target


class _ReturnPhase(Enum):
    CLIMB = "climb"
    RETURN = "return"
    LAND = "land"


class ReturnFlight(Flight):
    """AUTO.RTL: climb, go home (or to a nearer rally point), land there."""

    def __init__(self) -> None:
        self.rally_points: tuple[tuple[float, float], ...] = ()  # north, east, of the plan
        # Chosen anew on entering; `_phase` goes on by height and distance.
        self._phase = _ReturnPhase.CLIMB
        self._start = (0.0, 0.0)  # north, east: where it was entered and climbs
        self._goal = (0.0, 0.0)  # home or rally point (north, east)
        self._altitude_m = 0.0  # to return at, AMSL

    def activate(self, situation: Situation) -> None:
        """See `Flight`."""
        here = situation.here
        home = situation.home or here
        self._goal = min((home, *self.rally_points), key=lambda point: math.dist(point, here))
        self._start = here
        self._phase = _ReturnPhase.CLIMB
        self._altitude_m = self._return_altitude(situation)
        above_m = math.ceil(self._altitude_m - situation.home_altitude_m)
        situation.announce("vrtl_return_at", math.ceil(self._altitude_m), above_m)

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        if situation.landed:
            return Setpoint()
        low_m = self._altitude_m - situation.altitude_m
        north, east = self._goal
        distance_m = math.dist(self._goal, situation.here)
        if self._phase is _ReturnPhase.CLIMB and low_m < situation.altitude_acceptance_m:
            self._phase = _ReturnPhase.RETURN
        if self._phase is _ReturnPhase.RETURN and distance_m <= situation.acceptance_m:
            self._phase = _ReturnPhase.LAND
            situation.announce("rtl_land_at_destination")
        if self._phase is _ReturnPhase.CLIMB:
            return go_to(*self._start, self._altitude_m, situation)
        if self._phase is _ReturnPhase.LAND:
            return Setpoint(SetpointKind.LAND, north, east)
        return Setpoint(
            SetpointKind.POSITION,
            north,
            east,
            self._altitude_m,
            previous=self._start,
            acceptance_m=situation.acceptance_m,
        )

    def _return_altitude(self, situation: Situation) -> float:
        """PX4's: RTL_RETURN_ALT above home, less within a cone close to home."""
        limited = situation.parameters.limited
        home_m = situation.home_altitude_m
        most_m = home_m + limited("RTL_RETURN_ALT", 0.0, 1000.0)
        distance_m = math.dist(self._start, self._goal)
        acceptance_m = situation.acceptance_m
        if distance_m <= acceptance_m:
            altitude_m = home_m + 2.0 * distance_m
        else:
            altitude_m = most_m
            if distance_m <= limited("RTL_MIN_DIST", 0.5, 1000.0):
                cone_rad = math.radians(limited("RTL_CONE_ANG", 1.0, 89.0))
                altitude_m = min(distance_m / math.tan(cone_rad) + home_m, most_m)
            altitude_m = max(altitude_m, home_m + 2.0 * acceptance_m)
        return max(min(altitude_m, most_m), situation.altitude_m)


def go_to(north_m: float, east_m: float, altitude_m: float, situation: Situation) -> Setpoint:
    """Stay at a point, or go straight there, looking as now."""
    return Setpoint(
        SetpointKind.POSITION,
        north_m,
        east_m,
        altitude_m,
        yaw_rad=situation.heading_rad,
        acceptance_m=situation.acceptance_m,
    )


def stop_ahead(situation: Situation) -> Setpoint:
    """Where PX4 holds on a Hold command: a braking distance ahead, at the present height."""
    north_m_s, east_m_s, _ = situation.velocity_m_s
    speed = math.hypot(north_m_s, east_m_s)
    ahead_s = (
        braking_distance(speed, situation.speed_limits()) / speed if speed > _SLOW_M_S else 0.0
    )
    return go_to(
        situation.north_m + north_m_s * ahead_s,
        situation.east_m + east_m_s * ahead_s,
        situation.altitude_m,
        situation,
    )
