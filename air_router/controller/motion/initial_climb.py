"""Off the ground, and up to the mission's altitude: legs are checked for that and no other."""

from __future__ import annotations

from dataclasses import dataclass, field

from air_router.controller.model import FlyToNode, FlyToPoint, MissionContext, Motion
from air_router.controller.motion.limits import ALTITUDE_M, CLIMB_S, PROGRESS_M
from air_router.controller.motion.setpoints import stopping_point
from air_router.mission import Mission
from air_router.vehicle import Telemetry


@dataclass(frozen=True, slots=True)
class NoClimb:
    """Why the vehicle cannot climb by itself from where it is, and hovers."""

    why: str


@dataclass(slots=True)
class ClimbWatch:
    """Sees whether a climb goes on."""

    _highest: tuple[float, float] | None = None  # the last progress: altitude, time

    def stuck(self, telemetry: Telemetry) -> bool:
        """Whether it has not gained height for some time."""
        if self._highest is None or telemetry.altitude_m > self._highest[0] + PROGRESS_M:
            self._highest = (telemetry.altitude_m, telemetry.time_s)
        return telemetry.time_s - self._highest[1] >= CLIMB_S


def below(altitude_m: float, telemetry: Telemetry) -> bool:
    """Whether the vehicle is below an altitude above home."""
    return telemetry.altitude_m < altitude_m - min(ALTITUDE_M, altitude_m / 2)


def low(mission: Mission, telemetry: Telemetry) -> bool:
    """Whether the vehicle is below the mission's altitudes, where no leg was checked."""
    return below(mission.altitudes_m[0], telemetry)


@dataclass(slots=True, eq=False)
class InitialClimb:
    """Has a vehicle climb straight up where it is, and only then fly its legs.

    Args:
        context: How high it is, and what is flown once it is level.

    Attributes:
        climb: Its way up; None: it does not climb.
    """

    _context: MissionContext
    climb: FlyToPoint | None = None
    _watch: ClimbWatch = field(default_factory=ClimbWatch)

    def why_not(self, telemetry: Telemetry) -> str | None:
        """Why it cannot climb here by itself, and what the pilot does; None if it can, or is up."""
        mission, here = self._context.airspace.mission, telemetry.position
        if not low(mission, telemetry):
            return None
        # What a first leg keeps: where it has left a zone it hovers on the edge of the margin of
        # routes.
        drift_m = mission.tracking.flown_m
        airspace = mission.airspace_off_cruise(telemetry.altitude_m).with_margin(drift_m)
        names = airspace.blockers(here, here) or _layers_between(mission, telemetry)
        if not names:
            return None
        return (
            f"it is {telemetry.altitude_m:.0f} m above home, too near to {' and '.join(names)} to "
            f"climb by itself: climb to {mission.altitude_above_home_m:.0f} m by hand, then choose "
            "Hold"
        )

    def first(self, motion: Motion, last: Motion | None, reaction_s: float) -> Motion | NoClimb:
        """The leg of a vehicle that is low waits, and it climbs instead.

        Args:
            motion: Wanted.
            last: What the vehicle was commanded last; None: it did not follow.
            reaction_s: After which it follows a command.
        """
        if not isinstance(motion, FlyToNode | FlyToPoint):
            return motion
        mission, telemetry = self._context.airspace.mission, self._context.last_telemetry
        if not low(mission, telemetry):
            self._context.interlocks.climbed()
            return motion
        goes_on = self.climb is not None and last == self.climb
        # Nothing of the way counts any more but where to: if the climb ends early, that is tried.
        self._context.task.head_for(self._context.task.way.goal)
        why_not = self.why_not(telemetry)
        if why_not is not None:
            return NoClimb(why_not)
        if not goes_on:  # another climb than the one that a pilot may have ended
            self._context.inform(
                f"climbing from {telemetry.altitude_m:.0f} to "
                f"{mission.altitude_above_home_m:.0f} m first"
            )
            self._watch = ClimbWatch((telemetry.altitude_m, self._context.now_s))
        place = stopping_point(telemetry, reaction_s)
        self.climb = FlyToPoint(place, mission.altitude_above_home_m)
        return self.climb

    def go_on(self, telemetry: Telemetry, last: Motion | None) -> bool:
        """Whether it climbs, and everything else waits; `last` was commanded last."""
        if self.climb is None:
            return False
        if last != self.climb:
            # The vehicle did not follow, or was commanded to hold: the climb begins anew.
            self.climb = None
            return False
        if below(self.climb.altitude_m, telemetry):
            return True
        self.climb = None
        self._context.interlocks.climbed()
        return True

    def stuck(self, telemetry: Telemetry) -> bool:
        """Whether a climb has not gone on for some time."""
        return self.climb is not None and self._watch.stuck(telemetry)


def _layers_between(mission: Mission, telemetry: Telemetry) -> tuple[str, ...]:
    """The other UAVs that fly between where the vehicle is and its own layer."""
    own = mission.layer
    if own is None:
        return ()
    here_m = telemetry.altitude_m + own.level_m - own.altitude_m
    lowest_m = here_m - mission.planner.vertical_separation_m
    return tuple(o.uav for o in mission.layers if lowest_m < o.level_m < own.level_m)
