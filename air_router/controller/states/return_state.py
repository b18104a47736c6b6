"""The states HOME, LAND, PASSIVE and DONE: comes home if there is a way, and lands.

A mission flies only if home can be reached from every waypoint. Zones drawn in flight may change
that. The vehicle then flies through no zone: an alarm to the operator repeats until someone acts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from air_router.controller.model import (
    Goal,
    LandHere,
    MissionContext,
    Rest,
    Signal,
    StateHandler,
    Wanted,
)
from air_router.controller.motion import RETRY_S, CommandGate, stopping_point
from air_router.controller.states.limits import (
    ANNOUNCE_AGAIN_S,
    CHECK_S,
    LANDING_M,
    NAMED,
    POSITION_S,
    WIDEST_M,
)
from air_router.mission import HOME_NODE, Mission
from air_router.routing import Route, Router, names_of
from air_router.vehicle import BRING_HOME_BY_HEIGHT, FLY_OUT_OR_RELOAD, Telemetry
from geo.frame import Point
from geo.paths import barriers


def landing_radius_m(mission: Mission) -> float:
    """Radius around home, in meters, within which a landing may begin."""
    return min(mission.planner.acceptance_radius_m, WIDEST_M) + LANDING_M


@dataclass(slots=True, eq=False)
class HomeReachability:
    """Checks whether the current zones leave a way home.

    Attributes:
        walls: The zones (and the fence) between the vehicle and home; None while there is a clear
            way.
        checked_router: The router of the last check.
        next_check_s: Time of the next check.
    """

    _context: MissionContext
    walls: tuple[str, ...] | None = None
    checked_router: Router | None = None
    next_check_s: float = -math.inf
    _announce_at_s: float = -math.inf  # when to repeat the announcement
    _due: bool = False  # `due` of the last announcement

    @property
    def no_way_home(self) -> bool:
        """Whether zones drawn in flight block every way home from here."""
        return self.walls is not None

    def update(self, telemetry: Telemetry, *, due: bool) -> None:
        """Announce that there is no way home, repeatedly, and when there is one again.

        Args:
            telemetry: Position of the vehicle in the air.
            due: The vehicle should be on its way home.
        """
        if self.checked_router is not self._context.airspace.router:
            self.checked_router = self._context.airspace.router
            self.next_check_s = self._announce_at_s = -math.inf
        if telemetry.time_s >= self.next_check_s:
            before = self.walls
            self._plan_home(telemetry)
            if before is not None and self.walls is None:
                self._announce_at_s = -math.inf
                self._context.inform("a clear way leads home again")
                return
        if self.walls is None or (telemetry.time_s < self._announce_at_s and due == self._due):
            return
        self._announce_at_s, self._due = telemetry.time_s + ANNOUNCE_AGAIN_S, due
        self._announce(telemetry, due=due)

    def _plan_home(self, telemetry: Telemetry) -> None:
        mission, router = self._context.airspace.mission, self._context.airspace.router
        here, home = telemetry.position, mission.home
        if mission.airspace_at(telemetry.altitude_m).zones_at(here):
            return  # the vehicle leaves that zone first
        self.next_check_s = telemetry.time_s + CHECK_S
        paths = router.graph.paths
        place = paths.nearest(here)
        if place is not None and paths.connected(home, place):
            self.walls = None
        elif isinstance(router.route(here, HOME_NODE), Route):
            self.walls = None  # through a tight way out
        elif place is None:
            self.walls = ()
        else:
            airspace = router.graph.mission.planning_airspace
            walls = barriers(airspace, place, home)
            self.walls = walls or airspace.blockers(place, home)  # home itself is not clear

    def _announce(self, telemetry: Telemetry, *, due: bool) -> None:
        context, walls = self._context, self.walls or ()
        named = names_of(walls[::-1][:NAMED]) or "zones"  # the newest are last
        more = f" and {len(walls) - NAMED} more" if len(walls) > NAMED else ""
        charge = "" if telemetry.battery is None else f" (battery at {telemetry.battery:.0%})"
        if due and context.airspace.mission.all_zones:
            context.alarm(
                f"no way home is clear at every altitude{charge}, because of {named}{more}: "
                "it hovers, and comes home by PX4's altitude at the battery reserve",
                BRING_HOME_BY_HEIGHT,
            )
        elif due:
            context.alarm(
                f"no way home{charge}: it should come home and cannot, because of {named}{more}; "
                "it hovers until PX4's battery failsafe acts, which may fly through zones",
                FLY_OUT_OR_RELOAD,
            )
        else:
            context.warn(f"no way home{charge}: {named}{more} cut it off", FLY_OUT_OR_RELOAD)


@dataclass(slots=True, eq=False)
class ReturnState(StateHandler):
    """Flies home along the graph.

    Args:
        context: Receives the signal that the vehicle is above home.
        gate: Knows the motions commanded before.
    """

    _context: MissionContext
    _gate: CommandGate

    def begin(self) -> Wanted:
        """Announce the reason and fly home along the graph."""
        ending = self._context.task.ending
        assert ending is not None  # noqa: S101 - `come_home` sets it before the state begins
        text = f"coming home: {ending.why}"
        if self._context.inputs.stopped:
            text = f"{text}; it holds until that is known again"
        self._context.announce(text, ending.instruction)
        return self.retry()

    def arrived(self) -> Wanted:
        """Land, if this is home."""
        goal = self._context.task.way.goal
        if goal is None or goal.node != HOME_NODE:
            return Rest("this is not home")
        return self._above_home(goal.position)

    def retry(self) -> Wanted:
        """Plan the way home again."""
        return Goal(self._context.airspace.mission.home, HOME_NODE)

    replan = retry

    def _above_home(self, home: Point) -> Wanted:
        """Land if the vehicle stays here and no earlier command may still move it."""
        telemetry = self._context.last_telemetry
        near_m = landing_radius_m(self._context.airspace.mission)
        under_way = set(self._gate.setpoints.open(telemetry)) - {home}
        places = (telemetry.position, stopping_point(telemetry))  # it may only be passing
        known = telemetry.ages.position_s < POSITION_S
        near = known and all(math.dist(place, home) <= near_m for place in places)
        if near and not under_way:
            return Signal.ARRIVED
        waits = self._gate.pending is not None or self._context.task.retry_at_s is not None
        return Rest("it settles above home", None if waits else RETRY_S)


@dataclass(slots=True, eq=False)
class LandState(StateHandler):
    """Descends, at home or where the vehicle hovers.

    Args:
        context: The vehicle's position, and the zones and layers below.
        gate: Commands the landing.
    """

    _context: MissionContext
    _gate: CommandGate

    def why_no_landing(self) -> str | None:
        """Why the vehicle may not land in place; None if nothing is below and it hovers still."""
        mission, telemetry = self._context.airspace.mission, self._context.last_telemetry
        drift_m = math.dist(telemetry.position, stopping_point(telemetry))
        gate = self._gate
        if gate.pending or gate.setpoints.open(telemetry) or drift_m > LANDING_M:
            return "it does not hover yet; request it again in a moment"
        home_m = math.dist(telemetry.position, mission.home)
        if mission.layers_below and home_m > landing_radius_m(mission):
            below = ", ".join(mission.layers_below)
            return f"the layer of {below} is below; it lands at home only: 'home'"
        margin_m = mission.tracking.planned_m
        for airspace in (mission.climb_airspace, mission.airspace_at(telemetry.altitude_m)):
            if not airspace.with_margin(margin_m).point_clear(telemetry.position):
                _, what = airspace.with_margin(margin_m).clearance_left_m(telemetry.position)
                return f"it would come too near to {names_of((what,))}; fly to another place first"
        return None

    def begin(self) -> Wanted:
        """Command the landing."""
        return LandHere()

    def replan(self) -> Wanted:
        """Command the landing again, unless the last one is still in effect."""
        if not isinstance(self._gate.last, LandHere):
            return self.begin()
        return Rest("it descends")

    retry = replan


@dataclass(slots=True, eq=False)
class HandsOffState(StateHandler):
    """PASSIVE and DONE: a pilot or failsafe flies the vehicle, or it has landed."""
