"""Takes up what was stored over MAVLink: a new mission, another current item, a new fence.

A mission is checked when it is taken up, not when it is uploaded; what is wrong is said then.
"""

import struct
from typing import Final

from sitl.px4sim.auto_modes import ReturnFlight
from sitl.px4sim.fence import Fence
from sitl.px4sim.mission_flight import MissionFlight
from sitl.px4sim.plan_store import FRAME_RELATIVE, Command, MissionItem, MissionType, PlanStore
from sitl.px4sim.state import Severity, Situation

_LEAST_CLIMB_M: Final = 1e-6


class PlanIntake:
    """Hands the stored plan to those who fly by it, when it has changed."""

    def __init__(
        self, plan: PlanStore, fence: Fence, mission: MissionFlight, returning: ReturnFlight
    ) -> None:
        self._plan = plan
        self._fence = fence
        self._mission = mission
        self._return = returning
        self._revision = 0  # of the plan store, when it was looked at last
        self._mission_id = 0  # checksum of the mission that is loaded; 0: none

    def step(self, situation: Situation) -> None:
        """Look for changes."""
        plan, mission = self._plan, self._mission
        fence_loaded = self._fence.load_if_due(situation)
        if plan.revision != self._revision:
            self._revision = plan.revision
            self._return.rally_points = tuple(
                situation.projection.to_local(*item.degrees)
                for item in plan.items(MissionType.RALLY)
            )
            identifier = plan.identifier(MissionType.MISSION)
            if identifier != self._mission_id:
                self._mission_id = identifier
                self._load(situation)
            elif plan.current is not None and plan.current != mission.index:
                mission.jump(plan.current, situation)
            plan.current = None
        if fence_loaded:
            mission.judge(valid=self._feasible(situation))
            if mission.under_way:
                mission.begin(situation)
        plan.active = mission.result.current

    def _load(self, situation: Situation) -> None:
        """A mission that replaces one in flight is flown on with, from the index it has.

        While a fence is being loaded the verdict on the mission has to wait.
        """
        mission = self._mission
        index = mission.index if self._plan.current is None else self._plan.current
        was_under_way = mission.under_way
        items = self._plan.items(MissionType.MISSION)
        valid = mission.result.valid if self._fence.loading else self._feasible(situation)
        mission.load(items, index, valid=valid and bool(items))
        if was_under_way:
            mission.begin(situation)

    def _feasible(self, situation: Situation) -> bool:
        """Check the mission and say what is wrong; a leg across a fence is not looked at."""
        items = self._plan.items(MissionType.MISSION)
        return (
            bool(items) and _items_feasible(items, situation) and self._fence_kept(items, situation)
        )

    def _fence_kept(self, items: tuple[MissionItem, ...], situation: Situation) -> bool:
        to_local = situation.projection.to_local
        for number, item in enumerate(items, 1):
            if item.has_position and not self._fence.encloses(*to_local(*item.degrees)):
                situation.say(
                    f"Geofence violation for waypoint {number}",
                    "navigator_mis_geofence_violation",
                    Severity.CRITICAL,
                    Severity.ERROR,
                    struct.pack("<h", min(number, 32767)),
                )
                return False
        return True


def _items_feasible(items: tuple[MissionItem, ...], situation: Situation) -> bool:
    feasible = True
    seen_position = False
    for number, item in enumerate(items, 1):
        if number == 1 and item.command == Command.NAV_LAND and situation.landed:
            _reject(situation, "navigator_mis_starts_w_landing")
            return False
        if item.command == Command.NAV_TAKEOFF:
            feasible &= _takeoff_feasible(item, situation, seen_position=seen_position)
        seen_position = seen_position or item.command != Command.DO_CHANGE_SPEED
    return feasible


def _takeoff_feasible(item: MissionItem, situation: Situation, *, seen_position: bool) -> bool:
    offset_m = 0.0 if item.frame == FRAME_RELATIVE else situation.home_altitude_m
    if item.z - offset_m < _LEAST_CLIMB_M:
        _reject(situation, "navigator_mis_takeoff_too_low", struct.pack("<f", offset_m))
        return False
    if seen_position:
        _reject(situation, "navigator_mis_takeoff_not_first")
        return False
    return True


def _reject(situation: Situation, event: str, arguments: bytes = b"") -> None:
    """PX4 1.17's checker has no channel for texts: these reasons exist only as events."""
    situation.say("", event, Severity.ERROR, None, arguments)
