"""Rows over an area, from which a nadir camera covers all of it.

Rows are exact scan lines over the clear area, so that each keeps the clearance by construction;
they are joined by shortest clear paths. What the even rows cannot see (niches, ends of slanted
gaps) gets short rows of its own where that is worth a turn; ground that remains uncovered is
listed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise

import shapely
from shapely import Point as ShapelyPoint
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from geo.airspace import Airspace, polygons_of
from geo.coverage.row_order import Joiner, Row, cells_of, in_order
from geo.coverage.visibility import CoverageError, Swath, Sweep, Visibility
from geo.frame import Point
from geo.paths import FreeSpace, Mesh, Source, shortest_path, shortest_paths

__all__ = ["Coverage", "CoverageError", "Swath", "cover"]

_MARGIN_M = 0.03
"""Rows keep this much more than the clearance: degrees of seven decimals move them by 8 mm."""

_TRIED = 3
"""So many of the most promising bearings are planned to the end."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Rows in the order of flight, the legs between them, and the ground that they cover.

    Attributes:
        bearing_deg: where the rows lead, clockwise from north.
        rows: as flown; their number counts from 1.
        track: every point of the flight from the first row's start to the last row's end; each leg
            keeps the airspace's clearance.
        way_out: from the start to the first row, both included; empty without a start.
        way_back: from the last row to the start.
        target: the ground to cover: the area without no-fly zones.
        seen: the covered part of it.
        missed: the uncovered parts, and why.
    """

    bearing_deg: float
    rows: tuple[Row, ...]
    track: tuple[Point, ...]
    way_out: tuple[Point, ...]
    way_back: tuple[Point, ...]
    target: BaseGeometry
    seen: BaseGeometry
    missed: tuple[UnseenGround, ...]

    @property
    def share(self) -> float:
        """The share of the target that is seen, 0 to 1."""
        return float(self.seen.area / self.target.area)

    @property
    def length_m(self) -> float:
        """Length of the track, with the ways out and back."""
        return sum(math.dist(*leg) for leg in self.legs)

    @property
    def legs(self) -> Iterator[tuple[Point, Point]]:
        """Every straight leg, with the ways out and back."""
        for line in (self.way_out, self.track, self.way_back):
            yield from pairwise(line)


def cover(  # noqa: PLR0913 - what a survey flight is made from
    area: BaseGeometry,
    airspace: Airspace,
    swath: Swath,
    *,
    bearing_deg: float | None = None,
    start: Point | None = None,
    stop_m: float = 6.0,
) -> Coverage:
    """Rows over an area, in a good order.

    Args:
        area: the ground to cover; polygons with holes, in meters east and north.
        airspace: where the vehicle may be. Rows may begin and end outside of the area.
        swath: the width covered from a row, and the distance of rows.
        bearing_deg: where rows lead, clockwise from north; None for the quickest.
        start: where the vehicle sets out and comes back to; None leaves that open.
        stop_m: what a stop at a corner costs, as metres of flight.

    Raises:
        CoverageError: the area is empty, lies inside of zones, is too large for such pictures, or
            no row over it is clear.
    """
    zones = shapely.union_all([zone.polygon for zone in airspace.zones])
    target = area.difference(zones)
    if area.area == 0 or target.area < 1e-9 * area.area:
        raise CoverageError("the area has no ground outside of no-fly zones; draw another one")
    wary = airspace.with_margin(airspace.margin_m + _MARGIN_M)
    free = shapely.MultiPolygon(FreeSpace(wary).lean)
    within = _within(free, target, airspace, start)
    sight = Visibility(target, within, swath)
    path = _joiner(airspace, within)
    if bearing_deg is None:
        tried = sight.bearings(area, stop_m)[:_TRIED]
        bearing_deg = min(tried, key=lambda b: _plan(sight, b, _straight, start, stop_m)[0])
    _, plan = _plan(sight, bearing_deg % 180.0, path, start, stop_m)
    if plan is None:
        raise CoverageError(
            "no row over the area keeps its distance from zones and fence; "
            "lower the clearance, or draw a larger area"
        )
    parts = explain(target.difference(plan.seen), airspace, free, within, swath.across_m / 2)
    return replace(plan, missed=parts)


def _within(
    free: BaseGeometry, target: BaseGeometry, airspace: Airspace, start: Point | None
) -> Polygon:
    """The part of the clear area that the vehicle stays in: that of its start, or the largest."""
    parts = polygons_of(free)
    if not parts:
        raise CoverageError("zones and fence leave no place to fly at all; lower the clearance")
    if start is None:
        return max(parts, key=lambda part: part.intersection(target).area)
    nearest = min(parts, key=lambda part: part.distance(ShapelyPoint(start)))
    if nearest.distance(ShapelyPoint(start)) > 0.05 + 0.1 * airspace.fence_distance_m:
        raise CoverageError("the start does not keep its distance from zones and fence; move it")
    return nearest


def _joiner(airspace: Airspace, within: Polygon) -> Joiner:
    """Ways between rows, in few legs: every corner is a stop, so they turn well off zones.

    A start that rows would not come so near to is joined by the airspace's own shortest path.
    """
    mesh = Mesh([within])

    def path(start: Point, end: Point) -> Sequence[Point] | None:
        if airspace.leg_clear(start, end):
            return start, end
        if mesh.part_of(start) is None or mesh.part_of(end) is None:
            return shortest_paths(airspace).path(start, end)
        return shortest_path(mesh, [Source(0.0, start)], end)

    return path


def _straight(start: Point, end: Point) -> tuple[Point, Point]:
    """As if nothing were in the way: good enough to compare bearings."""
    return start, end


def _plan(
    sight: Visibility, bearing_deg: float, path: Joiner, start: Point | None, stop_m: float
) -> tuple[float, Coverage | None]:
    """The plan with rows of one bearing, and what it costs in metres; None if there are no rows."""
    sweep = Sweep(bearing_deg)
    pieces, levels, short = sight.rows(sweep)
    cells = cells_of(pieces, levels, short, sweep)
    if not cells:
        return math.inf, None
    order = in_order(cells, path, start)
    flown = [sweep.span(row.start, row.end) for row in order.rows]
    seen = sweep.turned(sight.seen(flown)).intersection(sight.target)
    plan = Coverage(bearing_deg, *order, sight.target, seen, missed=())
    missed_m = (sight.target.area - seen.area) / sight.swath.spacing_m
    return plan.length_m + stop_m * len(list(plan.legs)) + 2 * missed_m, plan


# Why some ground is not seen


_DUST_M2 = 0.01
"""Smaller gaps are the rounding of geometry."""


class UnseenCause(Enum):
    """Why ground is not covered, for the operator; `{by}` is the zone (or the fence) in the way."""

    NEAR = "no place that keeps its distance from {by} sees it"
    APART = "no clear way leads there, {by} is nearest"
    OUTSIDE = "outside of the fence, and out of sight from inside"
    SLIVER = "slivers, too small for rows of their own"


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
        return _place_in(max(self.parts, key=lambda part: part.area))


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
    rest = shapely.intersection_all([missed, *(fence.polygon for fence in airspace.fences)])
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
                held = why in {UnseenCause.APART, UnseenCause.NEAR}
                by = airspace.nearest(_place_in(part))[1] if held else ""
                found.setdefault((why, by), []).append(part)
    groups = [UnseenGround(why, by, tuple(parts)) for (why, by), parts in found.items()]
    return tuple(sorted(groups, key=lambda group: -group.area_m2))


def _place_in(part: Polygon) -> Point:
    inside = part.representative_point()
    return Point(inside.x, inside.y)
