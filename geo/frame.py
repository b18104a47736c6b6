"""The local frame of a mission: meters east and north of an origin on the WGS-84 ellipsoid.

The projection is azimuthal equidistant. Distances and directions from the origin are exact.
Distances between any two points within 5 km of the origin are right to better than a millimeter
(within 10 km: five), anywhere on Earth, including UTM zone borders, the antimeridian and the poles.

Plans, GeoJSON and autopilots draw lines that are straight in degrees. On the ground these lines are
curved: by 2 cm on 1 km at mid-latitudes, by 0.2 m on 2 km far north. `dense_ring` adds corners to
long sides, so that a ring is right to a few centimeters in a local frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike
from pyproj import Geod, Transformer

Floats = npt.NDArray[np.float64]

_FARTHEST_M = 19_000_000.0
"""Beyond this (almost the antipode) the projection has no meaning."""


class FrameError(ValueError):
    """A coordinate that is not on Earth, or too far from the frame's origin."""


class Point(NamedTuple):
    """A place in a local frame, in meters east and north of its origin."""

    east_m: float
    north_m: float


def off_line_m(place: Point, start: Point, end: Point) -> float:
    """Distance of a place from a straight segment.

    Args:
        place: the place.
        start: where the segment begins.
        end: where it ends.

    Returns:
        Meters.
    """
    east_m, north_m = end[0] - start[0], end[1] - start[1]
    length_2 = east_m**2 + north_m**2
    along = (place[0] - start[0]) * east_m + (place[1] - start[1]) * north_m
    share = min(max(along / length_2, 0.0), 1.0) if length_2 > 0 else 0.0
    return math.dist(place, (start[0] + share * east_m, start[1] + share * north_m))


class Geodetic(NamedTuple):
    """A place on the WGS-84 ellipsoid, in degrees; latitude first, as in plans and MAVLink."""

    latitude_deg: float
    longitude_deg: float


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """Converts between WGS-84 degrees and meters east and north of `origin`.

    Raises:
        FrameError: the origin, or a converted coordinate, is not finite or out of range.
    """

    origin: Geodetic

    def __post_init__(self) -> None:
        check_on_earth(*self.origin)

    def to_local(self, latitude_deg: float, longitude_deg: float) -> Point:
        """Convert a place from degrees.

        Args:
            latitude_deg: -90 to 90.
            longitude_deg: -180 to 180.

        Returns:
            Meters east and north of the origin.

        Raises:
            FrameError: the place is not on Earth, or too far from the origin.
        """
        check_on_earth(latitude_deg, longitude_deg)
        to_local, _ = _transformers(*self.origin)
        east_m, north_m = to_local.transform(longitude_deg, latitude_deg)
        if not (math.isfinite(east_m) and math.isfinite(north_m)):
            raise FrameError(
                f"{latitude_deg}, {longitude_deg} lies too far from the origin {self.origin}"
            )
        return Point(east_m, north_m)

    def to_local_many(self, latitudes_deg: ArrayLike, longitudes_deg: ArrayLike) -> Floats:
        """`to_local` of many places.

        Args:
            latitudes_deg: array of any shape.
            longitudes_deg: array that broadcasts with it.

        Returns:
            Array of the broadcast shape plus one axis of length 2: east and north in meters.

        Raises:
            FrameError: a place is not on Earth, or too far from the origin.
        """
        latitudes, longitudes = np.broadcast_arrays(
            np.asarray(latitudes_deg, dtype=float), np.asarray(longitudes_deg, dtype=float)
        )
        legal = (np.abs(latitudes) <= 90) & (np.abs(longitudes) <= 180)
        for index in np.flatnonzero(~legal)[:1]:
            check_on_earth(float(latitudes[index]), float(longitudes[index]))
        to_local, _ = _transformers(*self.origin)
        places = np.stack(to_local.transform(longitudes, latitudes), axis=-1)
        for index in np.flatnonzero(~np.isfinite(places).all(axis=-1))[:1]:
            self.to_local(float(latitudes[index]), float(longitudes[index]))
        return places

    def to_geodetic_many(self, points: ArrayLike) -> Floats:
        """`to_geodetic` of many places.

        Args:
            points: array of shape (n, 2), east and north in meters.

        Returns:
            Array of shape (n, 2), latitude and longitude in degrees.

        Raises:
            FrameError: a place is too far from the origin.
        """
        places = np.asarray(points, dtype=float).reshape(-1, 2)
        legal = np.hypot(*places.T) < _FARTHEST_M
        for index in np.flatnonzero(~legal)[:1]:
            self.to_geodetic(Point(*places[index].tolist()))
        _, to_geodetic = _transformers(*self.origin)
        longitudes, latitudes = to_geodetic.transform(*places.T)
        longitudes = np.where(
            np.abs(longitudes) > 180, longitudes - np.copysign(360, longitudes), longitudes
        )
        return np.stack([latitudes, longitudes], axis=-1)

    def to_geodetic(self, point: Point) -> Geodetic:
        """Convert a place to degrees.

        Args:
            point: meters east and north of the origin.

        Returns:
            Latitude and longitude.

        Raises:
            FrameError: the place is too far from the origin.
        """
        east_m, north_m = point
        if not math.hypot(east_m, north_m) < _FARTHEST_M:
            raise FrameError(f"{east_m}, {north_m} metres is not a place of this local frame")
        _, to_geodetic = _transformers(*self.origin)
        longitude_deg, latitude_deg = to_geodetic.transform(east_m, north_m)
        if abs(longitude_deg) > 180:  # PROJ rounds a hair beyond the antimeridian
            longitude_deg -= math.copysign(360, longitude_deg)
        return Geodetic(latitude_deg, longitude_deg)


