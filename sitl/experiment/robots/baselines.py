"""Seek policies for comparison, which no mission can choose: they look ahead, or plan exactly."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations, product
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from air_router.controller.targets import (
    Freshest,
    PredictedPath,
    SearchPlace,
    SeekContext,
    TargetList,
    Tour,
    TourStop,
    meet,
    rate,
)
from geo.frame import Point

STOPS: Final = 3
"""So many robots ahead `Orienteering` looks."""


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

    It is for comparison: no mission can choose it. `Freshest` takes the robot whose visit is
    expected to remove most age per second. This takes the tour that does, from robot to robot. Ages
    as they are now, places where robots are believed to be and the chances to find them there are
    those of `Freshest`.

    Args:
        speed_m_s: At which the UAV flies from robot to robot, straight.
        values: How much a robot's age counts, by its name; 1 if it is not named.
    """

    def __init__(
        self, speed_m_s: float, values: Mapping[str, float] = MappingProxyType({})
    ) -> None:
        super().__init__(values)
        self._speed_m_s = speed_m_s

    def order(self, targets: TargetList, context: SeekContext) -> Iterable[SearchPlace]:
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
        found = self._candidate(robot, targets, context)
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


MOST_PLANNED: Final = 6
"""Of so many robots at most, those that bring most, a tour is planned exactly."""


class PlannedRendezvous(Tour):
    """Meets robots as planned at once for all of them, by mixed-integer linear programming.

    Each robot that it goes over has one meeting point, that of `Rendezvous`. Of all tours, over as
    many robots as pays, the one is flown that is expected to remove most age per second. A ratio is
    no linear objective: the greatest gain less a price for the time is one, and the price for which
    it comes out as nothing is the greatest ratio (Dinkelbach, On nonlinear fractional programming,
    Management Science 13, 1967). The program is that of an orienteering problem, its order by the
    constraints of Miller, Tucker and Zemlin.
    """

    def _places(self, course: PredictedPath, context: SeekContext) -> tuple[Point, ...]:
        return (course.place(meet(course, context)[0]),)

    def _best(self, stops: Sequence[TourStop], context: SeekContext) -> tuple[TourStop, ...]:
        stops = sorted(stops, key=lambda stop: -stop.gain_s)[:MOST_PLANNED]
        best: tuple[TourStop, ...] = ()
        price = 0.0
        while (tour := _priced(stops, context, price)) and rate(tour, context) > price + 1e-9:
            best, price = tour, rate(tour, context)
        return best


def _priced(stops: Sequence[TourStop], context: SeekContext, price: float) -> tuple[TourStop, ...]:
    """The tour with the greatest gain less the price of each second; none: no stop pays.

    Arcs lead from the vehicle (0) and each stop (1 ...) to each stop and the end (n + 1).
    """
    from scipy.optimize import Bounds, LinearConstraint, milp  # noqa: PLC0415 - takes its time

    count = len(stops)
    arcs = [(a, b) for a, b in product(range(count + 1), range(1, count + 2)) if a != b]
    ends = np.array(arcs)

    def time_s(start: int, end: int) -> float:
        if end > count:
            return 0.0
        if start == 0:
            return stops[end - 1].flight_s
        return context.leg_s(stops[start - 1].places[-1], stops[end - 1].places[0])

    gains = [stops[end - 1].gain_s if end <= count else 0.0 for _, end in arcs]
    worth = np.array(gains) - price * np.array([time_s(*arc) for arc in arcs])
    rows: list[npt.NDArray[np.float64]] = [np.append(ends[:, 0] == 0, np.zeros(count))]
    low, high = [1.0], [1.0]  # it sets out once
    for stop in range(1, count + 1):
        comes, goes = ends[:, 1] == stop, ends[:, 0] == stop
        rows += [
            np.append(comes.astype(float) - goes, np.zeros(count)),  # what comes goes
            np.append(comes, np.zeros(count)),
        ]
        low, high = [*low, 0.0, 0.0], [*high, 0.0, 1.0]
    for number, (start, end) in enumerate(arcs):
        if start > 0 and end <= count:  # then the end comes later
            row = np.zeros(len(arcs) + count)
            row[[number, len(arcs) + start - 1, len(arcs) + end - 1]] = count, 1.0, -1.0
            rows, low, high = [*rows, row], [*low, -np.inf], [*high, count - 1.0]
    found = milp(
        np.append(-worth, np.zeros(count)),
        constraints=LinearConstraint(np.array(rows, float), low, high),
        integrality=np.append(np.ones(len(arcs)), np.zeros(count)),
        bounds=Bounds(0, np.append(np.ones(len(arcs)), np.full(count, float(count)))),
    )
    after = {a: b for (a, b), used in zip(arcs, found.x, strict=False) if used > 0.5}
    tour, at = [], after[0]
    while at <= count:
        tour.append(stops[at - 1])
        at = after[at]
    return tuple(tour)
