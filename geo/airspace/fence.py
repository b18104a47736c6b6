"""A fence: what lies inside of it, and how far, by exact distances."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Point as ShapelyPoint
from shapely import STRtree
from shapely.geometry.base import BaseGeometry

from geo.airspace.zone import Circle, Shape
from geo.airspace.zone_index import PREPARED_FROM, TOLERANCE_M, threshold_m


class Fence:
    """One fence: how far inside of its border things are, exactly; a circle is never a polygon.

    Args:
        shape: what it encloses.
        distance_m: to keep from its border.
    """

    def __init__(self, shape: Shape, distance_m: float) -> None:
        self.shape = shape
        self._threshold_m = threshold_m(distance_m)  # with rounding allowed for
        self._circle = shape if isinstance(shape, Circle) else None  # None: a polygon
        self._inside = shape.polygon  # area, prepared for many questions
        self._border = shape.polygon.boundary  # prepared if it is long
        if self._circle is None:
            shapely.prepare(self._inside)
            if shapely.get_num_coordinates(self._border) > PREPARED_FROM:
                shapely.prepare(self._border)

    def keeps(self, things: npt.NDArray[np.object_]) -> npt.NDArray[np.bool_]:
        """Which of these connected geometries are inside, and far enough from the border."""
        if len(things) == 0:
            return np.zeros(0, dtype=bool)
        if self._circle is not None:
            # A circle is convex: it holds all of a thing when it holds the corners.
            points, owners = shapely.get_coordinates(things, return_index=True)
            reach_m = np.hypot(*(points - self._circle.centre).T)
            farthest_m = np.zeros(len(things))
            np.maximum.at(farthest_m, owners, reach_m)
            return farthest_m < self._circle.radius_m - self._threshold_m
        # A connected thing that stays away from the border is inside where any part of it is.
        keeps: npt.NDArray[np.bool_] = shapely.intersects(self._inside, things)
        near = slice(None) if len(things) == 1 else np.unique(self._sides.query(things)[0])
        keeps[near] &= ~shapely.dwithin(self._border, things[near], self._threshold_m)
        return keeps

    @cached_property
    def _sides(self) -> STRtree:
        """Boxes around all that is too near to a side of the border, and a few more."""
        corners = shapely.get_coordinates(self._border)  # as if one ring led to the next
        low, high = np.minimum(corners[:-1], corners[1:]), np.maximum(corners[:-1], corners[1:])
        reach_m = self._threshold_m + TOLERANCE_M
        (west, south), (east, north) = (low - reach_m).T, (high + reach_m).T
        return STRtree(shapely.box(west, south, east, north))

    def depth_m(self, place: ShapelyPoint) -> float:
        """How far inside of the border a point is; negative: how far outside."""
        if self._circle is not None:
            return self._circle.radius_m - math.dist((place.x, place.y), self._circle.centre)
        distance_m = float(self._border.distance(place))
        return distance_m if self._inside.covers(place) else -distance_m

    def distance_m(self, track: BaseGeometry) -> float:
        """The least distance of a line to the border; of a circle, less than 0 once outside."""
        if self._circle is None:
            return float(self._border.distance(track))
        reach_m = np.hypot(*(shapely.get_coordinates(track) - self._circle.centre).T)
        return self._circle.radius_m - float(reach_m.max())
