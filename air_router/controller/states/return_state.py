"""Coming home in time: the state HOME."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.model.mission_context import MissionContext, StateHandler
from air_router.controller.model.states import Signal, State
from air_router.controller.monitor.flight_phase import FlightPhase
from air_router.controller.monitor.home_reachability import HomeReachability
from air_router.controller.monitor.triggers import reason_to_return
from air_router.controller.motion.command_gate import RETRY_S, CommandGate
from air_router.controller.motion.navigator import Goal, stopping_point
from air_router.mission.flight_plan import HOME_NODE
from air_router.routing.return_planner import WayHome
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point

POSITION_S: Final = 1.0
"""A vehicle whose positions have been missing for longer is not known to be above home."""

LANDING_M: Final = 1.0
"""So much farther from home than the acceptance radius it may be when it is told to land."""


@dataclass(slots=True, eq=False)
class ReturnState(StateHandler):
    """Decides when the mission ends, says where it cannot, and flies home.

    Args:
        context: Where it signals that the vehicle comes home, and that it is there.
        gate: Flies home.
        flight_phase: Since when the mission is in the air.
        reachability: Whether zones leave a way home.

    Attributes:
        why: Why the vehicle comes home, once it does.
    """

    _context: MissionContext
    _gate: CommandGate
    _flight_phase: FlightPhase
    _reachability: HomeReachability
    why: str | None = None
    _by_request: bool = False
    _way_home: WayHome = field(default_factory=WayHome)

    # When.

    @property
    def need_home(self) -> float | None:
        """The charge that flying home from here takes; None when unknown, or on the way already."""
        return self._way_home.need_now if self._can_end else None

    @property
    def _can_end(self) -> bool:
        """Whether the mission can still be ended."""
        return self._context.knows(Signal.COME_HOME)

    def check(self, telemetry: Telemetry) -> None:
        """End the mission if it is time; say it, loudly, where no way leads home."""
        if self._context.state is not State.LAND:
            news = self._reachability.look(telemetry, due=self._context.state is State.HOME)
            if news is not None:
                self._context.say(news)
        if self._can_end:
            why = self._due(telemetry)
            if why is not None:
                self.come_home(why)

    def _due(self, telemetry: Telemetry) -> str | None:
        since_s = self._flight_phase.since_s(self._context.now_s)
        need = self._way_home.need(telemetry, self._context.router)
        return reason_to_return(self._context.mission, telemetry, since_s, need)

    def come_home(self, why: str) -> None:
        """End the mission, in the air by flying home."""
        if not self._can_end:
            return
        self.why = why
        if self._context.in_air:
            self._context.signal(Signal.COME_HOME)
        else:
            self._flight_phase.stayed_why = why
            self._context.signal(Signal.GROUNDED)

    def come_home_on_request(self, who: str) -> None:
        """The same on request; the operator may call it off."""
        self._by_request = self._context.state is not State.READY
        self.come_home(f"{who}'s word")

    def call_off(self) -> None:
        """The way home is not flown on."""
        self.why = None
        self._by_request = False

    def objection(self) -> str | None:
        """Why its way home cannot be called off; None if it may."""
        if self._context.state is State.HOME and self._by_request:
            return self._due(self._context.heard)
        return self.why

    # The flight itself.

    def begin(self) -> None:
        """Fly home along the graph, and say why."""
        self._context.say(f"coming home: {self.why}")
        self._go()

    def arrived(self) -> None:
        """Land, if this is home."""
        goal = self._gate.navigator.goal
        if goal is not None and goal.node == HOME_NODE:
            self._above_home(goal.position)

    def no_route(self, refusal: str) -> None:
        """Wait where it is."""
        self._gate.wait_for_way(refusal)

    def retry(self) -> None:
        """By another way, perhaps."""
        self._go()

    replan = retry

    def _go(self) -> None:
        self._gate.fly_to(Goal(self._context.mission.home, HOME_NODE))

    def _above_home(self, home: Point) -> None:
        """Land if it stays here, and no order from before may take it away: it would land there."""
        telemetry = self._context.heard
        near_m = self._context.mission.planner.acceptance_radius_m + LANDING_M
        under_way = set(self._gate.navigator.setpoints.open(telemetry)) - {home}
        places = (telemetry.position, stopping_point(telemetry))  # it may be passing by
        known = telemetry.ages.position_s < POSITION_S
        near = known and all(math.dist(place, home) <= near_m for place in places)
        if near and not under_way:
            self._context.signal(Signal.ARRIVED)
        elif not (self._gate.commanded_mode.pending or self._context.retrying):
            self._context.retry_in(RETRY_S)
