"""No-fly zones and fences.

Outlines with holes, circles, and the checks that make them valid areas.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from shapely import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.validation import explain_validity

from geo.frame import Point
from geo.validity import Validity

Ring = tuple[Point, ...]
"""The corners of a polygon in order, either way around; the last one joins the first."""

_LEAST_AREA_M2 = 1e-6
_FARTHEST_M = 1e8
_LEAST_SEGMENTS, _MOST_SEGMENTS = 12, 360
_EXCESS_M = 0.02  # how much farther out a grown circle's corners may be


def arc_excess(steps: int) -> float:
    """The factor that makes every chord of a buffered arc reach the full distance.

    GEOS rounds the number of steps of an arc, so that a step may be half as long again. The usual
    compensation for the chord falls short then; this factor does not.

    Args:
        steps: per quarter circle.

    Returns:
        The factor, more than 1.
    """
    return 1 / math.cos(0.75 * (math.pi / 2) / steps)


ARC_STEPS = 16  # of a quarter circle
ARC_EXCESS = arc_excess(ARC_STEPS)


class ZoneError(ValueError):
    """A shape that bounds no area.

    Attributes:
        code: the error code, e.g. `zone-self-intersects`; listed in docs/errors.md.
        place: where the border is wrong, if the error has one place.
    """

    def __init__(self, message: str, code: str, place: Point | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.place = place


@dataclass(frozen=True, slots=True)
class Outline:
    """The area within a ring and outside its holes; it may be concave.

    Attributes:
        ring: the corners of the border, meters east and north.
        holes: rings within the border, apart from each other.
        polygon: the area as a shapely polygon.

    Raises:
        ZoneError: as `checked_ring`, or a hole lies outside the ring, on its border or on another
            hole.
    """

    ring: Ring
    holes: tuple[Ring, ...] = ()  # within the ring, apart from each other
    polygon: Polygon = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        ring = checked_ring(self.ring)
        holes = tuple(_checked_hole(number, hole) for number, hole in enumerate(self.holes, 1))
        polygon = Polygon(ring, holes)
        if holes and not polygon.is_valid:
            what, place = _explained(polygon)
            raise ZoneError(
                f"its holes must lie within it, apart from each other ({what})",
                "hole-outside-ring" if "outside" in what else "holes-touch",
                place,
            )
        object.__setattr__(self, "ring", ring)
        object.__setattr__(self, "holes", holes)
        object.__setattr__(self, "polygon", polygon)

    @property
    def corners(self) -> Ring:
        """All corners, including those of holes."""
        return (*self.ring, *(corner for hole in self.holes for corner in hole))

    @property
    def border(self) -> BaseGeometry:
        """The ring and the rings of the holes, as lines."""
        return self.polygon.boundary


@dataclass(frozen=True, slots=True)
class Circle:
    """All places within a radius of a center. No test uses a polygon of it.

    Attributes:
        centre: the center, meters east and north.
        radius_m: the radius.
        polygon: a polygon around the circle, for drawings.

    Raises:
        ZoneError: the center is not finite, or the radius is not a positive finite number.
    """

    centre: Point
    radius_m: float
    polygon: Polygon = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        centre = _checked_point(self.centre)
        object.__setattr__(self, "centre", centre)
        object.__setattr__(self, "polygon", Polygon(circle_ring(centre, self.radius_m)))

    @property
    def corners(self) -> Ring:
        """The corners of a polygon around the circle."""
        return circle_ring(self.centre, self.radius_m)


Shape = Outline | Circle
"""An area on the ground. Of both, `polygon` covers it (a circle's is a little larger than the
circle; no test uses it) and `corners` are the polygon's."""


@dataclass(frozen=True, slots=True)
class Band:
    """A range of altitude, in meters above home; both ends may be infinite.

    Raises:
        ZoneError: an end is not a number, or the upper one is below the lower one.
    """

    lower_m: float = -math.inf
    upper_m: float = math.inf

    def __post_init__(self) -> None:
        if not self.lower_m <= self.upper_m:
            raise ZoneError(
                f"it reaches from {self.lower_m:g} m up to {self.upper_m:g} m; exchange them",
                "zone-altitudes-inverted",
            )

    def meets(self, low_m: float, high_m: float) -> bool:
        """Whether the band overlaps the range from `low_m` to `high_m`, including its ends."""
        return self.lower_m <= high_m and low_m <= self.upper_m


@dataclass(frozen=True, slots=True, init=False)
class Zone:
    """A no-fly zone.

    Args:
        name: the name for the operator.
        shape: the area; a bare ring is an outline without holes.
        clearance_m: the clearance of this zone; None: that of the airspace.
        band: the altitudes at which the zone applies; None: all.
        validity: the times at which the zone applies; None: always.
        crosses_fence: the zone may reach beyond the fence.

    Raises:
        ZoneError: the ring is not a simple polygon, or the clearance is not a distance.
    """

    name: str
    shape: Shape
    clearance_m: float | None
    band: Band | None
    validity: Validity | None
    crosses_fence: bool

    def __init__(  # noqa: PLR0913 - one for each field
        self,
        name: str,
        shape: Shape | Sequence[Point],
        *,
        clearance_m: float | None = None,
        band: Band | None = None,
        validity: Validity | None = None,
        crosses_fence: bool = False,
    ) -> None:
        if clearance_m is not None and not 0 <= clearance_m < math.inf:
            raise ZoneError(f"a clearance of {clearance_m} m; it must be 0 or more", "out-of-range")
        for attribute, value in (
            ("name", name),
            ("shape", shape if isinstance(shape, Outline | Circle) else Outline(tuple(shape))),
            ("clearance_m", clearance_m),
            ("band", band),
            ("validity", validity),
            ("crosses_fence", crosses_fence),
        ):
            object.__setattr__(self, attribute, value)

    @property
    def polygon(self) -> Polygon:
        """A polygon that covers the zone: exact for outlines, circumscribed for circles."""
        return self.shape.polygon


