"""Where a vehicle may be: inside every fence and clear of every no-fly zone.

All tests are exact, by distance to the zones and fences as drawn. There is no raster and no buffer
polygon, and the distance to a circle is the distance to its center less its radius.

The required distance to a zone is the zone's own clearance, or else that of the airspace, plus the
margin of the airspace. The required distance to a fence's border is the airspace's clearance plus
the margin. A place or a leg is clear when it keeps these distances (less a tolerance of a
micrometer, so that points computed to lie on the limit count as clear). A coordinate that is not
finite is not clear.

Places are (east, north) in meters in the local frame of the mission.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import cast

import numpy as np
from shapely import LineString, MultiPoint
from shapely import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry

from geo.airspace.fence import Fence
from geo.airspace.zone import Circle, Outline, Ring, Shape, Zone, rounded
from geo.airspace.zone_index import (
    TOLERANCE_M,
    Flags,
    Floats,
    ZoneIndex,
    leg_line,
    leg_lines,
)
from geo.frame import Point

__all__ = ["FENCE", "TOLERANCE_M", "Airspace", "Zone"]

FENCE = "fence"
"""The name of the fences in results."""


class Airspace:
    """Fences (or none), no-fly zones, and the required distance to both.

    Args:
        fences: the vehicle stays inside all of these; None or an empty list: no fence.
        zones: the vehicle stays outside these; they may overlap and touch.
        clearance_m: the least distance to every zone without its own clearance, and to the borders
            of fences.
        margin_m: added to every clearance. It may be negative; no required distance is below 0.
        relaxed_m: see `relaxed`.

    Raises:
        ZoneError: a fence is not a simple polygon.
        ValueError: the clearance is negative or not finite, or the margin is not a number.
    """

    def __init__(
        self,
        fences: Shape | Sequence[Point] | Sequence[Shape] | None,
        zones: Sequence[Zone],
        clearance_m: float,
        margin_m: float = 0.0,
        relaxed_m: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        if not 0 <= clearance_m < math.inf:
            raise ValueError(f"a clearance of {clearance_m} m; it must be 0 or more")
        if not margin_m < math.inf:
            raise ValueError(f"a margin of {margin_m} m; it must be a finite distance")
        self.fences = _shapes(fences)
        self.zones = tuple(zones)
        self.clearance_m = clearance_m
        self.margin_m = margin_m
        self.relaxed_m = relaxed_m
        # required distance to each zone
        self.distances_m = tuple(self._required_m(zone.clearance_m) for zone in self.zones)
        self.fence_distance_m = self._required_m(None)  # required distance to fences
        self._fences = tuple(Fence(shape, self.fence_distance_m) for shape in self.fences)
        self._index = ZoneIndex(self.zones, self.distances_m)
        # last leg and its result: the router tests the straight leg three times
        self._last_leg: tuple[Point, Point, bool] | None = None

    def with_margin(self, margin_m: float) -> Airspace:
        """The airspace with another margin.

        Args:
            margin_m: added to every clearance.
        """
        return Airspace(self.fences, self.zones, self.clearance_m, margin_m, self.relaxed_m)

    def as_drawn(self) -> Airspace:
        """The same fences and zones, with a required distance of 0."""
        return self.with_margin(-math.inf)

    def relaxed(self, shortfall_m: float, floor_m: float) -> Airspace:
        """The airspace with shorter required distances, for a vehicle that is already too near.

        Args:
            shortfall_m: subtracted from every required distance.
            floor_m: no required distance is reduced below this one. It is the vehicle's current
                distance, so that a zone with a large clearance does not cancel the others'.
        """
        relaxed_m = (shortfall_m, floor_m)
        return Airspace(self.fences, self.zones, self.clearance_m, self.margin_m, relaxed_m)

    def without(self, names: Sequence[str]) -> Airspace:
        """The airspace without the zones of these names, or without the fences.

        Args:
            names: names of zones; `FENCE` stands for all fences.
        """
        fences = () if FENCE in names else self.fences
        return self._of(fences, (zone for zone in self.zones if zone.name not in names))

    def without_zones_at(self, point: Point) -> Airspace:
        """The airspace without the zones that contain a point and the fences that do not.

        Args:
            point: the place of the vehicle.
        """
        place = ShapelyPoint(point)
        beyond = self._index.distances_m(place) > 0
        zones = (zone for zone, out in zip(self.zones, beyond, strict=True) if out)
        return self._of([fence.shape for fence in self._fences if fence.depth_m(place) >= 0], zones)

    def clear_of_leg(self, start: Point, end: Point) -> Airspace:
        """The airspace with only the zones and fences that a leg is clear of.

        Args:
            start: where the leg begins.
            end: where it ends.
        """
        leg = leg_line(start, end)
        far = self._index.far(leg)
        zones = (zone for zone, clear in zip(self.zones, far, strict=True) if clear)
        things = np.array([leg], dtype=object)
        return self._of([fence.shape for fence in self._fences if fence.keeps(things)[0]], zones)

    def around(self, point: Point, reach_m: float) -> Airspace:
        """The airspace with only the zones near a point.

        Args:
            point: the place.
            reach_m: the greatest distance of a zone.
        """
        distances_m = self._index.distances_m(ShapelyPoint(point))
        near = zip(self.zones, distances_m, strict=True)
        return self._of(self.fences, (zone for zone, distance_m in near if distance_m <= reach_m))

    def at(self, low_m: float, high_m: float) -> Airspace:
        """The airspace with only the zones that apply somewhere in a range of altitude.

        Args:
            low_m: the lower end, meters above home.
            high_m: the upper end, meters above home.
        """
        zones = (z for z in self.zones if z.band is None or z.band.meets(low_m, high_m))
        return self._of(self.fences, zones)

    def during(self, start: datetime, end: datetime | None) -> Airspace:
        """The airspace with only the zones that apply at some time in an interval.

        Args:
            start: the beginning, UTC.
            end: the end, UTC; None: without end.
        """
        zones = (z for z in self.zones if not z.validity or z.validity.active_between(start, end))
        return self._of(self.fences, zones)

    def point_clear(self, point: Point) -> bool:
        """Whether a point is clear."""
        return math.isfinite(point[0] + point[1]) and self._clear(ShapelyPoint(point))

    def leg_clear(self, start: Point, end: Point) -> bool:
        """Whether every point of the straight leg from `start` to `end` is clear."""
        if not math.isfinite(start[0] + start[1] + end[0] + end[1]):
            return False
        last_leg = self._last_leg
        if last_leg is None or last_leg[:2] != (start, end):
            last_leg = self._last_leg = start, end, self._leg_clear(start, end)
        return last_leg[2]

    def _leg_clear(self, start: Point, end: Point) -> bool:
        leg = leg_line(start, end)
        return not self._index.leg_close(start, end, leg) and self._within_fences(leg)

    def legs_clear(self, start: Point, ends: Sequence[Point]) -> list[bool]:
        """`leg_clear` from one place to many.

        Args:
            start: where all legs begin.
            ends: where they end.

        Returns:
            A flag for each end.
        """
        there = np.array(ends, dtype=float).reshape(-1, 2)
        starts = np.broadcast_to(start, there.shape)
        return [bool(clear) for clear in self.legs_clear_between(starts, there)]

    def points_clear(self, points: Sequence[Point]) -> list[bool]:
        """`point_clear` of many places.

        Args:
            points: the places.

        Returns:
            A flag for each place.
        """
        places = np.array(points, dtype=float).reshape(-1, 2)
        return [bool(clear) for clear in self.legs_clear_between(places, places)]

    def legs_clear_between(self, starts: Floats, ends: Floats) -> Flags:
        """`leg_clear` of many legs.

        Args:
            starts: array of shape (n, 2), east and north in meters.
            ends: array of the same shape.

        Returns:
            Array of n flags.
        """
        clear = np.asarray(np.isfinite(np.hstack((starts, ends))).all(axis=1))
        if not clear.all():
            starts, ends = (np.where(clear[:, None], places, 0.0) for places in (starts, ends))
        lines = leg_lines(starts, ends)
        for fence in self._fences:
            clear[clear] = fence.keeps(lines[clear])
        rest = np.flatnonzero(clear)
        clear[rest[self._index.legs_close(starts[rest], ends[rest], lines[rest])]] = False
        return clear

    def swept_clear(self, points: Sequence[Point]) -> bool:
        """Whether the convex hull of points is clear.

        A moving vehicle with a new target flies a curve; the points are the corners of an area that
        contains the curve.

        Args:
            points: the corners, in any order.
        """
        if not np.isfinite(points).all():
            return False
        return self._clear(MultiPoint(points).convex_hull)

    def blockers(self, start: Point, end: Point) -> tuple[str, ...]:
        """The obstacles of a leg.

        Args:
            start: where the leg begins.
            end: where it ends.

        Returns:
            Names of the zones (and `FENCE`) that the leg is not clear of.
        """
        leg = leg_line(start, end)
        names = [self.zones[index].name for index in sorted(self._index.close(leg))]
        if not self._within_fences(leg):
            names.append(FENCE)
        return tuple(names)

    def zones_at(self, point: Point) -> tuple[str, ...]:
        """The zones that contain a point.

        Args:
            point: the place.

        Returns:
            Names of the zones, and `FENCE` if the point is outside a fence.
        """
        place = ShapelyPoint(point)
        names = [self.zones[index].name for index in self._index.holding(place)]
        if any(fence.depth_m(place) < 0 for fence in self._fences):
            names.append(FENCE)
        return tuple(names)

    def distance_m(self, point: Point) -> float:
        """Distance to the nearest zone or fence border.

        Args:
            point: the place.

        Returns:
            Meters; negative inside a zone (depth) and outside a fence (distance); infinite without
            zones and fences.
        """
        return self.nearest(point)[0]

    def nearest(self, point: Point) -> tuple[float, str]:
        """The nearest zone or fence border.

        Args:
            point: the place.

        Returns:
            `distance_m`, and the name of the zone, or `FENCE`; "" without zones and fences.
        """
        return self._least(point, 0.0, 0.0)

    def clearance_left_m(self, point: Point) -> tuple[float, str]:
        """The least clearance left over all zones and fences.

        Args:
            point: the place.

        Returns:
            Distance less required distance in meters, negative if the point is too near, and the
            name of the zone, or `FENCE`; infinite and "" without zones and fences.
        """
        return self._least(point, np.array(self.distances_m), self.fence_distance_m)

    def required_m(self, name: str) -> float:
        """The required distance to the zones of a name, or to the borders of fences.

        Args:
            name: the name of a zone, or `FENCE`.

        Returns:
            Meters; the greatest if several zones have the name.

        Raises:
            KeyError: no zone has this name.
        """
        required = [
            d for zone, d in zip(self.zones, self.distances_m, strict=True) if zone.name == name
        ]
        if name == FENCE:
            required.append(self.fence_distance_m)
        if not required:
            raise KeyError(name)
        return max(required)

    def track_distance_m(self, points: Sequence[Point]) -> tuple[float, str]:
        """Closest approach of a polyline.

        Args:
            points: the corners of the polyline.

        Returns:
            Meters, and the name of the zone, or `FENCE`. Where the track enters a zone or leaves
            the fence, the distance is 0, or negative by the depth of its points. Without zones and
            fence: infinity and "".
        """
        if not points:
            return math.inf, ""
        track = leg_line(points[0], points[0]) if len(points) == 1 else LineString(points)
        closest = (math.inf, "")
        if self.zones:
            distances = self._index.distances_m(track)
            nearest = int(np.argmin(distances))
            closest = (max(float(distances[nearest]), 0.0), self.zones[nearest].name)
        for fence in self._fences:
            closest = min(closest, (max(fence.distance_m(track), 0.0), FENCE))
        if closest[0] > 0 and not self.zones_at(points[0]):
            return closest
        return min(closest, *(self.nearest(point) for point in points))

    def inflated(self) -> list[BaseGeometry]:
        """Every zone, grown by its required distance or slightly more.

        Returns:
            Polygons in the order of `zones`.
        """
        reaches = zip(self.zones, self.distances_m, strict=True)
        return [rounded(zone.shape, distance_m) for zone, distance_m in reaches]

    def _of(self, fences: Sequence[Shape], zones: Iterable[Zone]) -> Airspace:
        return Airspace(fences, tuple(zones), self.clearance_m, self.margin_m, self.relaxed_m)

    def _required_m(self, own_clearance_m: float | None) -> float:
        clearance_m = self.clearance_m if own_clearance_m is None else own_clearance_m
        distance_m = clearance_m + self.margin_m
        shortfall_m, floor_m = self.relaxed_m
        return max(distance_m - shortfall_m, min(distance_m, floor_m), 0.0)

    def _clear(self, shape: BaseGeometry) -> bool:
        return not self._index.close(shape).size and self._within_fences(shape)

    def _within_fences(self, shape: BaseGeometry) -> bool:
        things = np.array([shape], dtype=object)
        for fence in self._fences:  # noqa: SIM110 - called for every leg; a generator takes longer
            if not fence.keeps(things)[0]:
                return False
        return True

    def _least(
        self, point: Point, required_m: Floats | float, fence_required_m: float
    ) -> tuple[float, str]:
        """The smallest distance beyond the required one, and its zone or fence.

        Distances are negative inside zones and outside fences.
        """
        place = ShapelyPoint(point)
        least = (math.inf, "")
        if self.zones:
            distances_m = self._index.distances_m(place)
            for index in np.flatnonzero(distances_m == 0):
                shape = self.zones[index].shape
                if isinstance(shape, Outline):
                    distances_m[index] = -shape.border.distance(place)
            left_m = distances_m - required_m
            nearest = int(np.argmin(left_m))
            least = (float(left_m[nearest]), self.zones[nearest].name)
        for fence in self._fences:
            least = min(least, (fence.depth_m(place) - fence_required_m, FENCE))
        return least


def _shapes(fences: Shape | Sequence[Point] | Sequence[Shape] | None) -> tuple[Shape, ...]:
    if fences is None:
        return ()
    if isinstance(fences, Outline | Circle):
        return (fences,)
    if all(isinstance(shape, Outline | Circle) for shape in fences):
        return tuple(cast("Sequence[Shape]", fences))
    return (Outline(cast("Ring", tuple(fences))),)
