"""Where to fly for each robot: the best guess, where hovering keeps the clearance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from air_router.controller.model.mission_context import MissionContext
from air_router.controller.motion.navigator import Goal
from air_router.controller.targets.exploration import Exploration
from air_router.controller.targets.seeking import POLICIES, Policy, SeekContext
from air_router.controller.targets.target_list import SearchPlace, TargetList
from air_router.routing.departure import names_of
from air_router.routing.return_planner import Way
from air_router.routing.router import NoRoute
from geo.airspace.airspace import FENCE
from geo.frame import Point
from mocha_link.links.metrics import ContactBegan, ContactEnded, SyncEnded, SyncStarted

RadioEvent = ContactBegan | ContactEnded | SyncStarted | SyncEnded
"""What tells that a robot's radio is heard where the vehicle is."""


@dataclass(frozen=True, slots=True)
class SearchPoint:
    """A robot that could be sought now, where, and why there.

    Attributes:
        robot: Its name.
        goal: Where to hover.
        reason: What is known there of the robot, and what keeps the vehicle beside it.
        beside_m: How far from the robot's place the vehicle will hover.
    """

    robot: str
    goal: Goal
    reason: str
    beside_m: float = 0.0


class Search:
    """Knows the robots, and the places from which to look for them.

    Args:
        context: The airspace, and how long the vehicle would fly.
        seek: Names of the robots to seek, in order.
        exploration: Where the vehicle is, and where a robot may be that was never heard.
        explore: Whether it explores between two searches.

    Attributes:
        targets: The robots, and what is known of each.
        policy: Whom to seek, and where; the mission's.
        foresees: A robot is sought where it will be, so that news of its path matters too.
    """

    def __init__(
        self,
        context: MissionContext,
        seek: tuple[str, ...],
        exploration: Exploration,
        *,
        explore: bool = True,
    ) -> None:
        self.targets = TargetList(seek)
        self.policy: Policy = POLICIES[context.mission.seek_policy]
        self.foresees = self.policy.foresees
        self._context = context
        self._exploration = exploration
        timers = context.mission.timers
        # a search, a talk, and exploring between them
        self._round_s = timers.search_s + timers.communicate_s + explore * timers.explore_s

    def heard(self, event: RadioEvent, now_s: float) -> None:
        """A robot's radio was heard: it is near."""
        if self._exploration.here is not None:
            self.targets.radio_heard(event.peer, self._exploration.here, now_s)
        if isinstance(event, SyncEnded) and event.complete:
            self.targets.synced(event.peer, event.direction, now_s)

    def search_points(self, now_s: float) -> Iterator[SearchPoint]:
        """The robots in the order in which they are to be tried."""
        for place in self.policy.order(self.targets, self._seek_context(now_s)):
            yield self._beside(place)

    def search_point(self, robot: str, now_s: float) -> SearchPoint:
        """Where one of the robots would be sought now."""
        return self._beside(self.policy.place(robot, self.targets, self._seek_context(now_s)))

    def _seek_context(self, now_s: float) -> SeekContext:
        exploration = self._exploration
        began_s = now_s if exploration.began_s is None else exploration.began_s
        return SeekContext(
            now_s,
            began_s,
            self._flight_s,
            unseen=exploration.longest_unseen().position,
            round_s=self._round_s,
        )

    def _flight_s(self, place: Point) -> float:
        here = self._exploration.here
        if here is None:
            return 0.0
        route = self._context.router.route(here, self._hover_point(place))
        if isinstance(route, NoRoute):
            return math.inf
        return self._context.pace.time_s(Way(route.length_m, len(route.legs)))

    def _beside(self, place: SearchPlace) -> SearchPoint:
        robot = place.robot
        if place.position is None:
            return SearchPoint(robot, self._exploration.longest_unseen(), place.reason)
        hover, why = self.hover(place.position)
        beside_m = math.dist(place.position, hover)
        reason = place.reason + (f"; {why}, so {max(beside_m, 0.1):.1f} m beside it" if why else "")
        return SearchPoint(robot, Goal(hover), reason, beside_m)

    def hover(self, position: Point) -> tuple[Point, str]:
        """Where to hover for a place, and why not there; nothing if it is the place itself."""
        place = self._hover_point(position)
        return place, self._why_not_there(position) if place != position else ""

    def ahead_of(self, robot: str, now_s: float) -> tuple[Goal, float] | None:
        """Where a robot is to be met from here, and how far beside it; None if never heard of."""
        point = self.search_point(robot, now_s)
        return None if self.targets.position_of(robot) is None else (point.goal, point.beside_m)

    def over(self, robot: str) -> tuple[Goal, float] | None:
        """The hovering place nearest to a robot, and how far beside it; None if never heard of."""
        position = self.targets.position_of(robot)
        if position is None:
            return None
        place = self._hover_point(position)
        return Goal(place), math.dist(position, place)

    def _hover_point(self, position: Point) -> Point:
        """The place itself, or the nearest clear one that a clear way leads to from home."""
        context = self._context
        place = context.router.graph.paths.nearest(position, reachable_from=context.mission.home)
        return place or position  # the router says why not

    def _why_not_there(self, position: Point) -> str:
        airspace = self._context.mission.planning_airspace
        holders = airspace.holders(position)
        if FENCE in holders:
            return "it is outside of the fence"
        if holders:
            return f"it is inside {names_of(holders)}"
        if airspace.point_clear(position):
            return "no clear way leads there"
        return f"it is too close to {names_of((airspace.spare_m(position)[1],))}"
