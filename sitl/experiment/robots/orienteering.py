"""A seek policy for comparison: orienteering in a receding horizon. No mission can choose it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import permutations
from types import MappingProxyType
from typing import Final, NamedTuple

from air_router.controller.targets.seeking import Freshest, SeekContext
from air_router.controller.targets.target_list import SearchPlace, TargetList
from geo.frame import Point

STOPS: Final = 3
"""So many robots ahead it looks."""


class _Stop(NamedTuple):
    """A robot that may be visited, and what a visit at once would be worth.

    Attributes:
        place: Where it is believed to be.
        ages_s: Of what it and the UAV hold of each other, together.
        chance: That it is found there, times its value.
        flight_s: To it from where the UAV is.
    """

    robot: str
    place: Point
    ages_s: float
    chance: float
    flight_s: float


class Orienteering(Freshest):
    """Seeks the first robot of the best tour of `STOPS` robots, and plans anew at each search.

    `Freshest` takes the robot whose visit is expected to remove most age per second. This takes the
    tour that does, from robot to robot. Ages as they are now, places where robots are believed to
    be and the chances to find them there are those of `Freshest`.

    Args:
        speed_m_s: At which the UAV flies from robot to robot, straight.
        values: How much a robot's age counts, by its name; 1 if it is not named.
    """

    def __init__(
        self, speed_m_s: float, values: Mapping[str, float] = MappingProxyType({})
    ) -> None:
        super().__init__(values)
        self._speed_m_s = speed_m_s

    def order(self, targets: TargetList, context: SeekContext) -> tuple[SearchPlace, ...]:
        """As `Freshest.order`, but for the first."""
        ranked = super().order(targets, context)
        free, *_ = targets.groups(context.now_s)
        stops = [self._stop(robot, targets, context) for robot in free]
        stops = [stop for stop in stops if math.isfinite(stop.flight_s)]
        if not stops:
            return ranked
        tours = permutations(stops, min(STOPS, len(stops)))
        first, *_ = max(tours, key=lambda tour: self._rate(tour, context.round_s))
        return tuple(sorted(ranked, key=lambda place: place.robot != first.robot))

    def _stop(self, robot: str, targets: TargetList, context: SeekContext) -> _Stop:
        found = self._prospect(robot, targets, context)
        course = targets.course(robot)
        over_s = context.began_s if course is None else course.end_s
        doubt_s = max(context.now_s + found.flight_s - over_s, 0.0)
        tries = targets.tracks[robot].tries
        chance = self._values.get(robot, 1.0) / (1 + doubt_s / context.round_s) / (1 + tries)
        ages_s = found.benefit * (found.flight_s + context.round_s) / chance if chance else 0.0
        return _Stop(robot, found.place.position or context.unseen, ages_s, chance, found.flight_s)

    def _rate(self, tour: Sequence[_Stop], round_s: float) -> float:
        """The age that is expected to be removed, per second of the tour."""
        time_s = removed_s = 0.0
        for before, stop in zip((None, *tour), tour, strict=False):
            way_m = 0.0 if before is None else math.dist(before.place, stop.place)
            time_s += stop.flight_s if before is None else way_m / self._speed_m_s
            time_s += round_s
            removed_s += stop.chance * stop.ages_s
        return removed_s / time_s
