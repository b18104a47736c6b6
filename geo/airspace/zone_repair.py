"""A zone whose border crosses or touches itself, as all the area that it may mean.

Authorities and map programs publish such borders: an arc that misses its point by metres, a spike,
the figure of an eight, a hole that reaches out of its ring. Which part was meant cannot be known.
So all that the border encloses is the zone, however often and whichever way around: no reading of
it has a place outside of the repair. Only zones are repaired: a fence that grows would let the
vehicle out.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Polygon, STRtree
from shapely import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry

from geo.airspace.zone import Outline, Ring, ZoneError, polygons_of
from geo.frame import Point

STRIP_M: Final = 0.5
"""What encloses nothing (a spike, a border along one line, one place) becomes a strip of it, this
far to all sides."""

_LEAST_FACE_M2: Final = 1e-4
"""Smaller faces are left by rounding: if they matter, the lines around them become strips."""

_LEAST_STRIP_M: Final = 1e-3
"""What lies no farther than this outside of the faces is a matter of rounding."""


def repaired(ring: Ring, holes: Sequence[Ring] = ()) -> list[Outline]:
    """The areas that a border encloses; they do not overlap.

    Holes are kept where every reading agrees on them: where the ring is sound, and the hole is an
    area that lies within it and meets no other hole. The others are filled.

    Args:
        ring: The border's corners in a local frame, in metres; the last one joins the first.
        holes: Borders of areas within it that are no part of the zone.

    Returns:
        At least one outline. Together they cover the border and all that lies within it, however it
        is read: by crossings of all rings, by winding number, or as the union of all faces.

    Raises:
        ZoneError: a corner is not finite, or there is none.
    """
    if not ring or not all(np.isfinite(line).all() for line in (ring, *holes)):
        raise ZoneError("a corner is not a finite number", "zone-not-finite")
    kept, filled = _sorted_holes(ring, [hole for hole in holes if hole])
    outlines = []
    for polygon in _enclosed([ring, *filled]):
        within = tuple(hole for hole in kept if polygon.contains(ShapelyPoint(hole[0])))
        outlines.append(Outline(_corners(polygon), within))
    return outlines


def _sorted_holes(ring: Ring, holes: Sequence[Ring]) -> tuple[list[Ring], list[Ring]]:
    """The holes that are kept, and those that are filled."""
    try:
        inside = Outline(ring).polygon
    except ZoneError:
        return [], list(holes)
    areas = [shapely.union_all(_enclosed([hole])) for hole in holes]
    tree = STRtree(areas)
    kept: list[Ring] = []
    filled: list[Ring] = []
    for hole, area in zip(holes, areas, strict=True):
        alone = len(tree.query(area, predicate="intersects")) == 1
        sound = False
        with contextlib.suppress(ZoneError):
            sound = alone and inside.contains_properly(Outline(hole).polygon)
        (kept if sound else filled).append(hole)
    return kept, filled


def _enclosed(rings: Sequence[Ring]) -> list[Polygon]:
    """All that borders enclose, without holes, and strips along what of them encloses nothing."""
    lines: list[BaseGeometry] = [
        LineString([*ring, ring[0]]) if len(set(ring)) > 1 else ShapelyPoint(ring[0])
        for ring in rings
    ]
    noded = shapely.union_all(lines)  # cut where they meet
    faces = shapely.polygonize([noded]).geoms
    body = shapely.union_all([face for face in faces if face.area >= _LEAST_FACE_M2])
    rest = noded if body.is_empty else noded.difference(body.buffer(_LEAST_STRIP_M))
    whole = shapely.union_all([body, rest.buffer(STRIP_M, cap_style="square")])
    filled = [Polygon(part.exterior) for part in polygons_of(whole)]
    return [p for p in polygons_of(shapely.union_all(filled)) if p.area >= _LEAST_FACE_M2]


def _corners(polygon: Polygon) -> Ring:
    return tuple(Point(*corner) for corner in shapely.get_coordinates(polygon.exterior)[:-1])
