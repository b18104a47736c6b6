"""Lines that are straight on a map in degrees, as plans, GeoJSON and autopilots draw them.

On the ground they are bent: by 2 cm on 1 km at mid-latitudes, by 0.2 m on 2 km far north. A ring
whose long sides have corners in between is right to within a few centimetres in a local frame too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from geo.frame import Geodetic, check_on_earth

_DEGREE_M = 111_000.0
STEP_M = 1_000.0
"""No side of a dense ring is longer."""

_MOST_STEPS = 100


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
