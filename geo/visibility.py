"""The shortest clear path around the corners of zones and fence.

A visibility graph: its corners lie a centimetre outside of the clearance, its legs are judged by
the airspace's own exact test, so that every leg of a path that is returned is clear. A gap that is
less than two centimetres (and 0.6 % of the clearance) wider than twice the clearance counts as
closed; one that is not much wider, at pointed corners up to half, is passed only where no other way
is open.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from geo.airspace import Airspace
from geo.frame import Point
from geo.regions import Regions
from geo.zone import polygons_of

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

_SLACK_M2 = 1e-6
"""A turn flatter than this counts as straight on, so that rounding never costs a path."""


def shortest_path(airspace: Airspace, start: Point, end: Point) -> tuple[Point, ...] | None:
    """The shortest clear path from start to end, both included; None if there is none."""
    return path_finder(airspace).path(start, end)


@lru_cache(maxsize=8)
def path_finder(airspace: Airspace) -> PathFinder:
    """The path finder of an airspace; made once, then kept."""
    return PathFinder(airspace)


class PathFinder:
    """Finds shortest paths with few corners, and looks closer only where there is none."""

    def __init__(self, airspace: Airspace) -> None:
        self._airspace = airspace

    def path(
        self, start: Point, end: Point, *, first: Callable[[Point], bool] | None = None
    ) -> tuple[Point, ...] | None:
        """The shortest clear path from start to end, both included; None if there is none.

        Args:
            start: where the path begins.
            end: where it ends.
            first: what the first leg must satisfy, told by its end, instead of being clear.
        """
        path = self._mitred.path(start, end, first=first)
        if path is None and (first is not None or self._regions.connected(start, end)):
            path = self._round.path(start, end, first=first)
        return path

    def nearest_corners(self, point: Point) -> list[Point]:
        """The corners that paths turn at, nearest first."""
        return self._mitred.nearest(point)

    @cached_property
    def _regions(self) -> Regions:
        return Regions(self._airspace)

    @cached_property
    def _mitred(self) -> Corners:
        return Corners(self._airspace, self._airspace.free_mitred)

    @cached_property
    def _round(self) -> Corners:
        return Corners(self._airspace, self._airspace.free)


class Corners:
    """The corners of an airspace's clear area, and who sees whom."""

    def __init__(self, airspace: Airspace, free: BaseGeometry) -> None:
        self._airspace = airspace
        self._free = free
        shapely.prepare(free)
        here, before, after = _reflex_corners(free)
        self._here, self._before, self._after = here, before, after
        self._points = [Point(float(east), float(north)) for east, north in here]
        self._seen: dict[int, list[tuple[int, float]]] = {}

    def path(
        self, start: Point, end: Point, *, first: Callable[[Point], bool] | None = None
    ) -> tuple[Point, ...] | None:
        """As `PathFinder.path`, by way of these corners only."""
        start_ok = first or (lambda to: self._airspace.leg_clear(start, to))
        if start_ok(end):
            return (start, end)
        if not self._airspace.point_clear(end):
            return None
        goal = len(self._points)
        last_legs = dict(self._visible(end))
        queue: list[tuple[float, float, int, int]] = []
        for corner, length_m in self._visible(start, start_ok if first else None):
            estimate_m = length_m + math.dist(self._points[corner], end)
            heapq.heappush(queue, (estimate_m, length_m, corner, -1))
        came_from: dict[int, int] = {}
        while queue:
            _, so_far_m, corner, previous = heapq.heappop(queue)
            if corner in came_from:
                continue
            came_from[corner] = previous
            if corner == goal:
                return (start, *self._trace(came_from, previous), end)
            for other, length_m in self._neighbours(corner):
                if other not in came_from:
                    reach_m = so_far_m + length_m
                    estimate_m = reach_m + math.dist(self._points[other], end)
                    heapq.heappush(queue, (estimate_m, reach_m, other, corner))
            if corner in last_legs:
                reach_m = so_far_m + last_legs[corner]
                heapq.heappush(queue, (reach_m, reach_m, goal, corner))
        return None

    def nearest(self, point: Point) -> list[Point]:
        """The corners, nearest first."""
        return sorted(self._points, key=lambda corner: math.dist(corner, point))

    def _trace(self, came_from: dict[int, int], corner: int) -> list[Point]:
        path = []
        while corner >= 0:
            path.append(self._points[corner])
            corner = came_from[corner]
        return path[::-1]

    def _visible(
        self, point: Point, allowed: Callable[[Point], bool] | None = None
    ) -> list[tuple[int, float]]:
        """Corners that a path from the point can turn at first, with their distances."""
        if shapely.intersects_xy(self._free, *point):
            indices = np.flatnonzero(self._tangent_from(np.array(point)))
        else:  # between the limit and the corners, which lie a bit outside of it
            indices = np.arange(len(self._points))
        ends = [self._points[i] for i in indices]
        if allowed is None:
            clear = self._airspace.legs_clear(point, ends)
        else:
            clear = [allowed(end) for end in ends]
        return [
            (int(i), math.dist(point, end))
            for i, end, ok in zip(indices, ends, clear, strict=True)
            if ok
        ]

    def _neighbours(self, corner: int) -> list[tuple[int, float]]:
        if corner not in self._seen:
            here, before, after = self._here[corner], self._before[corner], self._after[corner]
            # A shortest path only turns around a corner: both sides of it lie on one hand.
            leaving = _one_sided(here, self._here, before, after)
            arriving = self._tangent_from(here)
            indices = [int(i) for i in np.flatnonzero(leaving & arriving) if i != corner]
            ends = [self._points[i] for i in indices]
            clear = self._airspace.legs_clear(self._points[corner], ends)
            self._seen[corner] = [
                (i, math.dist(self._points[corner], end))
                for i, end, ok in zip(indices, ends, clear, strict=True)
                if ok
            ]
        return self._seen[corner]

    def _tangent_from(self, origin: Floats) -> Flags:
        """Which corners a line from the origin touches without cutting into their angle."""
        return _one_sided(origin, self._here, self._before, self._after)


def _one_sided(a: Floats, b: Floats, first: Floats, second: Floats) -> Flags:
    """Whether `first` and `second` lie on the same side of the line from a to b, or on it."""
    along = b - a
    hand_1 = along[..., 0] * (first - a)[..., 1] - along[..., 1] * (first - a)[..., 0]
    hand_2 = along[..., 0] * (second - a)[..., 1] - along[..., 1] * (second - a)[..., 0]
    slack = _SLACK_M2 * (1 + np.abs(along).sum(axis=-1))
    same = (np.minimum(hand_1, hand_2) >= -slack) | (np.maximum(hand_1, hand_2) <= slack)
    return np.asarray(same, dtype=np.bool_)


def _reflex_corners(free: BaseGeometry) -> tuple[Floats, Floats, Floats]:
    """The corners that stick out into the clear area, with their neighbours on the border."""
    found: list[Floats] = []
    for part in polygons_of(free):
        oriented = shapely.geometry.polygon.orient(part)  # the clear area lies to the left
        for ring in (oriented.exterior, *oriented.interiors):
            here = shapely.get_coordinates(ring)[:-1]
            before, after = np.roll(here, 1, axis=0), np.roll(here, -1, axis=0)
            arriving, leaving = here - before, after - here
            turn = arriving[:, 0] * leaving[:, 1] - arriving[:, 1] * leaving[:, 0]
            right = turn < 0
            found.append(np.stack([here[right], before[right], after[right]]))
    corners = np.concatenate(found, axis=1) if found else np.empty((3, 0, 2))
    return corners[0], corners[1], corners[2]
