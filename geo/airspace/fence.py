"""The border of one fence, as tests see it: how far inside of it things are."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry

from geo.airspace.zone import Circle, Shape

PREPARED_FROM = 48
"""Distances to shapes of fewer corners are found sooner without an index; measured."""


class Fence:
    """Answers exactly; a circle is never made a polygon."""

    def __init__(self, shape: Shape) -> None:
        self._circle = shape if isinstance(shape, Circle) else None  # None: a polygon
        self._inside = shape.polygon  # area, prepared for many questions
        self._border = shape.polygon.boundary  # prepared if it is long
        if self._circle is None:
            shapely.prepare(self._inside)
            if shapely.get_num_coordinates(self._border) > PREPARED_FROM:
                shapely.prepare(self._border)

    def keeps(self, things: npt.NDArray[np.object_], threshold_m: float) -> npt.NDArray[np.bool_]:
        """Which of these connected geometries are inside, and farther than this from the border."""
        if len(things) == 0:
            return np.zeros(0, dtype=bool)
        if self._circle is not None:
            # A circle is convex: it holds all of a thing when it holds the corners.
            points, owners = shapely.get_coordinates(things, return_index=True)
            reach_m = np.hypot(*(points - self._circle.centre).T)
            farthest_m = np.zeros(len(things))
            np.maximum.at(farthest_m, owners, reach_m)
            return farthest_m < self._circle.radius_m - threshold_m
        # A connected thing that stays away from the border is inside where any part of it is.
        inside = shapely.intersects(self._inside, things)
        return np.asarray(inside & ~shapely.dwithin(self._border, things, threshold_m))

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
