"""Circles on the ellipsoid, for files that can only draw polygons."""

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


@cache
def _ellipsoid() -> Geod:
    return Geod(ellps="WGS84")
