"""The climb to the mission's altitude before the first leg, because legs are checked only there."""

from __future__ import annotations

from dataclasses import dataclass, field

from air_router.controller.model import FlyToNode, FlyToPoint, MissionContext, Motion
from air_router.controller.motion.limits import ALTITUDE_M, CLIMB_S, PROGRESS_M
from air_router.controller.motion.setpoints import stopping_point
from air_router.mission import Mission
from air_router.vehicle import Telemetry


@dataclass(frozen=True, slots=True)
class NoClimb:
    """Why the vehicle hovers instead of climbing from its position."""

    why: str


@dataclass(slots=True)
class ClimbWatch:
    """Monitors the progress of a climb."""

    _highest: tuple[float, float] | None = None  # altitude and time of the last progress

    def stuck(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle has not gained altitude for some time."""
        if self._highest is None or telemetry.altitude_m > self._highest[0] + PROGRESS_M:
            self._highest = (telemetry.altitude_m, telemetry.time_s)
        return telemetry.time_s - self._highest[1] >= CLIMB_S


def below(altitude_m: float, telemetry: Telemetry) -> bool:
    """Whether the vehicle is clearly below an altitude above home."""
    return telemetry.altitude_m < altitude_m - min(ALTITUDE_M, altitude_m / 2)


def low(mission: Mission, telemetry: Telemetry) -> bool:
    """Whether the vehicle is below the mission's altitudes, where legs are not checked."""
    return below(mission.altitudes_m[0], telemetry)


@dataclass(slots=True, eq=False)
class InitialClimb:
    """Climbs straight up to the mission's altitude before the vehicle flies legs.

    Args:
        context: Telemetry and task.

    Attributes:
        climb: The climb in progress; None: there is none.
    """

    _context: MissionContext
    climb: FlyToPoint | None = None
    _watch: ClimbWatch = field(default_factory=ClimbWatch)

    def why_not(self, telemetry: Telemetry) -> str | None:
        """Why the vehicle cannot climb here, with the pilot's action; None: it can, or need not."""
        mission, here = self._context.airspace.mission, telemetry.position
        if not low(mission, telemetry):
            return None
        # The margin of a first leg: after leaving a zone, the vehicle hovers at the edge of the
        # routes' margin.
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
        """Replace a leg by a climb if the vehicle is low.

        Args:
            motion: The requested motion.
            last: The last command; None: the vehicle did not follow.
            reaction_s: Delay before the vehicle follows a command.
        """
        if not isinstance(motion, FlyToNode | FlyToPoint):
            return motion
        mission, telemetry = self._context.airspace.mission, self._context.last_telemetry
        if not low(mission, telemetry):
            self._context.interlocks.climbed()
            return motion
        continued = self.climb is not None and last == self.climb
        # Only the goal of the way is kept: if the climb ends early, a new way is planned.
        self._context.task.head_for(self._context.task.way.goal)
        why_not = self.why_not(telemetry)
        if why_not is not None:
            return NoClimb(why_not)
        if not continued:
            self._context.inform(
                f"climbing from {telemetry.altitude_m:.0f} to "
                f"{mission.altitude_above_home_m:.0f} m first"
            )
            self._watch = ClimbWatch((telemetry.altitude_m, self._context.now_s))
        place = stopping_point(telemetry, reaction_s)
        self.climb = FlyToPoint(place, mission.altitude_above_home_m)
        return self.climb

    def continues(self, telemetry: Telemetry, last: Motion | None) -> bool:
        """Whether the vehicle climbs, so that everything else waits; `last` is the last command."""
        if self.climb is None:
            return False
        if last != self.climb:
            # The vehicle did not follow, or was commanded to hold: the climb starts again.
            self.climb = None
            return False
        if below(self.climb.altitude_m, telemetry):
            return True
        self.climb = None
        self._context.interlocks.climbed()
        return True

    def stuck(self, telemetry: Telemetry) -> bool:
        """Whether a climb has made no progress for some time."""
        return self.climb is not None and self._watch.stuck(telemetry)


def _layers_between(mission: Mission, telemetry: Telemetry) -> tuple[str, ...]:
    """The other UAVs with layers between the vehicle and its own layer."""
    own = mission.layer
    if own is None:
        return ()
    here_m = telemetry.altitude_m + own.level_m - own.altitude_m
    lowest_m = here_m - mission.planner.vertical_separation_m
    return tuple(o.uav for o in mission.layers if lowest_m < o.level_m < own.level_m)
