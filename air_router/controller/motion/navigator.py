"""Flies a route leg by leg. Each leg is checked from the vehicle's position, then commanded.

Pure: telemetry in, at most one motion out. The vehicle hovers at the end of each leg until the next
is commanded, so a slow companion costs time but never takes the vehicle off the route.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

from shapely import MultiPoint
from shapely import Point as ShapelyPoint

from air_router.controller.model import (
    Anomaly,
    FlyToNode,
    FlyToPoint,
    Goal,
    HoldHere,
    Hover,
    LandHere,
    MissionContext,
    Motion,
    NoWay,
    Planned,
    Progress,
    Rest,
    Signal,
    Wanted,
)
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.initial_climb import low
from air_router.controller.motion.limits import (
    ASTRAY_M,
    RECHECK_S,
    RECHECKS,
    STALL_S,
    STOP_S,
    WANDERS_M,
)
from air_router.routing import (
    STANDING_M_S,
    Leg,
    Momentum,
    NoRoute,
    PendingSetpoint,
    Route,
    names_of,
)
from air_router.vehicle import Telemetry
from geo.airspace import FENCE
from geo.frame import Point

_AROUND: Final = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Directions in which the next position of a hovering vehicle may differ: east, north."""


@dataclass(slots=True, eq=False)
class Navigator:
    """Flies the vehicle to one goal at a time; its progress is in `Task.way`.

    Nodes are flown to by DO_REPOSITION if the vehicle does not fly its plan
    (`CommandGate.by_points`), or while home's altitude has changed since take-off: the plan's items
    are relative to home.

    Args:
        context: Altitudes, the airspace that every leg must keep to, and its router.
        gate: Commands the legs, and knows the earlier commands.
    """

    _context: MissionContext
    _gate: CommandGate
    _recheck_at_s: float = -math.inf  # time of the next check, vehicle's clock

    # What a state requests.

    def follow(self, wanted: Wanted) -> None:
        """Carry out what a state requests, as far as no interlock blocks it."""
        gate, context = self._gate, self._context
        match wanted:
            case Goal():
                self.fly_to(wanted)
            case Planned(motion):
                self.advance(motion)
            case Hover(why, instruction, at_leg_end):
                gate.stop()
                if instruction is not None:
                    gate.wait_here(why, instruction)
                elif not at_leg_end:
                    gate.hold(why)
            case NoWay(refusal):
                gate.wait_for_way(refusal)
            case Signal():
                context.signal(wanted)
            case Rest(_, again_s):
                if again_s is not None:
                    context.retry_in(again_s)
            case _:
                gate.command(wanted)

    def plan_to(self, goal: Goal) -> Motion | None:
        """Plan a way to a goal from the vehicle's position and speed; return its first motion.

        Returns None with progress ARRIVED if there is nothing to fly. If no way is clear at the
        current speed, the vehicle stops and the way is planned again. Progress is NO_ROUTE, with
        the reason in `refusal`, if it hovers and still has no way.
        """
        self._context.task.head_for(goal)
        return self._plan()

    def again(self) -> Motion | None:
        """Plan again to the same goal: the vehicle did not follow, or something has changed."""
        return self._plan() if self._context.task.way.goal is not None else None

    def fly_to(self, goal: Goal) -> None:
        """Plan a way to a goal and start it."""
        self._context.task.head_for(goal)
        self.advance(self._plan())

    def advance(self, motion: Motion | None) -> None:
        """Command the next motion, if any, and carry out what the state requests then."""
        context = self._context
        if isinstance(motion, HoldHere) and context.interlocks.is_raised(Anomaly.FOREIGN_ORDER):
            # A hold would override a pilot's command; replanned if there is none.
            context.interlocks.defer_motion()
            context.task.way.cancel_stop()
        elif motion is not None:
            self._gate.command(motion)
        progress = self._context.task.way.progress
        if progress is Progress.ARRIVED:
            self.follow(self._context.task.handler.arrived())
        elif progress is Progress.NO_ROUTE:
            self.follow(self._context.task.handler.no_route(self.refusal))

    def hover(self, position: Point) -> tuple[Point, str]:
        """Where to hover for a place, and why not at the place itself (empty if it is)."""
        place = self.hover_point(position)
        if place == position:
            return place, ""
        airspace = self._context.airspace.mission.planning_airspace
        zones = airspace.zones_at(position)
        if FENCE in zones:
            return place, "it is outside the fence"
        if zones:
            return place, f"it is inside {names_of(zones)}"
        if airspace.point_clear(position):
            return place, "no clear way leads there"
        return place, f"it is too close to {names_of((airspace.clearance_left_m(position)[1],))}"

    def hover_point(self, position: Point) -> Point:
        """The place itself, or the nearest clear one with a clear way from home."""
        context = self._context
        place = context.airspace.router.graph.paths.nearest(
            position, reachable_from=context.airspace.mission.home
        )
        return place or position  # the router then gives the reason

    @property
    def refusal(self) -> str:
        """Why there is no way."""
        refusal = self._context.task.way.refusal
        return refusal.reason if refusal is not None else "no clear way"

    # Leg by leg.

    def update(self, telemetry: Telemetry, reached_node: int | None = None) -> Motion | None:
        """Track the vehicle; return the next leg's motion when it is due.

        The end of a leg is reached when the vehicle is within the acceptance radius, or when PX4
        reports the item as reached (`reached_node`). Either is enough, so no end is missed.
        """
        way = self._context.task.way
        leg, standing = way.leg, math.hypot(*telemetry.velocity_m_s) < STANDING_M_S
        if way.progress is not Progress.FLYING or way.braking or leg is None:
            stops = way.progress is Progress.FLYING and standing
            stopped = stops and not self._gate.setpoints.open(telemetry)
            return self._plan() if stopped else None
        reported = reached_node is not None and reached_node == leg.node
        if not reported and math.dist(telemetry.position, leg.to) > self._gate.setpoints.near_m:
            here, begin, end = telemetry.position, way.swept[0], way.swept[-1]
            # A place in this ellipse around the straight leg is not astray.
            around_m = math.hypot(math.dist(begin, end), 2 * ASTRAY_M)
            on_leg = math.dist(begin, here) + math.dist(here, end) <= around_m
            if standing or not on_leg:
                return self._on_the_way(leg, telemetry, standing=standing)
            way.stand(None)
            return None
        way.stand(None)
        if not way.legs:
            way.arrive()
            return None
        return self._leg_on(telemetry, standing=standing)

    def _leg_on(self, telemetry: Telemetry, *, standing: bool) -> Motion | None:
        """Command the next leg once it is clear and stays clear until it is sent."""
        way = self._context.task.way
        onward = way.legs[0].to
        clear = self.clear(telemetry, onward)
        pending = self._gate.setpoints.pending(telemetry)
        if clear and self._stays_clear(telemetry, onward, pending):
            return self._command(way.legs.popleft(), telemetry)
        if not standing:
            return None
        refusal = "no leg on from here is clear, wherever it settles"
        return self._recheck(telemetry, refusal, comes_to_rest=clear)

    def _on_the_way(self, leg: Leg, telemetry: Telemetry, *, standing: bool) -> Motion | None:
        """Check or replan for a vehicle that is off its leg, or that hovers far from its end."""
        way = self._context.task.way
        if self._astray(telemetry.position):
            if not self.clear(telemetry, leg.to):
                return self._plan()
            way.rechecked(self._swept(leg, telemetry))
            return None
        if not standing:
            way.stand(None)
            return None
        since_s = telemetry.time_s if way.stands_since_s is None else way.stands_since_s
        way.stand(since_s)
        if telemetry.time_s - since_s < STALL_S:
            return None
        return self._recheck(telemetry, "the vehicle stands and does not go")

    def _astray(self, here: Point) -> bool:
        """Whether a gust or a position jump took the vehicle out of the checked area."""
        swept = MultiPoint(self._context.task.way.swept).convex_hull
        return bool(swept.distance(ShapelyPoint(here)) > ASTRAY_M)

    def off_its_leg(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle is out of the checked area and the rest of its leg is not clear."""
        way = self._context.task.way
        leg = way.leg if way.progress is Progress.FLYING else None
        return (
            leg is not None
            and self._astray(telemetry.position)
            and not self.clear(telemetry, leg.to)
        )

    def _swept(
        self,
        leg: Leg,
        telemetry: Telemetry,
        momentum: Momentum | None = None,
        pending: Sequence[PendingSetpoint] | None = None,
    ) -> tuple[Point, ...]:
        """The corners of the area that a leg may sweep, however late the command arrives."""
        here, gate = telemetry.position, self._gate
        if momentum is None or pending is None:
            momentum, pending = gate.momentum(telemetry), gate.setpoints.pending(telemetry)
        turn, reaches = momentum.turn(here, leg.to), map(attrgetter("reach"), pending)
        return (here, momentum.rest, turn, *reaches, leg.to)

    def _recheck(
        self, telemetry: Telemetry, refusal: str, *, comes_to_rest: bool = False
    ) -> Motion | None:
        """Retry at intervals while no next leg is clear or followed; then give up.

        If the next leg is clear now, the vehicle first comes to rest: then the leg stays clear.
        """
        if telemetry.time_s < self._recheck_at_s:
            return None
        self._recheck_at_s = telemetry.time_s + RECHECK_S
        way = self._context.task.way
        times = way.recheck()
        if times <= RECHECKS:
            way.stand(None)
            return None if comes_to_rest and times < RECHECKS else self._plan()
        way.refuse(NoRoute(refusal))
        return None

    def _plan(self) -> Motion | None:
        """Plan a way to the goal; return its first motion. The router checks the first leg."""
        way, gate, telemetry = self._context.task.way, self._gate, self._context.telemetry
        goal = way.goal
        assert goal is not None  # noqa: S101 - every caller has set one
        assert telemetry is not None  # noqa: S101 - a vehicle in the air has sent telemetry
        target = goal.position if goal.node is None else goal.node
        here, momentum = telemetry.position, gate.momentum(telemetry)
        pending = gate.setpoints.pending(telemetry)
        route = self._context.airspace.flown_router.route(
            here, target, momentum=momentum, pending=pending
        )
        if (
            isinstance(route, Route)
            and pending
            and len(route.legs) > 1
            and self._longer_than_a_stop(route, momentum.rest, target)
        ):
            route = NoRoute("stopping first is quicker")
        if isinstance(route, Route):
            legs, near_m = deque(route.legs), gate.setpoints.near_m
            while len(legs) > 1 and math.dist(here, legs[0].to) <= near_m:
                if not self.clear(telemetry, legs[1].to):
                    break
                legs.popleft()
            if not legs or (len(legs) == 1 and math.dist(here, legs[0].to) <= near_m):
                way.arrive()
                # Near, but perhaps fast or heading elsewhere: it settles on the point itself.
                if legs or pending:
                    return self._motion(Leg(goal.position, goal.node), telemetry)
                return None
            way.follow(legs)
            refusal = self._first_leg_refusal(telemetry, legs[0].to, pending)
            if refusal is None:
                return self._command(way.legs.popleft(), telemetry, momentum, pending)
            route = refusal
        moves = math.hypot(*telemetry.velocity_m_s) >= STANDING_M_S or bool(pending)
        if (moves and not way.braking) or gate.setpoints.open(telemetry):
            way.stop()
            return HoldHere("no clear way at this speed; stopping to plan again")
        way.refuse(route)
        return None

    def _longer_than_a_stop(self, route: Route, stopping: Point, target: Point | int) -> bool:
        """Whether stopping first is quicker than this detour, which its speed causes."""
        after = self._context.airspace.flown_router.route(stopping, target)
        stop_m = STOP_S * self._context.airspace.mission.speed_m_s
        return isinstance(after, Route) and route.length_m > after.length_m + stop_m

    def _command(
        self,
        leg: Leg,
        telemetry: Telemetry,
        momentum: Momentum | None = None,
        pending: Sequence[PendingSetpoint] | None = None,
    ) -> Motion:
        swept = self._swept(leg, telemetry, momentum, pending)
        self._context.task.way.fly(leg, swept)
        return self._motion(leg, telemetry)

    def _motion(self, leg: Leg, telemetry: Telemetry) -> Motion:
        moved = telemetry.home_moved is not None and telemetry.home_moved.changes_heights
        if leg.node is not None and not (self._gate.by_points or moved):
            return FlyToNode(leg.node, leg.to)
        mission = self._context.airspace.mission
        if leg.node is None:
            return FlyToPoint(leg.to, mission.altitude_above_home_m)
        return FlyToPoint(leg.to, mission.altitude_of(leg.node))

    # Checked again right before it is sent.

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion decided earlier must not be sent anymore; None if it may."""
        telemetry = self._context.telemetry
        if motion is not self._gate.pending or telemetry is None:
            return "it was canceled"
        if isinstance(motion, HoldHere):
            return None
        if self._context.interlocks.is_raised(Anomaly.FOREIGN_ORDER):
            return Anomaly.FOREIGN_ORDER.value
        return None if isinstance(motion, LandHere) else self._leg_refusal(motion, telemetry, now_s)

    def _leg_refusal(
        self, motion: FlyToNode | FlyToPoint, telemetry: Telemetry, now_s: float
    ) -> str | None:
        """Why a leg decided earlier must not be sent anymore."""
        age_s = max(0.0, now_s - telemetry.time_s)
        if age_s > self._gate.reaction_s:
            return "the vehicle's position is too old to check the leg from"
        moved = telemetry.home_moved
        if isinstance(motion, FlyToNode) and moved is not None and moved.changes_heights:
            return "home was moved, and the plan's items with it"
        flies_it = [*self._gate.setpoints.all_known] == [motion]  # already, whatever is sent
        if not flies_it and not self.clear(telemetry, motion.position, age_s, unsent=motion):
            return "the leg was no longer clear when it was due"
        return None

    def clear(
        self,
        telemetry: Telemetry,
        target: Point,
        age_s: float = 0.0,
        *,
        unsent: Motion | None = None,
    ) -> bool:
        """Whether a straight leg from the vehicle's position, at its speed, keeps the clearance.

        This holds however late the command arrives: until then the vehicle may fly the whole rest
        of its current leg. In `age_s` it has flown on from the reported position. It does not fly
        `unsent` yet, the motion to be sent now: a leg out of a hover starts as planned.
        """
        momentum = self._gate.momentum(telemetry, age_s)
        pending = self._gate.setpoints.pending(telemetry, unsent)
        return (
            self._context.airspace.flown_router.check_leg(
                telemetry.position, target, momentum, pending
            )
            and self._height_refusal(telemetry, target, age_s, unsent) is None
        )

    def _first_leg_refusal(
        self, telemetry: Telemetry, target: Point, pending: Sequence[PendingSetpoint]
    ) -> NoRoute | None:
        """Why a leg that is clear at the cruise altitudes may not start now.

        A leg that would not be clear by the time it is sent waits for a stop.
        """
        refusal = self._height_refusal(telemetry, target)
        if refusal is not None:
            if not low(self._context.airspace.mission, telemetry):
                return refusal
            # If the vehicle is low, the gate commands a climb instead, or gives the reason it
            # cannot.
            self._context.interlocks.climb_first()
        moves = math.hypot(*telemetry.velocity_m_s) >= STANDING_M_S or bool(pending)
        brakes = self._context.task.way.braking
        if moves and not brakes and not self._stays_clear(telemetry, target, pending):
            return NoRoute("no first leg is clear until it has left")
        return None

    def _stays_clear(
        self, telemetry: Telemetry, target: Point, pending: Sequence[PendingSetpoint]
    ) -> bool:
        """Whether a leg that is clear now will be clear when it is sent.

        It is then checked with this telemetry, or with newer telemetry from where the vehicle has
        flown or, if it hovers, seems to have drifted.
        """
        gate, router = self._gate, self._context.airspace.flown_router
        here, (east_m_s, north_m_s) = telemetry.position, telemetry.velocity_m_s
        after_s = gate.leaves_s
        if not router.check_leg(here, target, gate.momentum(telemetry, after_s), pending):
            return False
        there = Point(here.east_m + after_s * east_m_s, here.north_m + after_s * north_m_s)
        stands = math.hypot(east_m_s, north_m_s) < STANDING_M_S
        for east_m, north_m in _AROUND if stands else ((0.0, 0.0),):
            place = Point(
                there.east_m + WANDERS_M * east_m,
                there.north_m + WANDERS_M * north_m,
            )
            moved = dataclasses.replace(telemetry, position=place)
            later = gate.setpoints.pending(moved)
            if not router.check_leg(place, target, gate.momentum(moved), later):
                return False
        return True

    def _height_refusal(
        self,
        telemetry: Telemetry,
        target: Point,
        age_s: float = 0.0,
        unsent: Motion | None = None,
    ) -> NoRoute | None:
        """Why a leg that starts off the cruise altitudes is not clear: other zones count there.

        On the way out of a zone the route is planned among these zones only.
        """
        context, altitude_m = self._context, telemetry.altitude_m
        cruises = context.airspace.mission.cruises_at(altitude_m)
        if cruises or context.airspace.flown_router is context.airspace.way_out_router:
            return None
        here, momentum = telemetry.position, self._gate.momentum(telemetry, age_s)
        places = [setpoint.reach for setpoint in self._gate.setpoints.pending(telemetry, unsent)]
        swept = (here, momentum.rest, momentum.turn(here, target), *places, target)
        return self._context.airspace.router.off_cruise(altitude_m, swept)
