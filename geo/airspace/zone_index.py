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

from geo.airspace.zone import Circle, Zone
from geo.frame import Point

TOLERANCE_M = 1e-6
"""Points computed to lie on a limit count as clear."""

PREPARED_FROM = 48
"""Distances to shapes of fewer corners are found sooner without an index; measured."""

Geometries = npt.NDArray[np.object_]
Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.intp]

_dwithin = cast("Callable[..., Flags]", shapely.dwithin)
"""Takes a distance for each pair, which shapely's annotations do not know."""


class ZoneIndex:
    """Zones, each with its required distance. Cheap to construct; indexed on first use.

    Args:
        zones: results number them in this order.
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

    def far(self, shape: BaseGeometry) -> Flags:
        """Of each zone whether a shape keeps its distance."""
        return ~_dwithin(self._geometries, shape, self._thresholds_m)

    def leg_close(self, start: Point, end: Point, leg: BaseGeometry) -> bool:
        """Whether a straight leg (its ends, and its line) is too near to any zone."""
        near = np.flatnonzero(self._in_line(slice(None), start, end))
        return bool(_dwithin(self._geometries[near], leg, self._thresholds_m[near]).any())

    def legs_close(self, starts: Floats, ends: Floats, legs: Geometries) -> Numbers:
        """Which of many legs are too near to some zone; one may be named several times."""
        numbers, zones = self._tree.query(legs)
        near = self._in_line(zones, starts[numbers].T, ends[numbers].T)
        numbers, zones = numbers[near], zones[near]
        close = _dwithin(self._geometries[zones], legs[numbers], self._thresholds_m[zones])
        return np.asarray(numbers[close])

    def holding(self, place: ShapelyPoint) -> Numbers:
        """The zones that a point is in, or on the border of."""
        near = np.sort(self._tree.query(place))
        return near[shapely.distance(self._geometries[near], place) <= self._radii_m[near]]

    @cached_property
    def _geometries(self) -> Geometries:
        """What distances are measured from: polygons, and the centres of circles."""
        shapes = (zone.shape for zone in self._zones)
        solids = [ShapelyPoint(s.centre) if isinstance(s, Circle) else s.polygon for s in shapes]
        geometries = np.array(solids, dtype=object)
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

    def _in_line(self, zones: Numbers | slice, start: Point | Floats, end: Point | Floats) -> Flags:
        """Which zones' boxes the line through a leg meets: it is near no other zone.

        A leg's own box is as wide as the map where it runs across it; of what lies in there, this
        leaves a tenth to be measured.
        """
        (start_e, start_n), (end_e, end_n) = start, end
        along_e, along_n = end_e - start_e, end_n - start_n
        east_m, north_m, half_east_m, half_north_m = self._boxes[:, zones]
        hand_m2 = along_e * (north_m - start_n) - along_n * (east_m - start_e)
        reach_m2 = abs(along_e) * half_north_m + abs(along_n) * half_east_m
        return np.asarray(abs(hand_m2) <= reach_m2)

    @cached_property
    def _boxes(self) -> Floats:
        """Centres and half widths (east, north) of boxes around all that is not clear by a zone."""
        west, south, east, north = shapely.bounds(self._geometries).reshape(-1, 4).T
        reach_m = self._thresholds_m + TOLERANCE_M
        half_m = (east - west) / 2 + reach_m, (north - south) / 2 + reach_m
        return np.array([(west + east) / 2, (south + north) / 2, *half_m])

    @cached_property
    def _tree(self) -> STRtree:
        """The boxes."""
        east_m, north_m, half_east_m, half_north_m = self._boxes
        west, south = east_m - half_east_m, north_m - half_north_m
        return STRtree(shapely.box(west, south, east_m + half_east_m, north_m + half_north_m))


def threshold_m(distance_m: float) -> float:
    """At this distance or less something is too near that has to keep `distance_m`."""
    return max(distance_m - TOLERANCE_M, 0.0)


def leg_line(start: Point, end: Point) -> BaseGeometry:
    """A straight leg; a leg without length is a point."""
    # GEOS 3.14 computes dwithin wrongly for a prepared shape and a line without length.
    return LineString((start, end)) if tuple(start) != tuple(end) else ShapelyPoint(start)


def leg_lines(starts: Floats, ends: Floats) -> Geometries:
    """`leg_line` for many; both arrays have a row of (east, north) for each."""
    lines = np.asarray(shapely.linestrings(np.stack([starts, ends], axis=1)), dtype=object)
    still = (starts == ends).all(axis=1)
    if still.any():
        lines[still] = shapely.points(starts[still])
    return lines