def check_on_earth(latitude_deg: float, longitude_deg: float) -> None:
    """Check a latitude and a longitude in degrees.

    Raises:
        FrameError: a value is not finite or out of range.
    """
    if not abs(latitude_deg) <= 90:  # also catches NaN
        raise FrameError(f"latitude {latitude_deg} is not within -90..90 degrees")
    if not abs(longitude_deg) <= 180:
        raise FrameError(f"longitude {longitude_deg} is not within -180..180 degrees")


@lru_cache(maxsize=32)  # making a transformer costs 25 ms; one is thread-safe and lasts
def _transformers(latitude_deg: float, longitude_deg: float) -> tuple[Transformer, Transformer]:
    local = f"+proj=aeqd +lat_0={latitude_deg!r} +lon_0={longitude_deg!r} +ellps=WGS84 +units=m"
    forward = Transformer.from_crs("OGC:CRS84", local, always_xy=True)
    return forward, Transformer.from_crs(local, "OGC:CRS84", always_xy=True)


# Circles, arcs and long lines on the ellipsoid, for files and programs that only know polygons


ARC_ERROR_M = 0.5
"""No chord of an arc is farther than this from it."""

_DEGREE_M = 111_000.0

STEP_M = 1_000.0
"""No side of a dense ring is longer, but for parts of one that is cut into as many as there may be.

Towards the poles, where what is straight in degrees is bent more and more, they are shorter.
"""

_MOST_STEPS = 2_000
_MOST_SEGMENTS = 10_000
_BENT = 3.0  # tangent of the latitude from which on sides are shorter: 72 degrees
_STEEPEST_DEG = 89.99


_SEGMENTS = 64  # of a circle that is not too large for so few


def circle_around(
    centre: Geodetic, radius_m: float, segments: int | None = None
) -> tuple[Geodetic, ...]:
    """A polygon around a circle on the ellipsoid; no side cuts into the circle.

    Args:
        centre: the center.
        radius_m: the radius.
        segments: the number of sides; None: as many as keep the sides straight on the ground and in
            degrees.

    Returns:
        The corners, counterclockwise.
    """
    if segments is None:
        farthest_deg = abs(centre.latitude_deg) + radius_m / _DEGREE_M
        sides = math.tau * radius_m / step_at_m(farthest_deg)
        segments = max(_SEGMENTS, math.ceil(min(sides, _MOST_SEGMENTS)))
    reach_m = radius_m / math.cos(math.pi / segments)
    azimuths_deg = -np.arange(segments) * 360.0 / segments
    return _from_centre(centre, azimuths_deg, np.full(segments, reach_m))


def arc_around(
    centre: Geodetic, start: tuple[float, float], end: tuple[float, float], *, clockwise: bool
) -> tuple[Geodetic, ...]:
    """Places on an arc, including both ends.

    Between ends of different distances the arc is a spiral. Ends in the same direction make a full
    turn.

    Args:
        centre: the center.
        start: azimuth in degrees and distance in meters, as `polar` returns them.
        end: the same of the other end.
        clockwise: the direction of the arc.

    Returns:
        Places at most `ARC_ERROR_M` from the arc by their chords.
    """
    span_deg = (end[0] - start[0]) % 360.0 if clockwise else -((start[0] - end[0]) % 360.0)
    span_deg = span_deg or (360.0 if clockwise else -360.0)
    farthest_m = max(start[1], end[1], ARC_ERROR_M)
    step_deg = math.degrees(2 * math.acos(1 - ARC_ERROR_M / farthest_m))
    count = math.ceil(abs(span_deg) / step_deg) + 1
    azimuths_deg = start[0] + np.linspace(0.0, span_deg, count)
    return _from_centre(centre, azimuths_deg, np.linspace(start[1], end[1], count))


