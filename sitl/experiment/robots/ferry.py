"""A message ferry under partial observation, for comparison: beliefs of where robots are.

The problem is a POMDP: robots move on while they are out of reach, and a search shows only whether
a robot was in reach of where the UAV flew. Its exact solution is out of reach for a team, so this
takes the usual way: a belief by particles for each robot, and the action that is best by what the
belief is now, as if it were to be known afterwards (QMDP: Littman, Cassandra and Kaelbling,
Learning policies for partially observable environments, ICML 1995).
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from air_router.controller.targets import (
    PredictedPath,
    SearchPlace,
    SeekContext,
    TargetList,
    Tour,
    TourStop,
)
from geo.frame import Point

PARTICLES: Final = 96
"""Of each robot."""

PACE: Final = (0.5, 1.3)
"""A robot drives between so much and so much of the speed that is known of it."""

STAYS, RETURNS = 0.4, 0.3
"""Shares of the robots that stay at the end of their path and that drive back along it. The others
drive on to some place that nothing is known of."""

HOP_M: Final = (20.0, 120.0)
"""How far away such a place is."""

MISSED: Final = 0.1
"""Chance that a robot in reach of the UAV is not received."""

MOST_PLACES: Final = 4
"""A robot is looked for at so many places at most in one search."""

LEAST_GAIN: Final = 0.05
"""A further place has to add so much to the chance to find it."""

_TRIED: Final = 24
"""So many particles' places are tried as places to look at."""

Places = npt.NDArray[np.float64]
"""(n, 2): east, north in metres."""


@dataclass(slots=True)
class _Belief:
    """Where one robot may be.

    Attributes:
        course: What it was made of; another one makes a new belief.
        pace, hop_m, turn, kind: Of each particle: its share of the speed, how far and in which
            direction (radians) it goes on at the end of its path, and a draw of what it does there.
        weights: How likely each is; they sum to 1.
        looked: Where it was looked for last, and when; None: it was not, or was found.
    """

    course: PredictedPath
    pace: npt.NDArray[np.float64]
    hop_m: npt.NDArray[np.float64]
    turn: npt.NDArray[np.float64]
    kind: npt.NDArray[np.float64]
    weights: npt.NDArray[np.float64] = field(
        default_factory=lambda: np.full(PARTICLES, 1 / PARTICLES)
    )
    looked: tuple[tuple[Point, ...], float] | None = None

    @classmethod
    def of(cls, robot: str, course: PredictedPath) -> _Belief:
        chance = random.Random(f"{robot} {course.start_s:.3f}")  # noqa: S311 - repeatable

        def drawn(low: float, high: float) -> npt.NDArray[np.float64]:
            return np.array([chance.uniform(low, high) for _ in range(PARTICLES)])

        return cls(course, drawn(*PACE), drawn(*HOP_M), drawn(0, math.tau), drawn(0, 1))

    def at(self, time_s: float) -> Places:
        """The particles at a time."""
        course, length_m = self.course, self.course.length_m
        driven_m = np.maximum(time_s - course.start_s, 0.0) * course.speed_m_s * self.pace
        beyond_m = np.maximum(driven_m - length_m, 0.0)
        back = (self.kind >= STAYS) & (self.kind < STAYS + RETURNS)
        along_m = np.minimum(driven_m, length_m)
        along_m = np.where(back, np.maximum(along_m - beyond_m, 0.0), along_m)
        places: Places = np.array([course.place(each) for each in along_m.tolist()])
        goes_on = self.kind >= STAYS + RETURNS
        reach_m = np.where(goes_on, np.minimum(beyond_m, self.hop_m), 0.0)
        places += (reach_m * np.array([np.cos(self.turn), np.sin(self.turn)])).T
        return places

    def missed(self, reach_m: float) -> None:
        """It was not found where it was looked for."""
        if self.looked is None:
            return
        way, time_s = self.looked
        self.looked = None
        near = _near(self.at(time_s), way, reach_m)
        self.weights = self.weights * np.where(near, MISSED, 1.0)
        self.weights /= self.weights.sum()


