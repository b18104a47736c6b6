"""When the mission ends: the battery at its reserve, the charge for the way home, its time over."""

from __future__ import annotations

from dataclasses import dataclass, field

from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.states import Signal, State
from air_router.controller.states.return_state import HomeReachability
from air_router.routing.return_planner import LANDING_MARGIN, WayHome
from air_router.vehicle.vehicle import Telemetry


@dataclass(slots=True, eq=False)
class ReturnMonitor:
    """Decides when the mission ends, and says where no way leads home.

    Args:
        context: The charge, and since when the mission is in the air.
        reachability: Whether zones leave a way home.
    """

    _context: MissionContext
    _reachability: HomeReachability
    _way_home: WayHome = field(default_factory=WayHome)

    @property
    def need_home(self) -> float | None:
        """The charge that flying home from here takes; None when unknown, or on the way already."""
        return self._way_home.need_now if self._context.knows(Signal.COME_HOME) else None

    def check(self, telemetry: Telemetry) -> None:
        """End the mission if it is time; say it, loudly, where no way leads home."""
        context, reachability = self._context, self._reachability
        if context.state is not State.LAND and (
            telemetry.time_s >= reachability.look_at_s
            or reachability.walls is not None
            or reachability.among is not context.mission
        ):
            news = reachability.look(telemetry, due=context.state is State.HOME)
            if news is not None:
                context.say(news)
        if Signal.COME_HOME in context.spec.on:
            why = self.due(telemetry)
            if why is not None:
                context.come_home(why)

    def due(self, telemetry: Telemetry) -> str | None:
        """Why the vehicle comes home now; None to stay out."""
        context, mission, charge = self._context, self._context.mission, telemetry.battery
        need_home = None
        if context.pace.endurance_s is not None:
            need_home = self._way_home.need(telemetry, context.router)
        if charge is not None and charge <= mission.battery_reserve:
            return f"battery at {charge:.0%}"
        if charge is not None and need_home is not None and charge <= need_home + LANDING_MARGIN:
            return (
                f"battery at {charge:.0%}: the way home takes {need_home:.0%}, "
                f"{LANDING_MARGIN:.0%} are to be left on the ground"
            )
        airborne_s = 0.0 if context.airborne_s is None else context.now_s - context.airborne_s
        if mission.duration_s is not None and airborne_s >= mission.duration_s:
            return f"{mission.duration_s:.0f} s of mission are over"
        return None
