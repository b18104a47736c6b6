"""Why some ground is not seen from a coverage's rows."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from geo.airspace.airspace import Airspace
from geo.airspace.zone import polygons_of
from geo.frame import Point

_DUST_M2 = 0.01
"""Smaller gaps are the rounding of geometry."""


class UnseenCause(Enum):
    """Why ground is not seen."""

    NEAR = "no place that keeps its distance is near enough"
    APART = "no clear way leads there"
    OUTSIDE = "it lies outside of the fence"
    SLIVER = "too small, or too little of it in sight, for a row of its own"


@dataclass(frozen=True, slots=True)
class UnseenGround:
    """Ground that is not seen.

    Attributes:
        why: the reason.
        by: the zone (or the fence) that is in the way; "" where nothing is.
        parts: the ground, in metres east and north.
    """

    why: UnseenCause
    by: str
    parts: tuple[Polygon, ...]

    @property
    def area_m2(self) -> float:
        """How much ground."""
        return sum(float(part.area) for part in self.parts)

    @property
    def place(self) -> Point:
        """A place in the largest part."""
        largest = max(self.parts, key=lambda part: part.area)
        inside = largest.representative_point()
        return Point(inside.x, inside.y)


def explain(
    missed: BaseGeometry,
    airspace: Airspace,
    free: BaseGeometry,
    within: BaseGeometry,
    reach_m: float,
) -> tuple[UnseenGround, ...]:
    """What is missed, by reason, the most ground first.

    Args:
        missed: the ground that is not seen.
        airspace: fence and zones.
        free: where the vehicle may be at all.
        within: where it can get to.
        reach_m: how far to the side of a row something is seen.
    """
    rest = missed
    for fence in airspace.fences:
        rest = rest.intersection(fence.polygon)
    shares = [(UnseenCause.OUTSIDE, missed.difference(rest))]
    for why, places in ((UnseenCause.SLIVER, within), (UnseenCause.APART, free)):
        in_sight = places.intersection(rest.buffer(2 * reach_m).envelope).buffer(reach_m)
        shares.append((why, rest.intersection(in_sight)))
        rest = rest.difference(in_sight)
    shares.append((UnseenCause.NEAR, rest))
    found: dict[tuple[UnseenCause, str], list[Polygon]] = {}
    for why, share in shares:
        for part in polygons_of(share):
            if part.area >= _DUST_M2:
                by = (
                    _nearest(part, airspace) if why in {UnseenCause.APART, UnseenCause.NEAR} else ""
                )
                found.setdefault((why, by), []).append(part)
    groups = [UnseenGround(why, by, tuple(parts)) for (why, by), parts in found.items()]
    return tuple(sorted(groups, key=lambda group: -group.area_m2))


def _nearest(part: Polygon, airspace: Airspace) -> str:
    inside = part.representative_point()
    return airspace.nearest(Point(inside.x, inside.y))[1]
