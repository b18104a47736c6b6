"""Many zones at once: what lies nearer to which than it may, by exact distances in bulk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import cast

import numpy as np
import numpy.typing as npt
import shapely
from shapely import LineString, STRtree
from shapely import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry

from geo.airspace.fence import PREPARED_FROM
from geo.airspace.zone import Circle, Shape, Zone
from geo.frame import Point

TOLERANCE_M = 1e-6
"""Points computed to lie on a limit count as clear."""

Geometries = npt.NDArray[np.object_]
Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.intp]

_dwithin = cast("Callable[..., Flags]", shapely.dwithin)
"""Takes a distance for each pair, which shapely's annotations do not know."""


class ZoneIndex:
    """Zones, each with the distance to keep from it. Made in no time; indexed when first asked.

    Args:
        zones: their numbers in the answers are those of this order.
        distances_m: to keep from each.
    """

    def __init__(self, zones: Sequence[Zone], distances_m: Sequence[float]) -> None:
        self._zones = zones
        self._distances_m = distances_m

    def distances_m(self, shape: BaseGeometry) -> Floats:
        """How far each zone is from a shape: 0 within a polygon, less than that within a circle."""
        return np.asarray(shapely.distance(self._geometries, shape) - self._radii_m)

    def close(self, shape: BaseGeometry) -> Numbers:
        """The zones that a shape is too near to."""
        near = self._tree.query(shape)
        return near[_dwithin(self._geometries[near], shape, self._thresholds_m[near])]

    def any_close(self, shape: BaseGeometry) -> bool:
        """Whether a shape is too near to any zone."""
        return self.close(shape).size > 0

    def far(self, shape: BaseGeometry) -> Flags:
        """Of each zone whether a shape keeps its distance."""
        return ~_dwithin(self._geometries, shape, self._thresholds_m)

    def too_close(self, shapes: Geometries) -> Numbers:
        """Which of many shapes are too near to some zone; one may be named several times."""
        numbers, zones = self._tree.query(shapes)
        close = _dwithin(self._geometries[zones], shapes[numbers], self._thresholds_m[zones])
        return np.asarray(numbers[close])

    def holding(self, place: ShapelyPoint) -> Numbers:
        """The zones that a point is in, or on the border of."""
        near = np.sort(self._tree.query(place))
        return near[shapely.distance(self._geometries[near], place) <= self._radii_m[near]]

    @cached_property
    def _geometries(self) -> Geometries:
        """What distances are measured from: polygons, and the centres of circles."""
        geometries = np.array([_solid(zone.shape) for zone in self._zones], dtype=object)
        shapely.prepare([g for g in geometries if shapely.get_num_coordinates(g) > PREPARED_FROM])
        return geometries

    @cached_property
    def _radii_m(self) -> Floats:
        """What of these distances lies within the zones."""
        shapes = (zone.shape for zone in self._zones)
        return np.array([s.radius_m if isinstance(s, Circle) else 0.0 for s in shapes])

    @cached_property
    def _thresholds_m(self) -> Floats:
        """At these distances or less from `_geometries` nothing is clear."""
        return self._radii_m + [threshold_m(distance_m) for distance_m in self._distances_m]

    @cached_property
    def _tree(self) -> STRtree:
        """Boxes around all that is not clear because of each zone."""
        bounds = shapely.bounds(self._geometries)
        reach_m = self._thresholds_m + TOLERANCE_M
        west, south, east, north = bounds.reshape(-1, 4).T
        return STRtree(
            shapely.box(west - reach_m, south - reach_m, east + reach_m, north + reach_m)
        )


def threshold_m(distance_m: float) -> float:
    """At this distance or less something is too near that has to keep `distance_m`."""
    return max(distance_m - TOLERANCE_M, 0.0)


def leg_line(start: Point, end: Point) -> BaseGeometry:
    """A straight leg; a leg without length is a point."""
    # GEOS 3.14 answers dwithin wrongly for a prepared shape and a line without length.
    return LineString((start, end)) if tuple(start) != tuple(end) else ShapelyPoint(start)


def leg_lines(starts: Floats, ends: Floats) -> Geometries:
    """`leg_line` for many; both arrays have a row of (east, north) for each."""
    lines = np.asarray(shapely.linestrings(np.stack([starts, ends], axis=1)), dtype=object)
    still = (starts == ends).all(axis=1)
    if still.any():
        lines[still] = shapely.points(starts[still])
    return lines


def _solid(shape: Shape) -> BaseGeometry:
    return ShapelyPoint(shape.centre) if isinstance(shape, Circle) else shape.polygon
