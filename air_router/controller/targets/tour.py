"""A seek policy that flies over several robots in one search."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from shapely import LineString

from air_router.controller.targets.limits import MOST_STOPS, OFF_WAY_M, SPREAD, VAIN_SHARE
from air_router.controller.targets.predicted_path import PredictedPath
from air_router.controller.targets.seeking import Rendezvous, SeekContext, with_reason
from air_router.controller.targets.target_list import NEVER_RECEIVED, SearchPlace, TargetList
from geo.frame import Point


@dataclass(frozen=True, slots=True)
class TourStop:
    """A robot that a search could fly over.

    Attributes:
        robot: Its name.
        places: Where it may be: one place, or a stretch of its path, in flight order.
        gain_s: Expected reduction in age by flying over it, weighted by its value.
        flight_s: Flight time from the vehicle to the first place, straight.
        along_s: Flight time from the first place to the last.
    """

    robot: str
    places: tuple[Point, ...]
    gain_s: float
    flight_s: float
    along_s: float = 0.0


class Tour(Rendezvous):
    """Flies over several robots in one search, and exchanges data in passing.

    Besides the flight, every search costs a round of exploring, waiting and communicating, so
    flying over other robots on the way pays off. For each robot, with the time on the vehicle's
    clock,

        gain   = (held + given) * value * chance
        chance = round / (round + doubt) * VAIN_SHARE ^ tries

    with the terms of `Freshest`. The search is the tour of at most `MOST_STOPS` robots with the
    greatest

        sum of gains / (flight + round)

    found by insertion: the robot that raises the value most is inserted where it raises it most,
    until no robot raises it. The value is the expected reduction in age of information per second
    (orienteering in a receding horizon, with the stopping rule of foraging: Charnov, Optimal
    foraging, the marginal value theorem, Theoretical Population Biology 9, 1976). The vehicle waits
    and hovers over the last robot of the tour: the sought one.

    A robot still on its published path is sought along the stretch on which it may be (`SPREAD`). A
    robot whose path is over is sought along the whole path, because it may have turned back. A
    robot without a path is sought at its last position.

    Tours are compared by straight lines, because a search must start within one turn of the flight
    loop: among hundreds of zones each route takes milliseconds.
    """

    def order(self, targets: TargetList, context: SeekContext) -> Iterator[SearchPlace]:
        """As `Policy.order`; the first place may fly over other robots on the way."""
        tour, flight_s = self._tour(targets, context)
        if not tour:
            yield from super().order(targets, context)
            return
        sought = tour[-1].robot
        over = tuple(stop.robot for stop in tour[:-1])
        place = replace(self.place(sought, targets, context), over=over)
        ages_s = {robot: self.held_s(robot, targets, context) for robot in targets.names}
        place = with_reason(place, ages_s[sought], flight_s, max(ages_s.values()))
        if over:
            place = replace(place, reason=f"over {', '.join(over)}; {place.reason}")
        yield place
        others = super().order(targets, context)
        yield from (other for other in others if other.robot != sought)

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """As `Policy.place`."""
        course = self._course(robot, targets)
        if course is None:
            return SearchPlace(robot, None, NEVER_RECEIVED)
        *before, last = self._places(course, context)
        if len(course.points) == 1:
            why = "its last position"
        else:
            why = "along its path" if course.end_s > context.now_s else "along its path, now over"
        return SearchPlace(robot, last, why, along=tuple(before))

    def _tour(
        self, targets: TargetList, context: SeekContext
    ) -> tuple[tuple[TourStop, ...], float]:
        """The best tour, and the flight time to its last robot; empty if no tour gains anything.

        Each of its robots can be reached.
        """
        stops = self._stops(targets, context)
        while tour := self._best(stops, context):
            flights_s = {stop.robot: context.flight_s(stop.places[-1]) for stop in tour}
            walled = {robot for robot, flight_s in flights_s.items() if math.isinf(flight_s)}
            if not walled:
                return tour, flights_s[tour[-1].robot]
            stops = [stop for stop in stops if stop.robot not in walled]
        return (), math.inf

    def _best(self, stops: Sequence[TourStop], context: SeekContext) -> tuple[TourStop, ...]:
        """The best tour; empty if no tour gains anything."""
        return best_tour(stops, context)

    def _course(self, robot: str, targets: TargetList) -> PredictedPath | None:
        """Where a robot will be, as far as this policy uses it; None: it was never received."""
        return targets.course(robot)

    def _places(self, course: PredictedPath, context: SeekContext) -> tuple[Point, ...]:
        """Where to seek a robot, in flight order."""
        return stretch(course, context)

    def _stops(self, targets: TargetList, context: SeekContext) -> list[TourStop]:
        """The robots that may be sought.

        Only one of the robots never received is included: all would be sought at the same place.
        """
        free, *_ = targets.groups(context.now_s)
        stops: list[TourStop] = []
        never_received = False
        for robot in free:
            course = self._course(robot, targets)
            if course is None and never_received:
                continue
            never_received |= course is None
            places = (context.unseen,) if course is None else self._places(course, context)
            flight_s = context.straight_s(places[0])
            over_s = context.began_s if course is None else course.end_s
            doubt_s = max(context.now_s + flight_s - over_s, 0.0)
            chance = context.round_s / (context.round_s + doubt_s)
            chance *= VAIN_SHARE ** targets.tracks[robot].tries
            gain_s = self.ages_s(robot, targets, context) * self.value(robot) * chance
            along_s = sum(context.leg_s(a, b) for a, b in pairwise(places))
            stops.append(TourStop(robot, places, gain_s, flight_s, along_s))
        return stops


def stretch(course: PredictedPath, context: SeekContext) -> tuple[Point, ...]:
    """Where on its path a robot may be when the vehicle arrives; the nearer end first."""
    if context.now_s >= course.end_s:
        return along(course, 0.0, course.length_m, context)
    flight_s = context.straight_s(course.place(course.along_m(context.now_s)))
    driven_m = course.speed_m_s * max(context.now_s + flight_s - course.start_s, 0.0)
    low_m, high_m = (min(share * driven_m, course.length_m) for share in SPREAD)
    return along(course, low_m, high_m, context)


def along(
    course: PredictedPath, low_m: float, high_m: float, context: SeekContext
) -> tuple[Point, ...]:
    """The part of a path between two distances, nearer end first."""
    if high_m - low_m < OFF_WAY_M:
        return (course.place(high_m),)
    ends = course.place(low_m), course.place(high_m)
    line = LineString((ends[0], *course.between(low_m, high_m), ends[1])).simplify(OFF_WAY_M)
    places = tuple(Point(*place) for place in line.coords)
    return min(places, places[::-1], key=lambda way: context.straight_s(way[0]))


def best_tour(stops: Iterable[TourStop], context: SeekContext) -> tuple[TourStop, ...]:
    """The stops in flight order; empty if no tour gains anything."""
    left, best = list(stops), 0.0
    tour: tuple[TourStop, ...] = ()
    while left and len(tour) < MOST_STOPS:
        longer = [
            (rate(way, context), way, stop)
            for stop in left
            for place in range(len(tour) + 1)
            for way in ((*tour[:place], stop, *tour[place:]),)
        ]
        brings, way, stop = max(longer, key=lambda each: each[0])
        if brings <= best:
            break
        best, tour = brings, way
        left.remove(stop)
    return tour


def rate(tour: Sequence[TourStop], context: SeekContext) -> float:
    """The expected reduction in age of information by a tour, per second."""
    legs_s = sum(context.leg_s(a.places[-1], b.places[0]) for a, b in pairwise(tour))
    along_s = sum(stop.along_s for stop in tour)
    time_s = tour[0].flight_s + legs_s + along_s + context.round_s
    return sum(stop.gain_s for stop in tour) / time_s
