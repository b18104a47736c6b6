"""Back up to the mission's altitude before the first leg of a vehicle that was taken over lower."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from air_router.controller.model.actions import FlyToNode, FlyToPoint, Motion
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.monitor.safety_monitor import low
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import stopping_point
from air_router.mission.mission import Mission
from air_router.vehicle.vehicle import Telemetry

CLIMB_S: Final = 20.0
PROGRESS_M: Final = 0.5
"""A climb that gains less than this in that time does not go on."""


@dataclass(slots=True, eq=False)
class Levelling:
    """Has a vehicle climb straight up where it is, and only then fly its legs.

    Args:
        context: How high it is, and what is flown once it is level.
        gate: Commands the climb.

    Attributes:
        wanted: The next leg is begun at the mission's altitude: the vehicle was taken over, and
            may be anywhere. Stays until it is there.
        climb: Its way up; None: it does not climb.
    """

    _context: MissionContext
    _gate: CommandGate
    wanted: bool = False
    climb: FlyToPoint | None = None
    _gained: tuple[float, float] = (0.0, 0.0)

    def why_not(self, telemetry: Telemetry) -> str | None:
        """Why it cannot climb here by itself, and what the pilot does; None if it can, or is up."""
        mission, here = self._context.mission, telemetry.position
        if not low(mission, telemetry):
            return None
        drift_m = mission.planner.tracking_margin_m
        column = mission.column_airspace.as_drawn().with_margin(drift_m)
        names = column.blockers(here, here) or _layers_between(mission, telemetry)
        if not names:
            return None
        return (
            f"it is {telemetry.altitude_m:.0f} m above home, too near to {' and '.join(names)} to "
            f"climb by itself: climb to {mission.altitude_above_home_m:.0f} m by hand, then choose "
            "Hold"
        )

    def first(self, motion: Motion) -> Motion | None:
        """An interlock: the leg of a vehicle that is low waits, and it climbs instead."""
        if not self.wanted or not isinstance(motion, FlyToNode | FlyToPoint):
            return motion
        mission, telemetry = self._context.mission, self._context.heard
        if not low(mission, telemetry):
            self.wanted = False
            return motion
        self._gate.navigator.stop()
        why_not = self.why_not(telemetry)
        if why_not is not None:
            self._gate.wait_here(why_not)
            return None
        if self.climb is None:
            self._context.say(
                f"climbing from {telemetry.altitude_m:.0f} to "
                f"{mission.altitude_above_home_m:.0f} m first"
            )
            self._gained = (telemetry.altitude_m, self._context.now_s)
        place = stopping_point(telemetry, self._gate.navigator.reaction_s)
        self.climb = FlyToPoint(place, mission.altitude_above_home_m)
        return self.climb

    def go_on(self, telemetry: Telemetry) -> bool:
        """Whether it climbs, and everything else waits."""
        if self.climb is None:
            return False
        if self._gate.commanded_mode.last is not self.climb:
            # It did not follow, or was told to hold: the climb begins anew before the next leg.
            self.climb = None
            return False
        if low(self._context.mission, telemetry):
            if telemetry.altitude_m > self._gained[0] + PROGRESS_M:
                self._gained = (telemetry.altitude_m, telemetry.time_s)
            return True
        self.climb = None
        self.wanted = False
        self._context.handler.replan()
        return True

    @property
    def stuck(self) -> bool:
        """Whether a climb has not gone on for some time."""
        return self.climb is not None and self._context.now_s - self._gained[1] >= CLIMB_S


def _layers_between(mission: Mission, telemetry: Telemetry) -> tuple[str, ...]:
    """The other UAVs that fly between where the vehicle is and its own layer."""
    own = next((layer for layer in mission.layers if layer.uav == mission.uav), None)
    if own is None:
        return ()
    here_m = telemetry.altitude_m + own.level_m - own.altitude_m
    lowest_m = here_m - mission.planner.vertical_separation_m
    return tuple(o.uav for o in mission.layers if lowest_m < o.level_m < own.level_m)
