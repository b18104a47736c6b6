"""Rows over an area, from which a camera that looks straight down sees all of it.

Rows are exact scan lines over the clear area, so that each keeps the clearance by construction;
they are joined by shortest clear paths. What the even rows cannot see (niches, ends of slanted
gaps) gets short rows of its own where that is worth a turn; what is still not seen is named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
from shapely import Point as ShapelyPoint
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from geo.airspace.airspace import Airspace
from geo.airspace.zone import polygons_of
from geo.coverage.row_order import Joiner, Row, cells_of, in_order
from geo.coverage.scan_lines import Border, Floats, Span, Sweep, common, merged
from geo.coverage.unseen import UnseenGround, explain
from geo.frame import Point
from geo.paths.free_space import FreeSpace
from geo.paths.mesh import Mesh
from geo.paths.polyanya import Source, shortest
from geo.paths.shortest import shortest_paths

__all__ = ["Coverage", "CoverageError", "Swath", "cover"]

_MARGIN_M = 0.03
"""Rows keep this much more than the clearance: degrees of seven decimals move them by 8 mm."""

_WORTH = 0.02
"""A short row of its own must show so much of a picture that no other shows."""

_BEARING_STEP_DEG = 5.0
_TRIED = 3
"""So many of the most promising bearings are planned to the end."""

_TRIES_ACROSS = 13
_MOST_ROWS = 5_000


class CoverageError(ValueError):
    """An area that cannot be covered at all: the message says why."""


@dataclass(frozen=True, slots=True)
class Swath:
    """What is seen from a row, in metres on the ground.

    Attributes:
        across_m: width of a picture, across the row.
        along_m: length of a picture, along the row.
        spacing_m: the most between two rows; less than `across_m` by the overlap wanted.
    """

    across_m: float
    along_m: float
    spacing_m: float

    def __post_init__(self) -> None:
        if not 0 < self.along_m < math.inf:
            raise CoverageError(f"a picture of {self.along_m} m along the row; more than 0, please")
        if not 0 < self.spacing_m <= self.across_m < math.inf:
            raise CoverageError(
                f"rows {self.spacing_m} m apart with pictures of {self.across_m} m; "
                "rows must be more than 0 apart and not farther than a picture is wide"
            )


@dataclass(frozen=True, slots=True)
class Coverage:
    """Rows in the order of flight, how they are joined, and what is seen from them.

    Attributes:
        bearing_deg: where the rows lead, clockwise from north.
        rows: as flown; their number counts from 1.
        track: every point of the flight from the first row's start to the last row's end; each leg
            keeps the airspace's clearance.
        way_out: from the start to the first row, both included; empty without a start.
        way_back: from the last row to the start.
        target: what is to be seen: the area without what lies inside of no-fly zones.
        seen: what is seen of it.
        missed: what is not, and why.
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
        area: what is to be seen; polygons with holes, in metres east and north.
        airspace: where the vehicle may be. Rows may begin and end outside of the area.
        swath: what is seen from a row, and how close rows are.
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
    sight = _Visibility(target, within, swath)
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


