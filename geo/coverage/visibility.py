"""What a camera sees from rows of one bearing: even rows, and short ones for what these miss.

Rows are the exact pieces of parallel lines that lie inside of an area: every crossing of a line
with its border is computed from the border's own corners (even-odd rule, all lines at once),
nothing is rastered. A line through a corner counts the corner once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from geo.airspace import polygons_of
from geo.frame import Point

Floats = npt.NDArray[np.float64]
Span = tuple[float, float]
"""From where to where on a line, in metres along it."""

_WORTH = 0.02
"""A short row of its own must show so much of a picture that no other shows."""
_BEARING_STEP_DEG = 5.0
_TRIES_ACROSS = 13
_MOST_ROWS = 5_000


class CoverageError(ValueError):
    """An area that cannot be covered at all; the message has the reason."""


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
class Sweep:
    """A direction to sweep in: `along` the lines, and `across` them to the right.

    Args:
        bearing_deg: where the lines lead, clockwise from north.
    """

    bearing_deg: float

    def turned(self, shape: BaseGeometry) -> BaseGeometry:
        """The shape in metres (along, across)."""
        matrix = self._matrix
        return shapely.transform(shape, lambda corners: corners @ matrix)

    def place(self, along_m: float, across_m: float) -> Point:
        """The place (east, north) that is so far along and across."""
        east_m, north_m = np.array((along_m, across_m)) @ self._matrix  # its own inverse
        return Point(float(east_m), float(north_m))

    def span(self, start: Point, end: Point) -> tuple[float, Span]:
        """How far across a row lies, and from where to where along it leads, ascending."""
        (begin, across_m), (finish, _) = (np.array((start, end)) @ self._matrix).tolist()
        return across_m, (min(begin, finish), max(begin, finish))

    @property
    def _matrix(self) -> Floats:
        bearing = math.radians(self.bearing_deg)
        sine, cosine = math.sin(bearing), math.cos(bearing)
        return np.array(((sine, cosine), (cosine, -sine)))


class Border:
    """The border of an area in metres (along, across), to cut lines with."""

    def __init__(self, area: BaseGeometry) -> None:
        edges = [
            np.hstack((corners[:-1], corners[1:]))
            for polygon in polygons_of(area)
            for ring in (polygon.exterior, *polygon.interiors)
            for corners in (shapely.get_coordinates(ring),)
        ]
        every = np.concatenate(edges) if edges else np.empty((0, 4))
        rising = every[:, 3] >= every[:, 1]
        every = np.where(rising[:, None], every, every[:, [2, 3, 0, 1]])
        self._edges = every[every[:, 1] < every[:, 3]]  # what lies along a line never crosses it

    def spans(self, levels: Floats) -> list[list[Span]]:
        """For every line (how far across, ascending), the pieces inside, ascending."""
        crossings, lines = self._crossings(levels)
        cuts = np.searchsorted(lines, np.arange(len(levels) + 1))
        return [
            list(zip(on_line[::2].tolist(), on_line[1::2].tolist(), strict=True))
            for begin, end in pairwise(cuts)
            for on_line in (crossings[begin:end],)
        ]

    def total(self, levels: Floats) -> tuple[int, float]:
        """How many pieces all lines have inside, and how long they are together."""
        crossings, _ = self._crossings(levels)
        return len(crossings) // 2, float((crossings[1::2] - crossings[::2]).sum())

    def _crossings(self, levels: Floats) -> tuple[Floats, npt.NDArray[np.intp]]:
        """Where lines cross the border, ascending on each line, and on which line."""
        along_1, low, along_2, high = self._edges.T
        first = np.searchsorted(levels, low, side="left")
        counts = np.searchsorted(levels, high, side="left") - first  # low <= level < high
        edges = np.repeat(np.arange(len(low)), counts)
        starts = np.repeat(np.cumsum(counts) - counts, counts)
        lines = np.repeat(first, counts) + np.arange(len(edges)) - starts
        share = (levels[lines] - low[edges]) / (high[edges] - low[edges])
        along = along_1[edges] + share * (along_2[edges] - along_1[edges])
        order = np.lexsort((along, lines))
        return along[order], lines[order]


def merged(spans: Iterable[Span]) -> list[Span]:
    """Spans that overlap or touch become one; ascending."""
    joined: list[Span] = []
    for begin, end in sorted(spans):
        if joined and begin <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end))
        else:
            joined.append((begin, end))
    return joined


def common(some: Iterable[Span], others: Iterable[Span]) -> list[Span]:
    """What two ascending lists of spans have in common."""
    return [
        (max(begin, other_begin), min(end, other_end))
        for begin, end in some
        for other_begin, other_end in others
        if max(begin, other_begin) <= min(end, other_end)
    ]


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
        """Bearings to try, the one with the shortest estimate first."""
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
