"""Places and shapes as map pages draw them: in degrees, on one side of the antimeridian."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from shapely import Point as ShapelyPoint
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from geo.airspace import Circle, Shape, polygons_of
from geo.frame import Floats, FrameError, LocalFrame, Point

DECIMALS = 7
_QUARTER = 8
"""Segments of a quarter circle in buffers; they are only shown."""

Degrees = list[float]
Rings = list[list[Degrees]]


def degrees(frame: LocalFrame, point: Point) -> Degrees:
    """A place; the frame's origin for one that is not on Earth."""
    return line(frame, [point])[0]


def line(frame: LocalFrame, points: Floats | Sequence[Point]) -> list[Degrees]:
    """`degrees` of many places, in bulk."""
    try:
        places = frame.to_geodetic_many(points)
    except FrameError:
        if len(points) > 1:
            return [degrees(frame, point) for point in points]
        places = np.array([frame.origin])
    places[:, 1] += 360 * np.round((frame.origin.longitude_deg - places[:, 1]) / 360)
    rounded: list[Degrees] = places.round(DECIMALS).tolist()
    return rounded


def beside(origin: tuple[float, float], place: tuple[float, float]) -> tuple[float, float]:
    """A place with its longitude on the origin's side of the antimeridian: 180.1 beside 179.9."""
    turns = round((origin[1] - place[1]) / 360)
    return place if turns == 0 else (place[0], round(place[1] + 360 * turns, DECIMALS))


def area_beside(
    name: str,
    outline: list[Rings],
    buffers: list[list[Rings]],
    notes: list[str],
    *,
    is_fence: bool = False,
) -> dict[str, Any]:
    """An area without handles; `buffers`: the required clearance, and that of routes."""
    return {
        "keys": None,
        "name": name,
        "fence": is_fence,
        "outline": outline,
        "rings": [],
        "circle": None,
        "wrong": False,
        "crosses": False,
        "notes": notes,
        "buffers": buffers,
    }


def buffer(frame: LocalFrame, shape: Shape, distance_m: float) -> list[Rings]:
    """A shape grown by a distance (shrunk, where that is negative), as polygons with holes."""
    if isinstance(shape, Circle):
        radius_m = max(shape.radius_m + distance_m, 0.0)
        grown = ShapelyPoint(shape.centre).buffer(radius_m, quad_segs=4 * _QUARTER)
    else:
        grown = shape.polygon.buffer(distance_m, quad_segs=_QUARTER)
    return outlines(frame, grown)


def place_in(shape: Shape) -> Point:
    """A place in a shape, where its name may stand."""
    if isinstance(shape, Circle):
        return shape.centre
    place = shape.polygon.representative_point()
    return Point(place.x, place.y)


def outlines(frame: LocalFrame, geometry: BaseGeometry) -> list[Rings]:
    """Polygons with holes, in degrees."""
    return [
        [line(frame, shapely.get_coordinates(ring)) for ring in _rings(polygon)]
        for polygon in polygons_of(geometry)
    ]


def _rings(polygon: Polygon) -> Iterable[Any]:
    return (polygon.exterior, *polygon.interiors)