class _Visibility:
    """Which rows see how much of a target."""

    def __init__(self, target: BaseGeometry, within: BaseGeometry, swath: Swath) -> None:
        self.target = target
        self.swath = swath
        # Rows beyond the sight of the target are of no use; less to cut lines with.
        reach_m = swath.across_m + swath.along_m
        west, south, east, north = target.bounds
        near = shapely.box(west - reach_m, south - reach_m, east + reach_m, north + reach_m)
        self.within = within.intersection(near)  # where rows may lie
        self.worth_m2 = _WORTH * swath.across_m * swath.along_m  # less is not flown for

    def bearings(self, area: BaseGeometry, stop_m: float) -> list[float]:
        """Bearings to try, the one that looks quickest first."""
        hull = shapely.get_coordinates(area.convex_hull)
        sides = np.diff(hull, axis=0)
        along_sides = np.degrees(np.arctan2(sides[:, 0], sides[:, 1])) % 180.0
        even = np.arange(0.0, 180.0, _BEARING_STEP_DEG)
        bearings = sorted({round(float(b), 6) % 180.0 for b in (*even, *along_sides)})
        return sorted(bearings, key=lambda bearing: self._estimate_m(bearing, stop_m))

    def _estimate_m(self, bearing_deg: float, stop_m: float) -> float:
        sweep = Sweep(bearing_deg)
        over = sweep.turned(self.within.intersection(self.target))
        levels = self.levels(sweep.turned(self.target), sweep.turned(self.within))
        count, length_m = Border(over).total(levels)
        if count == 0:
            return math.inf
        return length_m + count * (2 * stop_m + self.swath.spacing_m)

    def levels(self, target: BaseGeometry, within: BaseGeometry) -> Floats:
        """How far across the even rows lie: as few as the spacing allows, evenly apart."""
        if target.is_empty or within.is_empty:
            return np.empty(0)
        half_m = self.swath.across_m / 2
        _, target_low, _, target_high = target.bounds
        _, low, _, high = within.bounds
        first = min(max(target_low + half_m, low + 1e-3), high - 1e-3)
        last = max(min(target_high - half_m, high - 1e-3), low + 1e-3)
        if last <= first:
            middle = (target_low + target_high) / 2
            return np.array([min(max(middle, low + 1e-3), high - 1e-3)])
        count = 1 + math.ceil((last - first) / self.swath.spacing_m - 1e-9)
        if count > _MOST_ROWS:
            raise CoverageError(
                f"the area would take {count} rows; fly higher, overlap less, or cover it in parts"
            )
        return np.linspace(first, last, count)

    def rows(self, sweep: Sweep) -> tuple[list[list[Span]], Floats, list[tuple[float, Span]]]:
        """Even rows (pieces by line), where their lines are, and the short rows beside them."""
        target, within = sweep.turned(self.target), sweep.turned(self.within)
        levels = self.levels(target, within)
        border = Border(within)
        half_m = self.swath.across_m / 2
        west, east = np.full_like(levels, target.bounds[0]), np.full_like(levels, target.bounds[2])
        strips = shapely.box(west, levels - half_m, east, levels + half_m)
        pieces = []
        for clear, strip in zip(
            border.spans(levels), shapely.intersection(target, strips), strict=True
        ):
            wanted = merged((part.bounds[0], part.bounds[2]) for part in polygons_of(strip))
            pieces.append(common(clear, wanted))
        pieces = self._without_idle(pieces, levels, target)
        seen = self.seen(self._flat(pieces, levels))
        return pieces, levels, self._short_rows(target.difference(seen), border)

    def seen(self, rows: Sequence[tuple[float, Span]]) -> BaseGeometry:
        """What rows see, in metres along and across."""
        if not rows:
            return Polygon()
        half_m, ahead_m = self.swath.across_m / 2, self.swath.along_m / 2
        level = np.array([level for level, _ in rows])
        begin, end = np.array([span for _, span in rows]).T
        return shapely.union_all(
            shapely.box(begin - ahead_m, level - half_m, end + ahead_m, level + half_m)
        )

    @staticmethod
    def _flat(pieces: list[list[Span]], levels: Floats) -> list[tuple[float, Span]]:
        return [
            (float(level), span)
            for level, spans in zip(levels, pieces, strict=True)
            for span in spans
        ]

    def _without_idle(
        self, pieces: list[list[Span]], levels: Floats, target: BaseGeometry
    ) -> list[list[Span]]:
        """Leave out short pieces that show next to nothing of their own."""
        rows = self._flat(pieces, levels)
        idle: set[tuple[float, Span]] = set()
        for row in rows:
            level, (begin, end) = row
            if end - begin >= self.swath.along_m:
                continue
            own = self.seen([row]).intersection(target)
            others = [
                other
                for other in rows
                if other != row
                and other not in idle
                and abs(other[0] - level) < self.swath.across_m
                and other[1][0] - self.swath.along_m < end
                and other[1][1] + self.swath.along_m > begin
            ]
            if own.difference(self.seen(others)).area < self.worth_m2:
                idle.add(row)
        return [
            [span for span in spans if (float(level), span) not in idle]
            for level, spans in zip(levels, pieces, strict=True)
        ]

    def _short_rows(self, missed: BaseGeometry, border: Border) -> list[tuple[float, Span]]:
        """Rows for what the even ones do not see, as far as each shows enough."""
        found: list[tuple[float, Span]] = []
        parts = polygons_of(missed)
        while parts:
            part = parts.pop()
            if part.area < self.worth_m2:
                continue
            gain_m2, row = max(
                (
                    (self.seen([row]).intersection(part).area, row)
                    for row in self._over(part, border)
                ),
                default=(0.0, None),
            )
            if row is not None and gain_m2 >= self.worth_m2:
                found.append(row)
                seen = self.seen([row])
                touched = [p for p in (part, *parts) if p.intersects(seen)]
                parts = [p for p in parts if not p.intersects(seen)]
                parts += [rest for p in touched for rest in polygons_of(p.difference(seen))]
        return found

    def _over(self, part: BaseGeometry, border: Border) -> Iterator[tuple[float, Span]]:
        """Clear rows from which some of a part can be seen."""
        begin, low, end, high = part.bounds
        half_m, ahead_m = self.swath.across_m / 2 - 1e-3, self.swath.along_m / 2 - 1e-3
        levels = np.linspace(low - half_m, high + half_m, _TRIES_ACROSS)
        for level, spans in zip(levels, border.spans(levels), strict=True):
            for clear_begin, clear_end in spans:
                if clear_end < begin - ahead_m or clear_begin > end + ahead_m:
                    continue
                first = min(max(begin, clear_begin), clear_end)
                yield float(level), (first, max(first, min(end, clear_end)))


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
        return shortest(mesh, [Source(0.0, start)], end)

    return path


def _straight(start: Point, end: Point) -> tuple[Point, Point]:
    """As if nothing were in the way: good enough to compare bearings."""
    return start, end


def _plan(
    sight: _Visibility, bearing_deg: float, path: Joiner, start: Point | None, stop_m: float
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
    plan = Coverage(
        bearing_deg=bearing_deg,
        rows=order.rows,
        track=order.track,
        way_out=order.way_out,
        way_back=order.way_back,
        target=sight.target,
        seen=seen,
        missed=(),
    )
    missed_m = (sight.target.area - seen.area) / sight.swath.spacing_m
    return plan.length_m + stop_m * len(list(plan.legs)) + 2 * missed_m, plan
