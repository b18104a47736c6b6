"""Where each robot could be sought now: the best guess, where hovering keeps the clearance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import shapely

from air_router.controller.model import FlightSetup, Goal, MissionContext
from air_router.controller.motion import Navigator
from air_router.controller.states.explore_state import Exploration
from air_router.controller.targets import (
    LinkLog,
    Policy,
    SearchPlace,
    SeekContext,
    TargetList,
    policy_of,
)
from air_router.routing import NoRoute, Way
from geo.frame import Point
from geo.grid import SemanticGrid


@dataclass(frozen=True, slots=True)
class SearchPoint:
    """A robot that could be sought now, where, and why there.

    Attributes:
        robot: Its name.
        goal: Where to hover.
        reason: What is known there of the robot, and what keeps the vehicle beside it.
        beside_m: How far from the robot's place the vehicle will hover.
        over: Robots that are flown over before, in this order.
        along: Other places where it may be, that are flown over before the goal.
    """

    robot: str
    goal: Goal
    reason: str
    beside_m: float = 0.0
    over: tuple[str, ...] = ()
    along: tuple[Point, ...] = ()

    @property
    def places(self) -> tuple[Goal, ...]:
        """Where it may be, in the order in which it is flown."""
        return (*map(Goal, self.along), self.goal)


class Search:
    """Knows the robots, and the places from which to look for them.

    Args:
        context: The airspace, and how long the vehicle would fly.
        navigator: Where to hover for a place.
        setup: Whom to seek, in order, and whether the vehicle explores between two searches.
        exploration: Where the vehicle is, and where a robot may be that was never heard.
        policy: Whom to seek, and where; None: as the mission says.
        ground: What the vehicle maps as it flies; None: nothing.

    Attributes:
        targets: The robots, and what is known of each.
        links: Where their radios were received.
        name: This UAV's: of two that seek the same robot, the lower name keeps it.
        exploration: Where the vehicle is, and was.
        to_explore: The same, as what else there is to do; None: this vehicle only searches.
        policy: Whom to seek, and where.
    """

    def __init__(  # noqa: PLR0913 - what a search depends on
        self,
        context: MissionContext,
        navigator: Navigator,
        setup: FlightSetup,
        exploration: Exploration,
        policy: Policy | None = None,
        *,
        ground: SemanticGrid | None = None,
    ) -> None:
        self.name = setup.name
        self.targets = TargetList(setup.seek)
        self.links = LinkLog()
        self.policy: Policy = (
            policy_of(context.airspace.mission.seek_policy) if policy is None else policy
        )
        self._context, self._navigator, self._ground = context, navigator, ground
        self.exploration = exploration
        self.to_explore = exploration if setup.explore else None
        timers = context.airspace.mission.timers
        self._visit_s = timers.search_s + timers.communicate_s
        self._explore_s, self._revisit_s = timers.explore_s, timers.revisit_s

    def search_points(self, now_s: float) -> Iterator[SearchPoint]:
        """The robots that are due, in the order in which they are to be tried."""
        for place in self.policy.order(self.targets, self._seek_context(now_s)):
            if self._due_s(place.robot, now_s) <= now_s:
                yield self._beside(place)

    @property
    def foresees(self) -> bool:
        """Whether a robot is sought where it will be, so that its path matters too."""
        return self.policy.foresees

    @property
    def hovers(self) -> bool:
        """Whether the policy also says where to hover while data are exchanged."""
        return bool(getattr(self.policy, "hovers", False))

    @property
    def next_due_s(self) -> float:
        """When the next robot is due for a visit, on the vehicle's clock; infinite: none is.

        While anything is left to explore every robot always is.
        """
        now_s = self._context.now_s
        due_s = (self._due_s(robot, now_s) for robot in self.targets.names)
        return min(due_s, default=-math.inf if self.to_explore is None else math.inf)

    def _due_s(self, robot: str, now_s: float) -> float:
        """When a robot is to be visited again after a complete exchange.

        On patrol after `revisit_s`; otherwise never, once it was met with everything explored. A
        robot that another UAV seeks is left to it while others are free.
        """
        if self.to_explore is not None and self.to_explore.remaining:
            return -math.inf
        free = self.targets.free(now_s)
        if free and robot not in free:
            return math.inf
        met_s = self.targets.tracks[robot].met_s
        if self._context.airspace.mission.when_explored == "patrol":
            return met_s + self._revisit_s
        explored_s = -math.inf if self.to_explore is None else self.to_explore.explored_s
        return math.inf if met_s > explored_s else -math.inf

    @property
    def middle(self) -> Goal | None:
        """Where the farthest of the robots is nearest, by their last poses; None: none is known."""
        poses = [track.pose for track in self.targets.tracks.values() if track.pose is not None]
        if not poses:
            return None
        places = shapely.MultiPoint([pose.position for pose in poses])
        centre = shapely.minimum_bounding_circle(places).centroid
        return Goal(self._navigator.hover_point(Point(centre.x, centre.y)))

    def search_point(self, robot: str, now_s: float) -> SearchPoint:
        """Where one of the robots would be sought now."""
        return self._beside(self.policy.place(robot, self.targets, self._seek_context(now_s)))

    def _seek_context(self, now_s: float) -> SeekContext:
        exploration = self.exploration
        began_s = now_s if exploration.began_s is None else exploration.began_s
        explores = self.to_explore is not None and self.to_explore.remaining > 0
        return SeekContext(
            now_s,
            began_s,
            self._flight_s,
            self._leg_s,
            self._straight_s,
            unseen=exploration.longest_unseen().position,
            round_s=self._visit_s + self._explore_s * explores,
            here=exploration.here,
            altitude_m=self._context.airspace.mission.altitude_above_home_m,
            links=self.links.samples,
            ground=self._ground,
        )

    def _flight_s(self, place: Point) -> float:
        here = self.exploration.here
        if here is None:
            return 0.0
        route = self._context.airspace.router.route(here, self._navigator.hover_point(place))
        if isinstance(route, NoRoute):
            return math.inf
        return self._context.pace.time_s(Way(route.length_m, len(route.legs)))

    def _straight_s(self, place: Point) -> float:
        here = self.exploration.here
        return 0.0 if here is None else self._leg_s(here, place)

    def _leg_s(self, start: Point, end: Point) -> float:
        return self._context.pace.time_s(Way(math.dist(start, end), 1))

    def _beside(self, place: SearchPlace) -> SearchPoint:
        robot, more = place.robot, (place.over, place.along)
        if place.position is None:
            goal = self.exploration.longest_unseen()
            return SearchPoint(robot, goal, place.reason, 0.0, *more)
        hover, why = self._navigator.hover(place.position)
        beside_m = math.dist(place.position, hover)
        reason = place.reason + (f"; {why}, so {max(beside_m, 0.1):.1f} m beside it" if why else "")
        return SearchPoint(robot, Goal(hover), reason, beside_m, *more)
