"""Circles and arcs on the ellipsoid, for files and programs that only know polygons."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from pyproj import Geod

from geo.frame import Geodetic


def circle_around(centre: Geodetic, radius_m: float, segments: int = 64) -> tuple[Geodetic, ...]:
    """The corners of a polygon around a circle, counterclockwise; no corner cuts into it."""
    reach_m = radius_m / math.cos(math.pi / segments)
    azimuths_deg = -np.arange(segments) * 360.0 / segments
    longitudes, latitudes, _ = _ellipsoid().fwd(
        np.full(segments, centre.longitude_deg),
        np.full(segments, centre.latitude_deg),
        azimuths_deg,
        np.full(segments, reach_m),
    )
    return tuple(map(Geodetic, latitudes.tolist(), longitudes.tolist()))


ARC_ERROR_M = 0.5
"""No chord of an arc is farther than this from it."""


def arc_around(
    centre: Geodetic, start: tuple[float, float], end: tuple[float, float], *, clockwise: bool
) -> tuple[Geodetic, ...]:
    """Places on an arc between two places, these included, each given as `polar` does.

    Between ends of different distances it is a spiral; ends in one direction make it a full turn.
    """
    span_deg = (end[0] - start[0]) % 360.0 if clockwise else -((start[0] - end[0]) % 360.0)
    span_deg = span_deg or (360.0 if clockwise else -360.0)
    farthest_m = max(start[1], end[1], ARC_ERROR_M)
    step_deg = math.degrees(2 * math.acos(1 - ARC_ERROR_M / farthest_m))
    count = math.ceil(abs(span_deg) / step_deg) + 1
    longitudes, latitudes, _ = _ellipsoid().fwd(
        np.full(count, centre.longitude_deg),
        np.full(count, centre.latitude_deg),
        start[0] + np.linspace(0.0, span_deg, count),
        np.linspace(start[1], end[1], count),
    )
    return tuple(map(Geodetic, latitudes.tolist(), longitudes.tolist()))


def polar(centre: Geodetic, place: Geodetic) -> tuple[float, float]:
    """A place as degrees clockwise from north, and metres, from a centre."""
    azimuth_deg, _, distance_m = _ellipsoid().inv(
        centre.longitude_deg, centre.latitude_deg, place.longitude_deg, place.latitude_deg
    )
    return float(azimuth_deg), float(distance_m)


@cache
def _ellipsoid() -> Geod:
    return Geod(ellps="WGS84")
