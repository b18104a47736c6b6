"""Circles, arcs and long lines on the ellipsoid, for files and programs that only know polygons.

Lines that are straight on a map in degrees, as plans, GeoJSON and autopilots draw them, are bent on
the ground: by 2 cm on 1 km at mid-latitudes, by 0.2 m on 2 km far north. A ring whose long sides
have corners in between is right to within a few centimetres in a local frame too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from pyproj import Geod

from geo.frame import Geodetic, Point, check_on_earth

ARC_ERROR_M = 0.5
"""No chord of an arc is farther than this from it."""

_DEGREE_M = 111_000.0
STEP_M = 1_000.0
"""No side of a dense ring is longer, but for hundredths of one of more than 100 km."""

_MOST_STEPS = 100


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


def stepped(start: Point, end: Point, step_m: float) -> list[Point]:
    """A side's start and, where it is longer than a step, places on it, straight on the ground."""
    steps = max(math.ceil(math.dist(start, end) / step_m), 1)
    shares = [step / steps for step in range(steps)]
    return [
        Point(*((1 - share) * a + share * b for a, b in zip(start, end, strict=True)))
        for share in shares
    ]


def dense_ring(ring: Sequence[Geodetic], step_m: float = STEP_M) -> list[Geodetic]:
    """The ring with corners in between on long sides, on the straight line in degrees.

    A side goes around the Earth the short way, over the antimeridian if that is shorter.

    Raises:
        FrameError: a corner is not on Earth.
    """
    for corner in ring:
        check_on_earth(*corner)
    dense: list[Geodetic] = []
    for start, end in zip(ring, [*ring[1:], *ring[:1]], strict=True):
        lat_deg = end.latitude_deg - start.latitude_deg
        lon_deg = (end.longitude_deg - start.longitude_deg + 180) % 360 - 180
        east_m = lon_deg * math.cos(math.radians(start.latitude_deg)) * _DEGREE_M
        length_m = math.hypot(lat_deg * _DEGREE_M, east_m)
        steps = min(max(math.ceil(length_m / step_m), 1), _MOST_STEPS)
        dense.append(start)
        for step in range(1, steps):
            share = step / steps
            lon = (start.longitude_deg + share * lon_deg + 180) % 360 - 180
            dense.append(Geodetic(start.latitude_deg + share * lat_deg, lon))
    return dense