def checked_ring(corners: Iterable[Point | Sequence[float]]) -> Ring:
    """Check a ring.

    Args:
        corners: the corners, in either direction.

    Returns:
        The ring without repeated corners and without a closing one.

    Raises:
        ZoneError: a coordinate is not finite, fewer than three corners differ, the ring crosses or
            touches itself, or the ring has no area. A bad ring is never repaired: every repair
            makes a part of the operator's zone flyable.
    """
    ring: list[Point] = []
    for corner in corners:
        point = _checked_point(corner)
        if not ring or point != ring[-1]:
            ring.append(point)
    if len(ring) > 1 and ring[0] == ring[-1]:
        ring.pop()
    if len(set(ring)) < 3:
        count = len(set(ring))
        noun = "corner" if count == 1 else "corners"
        raise ZoneError(f"it has {count} different {noun}, an area needs 3", "zone-too-few-corners")
    polygon = Polygon(ring)
    if polygon.convex_hull.area < _LEAST_AREA_M2:
        raise ZoneError("its corners lie on one line, so it has no area", "zone-no-area")
    if not polygon.is_valid:
        what, place = _explained(polygon)
        raise ZoneError(
            f"its border crosses or touches itself ({what})", "zone-self-intersects", place
        )
    return tuple(ring)


def circle_ring(
    centre: Point, radius_m: float, *, outward: bool = True, within_m: float | None = None
) -> Ring:
    """A polygon around a circle (for a zone) or within it (for a fence).

    With 48 sides the polygon and the circle differ by at most 0.2 % of the radius.

    Args:
        centre: the center.
        radius_m: the radius.
        outward: the polygon lies around the circle, else within it.
        within_m: the greatest difference to the circle; the polygon has 12 to 360 sides for it.

    Raises:
        ZoneError: the radius is not a positive finite number.
    """
    if not 0 < radius_m < math.inf:
        raise ZoneError(f"its radius is {radius_m} m, it must be more than 0", "zone-radius")
    segments = 48
    if within_m is not None:
        ratio = radius_m / (radius_m + within_m) if outward else 1 - within_m / radius_m
        widest = math.acos(min(max(ratio, 0.0), 1.0))
        most = math.pi / widest if widest > 0 else math.inf
        segments = math.ceil(min(max(most, _LEAST_SEGMENTS), _MOST_SEGMENTS))
    half_step = math.pi / segments
    reach_m = radius_m / math.cos(half_step) if outward else radius_m
    angles = (2 * half_step * step for step in range(segments))
    return tuple(
        Point(centre.east_m + reach_m * math.cos(a), centre.north_m + reach_m * math.sin(a))
        for a in angles
    )


def polygons_of(shape: BaseGeometry) -> list[Polygon]:
    """The polygons of a shapely geometry that have an area, without its lines and points."""
    if isinstance(shape, Polygon):
        return [shape] if shape.area > 0 else []
    return [polygon for part in getattr(shape, "geoms", ()) for polygon in polygons_of(part)]


def _checked_point(corner: Point | Sequence[float]) -> Point:
    point = Point(float(corner[0]), float(corner[1]))
    if not math.hypot(*point) < math.inf:
        raise ZoneError("a corner is not a finite number", "zone-not-finite")
    if math.hypot(*point) > _FARTHEST_M:
        raise ZoneError("a corner is not on Earth", "zone-not-finite")
    return point


def _checked_hole(number: int, hole: Ring) -> Ring:
    try:
        return checked_ring(hole)
    except ZoneError as error:
        raise ZoneError(f"hole {number}: {error}", error.code, error.place) from None


def _explained(polygon: Polygon) -> tuple[str, Point | None]:
    """GEOS' reason why a polygon is not valid, and the place that it names."""
    reason = explain_validity(polygon)
    found = re.fullmatch(r"(.*)\[(\S+) (\S+)\]", reason)
    if found is None:
        return reason.lower(), None
    what, east_m, north_m = found.groups()
    return what.lower(), Point(float(east_m), float(north_m))


def rounded(shape: Shape, reach_m: float) -> BaseGeometry:
    """A shape grown by a distance, or by slightly more.

    Corners become round. The excess is at most 0.3 % of the distance, plus 2 cm for circles.

    Args:
        shape: the shape.
        reach_m: the distance.
    """
    if isinstance(shape, Circle):
        return Polygon(circle_ring(shape.centre, shape.radius_m + reach_m, within_m=_EXCESS_M))
    return shape.polygon.buffer(reach_m * ARC_EXCESS, quad_segs=ARC_STEPS)
