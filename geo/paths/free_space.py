"""The clear area of an airspace as polygons with few corners, for paths to be searched in.

Every zone is grown, every fence shrunk, by the distance to keep and a tenth of a millimetre: so
much that zones whose grown shapes touch leave no gap between them, and that rounding never brings
a path too near. Exact along straight sides; at corners of polygons

* lean: mitred corners that are cut off at 1.03 of the distance, hardly more corners than the zone
  has, so that searches are quick;
* tight: arcs, at most 0.3 % too far out. So are, in the lean area too, those shapes that would
  close a gap in between them only because of their mitred corners: both areas are connected alike,
  but for pockets between corners that the lean area fills. Where even these arcs close a gap, they
  are finer.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import cast

import numpy as np
import numpy.typing as npt
import shapely
from shapely import GeometryType, Polygon, STRtree
from shapely import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry

from geo.airspace import (
    ARC_EXCESS,
    ARC_STEPS,
    Airspace,
    Circle,
    Shape,
    arc_excess,
    circle_ring,
    polygons_of,
)

Shapes = npt.NDArray[np.object_]
Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
Flags = npt.NDArray[np.bool_]
Bounds = tuple[float, float, float, float]
"""West, south, east, north."""

_dwithin = cast("Callable[..., npt.NDArray[np.bool_]]", shapely.dwithin)  # of arrays too

HAIR_M = 1e-4
"""What the clear area is smaller by than it could be."""

BEVEL = 1.03
"""Where mitred corners are cut off, in distances to keep: up to here they never fall short."""

FINE_STEPS = 128  # of a quarter circle
"""Of arcs beside a gap that coarser ones would close: at most 0.004 % too far out."""

_SHARP = 2.0
"""For shapes that are cut to arcs afterwards; a limit much higher than this falls short."""

_CIRCLE_SHARE, _CIRCLE_LEAST_M = 0.005, 0.01
_UNFENCED_M = 1_000_000.0


class FreeSpace:
    """The clear area of an airspace, lean or tight, whole or in part."""

    def __init__(self, airspace: Airspace) -> None:
        self._airspace = airspace
        # polygons
        self._zones: Shapes = np.array([zone.polygon for zone in airspace.zones], dtype=object)
        self._reaches_m = np.array(airspace.distances_m, dtype=float) + HAIR_M  # to keep from each
        # What distances are measured from, and to keep from that: circles have their centres, as
        # the polygons around them would close gaps of thousandths of their radii.
        self._solids, self._spans_m = self._zones.copy(), self._reaches_m.copy()
        for index, zone in enumerate(airspace.zones):
            if isinstance(zone.shape, Circle):
                self._solids[index] = ShapelyPoint(zone.shape.centre)
                self._spans_m[index] += zone.shape.radius_m

    @cached_property
    def lean(self) -> list[Polygon]:
        """The connected parts of the area, with few corners."""
        return self._parts(self._lean_grown(), self._inside)

    def tight(self, within: Bounds | None = None) -> list[Polygon]:
        """The connected parts of the area, or of what of it lies within bounds, with arcs."""
        inside = self._inside
        chosen = np.arange(len(self._zones))
        if within is not None:
            inside = inside.intersection(shapely.box(*within))
            west, south, east, north = shapely.bounds(self._zones).reshape(-1, 4).T
            reach_m = BEVEL * self._reaches_m
            chosen = np.flatnonzero(
                (west - reach_m <= within[2])
                & (east + reach_m >= within[0])
                & (south - reach_m <= within[3])
                & (north + reach_m >= within[1])
            )
        return self._parts(self._grown_tight(chosen), inside)

    def around(self, zones: Indices, *, fenced: bool) -> list[Polygon]:
        """The clear area (tight) if there were only these zones, with or without the fences."""
        return self._parts(self._grown_tight(zones), self._inside if fenced else self._plane)

    def touching(self, line: BaseGeometry) -> Indices:
        """The zones that a part of the clear area ends at, along its border or a part of it."""
        near = self._tree.query(line, predicate="dwithin", distance=self.slack_m)
        return np.sort(near)

    def fence_touches(self, line: BaseGeometry) -> bool:
        """Whether fences are what the clear area ends at somewhere along a part of its border."""
        reach_m = self._airspace.fence_distance_m + self.slack_m
        borders = [fence.polygon.boundary for fence in self._airspace.fences]
        return any(shapely.dwithin(border, line, reach_m) for border in borders)

    @cached_property
    def slack_m(self) -> float:
        """Farther out than this the drawn border of the clear area lies nowhere."""
        required_m = max(self._airspace.fence_distance_m, 0.0, *self._airspace.distances_m)
        shapes = (*(zone.shape for zone in self._airspace.zones), *self._airspace.fences)
        radii_m = (shape.radius_m for shape in shapes if isinstance(shape, Circle))
        widest_m = max(radii_m, default=0.0) + required_m
        return (BEVEL - 1) * required_m + _CIRCLE_SHARE * widest_m + 0.02

    @cached_property
    def _lean_zones(self) -> Shapes:
        reaches = zip(self._airspace.zones, self._reaches_m.tolist(), strict=True)
        return np.array([_lean(zone.shape, reach_m) for zone, reach_m in reaches], dtype=object)

    def _grown_tight(self, zones: Indices) -> Shapes:
        """Mitred and round shapes are both large enough, so what they have in common is."""
        missing = zones[[shape is None for shape in self._tight_zones[zones]]]
        drawn, reaches_m = self._zones[missing], self._reaches_m[missing]
        sharp = shapely.buffer(drawn, reaches_m, join_style="mitre", mitre_limit=_SHARP)
        arcs = shapely.buffer(drawn, reaches_m * ARC_EXCESS, quad_segs=ARC_STEPS)
        fine = self._fine[missing]
        if fine.any():
            far_m = reaches_m[fine] * arc_excess(FINE_STEPS)
            arcs[fine] = shapely.buffer(drawn[fine], far_m, quad_segs=FINE_STEPS)
        self._tight_zones[missing] = shapely.intersection(sharp, arcs)
        for index in missing:
            if isinstance(shape := self._airspace.zones[index].shape, Circle):
                reach_m = float(self._reaches_m[index])
                self._tight_zones[index] = _circle(shape, reach_m, finest=True)
        grown: Shapes = self._tight_zones[zones]
        return grown

    @cached_property
    def _fine(self) -> npt.NDArray[np.bool_]:
        """Of which zones the arcs are finer, as a gap beside them is open by less than 0.6 %."""
        return np.zeros(len(self._zones), dtype=bool)

    @cached_property
    def _tight_zones(self) -> Shapes:
        """Grown shapes with arcs, of those zones for which they were needed."""
        return np.full(len(self._zones), None, dtype=object)

    @cached_property
    def _inside(self) -> BaseGeometry:
        """What lies inside of all fences, always tight: they have few corners."""
        fences = self._airspace.fences
        if not fences:
            return self._plane
        reach_m = self._airspace.fence_distance_m + HAIR_M
        inside = shapely.intersection_all([_shrunk(fence, reach_m) for fence in fences])
        shapely.prepare(inside)
        return inside

    @property
    def _plane(self) -> BaseGeometry:
        far_m = _UNFENCED_M
        bounds = shapely.total_bounds(self._zones) if len(self._zones) else (0.0, 0.0, 0.0, 0.0)
        west, south, east, north = bounds
        return shapely.box(west - far_m, south - far_m, east + far_m, north + far_m)

    @cached_property
    def _tree(self) -> STRtree:
        return STRtree(self._lean_zones)

    def _lean_grown(self) -> Shapes:
        """The lean shapes, but tight ones where corners close a gap: in themselves or to others.

        Between two shapes that are too close and meet in one piece there is no gap.
        """
        grown, solids = self._lean_zones.copy(), self._solids
        pinching = shapely.get_num_interior_rings(grown) > 0
        pinching[self._closing(grown)] = True
        tight = np.zeros(len(grown), dtype=bool)
        one, other = self._tree.query(grown, predicate="intersects")
        one, other = one[one < other], other[one < other]
        close = _dwithin(solids[one], solids[other], self._spans_m[one] + self._spans_m[other])
        changed = np.ones(len(one), dtype=bool)
        while True:
            meeting = shapely.intersection(grown[one[changed]], grown[other[changed]])
            gaps = ~close[changed] & ~shapely.is_empty(meeting)
            gaps |= shapely.get_num_geometries(meeting) > 1
            pinching[one[changed][gaps]] = pinching[other[changed][gaps]] = True
            more = np.flatnonzero(pinching & ~tight)
            if not len(more):
                more = self._still_meeting(grown, one[~close], other[~close], tight)
                self._fine[more] = True
                self._tight_zones[more] = None
            if not len(more):
                return grown
            grown[more] = self._grown_tight(more)
            tight[more] = True
            changed = np.isin(one, more) | np.isin(other, more)

    def _still_meeting(self, grown: Shapes, one: Indices, other: Indices, tight: Flags) -> Indices:
        """The zones of pairs with a gap between them that their tight shapes close."""
        both = tight[one] & tight[other]
        one, other = one[both], other[both]
        closed = shapely.intersects(grown[one], grown[other])
        found = np.unique(np.concatenate([one[closed], other[closed]]))
        return np.asarray(found[~self._fine[found]])

    def _closing(self, grown: Shapes) -> Indices:
        """The zones that may close a gap between them and a fence."""
        across = np.flatnonzero(~shapely.covers(self._inside, grown))
        closing = shapely.get_num_geometries(shapely.difference(grown[across], self._inside)) > 1
        spans_m = self._spans_m[across] + self._airspace.fence_distance_m + HAIR_M
        for fence in self._airspace.fences:
            closing |= _far_within(fence, self._solids[across], spans_m)
        return across[closing]

    def _parts(self, grown: Shapes, inside: BaseGeometry) -> list[Polygon]:
        """What is inside and in none of the grown shapes; those that nothing meets are its holes.

        Most are: they take no part in overlays, which cost more than all else.
        """
        alone = (shapely.get_type_id(grown) == GeometryType.POLYGON) & (
            shapely.get_num_interior_rings(grown) == 0
        )
        alone &= shapely.contains_properly(inside, grown)
        one, other = STRtree(grown).query(grown, predicate="intersects")
        alone[one[one != other]] = False
        parts = polygons_of(inside.difference(shapely.union_all(grown[~alone])))
        if not alone.any():
            return parts
        rings = shapely.get_exterior_ring(grown[alone])
        ring, owner = STRtree(parts).query(rings, predicate="within")
        order = np.argsort(owner, kind="stable")
        holes = np.split(rings[ring[order]], np.searchsorted(owner[order], range(1, len(parts))))
        return [
            Polygon(part.exterior, [*part.interiors, *more]) if len(more) else part
            for part, more in zip(parts, holes, strict=True)
        ]


@lru_cache(maxsize=4_000)  # a zone that is drawn or moved leaves the others as they are
def _lean(shape: Shape, reach_m: float) -> BaseGeometry:
    if isinstance(shape, Circle):
        return _circle(shape, reach_m)
    return shape.polygon.buffer(reach_m, join_style="mitre", mitre_limit=BEVEL)


def _far_within(fence: Shape, solids: Shapes, distances_m: Floats) -> npt.NDArray[np.bool_]:
    """Which points and polygons are inside of a fence, and each so far from its border."""
    if isinstance(fence, Circle):
        farthest_m = shapely.hausdorff_distance(solids, ShapelyPoint(fence.centre))  # of corners
        return np.asarray(farthest_m < fence.radius_m - distances_m)
    inside = shapely.covers(fence.polygon, solids)
    return np.asarray(inside & ~_dwithin(fence.polygon.boundary, solids, distances_m))


def _shrunk(fence: Shape, reach_m: float) -> BaseGeometry:
    """Arcs and mitred corners both keep the distance, so what either of them keeps does."""
    if isinstance(fence, Circle):
        return _circle(fence, -reach_m, finest=True)
    sharp = fence.polygon.buffer(-reach_m, join_style="mitre", mitre_limit=_SHARP)
    return sharp.union(fence.polygon.buffer(-reach_m * ARC_EXCESS, quad_segs=ARC_STEPS))


def _circle(circle: Circle, reach_m: float, *, finest: bool = False) -> BaseGeometry:
    """A polygon around a grown circle, or within a shrunk one."""
    radius_m = circle.radius_m + reach_m
    if radius_m <= 0:
        return Polygon()
    within_m = _CIRCLE_LEAST_M if finest else max(_CIRCLE_LEAST_M, _CIRCLE_SHARE * radius_m)
    return Polygon(circle_ring(circle.centre, radius_m, outward=reach_m > 0, within_m=within_m))
