"""Where a vehicle may be: inside of every fence and clear of every no-fly zone.

All tests are exact, by distance to the zones and fences as they were drawn: nothing is rastered,
no buffer polygon takes part, and the distance to a circle is that to its centre less its radius.

The distance to keep from a zone is the zone's own clearance, or else that of the airspace, plus the
margin of the airspace; from a fence's border it is the airspace's clearance plus the margin. A
place or a leg is clear when it keeps these distances (less a tolerance of a micrometre, so that
points computed to lie on the limit count as clear). What is not finite is not clear.
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
"""The name that stands for the fences in answers about what is near or in the way."""


class Airspace:
    """Fences (or none), no-fly zones, and the distance to keep from both.

    Args:
        fences: the vehicle stays inside of all of these; None or an empty list: no fence.
        zones: the vehicle stays outside of these; they may overlap and touch.
        clearance_m: the least distance to every zone that has no clearance of its own, and to the
            fences' borders.
        margin_m: kept on top of every clearance. It may be negative: no distance gets less than 0.
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
        # to keep, by zone
        self.distances_m = tuple(self._required_m(zone.clearance_m) for zone in self.zones)
        self.fence_distance_m = self._required_m(None)  # to keep from fences
        self._fences = tuple(Fence(shape, self.fence_distance_m) for shape in self.fences)
        self._index = ZoneIndex(self.zones, self.distances_m)
        # the last leg, and whether it is clear: a route asks for the straight one three times
        self._last_leg: tuple[Point, Point, bool] | None = None

    def with_margin(self, margin_m: float) -> Airspace:
        """The same with another margin on top of every clearance."""
        return Airspace(self.fences, self.zones, self.clearance_m, margin_m, self.relaxed_m)

    def as_drawn(self) -> Airspace:
        """The same fences and zones, with no distance to keep from them."""
        return self.with_margin(-math.inf)

    def relaxed(self, shortfall_m: float, floor_m: float) -> Airspace:
        """The same with every distance shorter by `shortfall_m`, but none below `floor_m` for that.

        For a vehicle that is too near to something: it may stay as near for a moment. The floor is
        how near it is, so that a zone with a wide clearance does not take away all of the others'.
        """
        relaxed_m = (shortfall_m, floor_m)
        return Airspace(self.fences, self.zones, self.clearance_m, self.margin_m, relaxed_m)

    def without(self, names: Sequence[str]) -> Airspace:
        """The airspace without the zones (or the fences) of these names."""
        fences = () if FENCE in names else self.fences
        return self._of(fences, (zone for zone in self.zones if zone.name not in names))

    def without_zones_at(self, point: Point) -> Airspace:
        """The airspace without the zones that a point is in, and the fences that it is not in."""
        place = ShapelyPoint(point)
        beyond = self._index.distances_m(place) > 0
        zones = (zone for zone, out in zip(self.zones, beyond, strict=True) if out)
        return self._of([fence.shape for fence in self._fences if fence.depth_m(place) >= 0], zones)

    def clear_of_leg(self, start: Point, end: Point) -> Airspace:
        """The airspace with only those zones and fences that a leg keeps its distance from."""
        leg = leg_line(start, end)
        far = self._index.far(leg)
        zones = (zone for zone, clear in zip(self.zones, far, strict=True) if clear)
        things = np.array([leg], dtype=object)
        return self._of([fence.shape for fence in self._fences if fence.keeps(things)[0]], zones)

    def around(self, point: Point, reach_m: float) -> Airspace:
        """The airspace with only the zones that come nearer than this to a point."""
        distances_m = self._index.distances_m(ShapelyPoint(point))
        near = zip(self.zones, distances_m, strict=True)
        return self._of(self.fences, (zone for zone, distance_m in near if distance_m <= reach_m))

    def at(self, low_m: float, high_m: float) -> Airspace:
        """The airspace with only the zones that apply somewhere in a range above home."""
        zones = (z for z in self.zones if z.band is None or z.band.meets(low_m, high_m))
        return self._of(self.fences, zones)

    def during(self, start: datetime, end: datetime | None) -> Airspace:
        """The airspace with only the zones that apply at some time between (None: for ever)."""
        zones = (z for z in self.zones if not z.validity or z.validity.active_between(start, end))
        return self._of(self.fences, zones)

    def point_clear(self, point: Point) -> bool:
        """Whether the vehicle may be here."""
        return math.isfinite(point[0] + point[1]) and self._clear(ShapelyPoint(point))

    def leg_clear(self, start: Point, end: Point) -> bool:
        """Whether every point of the straight leg is clear."""
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
        """`leg_clear` from one place to many, in bulk."""
        there = np.array(ends, dtype=float).reshape(-1, 2)
        starts = np.broadcast_to(start, there.shape)
        return [bool(clear) for clear in self.legs_clear_between(starts, there)]

    def points_clear(self, points: Sequence[Point]) -> list[bool]:
        """`point_clear` of many places, in bulk."""
        places = np.array(points, dtype=float).reshape(-1, 2)
        return [bool(clear) for clear in self.legs_clear_between(places, places)]

    def legs_clear_between(self, starts: Floats, ends: Floats) -> Flags:
        """`leg_clear` of many legs at once; both arrays have a row of (east, north) for each."""
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
        """Whether the convex hull of the points is clear.

        A vehicle that is moving when it is sent elsewhere cuts a curve; its caller gives corners
        of an area that contains it.
        """
        if not np.isfinite(points).all():
            return False
        return self._clear(MultiPoint(points).convex_hull)

    def blockers(self, start: Point, end: Point) -> tuple[str, ...]:
        """Names of the zones (and `FENCE`) that keep the leg from being clear."""
        leg = leg_line(start, end)
        names = [self.zones[index].name for index in sorted(self._index.close(leg))]
        if not self._within_fences(leg):
            names.append(FENCE)
        return tuple(names)

    def zones_at(self, point: Point) -> tuple[str, ...]:
        """Names of the zones that the point is in, and `FENCE` if it is outside of a fence."""
        place = ShapelyPoint(point)
        names = [self.zones[index].name for index in self._index.holding(place)]
        if any(fence.depth_m(place) < 0 for fence in self._fences):
            names.append(FENCE)
        return tuple(names)

    def distance_m(self, point: Point) -> float:
        """Distance to the nearest zone or fence border.

        It is negative inside a zone (how deep) and outside of a fence (how far); infinite when
        there is neither zone nor fence.
        """
        return self.nearest(point)[0]

    def nearest(self, point: Point) -> tuple[float, str]:
        """`distance_m`, and the name of the zone (or `FENCE`) that is so near; "" for nothing."""
        return self._least(point, 0.0, 0.0)

    def clearance_left_m(self, point: Point) -> tuple[float, str]:
        """How much farther away than it has to be a point is, and from what; negative: too near.

        The least over all zones and fences of the distance to them less the distance to keep.
        Infinite, and "", when there is neither.
        """
        return self._least(point, np.array(self.distances_m), self.fence_distance_m)

    def required_m(self, name: str) -> float:
        """The distance to keep from the zones of this name, or from the fences' borders.

        Raises:
            KeyError: nothing has this name.
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
        """Closest approach of a polyline, and the name of what it approached.

        Where the track enters a zone or leaves the fence the distance is 0 or, by as much as one of
        its points lies beyond the border, negative. Without zones and fence: infinity and "".
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
        """Every zone, grown by the distance to keep from it, or slightly more.

        In the order of `zones`.
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
        for fence in self._fences:  # noqa: SIM110 - asked for every leg; a generator takes longer
            if not fence.keeps(things)[0]:
                return False
        return True

    def _least(
        self, point: Point, required_m: Floats | float, fence_required_m: float
    ) -> tuple[float, str]:
        """The least of all distances (negative beyond a border) less these, and to what it is."""
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
