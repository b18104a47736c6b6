"""Where a robot will be, by the path that it published."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate, pairwise

from geo.frame import Point, off_line_m


@dataclass(frozen=True, slots=True)
class PredictedPath:
    """The predicted track of a robot on its published path; a single point is a robot at rest.

    Attributes:
        points: Its path.
        start_s: Time at the first point, on the vehicle's clock.
        speed_m_s: Its speed.
    """

    points: tuple[Point, ...]
    start_s: float
    speed_m_s: float

    @property
    def length_m(self) -> float:
        """Length of the path."""
        return sum(math.dist(a, b) for a, b in pairwise(self.points))

    @property
    def end_s(self) -> float:
        """Time of arrival at the end, after which nothing is predicted."""
        return self.due_s(self.length_m)

    def due_s(self, along_m: float) -> float:
        """Time at which the robot has driven this far."""
        return self.start_s + along_m / self.speed_m_s

    def along_m(self, now_s: float) -> float:
        """Distance driven by now, from 0 to the path's length."""
        return min(max((now_s - self.start_s) * self.speed_m_s, 0.0), self.length_m)

    def between(self, low_m: float, high_m: float) -> tuple[Point, ...]:
        """The corners of the path between two distances along it."""
        starts_m = accumulate((math.dist(a, b) for a, b in pairwise(self.points)), initial=0.0)
        corners = zip(starts_m, self.points, strict=True)
        return tuple(corner for start_m, corner in corners if low_m < start_m < high_m)

    def place(self, along_m: float) -> Point:
        """The point at this distance."""
        starts_m = accumulate((math.dist(a, b) for a, b in pairwise(self.points)), initial=0.0)
        for start_m, (a, b) in zip(starts_m, pairwise(self.points), strict=False):
            leg_m = math.dist(a, b)
            if along_m <= start_m + leg_m and leg_m > 0:
                share = max(along_m - start_m, 0.0) / leg_m
                return Point(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
        return self.points[-1]


def ahead_of(path: tuple[Point, ...], place: Point) -> tuple[tuple[Point, ...], float]:
    """The part of a path ahead of a place, and the distance of that place from the path."""
    best, off_m = 0, math.dist(path[0], place)
    for index, (a, b) in enumerate(pairwise(path), start=1):
        away_m = off_line_m(place, a, b)
        if away_m < off_m:
            best, off_m = index, away_m
    return path[best:], off_m
