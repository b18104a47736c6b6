"""What a camera sees from rows of one bearing: even rows, and short ones for what these miss."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from geo.airspace.zone import polygons_of
from geo.coverage.scan_lines import Border, Floats, Span, Sweep, common, merged

_WORTH = 0.02
"""A short row of its own must show so much of a picture that no other shows."""
_BEARING_STEP_DEG = 5.0
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


class Visibility:
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