def _from_centre(
    centre: Geodetic, azimuths_deg: Floats, distances_m: Floats
) -> tuple[Geodetic, ...]:
    latitudes, longitudes = (np.full(len(azimuths_deg), degrees) for degrees in centre)
    to_lon, to_lat, _ = _ellipsoid().fwd(longitudes, latitudes, azimuths_deg, distances_m)
    return tuple(map(Geodetic, to_lat.tolist(), to_lon.tolist()))


def polar(centre: Geodetic, place: Geodetic) -> tuple[float, float]:
    """Azimuth and distance of a place.

    Args:
        centre: the reference.
        place: the place.

    Returns:
        Degrees clockwise from north, and meters.
    """
    azimuth_deg, _, distance_m = _ellipsoid().inv(
        centre.longitude_deg, centre.latitude_deg, place.longitude_deg, place.latitude_deg
    )
    return float(azimuth_deg), float(distance_m)


@cache
def _ellipsoid() -> Geod:
    return Geod(ellps="WGS84")


def stepped(start: Point, end: Point, step_m: float) -> list[Point]:
    """Divide a straight side of a local frame.

    Args:
        start: where the side begins; part of the result.
        end: where it ends; not part of the result.
        step_m: the greatest distance between places.

    Returns:
        The places, evenly spaced.
    """
    steps = max(math.ceil(math.dist(start, end) / step_m), 1)
    shares = [step / steps for step in range(steps)]
    return [
        Point(*((1 - share) * a + share * b for a, b in zip(start, end, strict=True)))
        for share in shares
    ]


def dense_ring(ring: Sequence[Geodetic], step_m: float = STEP_M) -> list[Geodetic]:
    """Add corners to the long sides of a ring, on the straight line in degrees.

    A side takes the short way around the Earth, across the antimeridian if that is shorter.

    Args:
        ring: the corners.
        step_m: the greatest length of a side, in meters.

    Returns:
        The corners with those added.

    Raises:
        FrameError: a corner is not on Earth.
    """
    for corner in ring:
        check_on_earth(*corner)
    dense: list[Geodetic] = []
    for start, end in zip(ring, [*ring[1:], *ring[:1]], strict=True):
        lat_deg = end.latitude_deg - start.latitude_deg
        lon_deg = (end.longitude_deg - start.longitude_deg + 180) % 360 - 180
        dense.append(start)
        steps = _steps(start.latitude_deg, end.latitude_deg, lon_deg, step_m)
        for step in range(1, steps):
            share = step / steps
            lon = (start.longitude_deg + share * lon_deg + 180) % 360 - 180
            dense.append(Geodetic(start.latitude_deg + share * lat_deg, lon))
    return dense


_MOST_RINGS = 2_000
"""Rings that are kept: an edit of a mission changes one and leaves the rest."""

_MOST_CORNERS = 20_000
"""Corners that a ring of long sides gets in between, more or less."""


@lru_cache(maxsize=_MOST_RINGS)
def local_ring(ring: tuple[Geodetic, ...], frame: LocalFrame) -> tuple[Point, ...]:
    """A ring of the map in a local frame, its long sides with corners in between.

    Raises:
        FrameError: a corner is not on Earth.
    """
    for corner in ring:
        check_on_earth(*corner)
    sides = np.diff(np.array([*ring, ring[0]]), axis=0)
    sides[:, 1] = (sides[:, 1] + 180) % 360 - 180
    around_m = float(np.hypot(*sides.T).sum()) * _DEGREE_M
    dense = dense_ring(ring, max(STEP_M, around_m / _MOST_CORNERS))
    return tuple(Point(*place) for place in frame.to_local_many(*zip(*dense, strict=True)).tolist())


def step_at_m(latitude_deg: float) -> float:
    """The greatest length of a side at a latitude that needs no more corners, in meters."""
    bent = math.tan(math.radians(min(abs(latitude_deg), _STEEPEST_DEG)))
    return STEP_M / math.sqrt(max(bent / _BENT, 1.0))


def _steps(from_lat_deg: float, to_lat_deg: float, lon_deg: float, step_m: float) -> int:
    """Into how many a side has to be cut; as many the other way around."""
    low_deg, high_deg = sorted((abs(from_lat_deg), abs(to_lat_deg)))
    widest_deg = low_deg if from_lat_deg * to_lat_deg > 0 else 0.0
    east_m = lon_deg * math.cos(math.radians(widest_deg)) * _DEGREE_M
    length_m = math.hypot((to_lat_deg - from_lat_deg) * _DEGREE_M, east_m)
    if step_m <= STEP_M:  # longer ones keep a ring of thousands of corners small
        step_m *= step_at_m(high_deg) / STEP_M
    return min(max(math.ceil(length_m / step_m), 1), _MOST_STEPS)
