"""Flies a route leg by leg: every leg is checked from where the vehicle is, then commanded.

Pure: telemetry in, one motion (or none) out. The vehicle hovers at the end of each leg until
the next one is commanded, so a late companion costs time and never a metre off the route.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from operator import attrgetter

from shapely import MultiPoint
from shapely import Point as ShapelyPoint

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere, LandHere, Motion
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.motion.pending_setpoints import (
    REACTION_S,
    PendingSetpoints,
    stopping_point,
)
from air_router.routing.departure import PendingSetpoint
from air_router.routing.router import Leg, NoRoute, Route
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point, off_line_m

STOP_S = 4.0
"""What stopping and setting out again takes: a way that avoids it may be longer by so much."""

SETTLE_S = 2.0
SETTLES = 5
"""How long apart, and how often, a vehicle that stands looks again for a clear leg on."""

STALL_S = 15.0
"""A vehicle that was sent somewhere and stands for so long did not understand, or may not go."""

ASTRAY_M = 2.0
"""Farther than this from what was checked for a leg, it is checked again from there."""

STANDING_M_S = 0.5
"""Slower than this counts as hovering: estimates and gusts never read exactly zero."""


class Progress(Enum):
    """How far the flight to a goal is."""

    IDLE = "nowhere to go"
    FLYING = "on the way"
    ARRIVED = "there"
    NO_ROUTE = "no clear way from here"


@dataclass(frozen=True, slots=True)
class Goal:
    """Where to: a node of the plan, or any point."""

    position: Point
    node: int | None = None  # None: a point that is no node


class Navigator:
    """Takes the vehicle to one goal at a time.

    `by_points`: nodes are flown to as any other point, because the vehicle does not fly its plan.
    So they are while home is higher or lower than at take-off, and with it the items of the plan.

    Args:
        context: Altitudes, the airspace that every leg must keep to, and routes in it.
        reaction_s: For how long the vehicle flies on as it does before it follows a command.

    Attributes:
        setpoints: What it was told, and may follow any moment.
        goal: Where to; None: nowhere.
        leg: The leg under way.
        progress: How far the flight to the goal is.
        refusal: Why there is no way, once `progress` says so.
    """

    def __init__(self, context: MissionContext, *, reaction_s: float = REACTION_S) -> None:
        mission = context.mission
        self.reaction_s = reaction_s
        self.by_points = False
        self.setpoints = PendingSetpoints(mission.planner.acceptance_radius_m, mission.speed_m_s)
        self.goal: Goal | None = None
        self.leg: Leg | None = None
        self.progress = Progress.IDLE
        self.refusal: NoRoute | None = None
        self._context = context
        self._radius_m = mission.planner.acceptance_radius_m  # a leg's end so near is reached
        self._legs: deque[Leg] = deque()  # behind the one under way
        self._braking = False  # to look for a way again once it stands
        self._settled = 0  # how often it looked again in vain
        self._settle_until_s = -math.inf  # when it looks again, vehicle's clock
        self._stands_since_s: float | None = None  # short of its leg's end
        self._swept: tuple[Point, ...] = ()  # what the leg under way was checked for

    def go(self, goal: Goal, telemetry: Telemetry) -> Motion | None:
        """Set out for a goal from where the vehicle is, however fast it moves.

        Returns the motion to command; None with `progress` ARRIVED when there is nothing to fly.
        When no way is clear at the present speed the vehicle is stopped first and asked again
        when it stands; STRANDED, with `refusal` saying why, when it stands and still has no way.
        """
        self.goal = goal
        self.leg = None
        self._legs.clear()
        self._braking = False
        self._settled = 0
        self._stands_since_s = None
        self.refusal = None
        return self._plan(telemetry)

    @property
    def ahead(self) -> tuple[Leg, ...]:
        """The legs that are still to be flown, the one under way first."""
        return () if self.leg is None else (self.leg, *self._legs)

    def stop(self) -> None:
        """Forget the goal."""
        self.goal = None
        self.leg = None
        self._legs.clear()
        self._braking = False
        self.progress = Progress.IDLE

    def update(self, telemetry: Telemetry, reached_node: int | None = None) -> Motion | None:
        """Follow the vehicle; returns the next leg's motion when it is time for it.

        A leg's end is reached when the vehicle is within the acceptance radius, or when the
        autopilot says so (`reached_node`): either alone is enough, so none is missed.
        """
        if self.progress is not Progress.FLYING:
            return None
        standing = math.hypot(*telemetry.velocity_m_s) < STANDING_M_S
        if self._braking or self.leg is None:
            stopped = standing and not self.setpoints.open(telemetry)
            return self._plan(telemetry) if stopped else None
        leg = self.leg
        reported = reached_node is not None and reached_node == leg.node
        if not reported and math.dist(telemetry.position, leg.to) > self._radius_m:
            return self._on_the_way(leg, telemetry, standing=standing)
        self._stands_since_s = None
        if not self._legs:
            self.leg = None
            self.progress = Progress.ARRIVED
            return None
        if self.clear(telemetry, self._legs[0].to):
            return self._command(self._legs.popleft(), telemetry)
        refusal = "no leg on from here is clear, wherever it settles"
        return self._settle(telemetry, refusal) if standing else None

    def again(self, telemetry: Telemetry) -> Motion | None:
        """Plan anew to the same goal: the vehicle did not follow, or something has changed."""
        return self._plan(telemetry) if self.goal is not None else None

    def hold_first(self) -> HoldHere:
        """The leg just planned is not begun: the vehicle stops, and it is planned anew."""
        self.leg = None
        self._legs.clear()
        self._braking = True
        self.progress = Progress.FLYING
        return HoldHere("an order from before may be under way; stopping to look again")

    def _on_the_way(self, leg: Leg, telemetry: Telemetry, *, standing: bool) -> Motion | None:
        """Have a vehicle that is off its leg, or stands far from its end for long, go on."""
        if self._astray(telemetry.position):
            return self._look_again(leg, telemetry)
        if not standing:
            self._stands_since_s = None
            return None
        if self._stands_since_s is None:
            self._stands_since_s = telemetry.time_s
        if telemetry.time_s - self._stands_since_s < STALL_S:
            return None
        return self._settle(telemetry, "the vehicle stands and does not go")

    def _astray(self, here: Point) -> bool:
        """Whether a gust, or a jump of the position estimate, took it out of what was checked."""
        if not self._swept or off_line_m(here, self._swept[0], self._swept[-1]) <= ASTRAY_M:
            return False
        swept = MultiPoint(self._swept).convex_hull
        return bool(swept.distance(ShapelyPoint(here)) > ASTRAY_M)

    def off_its_leg(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle is out of what was checked, and the rest of its leg is not clear."""
        leg = self.leg if self.progress is Progress.FLYING else None
        return (
            leg is not None
            and self._astray(telemetry.position)
            and not self.clear(telemetry, leg.to)
        )

    def _look_again(self, leg: Leg, telemetry: Telemetry) -> Motion | None:
        """The rest of the leg from where the vehicle is now; another way if that is not clear."""
        if self.clear(telemetry, leg.to):
            self._sweep(leg, telemetry)
            return None
        return self._plan(telemetry)

    def _sweep(
        self, leg: Leg, telemetry: Telemetry, pending: Sequence[PendingSetpoint] | None = None
    ) -> None:
        """Remember what was checked for a leg: all that it may sweep, however late it is told."""
        if pending is None:
            pending = self.setpoints.pending(telemetry)
        stopping = stopping_point(telemetry, self.reaction_s)
        reaches = map(attrgetter("reach"), pending)
        self._swept = (telemetry.position, stopping, *reaches, leg.to)

    def _settle(self, telemetry: Telemetry, refusal: str) -> Motion | None:
        """Look again now and then where no leg on is clear, or none is followed; then give up."""
        if telemetry.time_s < self._settle_until_s:
            return None
        self._settle_until_s = telemetry.time_s + SETTLE_S
        self._settled += 1
        if self._settled <= SETTLES:
            self._stands_since_s = None
            return self._plan(telemetry)
        self.refusal = NoRoute(refusal)
        self.progress = Progress.NO_ROUTE
        return None

    def _passed(self, leg: Leg, following: Leg, telemetry: Telemetry) -> bool:
        """Whether a leg's end is so near that the vehicle may as well go for the next one."""
        near = math.dist(telemetry.position, leg.to) <= self._radius_m
        return near and self.clear(telemetry, following.to)

    def _plan(self, telemetry: Telemetry) -> Motion | None:
        """The first motion of a way to the goal; the router has checked its first leg from here."""
        assert self.goal is not None  # noqa: S101 - every caller has set one
        target = self.goal.position if self.goal.node is None else self.goal.node
        here, stopping = telemetry.position, stopping_point(telemetry, self.reaction_s)
        pending = self.setpoints.pending(telemetry)
        route = self._context.router.route(here, target, stopping=stopping, pending=pending)
        if (
            isinstance(route, Route)
            and pending
            and self._longer_than_a_stop(route, stopping, target)
        ):
            route = NoRoute("stopping first is quicker")
        if isinstance(route, Route):
            legs = deque(route.legs)
            while len(legs) > 1 and self._passed(legs[0], legs[1], telemetry):
                legs.popleft()
            if not legs or (len(legs) == 1 and math.dist(here, legs[0].to) <= self._radius_m):
                self._legs.clear()
                self.leg = None
                self.progress = Progress.ARRIVED
                # Near, but perhaps fast, or bound elsewhere: let it settle on the point itself.
                if legs or pending:
                    return self._motion(Leg(self.goal.position, self.goal.node), telemetry)
                return None
            self._legs = legs
            refusal = self._height_refusal(telemetry, legs[0].to)
            if refusal is None:
                return self._command(legs.popleft(), telemetry, pending)
            route = refusal
        moves = math.hypot(*telemetry.velocity_m_s) >= STANDING_M_S or bool(pending)
        if (moves and not self._braking) or self.setpoints.open(telemetry):
            self._braking = True
            self.progress = Progress.FLYING
            return HoldHere("no clear way at this speed; stopping to look again")
        self.refusal = route
        self.progress = Progress.NO_ROUTE
        return None

    def _longer_than_a_stop(self, route: Route, stopping: Point, target: Point | int) -> bool:
        """Whether it goes such a long way round, for the way it is on, that stopping is quicker."""
        if len(route.legs) == 1:
            return False
        after = self._context.router.route(stopping, target)
        spare_m = STOP_S * self._context.mission.speed_m_s
        return isinstance(after, Route) and route.length_m > after.length_m + spare_m

    def _command(
        self, leg: Leg, telemetry: Telemetry, pending: Sequence[PendingSetpoint] | None = None
    ) -> Motion:
        self.leg = leg
        self._sweep(leg, telemetry, pending)
        self._braking = False
        self.progress = Progress.FLYING
        return self._motion(leg, telemetry)

    def _motion(self, leg: Leg, telemetry: Telemetry) -> Motion:
        if leg.node is not None and not (self.by_points or _items_moved(telemetry)):
            return FlyToNode(leg.node, leg.to)
        return FlyToPoint(leg.to, self._context.mission.altitude_of(leg.node))

    def objection(self, motion: Motion, telemetry: Telemetry, now_s: float) -> str | None:
        """Why a motion decided a moment ago must not be commanded any more; None if it may."""
        if isinstance(motion, HoldHere | LandHere):
            return None
        age_s = max(0.0, now_s - telemetry.time_s)
        if age_s > self.reaction_s:
            return "the vehicle's position is too old to check the leg from"
        if isinstance(motion, FlyToNode) and _items_moved(telemetry):
            return "home was moved, and the plan's items with it"
        if not self.clear(telemetry, motion.position, age_s):
            return "the leg was no longer clear in its turn"
        return None

    def clear(self, telemetry: Telemetry, target: Point, age_s: float = 0.0) -> bool:
        """Whether a straight leg from where the vehicle is, at its speed, keeps the clearance.

        However late the command arrives: until then it may fly all the rest of its present leg.
        In `age_s` it has flown on from where it was when it said so.
        """
        stopping = stopping_point(telemetry, self.reaction_s + age_s)
        pending = self.setpoints.pending(telemetry)
        return (
            self._context.router.check_leg(
                telemetry.position, target, stopping=stopping, pending=pending
            )
            and self._height_refusal(telemetry, target, age_s) is None
        )

    def _height_refusal(
        self, telemetry: Telemetry, target: Point, age_s: float = 0.0
    ) -> NoRoute | None:
        """Why a leg is not clear that begins off the cruise altitudes, where other zones count."""
        cruise, altitude_m = self._context.mission.cruise, telemetry.altitude_m
        if cruise.lower_m <= altitude_m <= cruise.upper_m:
            return None
        stopping = stopping_point(telemetry, self.reaction_s + age_s)
        places = [setpoint.place for setpoint in self.setpoints.pending(telemetry)]
        swept = (telemetry.position, stopping, *places, target)
        return self._context.router.off_cruise(altitude_m, swept)


def _items_moved(telemetry: Telemetry) -> bool:
    """Whether the plan's items lie higher or lower than planned, because home does."""
    return telemetry.home_moved is not None and telemetry.home_moved.changes_heights
