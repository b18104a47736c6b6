"""Keeps the autopilot's geofence: loads it some time after the upload, and looks for breaches."""

from __future__ import annotations

import math
from typing import Final

from sitl.px4sim.plan.fence import Fence, FenceArea, FenceConflict, fence_areas
from sitl.px4sim.plan.mission_items import MissionType
from sitl.px4sim.plan.plan_store import PlanStore
from sitl.px4sim.safety.failsafe import Action
from sitl.px4sim.state.notice import Severity
from sitl.px4sim.state.situation import Situation

_LOAD_S: Final = 0.35  # PX4 has it in force 0.2 to 0.5 s after it acknowledged the upload
_CHECK_S: Final = 0.2
_ACTIONS: Final = {
    1: Action.WARN,
    2: Action.HOLD,
    3: Action.RTL,
    4: Action.TERMINATE,
    5: Action.LAND,
}
_CONFLICTS: Final = {
    FenceConflict.HOME: (
        "Geofence invalid, doesn't contain Home position",
        "navigator_geofence_invalid_against_home",
    ),
    FenceConflict.VEHICLE: (
        "Geofence invalid, doesn't contain current vehicle position",
        "navigator_geofence_invalid_against_cur_pos",
    ),
}


class FenceGuard:
    """The fence in force.

    Attributes:
        fence: What missions and repositions are checked against.
        violated: Whether the vehicle was on the wrong side when it was looked at last.
    """

    def __init__(self, plan: PlanStore) -> None:
        self._plan = plan
        self._identifier = 0  # checksum of the fence seen last; 0: none
        self._load_at_s: float | None = None  # simulated time; None: nothing to load
        self._checked_s = -math.inf  # simulated time of the last look
        self.fence = Fence()
        self.violated = False

    @property
    def loading(self) -> bool:
        """Whether an uploaded fence is not in force yet."""
        return self._load_at_s is not None

    def load_if_due(self, situation: Situation) -> bool:
        """Take up an uploaded fence; whether that happened now."""
        identifier = self._plan.identifier(MissionType.FENCE)
        if identifier != self._identifier:
            self._identifier = identifier
            self._load_at_s = situation.time_s + _LOAD_S
        if self._load_at_s is None or situation.time_s < self._load_at_s:
            return False
        self._load_at_s = None
        areas = fence_areas(self._plan.items(MissionType.FENCE), situation.projection)
        self._load(areas, situation)
        return True

    def breach(self, situation: Situation) -> Action:
        """What to do about a breach that has just begun; looked for five times a second."""
        action = _ACTIONS.get(int(situation.parameters["GF_ACTION"]), Action.NONE)
        if action is Action.NONE or situation.time_s - self._checked_s < _CHECK_S:
            return Action.NONE
        self._checked_s = situation.time_s
        before, self.violated = self.violated, self._breached(situation)
        if before or not self.violated or not situation.armed:
            return Action.NONE
        situation.say("Geofence: approaching or outside geofence", severity=Severity.CRITICAL)
        return action

    def allows(self, north_m: float, east_m: float, situation: Situation) -> bool:
        """Whether a point may be gone to: GF_MAX_HOR_DIST is kept, too."""
        furthest_m, home = situation.parameters["GF_MAX_HOR_DIST"], situation.home
        near = home is None or furthest_m <= 0 or math.dist(home, (north_m, east_m)) < furthest_m
        return near and self.fence.allows(north_m, east_m)

    def _breached(self, situation: Situation) -> bool:
        height_m = situation.altitude_m - situation.home_altitude_m
        highest_m = situation.parameters["GF_MAX_VER_DIST"]
        too_high = situation.home is not None and 0 < highest_m <= height_m
        return too_high or not self.allows(situation.north_m, situation.east_m, situation)

    def _load(self, areas: tuple[FenceArea, ...], situation: Situation) -> None:
        def report(conflict: FenceConflict) -> None:
            text, event = _CONFLICTS[conflict]
            situation.say(text, event, Severity.CRITICAL)

        acts = situation.parameters["GF_ACTION"] > 0
        flying = acts and not situation.landed
        vehicle = (situation.north_m, situation.east_m) if flying else None
        self.fence.load(areas, situation.home, vehicle, report)
