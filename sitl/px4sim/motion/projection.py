"""Geographic to local coordinates and back, the way an autopilot does it.

PX4 navigates on a sphere with an azimuthal equidistant projection around the place where it was
started. The simulated vehicle does the same, so that its idea of a straight line is PX4's.
"""

from __future__ import annotations

import math
from typing import Final

EARTH_RADIUS_M: Final = 6371000.0


class MapProjection:
    """Azimuthal equidistant projection on a sphere.

    Args:
        latitude_deg: Of the origin.
        longitude_deg: Of the origin.
    """

    __slots__ = (
        "_cos_latitude",
        "_longitude_rad",
        "_sin_latitude",
        "latitude_deg",
        "longitude_deg",
    )

    def __init__(self, latitude_deg: float, longitude_deg: float) -> None:
        self.latitude_deg = latitude_deg
        self.longitude_deg = longitude_deg
        latitude_rad = math.radians(latitude_deg)
        self._longitude_rad = math.radians(longitude_deg)
        self._sin_latitude = math.sin(latitude_rad)  # of the origin
        self._cos_latitude = math.cos(latitude_rad)

    def to_local(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Metres (north, east) of the origin; any pair of numbers of degrees is taken."""
        latitude_rad = math.radians(latitude_deg)
        difference_rad = math.radians(longitude_deg) - self._longitude_rad
        sin_latitude, cos_latitude = math.sin(latitude_rad), math.cos(latitude_rad)
        cos_difference = math.cos(difference_rad)
        cosine = (
            self._sin_latitude * sin_latitude + self._cos_latitude * cos_latitude * cos_difference
        )
        angle_rad = math.acos(max(-1.0, min(1.0, cosine)))
        sine = math.sin(angle_rad)
        scale_m = EARTH_RADIUS_M * (angle_rad / sine if sine > 1e-12 else 1.0)
        north = (
            self._cos_latitude * sin_latitude - self._sin_latitude * cos_latitude * cos_difference
        )
        return north * scale_m, cos_latitude * math.sin(difference_rad) * scale_m

    def to_global(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Degrees (latitude, longitude) of a local point."""
        north_rad, east_rad = north_m / EARTH_RADIUS_M, east_m / EARTH_RADIUS_M
        angle_rad = math.hypot(north_rad, east_rad)
        if angle_rad == 0.0:
            return self.latitude_deg, self.longitude_deg
        sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
        latitude_rad = math.asin(
            max(
                -1.0,
                min(
                    1.0,
                    cosine * self._sin_latitude + north_rad * sine * self._cos_latitude / angle_rad,
                ),
            )
        )
        longitude_rad = self._longitude_rad + math.atan2(
            east_rad * sine,
            angle_rad * self._cos_latitude * cosine - north_rad * self._sin_latitude * sine,
        )
        return math.degrees(latitude_rad), math.degrees(longitude_rad)
