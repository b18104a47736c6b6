"""Where to fly for each robot: the roster's best guess, where hovering keeps the clearance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from air_router.navigator import Goal
from air_router.targets import Roster

if TYPE_CHECKING:
    from air_router.exploration import Exploration
    from air_router.mission import Mission
    from geo.frame import Point


@dataclass(frozen=True, slots=True)
class Aim:
    """A robot that could be sought now, where, and why there."""

    robot: str
    goal: Goal
    reason: str


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

    def aims(self, now_s: float) -> Iterator[Aim]:
        """The robots in the order in which they are to be tried."""
        for robot in self.roster.candidates(now_s):
            place = self.roster.place(robot, now_s)
            if place.position is None:
                goal = self._exploration.longest_unseen()
            else:
                goal = Goal(self._hover_point(place.position))
            yield Aim(robot, goal, place.reason)

    def over(self, robot: str) -> tuple[Goal, float] | None:
        """The hovering place nearest to a robot, and how far beside it; None if never heard of."""
        position = self.roster.position_of(robot)
        if position is None:
            return None
        place = self._hover_point(position)
        return Goal(place), math.dist(position, place)

    def _hover_point(self, position: Point) -> Point:
        if self._airspace.point_clear(position):
            return position
        return self._airspace.nearest_clear(position) or position  # the router says why not