class Ferry(Tour):
    """A `tour` whose places and chances are those of beliefs.

    Args:
        reach_m: Horizontal distance within which robots are received.
    """

    def __init__(self, reach_m: float) -> None:
        super().__init__()
        self._reach_m = reach_m
        self._beliefs: dict[str, _Belief] = {}  # by robot

    def order(self, targets: TargetList, context: SeekContext) -> Iterator[SearchPlace]:
        """As `Policy.order`."""
        for robot, belief in self._beliefs.items():
            if targets.tracks[robot].tries:
                belief.missed(self._reach_m)
        for number, place in enumerate(super().order(targets, context)):
            if number == 0:
                for robot in (*place.over, place.robot):
                    self._remember(robot, targets, context)
            yield place

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """As `Policy.place`."""
        belief = self._belief(robot, targets)
        if belief is None:
            return super().place(robot, targets, context)
        way, chance = self._way(belief, context)
        why = f"it may be there by {100 * chance:.0f} %"
        return SearchPlace(robot, way[-1], why, along=way[:-1])

    def _stops(self, targets: TargetList, context: SeekContext) -> list[TourStop]:
        found = []
        for stop in super()._stops(targets, context):
            belief = self._belief(stop.robot, targets)
            if belief is None:
                found.append(stop)
                continue
            way, chance = self._way(belief, context)
            gain_s = self.ages_s(stop.robot, targets, context) * self.value(stop.robot) * chance
            along_s = sum(context.leg_s(a, b) for a, b in pairwise(way))
            flight_s = context.straight_s(way[0])
            found.append(
                replace(stop, places=way, gain_s=gain_s, flight_s=flight_s, along_s=along_s)
            )
        return found

    def _belief(self, robot: str, targets: TargetList) -> _Belief | None:
        course = self._course(robot, targets)
        if course is None:
            return None
        known = self._beliefs.get(robot)
        if known is None or known.course != course:
            known = self._beliefs[robot] = _Belief.of(robot, course)
        return known

    def _remember(self, robot: str, targets: TargetList, context: SeekContext) -> None:
        belief = self._belief(robot, targets)
        if belief is not None:
            way, _ = self._way(belief, context)
            belief.looked = way, context.now_s + context.straight_s(way[0])

    def _way(self, belief: _Belief, context: SeekContext) -> tuple[tuple[Point, ...], float]:
        """Where a robot is looked for, in the order in which it is flown; the chance to find it."""
        middle = np.average(belief.at(context.now_s), axis=0, weights=belief.weights)
        arrival_s = context.now_s + context.straight_s(Point(*middle.tolist()))
        places = belief.at(arrival_s)
        likely = np.argsort(-belief.weights, kind="stable")[:: PARTICLES // _TRIED]
        tried = [Point(*place) for place in places[likely].tolist()]
        way: tuple[Point, ...] = ()
        chance = 0.0
        while len(way) < MOST_PLACES:
            longer = [
                (float(belief.weights[_near(places, new, self._reach_m)].sum()), new)
                for place in tried
                for new in ((*way, place),)
            ]
            found, new = max(longer, key=lambda each: each[0])
            if way and found < chance + LEAST_GAIN:
                break
            way, chance = new, found
        return min(way, way[::-1], key=lambda each: context.straight_s(each[0])), chance


def _near(places: Places, way: Sequence[Point], reach_m: float) -> npt.NDArray[np.bool_]:
    """Which places are within reach of a way."""
    near = np.hypot(*(places - way[0]).T) <= reach_m
    for a, b in pairwise(way):
        line = np.subtract(b, a)
        length2 = float(line @ line)
        if length2:
            share = np.clip((places - a) @ line / length2, 0.0, 1.0)
            near |= np.hypot(*(places - (np.array(a) + share[:, None] * line)).T) <= reach_m
    return np.asarray(near)
