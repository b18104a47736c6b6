"""No-fly zones and fences as rings of corners: what makes a ring a valid area."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from shapely import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.validation import explain_validity

from geo.frame import Point

Ring = tuple[Point, ...]
"""The corners of a polygon in order, either way around; the last one joins the first."""


class ZoneError(ValueError):
    """A ring that bounds no area: the message says why."""


@dataclass(frozen=True, slots=True)
class Zone:
    """A no-fly zone: a simple polygon, possibly concave.

    Raises:
        ZoneError: as `checked_ring`.
    """

    name: str
    ring: Ring

    def __post_init__(self) -> None:
        object.__setattr__(self, "ring", checked_ring(self.ring))


def checked_ring(corners: Iterable[Point | Sequence[float]]) -> Ring:
    """The ring without repeated corners and without a closing one.

    Raises:
        ZoneError: a coordinate is not finite, fewer than three corners differ, the ring crosses or
            touches itself, or it has no area. Such a ring is refused and not repaired: every
            repair makes a part of what the operator drew flyable.
    """
    ring: list[Point] = []
    for corner in corners:
        point = Point(float(corner[0]), float(corner[1]))
        if not (math.isfinite(point.east_m) and math.isfinite(point.north_m)):
            raise ZoneError("a corner is not a finite number")
        if not ring or point != ring[-1]:
            ring.append(point)
    if len(ring) > 1 and ring[0] == ring[-1]:
        ring.pop()
    if len(set(ring)) < 3:
        raise ZoneError(f"it has {len(set(ring))} different corners, an area needs 3")
    polygon = Polygon(ring)
    if polygon.convex_hull.area < 1e-6:
        raise ZoneError("its corners lie on one line, so it has no area")
    if not polygon.is_valid:
        raise ZoneError(f"its border crosses or touches itself ({explain_validity(polygon)})")
    return tuple(ring)


def circle_ring(
    centre: Point, radius_m: float, *, outward: bool = True, segments: int = 48
) -> Ring:
    """A circle as a polygon that lies around it (`outward`, a zone) or within it (a fence).

    With 48 sides the two differ from the circle by 0.2 % of the radius at most.

    Raises:
        ZoneError: the radius is not a positive finite number.
    """
    if not 0 < radius_m < math.inf:
        raise ZoneError(f"its radius is {radius_m} m, it must be more than 0")
    half_step = math.pi / segments
    reach_m = radius_m / math.cos(half_step) if outward else radius_m
    angles = (2 * half_step * step for step in range(segments))
    return checked_ring(
        Point(centre.east_m + reach_m * math.cos(a), centre.north_m + reach_m * math.sin(a))
        for a in angles
    )


def polygons_of(shape: BaseGeometry) -> list[Polygon]:
    """The polygons with an area that a shapely geometry consists of; lines and points are left."""
    if isinstance(shape, Polygon):
        return [shape] if shape.area > 0 else []
    return [polygon for part in getattr(shape, "geoms", ()) for polygon in polygons_of(part)]
