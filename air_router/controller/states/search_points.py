"""Where to seek each robot now: its most likely place, or the nearest that keeps the clearance."""

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
    """Where a robot could be sought now, and why there.

    Attributes:
        robot: Its name.
        goal: Where to hover.
        reason: Why the robot may be there, and why the vehicle hovers beside that place.
        offset_m: Distance between the robot's place and the hover position.
        over: Robots to fly over on the way, in this order.
        along: Other places where the robot may be, flown over before the goal.
    """

    robot: str
    goal: Goal
    reason: str
    offset_m: float = 0.0
    over: tuple[str, ...] = ()
    along: tuple[Point, ...] = ()

    @property
    def places(self) -> tuple[Goal, ...]:
        """All places where the robot may be, in flight order."""
        return (*map(Goal, self.along), self.goal)


class Search:
    """Knows the robots and where to seek them.

    Args:
        context: Airspace, router and pace.
        navigator: Finds where to hover for a place.
        setup: The robots to seek, in order, and whether the vehicle explores between two searches.
        exploration: The vehicle's position, and where to seek a robot that was never received.
        policy: Chooses the next robot and place; None: the mission's policy.
        ground: The vehicle's map; None: it maps nothing.

    Attributes:
        targets: The robots with their last data.
        links: Where their radios were received.
        name: This UAV's name. Of two UAVs that seek the same robot, the one with the lower name
            keeps it.
        exploration: Where the vehicle is and was.
        to_explore: The same if the vehicle explores; None: it only searches.
        policy: Chooses the next robot and place.
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
        self._visit_s = timers.search_s + timers.communicate_s  # longest stay at a robot
        self._explore_s = timers.explore_s  # between two searches
        self._revisit_s = timers.revisit_s  # after an exchange, once all is explored

    def search_points(self, now_s: float) -> Iterator[SearchPoint]:
        """The robots that are due, in the order of the policy."""
        for place in self.policy.order(self.targets, self._seek_context(now_s)):
            if self._due_s(place.robot, now_s) <= now_s:
                yield self._offset(place)

    @property
    def fault(self) -> str | None:
        """What went wrong in a guarded policy, so that robots take turns; None: nothing did."""
        fault: str | None = getattr(self.policy, "fault", None)
        return fault

    @property
    def foresees(self) -> bool:
        """Whether a robot is sought where it will be, so its path matters too."""
        return self.policy.foresees

    @property
    def hovers(self) -> bool:
        """Whether the policy also chooses where to hover while data are exchanged."""
        return bool(getattr(self.policy, "hovers", False))

    @property
    def next_due_s(self) -> float:
        """When the next robot is due, on the vehicle's clock; infinite: none is.

        Every robot is due while waypoints are left to explore.
        """
        now_s = self._context.now_s
        due_s = (self._due_s(robot, now_s) for robot in self.targets.names)
        return min(due_s, default=-math.inf if self.to_explore is None else math.inf)

    def _due_s(self, robot: str, now_s: float) -> float:
        """When a robot is due again after a complete exchange.

        On patrol: after `revisit_s`. Otherwise never, once it was met after exploration ended. A
        robot that another UAV seeks is left to that UAV while others are free.
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
        """The point whose farthest robot is nearest, by their last poses; None: no pose known."""
        poses = [track.pose for track in self.targets.tracks.values() if track.pose is not None]
        if not poses:
            return None
        places = shapely.MultiPoint([pose.position for pose in poses])
        centre = shapely.minimum_bounding_circle(places).centroid
        return Goal(self._navigator.hover_point(Point(centre.x, centre.y)))

    def search_point(self, robot: str, now_s: float) -> SearchPoint:
        """Where this robot would be sought now."""
        return self._offset(self.policy.place(robot, self.targets, self._seek_context(now_s)))

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

    def _offset(self, place: SearchPlace) -> SearchPoint:
        robot, more = place.robot, (place.over, place.along)
        if place.position is None:
            goal = self.exploration.longest_unseen()
            return SearchPoint(robot, goal, place.reason, 0.0, *more)
        hover, why = self._navigator.hover(place.position)
        offset_m = math.dist(place.position, hover)
        reason = place.reason + (f"; {why}, so {max(offset_m, 0.1):.1f} m beside it" if why else "")
        return SearchPoint(robot, Goal(hover), reason, offset_m, *more)
