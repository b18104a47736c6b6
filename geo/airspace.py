"""Where a vehicle may be: inside the fence and clear of every no-fly zone.

All tests are exact, by distance to the zones and the fence as they were drawn: nothing is rastered
and no buffer polygon takes part. A place or a leg is clear when it keeps `clearance_m` of distance
(less a tolerance of a micrometre, so that points computed to lie on the limit count as clear).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
import shapely
from shapely import LineString, MultiPoint, Polygon, STRtree
from shapely import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points

from geo.frame import Point
from geo.zone import Ring, Zone, checked_ring

__all__ = ["FENCE", "TOLERANCE_M", "Airspace", "Zone"]

FENCE = "fence"
"""The name that stands for the fence in answers about what is near or in the way."""

TOLERANCE_M = 1e-6

_NODE_MARGIN_M = 0.01
"""Corners of detours keep this much more than the clearance, so that legs along a zone's side
never fail their own test by rounding."""

_ARC_STEPS = 16

_UNFENCED_M = (-1e6, -1e6, 1e6, 1e6)
"""What is drawn of an airspace without a fence."""


class Airspace:
    """A fence (or none), no-fly zones, and the distance to keep from both.

    Args:
        fence: the vehicle stays inside of this ring; None if there is no fence.
        zones: the vehicle stays outside of these; they may overlap and touch.
        clearance_m: the least distance to any zone and to the fence's border.

    Raises:
        ZoneError: the fence is not a simple polygon.
        ValueError: the clearance is negative or not finite.
    """

    def __init__(self, fence: Ring | None, zones: Sequence[Zone], clearance_m: float) -> None:
        if not 0 <= clearance_m < math.inf:
            raise ValueError(f"a clearance of {clearance_m} m; it must be 0 or more")
        self.fence = None if fence is None else checked_ring(fence)
        self.zones = tuple(zones)
        self.clearance_m = clearance_m
        self._threshold_m = max(clearance_m - TOLERANCE_M, 0.0)
        self._polygons: tuple[Polygon, ...] = tuple(Polygon(zone.ring) for zone in self.zones)
        self._tree = STRtree(self._polygons)
        self._inside = None if self.fence is None else Polygon(self.fence)
        self._border = None if self._inside is None else self._inside.exterior
        if self._inside is not None:
            shapely.prepare([self._inside, self._border])

    def __repr__(self) -> str:
        fence = "no fence" if self.fence is None else f"a fence of {len(self.fence)} corners"
        return f"Airspace({fence}, {len(self.zones)} zones, clearance {self.clearance_m} m)"

    def with_clearance(self, clearance_m: float) -> Airspace:
        """The same fence and zones with another clearance."""
        return Airspace(self.fence, self.zones, clearance_m)

    def without(self, names: Sequence[str]) -> Airspace:
        """The airspace without the zones (or the fence) of these names."""
        zones = tuple(zone for zone in self.zones if zone.name not in names)
        return Airspace(None if FENCE in names else self.fence, zones, self.clearance_m)

    def point_clear(self, point: Point) -> bool:
        """Whether the vehicle may be here."""
        return self._clear(ShapelyPoint(point))

    def leg_clear(self, start: Point, end: Point) -> bool:
        """Whether every point of the straight leg is clear."""
        return self._clear(_line(start, end))

    def legs_clear(self, start: Point, ends: Sequence[Point]) -> list[bool]:
        """`leg_clear` from one place to many, in bulk."""
        if not ends:
            return []
        coordinates = np.empty((len(ends), 2, 2))
        coordinates[:, 0] = start
        coordinates[:, 1] = ends
        lines = shapely.linestrings(coordinates)
        clear = np.ones(len(ends), dtype=bool)
        hit, _ = self._tree.query(lines, predicate="dwithin", distance=self._threshold_m)
        clear[hit] = False
        if self._inside is not None:
            clear &= shapely.contains_xy(self._inside, *start)
            clear &= ~shapely.dwithin(self._border, lines, self._threshold_m)
        return [
            bool(answer) if end != start else self.point_clear(start)
            for answer, end in zip(clear, ends, strict=True)
        ]

    def swept_clear(self, points: Sequence[Point]) -> bool:
        """Whether the convex hull of the points is clear.

        A vehicle that is moving when it is sent elsewhere cuts a curve; position, stopping point
        and target span an area that contains it.
        """
        return self._clear(MultiPoint(points).convex_hull)

    def blockers(self, start: Point, end: Point) -> tuple[str, ...]:
        """Names of the zones (and `FENCE`) that keep the leg from being clear."""
        leg = _line(start, end)
        hits = self._tree.query(leg, predicate="dwithin", distance=self._threshold_m)
        names = [self.zones[index].name for index in sorted(hits)]
        if not self._within_fence(leg):
            names.append(FENCE)
        return tuple(names)

    def holders(self, point: Point) -> tuple[str, ...]:
        """Names of the zones that the point is in, and `FENCE` if it is outside of the fence."""
        place = ShapelyPoint(point)
        names = [self.zones[i].name for i in sorted(self._tree.query(place, "intersects"))]
        if self._inside is not None and not self._inside.covers(place):
            names.append(FENCE)
        return tuple(names)

    def distance_m(self, point: Point) -> float:
        """Distance to the nearest zone or fence border.

        It is negative inside a zone (how deep) and outside of the fence (how far); infinite when
        there is neither zone nor fence.
        """
        return self.nearest(point)[0]

    def nearest(self, point: Point) -> tuple[float, str]:
        """`distance_m`, and the name of the zone (or `FENCE`) that is so near; "" for nothing."""
        return min(self._distances(point), default=(math.inf, ""))

    def track_distance_m(self, points: Sequence[Point]) -> tuple[float, str]:
        """Closest approach of a polyline, and the name of what it approached.

        Where the track enters a zone or leaves the fence the distance is 0 or, by as much as one of
        its points lies beyond the border, negative. Without zones and fence: infinity and "".
        """
        if not points:
            return math.inf, ""
        track = _line(points[0], points[0]) if len(points) == 1 else LineString(points)
        closest = (math.inf, "")
        for polygon, zone in zip(self._polygons, self.zones, strict=True):
            closest = min(closest, (float(polygon.distance(track)), zone.name))
        if self._border is not None:
            closest = min(closest, (float(self._border.distance(track)), FENCE))
        if closest[0] > 0 and not self.holders(points[0]):
            return closest
        return min(closest, *(self.nearest(point) for point in points))

    def nearest_clear(self, point: Point) -> Point | None:
        """The closest place to go to: the point itself if it is clear; None if nowhere is."""
        if self.point_clear(point):
            return point
        if self.free.is_empty:
            return None
        nearest, _ = nearest_points(self.free, ShapelyPoint(point))
        found = Point(nearest.x, nearest.y)
        return found if self.point_clear(found) else None

    @cached_property
    def free(self) -> BaseGeometry:
        """The clear area, drawn a centimetre (and 0.3 % of the clearance) too small.

        For finding places and telling regions apart; the tests above do not use it.
        """
        return self._free(_rounded)

    @cached_property
    def free_mitred(self) -> BaseGeometry:
        """The clear area with few corners; up to a tenth of the clearance too small at corners."""
        return self._free(_mitred)

    def inflated(self, reach_m: float) -> list[BaseGeometry]:
        """Every zone, grown by `reach_m` or slightly more, never less; in the order of `zones`."""
        return [_rounded(polygon, reach_m) for polygon in self._polygons]

    def _free(self, grown: Callable[[Polygon, float], BaseGeometry]) -> BaseGeometry:
        reach_m = self.clearance_m + _NODE_MARGIN_M
        if self._inside is not None:
            inside = grown(self._inside, -reach_m)
        else:
            west, south, east, north = _UNFENCED_M
            inside = shapely.box(west, south, east, north)
        zones = [grown(polygon, reach_m) for polygon in self._polygons]
        return inside.difference(shapely.union_all(zones))

    def _clear(self, shape: BaseGeometry) -> bool:
        hits = self._tree.query(shape, predicate="dwithin", distance=self._threshold_m)
        return len(hits) == 0 and self._within_fence(shape)

    def _within_fence(self, shape: BaseGeometry) -> bool:
        if self._inside is None or self._border is None:
            return True
        # A connected shape that stays away from the border lies on the side of any of its points.
        first = shapely.get_coordinates(shape)[0]
        return bool(shapely.contains_xy(self._inside, *first)) and not bool(
            shapely.dwithin(self._border, shape, self._threshold_m)
        )

    def _distances(self, point: Point) -> Iterator[tuple[float, str]]:
        place = ShapelyPoint(point)
        for polygon, zone in zip(self._polygons, self.zones, strict=True):
            distance_m = float(polygon.distance(place))
            if distance_m == 0:
                distance_m = -float(polygon.exterior.distance(place))
            yield distance_m, zone.name
        if self._inside is not None and self._border is not None:
            distance_m = float(self._border.distance(place))
            yield (distance_m if self._inside.covers(place) else -distance_m), FENCE


def _line(start: Point, end: Point) -> BaseGeometry:
    # GEOS 3.14 answers dwithin wrongly for a prepared shape and a line without length.
    return LineString((start, end)) if tuple(start) != tuple(end) else ShapelyPoint(start)


def _mitred(polygon: Polygon, reach_m: float) -> BaseGeometry:
    # A mitre limit of 1.1 was measured never to fall short of the reach; bevelled corners do.
    return polygon.buffer(reach_m, join_style="mitre", mitre_limit=1.1)


def _rounded(polygon: Polygon, reach_m: float) -> BaseGeometry:
    # GEOS rounds the number of steps of an arc, so that a step may be half as long again: the
    # usual compensation for the chord still falls short, this one does not.
    step = 1.5 * (math.pi / 2) / _ARC_STEPS
    return polygon.buffer(reach_m / math.cos(step / 2), quad_segs=_ARC_STEPS)
