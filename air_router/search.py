"""Where to fly for each robot: the roster's best guess, where hovering keeps the clearance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from air_router.departure import names_of
from air_router.navigator import Goal
from air_router.targets import Roster
from geo.airspace import FENCE
from geo.shortest import shortest_paths

if TYPE_CHECKING:
    from air_router.exploration import Exploration
    from air_router.mission import Mission
    from geo.frame import Point


@dataclass(frozen=True, slots=True)
class Aim:
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
        mission: Its airspace.
        seek: Names of the robots to seek, in order.
        exploration: Tells where a robot may be that was never heard.
    """

    def __init__(self, mission: Mission, seek: tuple[str, ...], exploration: Exploration) -> None:
        self.roster = Roster(seek)
        self._exploration = exploration
        self._airspace = mission.planning_airspace
        self._paths = shortest_paths(mission.planning_airspace)
        self._home = mission.home

    def aims(self, now_s: float) -> Iterator[Aim]:
        """The robots in the order in which they are to be tried."""
        for robot in self.roster.candidates(now_s):
            place = self.roster.place(robot, now_s)
            if place.position is None:
                yield Aim(robot, self._exploration.longest_unseen(), place.reason)
                continue
            hover = self._hover_point(place.position)
            beside_m = math.dist(place.position, hover)
            reason = place.reason
            if beside_m > 0:
                why = self._why_not_there(place.position)
                reason += f"; {why}, so {max(beside_m, 0.1):.1f} m beside it"
            yield Aim(robot, Goal(hover), reason, beside_m)

    def over(self, robot: str) -> tuple[Goal, float] | None:
        """The hovering place nearest to a robot, and how far beside it; None if never heard of."""
        position = self.roster.position_of(robot)
        if position is None:
            return None
        place = self._hover_point(position)
        return Goal(place), math.dist(position, place)

    def _hover_point(self, position: Point) -> Point:
        """The place itself, or the nearest clear one that a clear way leads to from home."""
        place = self._paths.nearest(position, reachable_from=self._home)
        return place or position  # the router says why not

    def _why_not_there(self, position: Point) -> str:
        holders = self._airspace.holders(position)
        if FENCE in holders:
            return "it is outside of the fence"
        if holders:
            return f"it is inside {names_of(holders)}"
        if self._airspace.point_clear(position):
            return "no clear way leads there"
        return f"it is too close to {names_of((self._airspace.spare_m(position)[1],))}"
