"""Takes up what was stored over MAVLink: a new mission, another current item, a new fence."""

from __future__ import annotations

from sitl.px4sim.modes.auto_modes import ReturnFlight
from sitl.px4sim.modes.mission_flight import MissionFlight
from sitl.px4sim.plan.feasibility import mission_feasible
from sitl.px4sim.plan.mission_items import MissionType
from sitl.px4sim.plan.plan_store import PlanStore
from sitl.px4sim.safety.fence_guard import FenceGuard
from sitl.px4sim.state.situation import Situation


class PlanIntake:
    """Hands the stored plan to those who fly by it, when it has changed."""

    def __init__(
        self, plan: PlanStore, guard: FenceGuard, mission: MissionFlight, returning: ReturnFlight
    ) -> None:
        self._plan = plan
        self._guard = guard
        self._mission = mission
        self._return = returning
        self._revision = 0  # of the plan store, when it was looked at last
        self._mission_id = 0  # checksum of the mission that is loaded; 0: none

    def step(self, situation: Situation) -> None:
        """Look for changes."""
        plan, mission = self._plan, self._mission
        fence_loaded = self._guard.load_if_due(situation)
        if plan.revision != self._revision:
            self._revision = plan.revision
            self._return.rally_points = tuple(
                situation.projection.to_local(item.latitude_deg, item.longitude_deg)
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
                mission.restart(situation)
        plan.active = mission.result.current

    def _load(self, situation: Situation) -> None:
        """A mission that replaces one in flight is flown on with, from the index it has.

        While a fence is being loaded the verdict on the mission has to wait.
        """
        mission = self._mission
        index = mission.index if self._plan.current is None else self._plan.current
        was_under_way = mission.under_way
        items = self._plan.items(MissionType.MISSION)
        valid = mission.result.valid if self._guard.loading else self._feasible(situation)
        mission.load(items, index, valid=valid and bool(items))
        if was_under_way:
            mission.restart(situation)

    def _feasible(self, situation: Situation) -> bool:
        items = self._plan.items(MissionType.MISSION)
        return mission_feasible(items, self._guard.fence, situation)
