"""Coming home in time, where zones leave a way: the state HOME.

A mission is only flown where home can be reached from everywhere; zones that are drawn in flight
may change that. Nothing is flown through them then: the operator is told until one acts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.model.mission_context import MissionContext, StateHandler
from air_router.controller.model.states import Signal, State
from air_router.controller.monitor.flight_phase import FlightPhase
from air_router.controller.motion.command_gate import RETRY_S, CommandGate
from air_router.controller.motion.navigator import Goal
from air_router.controller.motion.pending_setpoints import stopping_point
from air_router.mission.flight_plan import HOME_NODE
from air_router.mission.mission import Mission
from air_router.routing.departure import names_of
from air_router.routing.return_planner import LANDING_MARGIN, WayHome
from air_router.routing.router import Route
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point
from geo.paths.regions import Regions

POSITION_S: Final = 1.0
"""A vehicle whose positions have been missing for longer is not known to be above home."""

LANDING_M: Final = 1.0
"""So much farther from home than the acceptance radius it may be when it is told to land."""


LOOK_S: Final = 5.0
"""How often it is looked whether there is a way; at once after zones have changed."""

TOLD_S: Final = 30.0
"""How often it is told again that there is none."""

_NAMED: Final = 3
"""So many walls are named; more would not be read in the air."""


def reason_to_return(
    mission: Mission, telemetry: Telemetry, airborne_s: float, need_home: float | None = None
) -> str | None:
    """Why the vehicle comes home now; None to stay out.

    Args:
        mission: its battery reserve and duration.
        telemetry: the vehicle's charge.
        airborne_s: seconds since take-off.
        need_home: the charge that flying home from here and landing takes, if that is known.
    """
    charge = telemetry.battery
    if charge is not None and charge <= mission.battery_reserve:
        return f"battery at {charge:.0%}"
    if charge is not None and need_home is not None and charge <= need_home + LANDING_MARGIN:
        return (
            f"battery at {charge:.0%}: the way home takes {need_home:.0%}, "
            f"{LANDING_MARGIN:.0%} are to be left on the ground"
        )
    if mission.duration_s is not None and airborne_s >= mission.duration_s:
        return f"{mission.duration_s:.0f} s of mission are over"
    return None


@dataclass(slots=True, eq=False)
class HomeReachability:
    """Looks for the way home among the zones of now.

    Attributes:
        walls: The zones (and the fence) between the vehicle and home; None while a way is clear.
        among: The mission among whose zones it was looked.
        look_at_s: When it is looked again.
    """

    _context: MissionContext
    walls: tuple[str, ...] | None = None
    among: Mission | None = None
    look_at_s: float = -math.inf
    _tell_at_s: float = -math.inf  # when it is announced again
    _due: bool = False  # it should be on its way home, as announced

    def look(self, telemetry: Telemetry, *, due: bool) -> str | None:
        """What to say now, if anything.

        Args:
            telemetry: where the vehicle is, in the air.
            due: it should be on its way home.
        """
        if self.among is not self._context.mission:
            self.among = self._context.mission
            self.look_at_s = self._tell_at_s = -math.inf
        if telemetry.time_s >= self.look_at_s:
            before = self.walls
            self._look(telemetry)
            if before is not None and self.walls is None:
                self._tell_at_s = -math.inf
                return "a clear way leads home again"
        if self.walls is None:
            return None
        if telemetry.time_s < self._tell_at_s and due == self._due:
            return None
        self._tell_at_s, self._due = telemetry.time_s + TOLD_S, due
        return self._words(telemetry, due=due)

    def _look(self, telemetry: Telemetry) -> None:
        mission, router = self._context.mission, self._context.router
        here, home = telemetry.position, mission.home
        if mission.airspace_at(telemetry.altitude_m).holders(here):
            return  # it leaves that first
        self.look_at_s = telemetry.time_s + LOOK_S
        paths = router.graph.paths
        place = paths.nearest(here)
        if place is not None and paths.connected(home, place):
            self.walls = None
        elif isinstance(router.route(here, HOME_NODE), Route):
            self.walls = None  # by a tight way out
        elif place is None:
            self.walls = ()
        else:
            airspace = mission.planning_airspace
            walls = Regions(airspace).separators(place, home)
            self.walls = walls or airspace.blockers(place, home)  # where home itself is not clear

    def _words(self, telemetry: Telemetry, *, due: bool) -> str:
        walls = self.walls or ()
        named = names_of(walls[::-1][:_NAMED]) or "zones"  # the newest are last
        more = f" and {len(walls) - _NAMED} more" if len(walls) > _NAMED else ""
        charge = "" if telemetry.battery is None else f" (battery at {telemetry.battery:.0%})"
        if not due:
            return (
                f"no way home{charge}: {named}{more} cut it off; take a zone away and "
                "reload, or fly it out by hand"
            )
        return (
            f"no way home{charge}: it should come home and cannot, for {named}{more}; it hovers "
            "until a zone is taken away, a pilot flies it out, or the autopilot's battery "
            "failsafe acts, which may fly through zones"
        )


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
    _by_request: bool = False  # such a return may be called off
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
            why = self._due(telemetry)
            if why is not None:
                self.come_home(why)

    def _due(self, telemetry: Telemetry) -> str | None:
        context, since_s = self._context, self._flight_phase.airborne_s
        airborne_s = 0.0 if since_s is None else context.now_s - since_s
        need = None
        if context.pace.endurance_s is not None:
            need = self._way_home.need(telemetry, context.router)
        return reason_to_return(context.mission, telemetry, airborne_s, need)

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
        self.come_home(f"{who}'s request")

    def land_on_request(self, who: str) -> None:
        """End the mission by landing where it hovers; `why_no_landing` has been asked."""
        self.why = f"{who} asked to land here"
        self._flight_phase.landing_place = f"where it hovered, as {who} asked"
        self._context.signal(Signal.LAND_HERE)

    def why_no_landing(self) -> str | None:
        """Why it may not land where it hovers; None if nothing is below, and it stays there."""
        mission, telemetry = self._context.mission, self._context.heard
        drift_m = math.dist(telemetry.position, stopping_point(telemetry))
        setpoints, commanded = self._gate.navigator.setpoints, self._gate.commanded_mode
        if commanded.pending or setpoints.open(telemetry) or drift_m > LANDING_M:
            return "it does not hover yet; ask again in a moment"
        margin_m = mission.planner.tracking_margin_m
        for airspace in (mission.climb_airspace, mission.airspace_at(telemetry.altitude_m)):
            if not airspace.with_margin(margin_m).point_clear(telemetry.position):
                _, what = airspace.with_margin(margin_m).spare_m(telemetry.position)
                return f"it would come too near to {names_of((what,))}; fly to another place first"
        return None

    def call_off(self) -> None:
        """The way home is not flown on."""
        self.why = None
        self._by_request = False
        self._flight_phase.landing_place = "at home"

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
        elif not (self._gate.commanded_mode.pending or self._context.retry_at_s is not None):
            self._context.retry_in(RETRY_S)
