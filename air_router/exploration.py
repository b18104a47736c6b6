"""Which waypoint is next, which were left out, and when each was last passed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from air_router.navigator import Goal

if TYPE_CHECKING:
    from air_router.mission import Waypoint
    from geo.frame import Point

PASSING_M = 15.0
"""Passing a waypoint so closely counts as having been there when we look for a lost robot."""


@dataclass(slots=True)
class Exploration:
    """The waypoints in the operator's order, explored once; resumes where it stopped."""

    waypoints: Sequence[Waypoint]
    left_out: list[int] = field(default_factory=list)
    _next: int = 0
    _passed_s: dict[int, float] = field(default_factory=dict)

    @property
    def remaining(self) -> int:
        """How many waypoints are still to be visited."""
        return len(self.waypoints) - self._next

    @property
    def goal(self) -> Goal:
        """The waypoint whose turn it is; only while some remain."""
        waypoint = self.waypoints[self._next]
        return Goal(waypoint.position, waypoint.number)

    def visited(self) -> None:
        """The waypoint whose turn it was is done."""
        self._next += 1

    def leave_out(self) -> int:
        """Give the waypoint whose turn it was up; returns its number."""
        number = self.waypoints[self._next].number
        self.left_out.append(number)
        self._next += 1
        return number

    def mark(self) -> int:
        """Where exploration stands, to come `back_to`."""
        return self._next

    def back_to(self, mark: int) -> None:
        """Take back what was left out since a mark, which lies after the last visit."""
        del self.left_out[len(self.left_out) - (self._next - mark) :]
        self._next = mark

    def passing(self, position: Point, now_s: float) -> None:
        """Note which waypoints the vehicle is near."""
        for waypoint in self.waypoints:
            if math.dist(position, waypoint.position) <= PASSING_M:
                self._passed_s[waypoint.number] = now_s

    def longest_unseen(self) -> Goal:
        """Where a robot may be that was never heard: the waypoint passed longest ago.

        Of those never passed the one farthest from all that were, in the middle of the unknown.
        """
        passed = [w.position for w in self.waypoints if w.number in self._passed_s]

        def rank(waypoint: Waypoint) -> tuple[float, float]:
            away_m = min((math.dist(waypoint.position, p) for p in passed), default=0.0)
            return self._passed_s.get(waypoint.number, -math.inf), -away_m

        waypoint = min(self.waypoints, key=rank)
        return Goal(waypoint.position, waypoint.number)
