"""The surroundings of a mission: a box around its places, and how far beyond it zones matter."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely

from air_router.files.maps.map_area import Places
from geo.airspace import Shape
from geo.frame import LocalFrame, Point

FENCED_REACH_M: Final = 2_000.0
OPEN_REACH_M: Final = 50_000.0
"""Zones farther than this from the fence, or from the mission's places without one, are left out:
no mission reaches farther."""

_DEGREE_M: Final = 111_000.0


class Surroundings:
    """Those of a mission, in degrees for a first check and in metres for the second.

    Attributes:
        frame: The mission's.
        reach_m: Zones that are farther away are left out.
    """

    def __init__(self, frame: LocalFrame, places: Sequence[Point], *, fenced: bool) -> None:
        """Around places of a mission, the corners of its fence or what it has instead."""
        self.frame, self.reach_m = frame, FENCED_REACH_M if fenced else OPEN_REACH_M
        west, south, east, north = shapely.MultiPoint(places or [Point(0.0, 0.0)]).bounds
        self._box = shapely.box(west, south, east, north)  # around the mission's places
        middle = frame.to_geodetic(Point((west + east) / 2, (south + north) / 2))
        half_m = math.hypot(east - west, north - south) / 2 + self.reach_m
        half_deg = 1.01 * half_m / _DEGREE_M  # of latitude, from the middle to the edge
        widest_deg = min(abs(middle.latitude_deg) + half_deg, 89.9)
        self._middle = np.array(middle)  # latitude, longitude
        self._half = np.array([half_deg, half_deg / math.cos(math.radians(widest_deg))])

    def may_reach(self, corners: Places) -> bool:
        """Whether a box around corners (rows of latitude, longitude) may come near enough."""
        offsets = corners - self._middle
        offsets[:, 1] = (offsets[:, 1] + 180) % 360 - 180
        if np.ptp(offsets[:, 1]) > 180:  # around half the Earth: the check in metres decides
            return True
        return bool(
            (offsets.min(axis=0) <= self._half).all() and (offsets.max(axis=0) >= -self._half).all()
        )

    def may_reach_unwrapped(self, corners: Places) -> bool:
        """The same on a map that ends at the antimeridian."""
        near = (corners.min(axis=0) <= self._middle + self._half) & (
            corners.max(axis=0) >= self._middle - self._half
        )
        return bool(near.all())

    def distance_m(self, shape: Shape) -> float:
        """From the box of the mission's places to a shape."""
        return float(self._box.distance(shape.polygon))
