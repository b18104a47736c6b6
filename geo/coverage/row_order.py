"""The order in which rows are flown, and the clear ways between them.

Rows beside each other form cells, each flown to and fro; the order of cells begins with the nearest
and is then improved by turning stretches around and by moving cells, measured by true clear ways.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np

from geo.coverage.visibility import Floats, Span, Sweep
from geo.frame import Point

Joiner = Callable[[Point, Point], Sequence[Point] | None]
"""The shortest clear path between two clear places, both included; None if there is none."""

_PASSES = 8
_MOST_CELLS = 2_000
"""The order of more cells is left as it begins: nearest first."""

_MOST_SINGLE = 500
"""Up to so many rows, single rows are moved too in the end, not only cells."""

_GAIN_M = 0.01
"""An order that is better by less counts as equal."""


@dataclass(frozen=True, slots=True)
class Row:
    """A straight row, in the direction of flight.

    Both ends are one place if one photo is enough.
    """

    start: Point
    end: Point

    @property
    def length_m(self) -> float:
        """Its length."""
        return math.dist(self.start, self.end)

    @property
    def turned(self) -> Row:
        """The same row the other way."""
        return Row(self.end, self.start)


@dataclass(frozen=True, slots=True)
class Cell:
    """Rows that are flown to and fro, one after the other."""

    rows: tuple[Row, ...]  # side by side

    @property
    def entry(self) -> Point:
        """Where its flight begins."""
        return self.rows[0].start

    @property
    def exit(self) -> Point:
        """Where its flight ends."""
        return self.rows[-1].end

    @property
    def turned(self) -> Cell:
        """The same flight backwards."""
        return Cell(tuple(row.turned for row in reversed(self.rows)))

    @property
    def ways(self) -> tuple[Cell, Cell, Cell, Cell]:
        """The four ways to fly it: from either end of the first row, or of the last."""
        other = Cell(tuple(row.turned for row in self.rows))
        return self, other, self.turned, other.turned


class RowOrder(NamedTuple):
    """Rows in order, with the points between them; see `geo.coverage.coverage.Coverage`."""

    rows: tuple[Row, ...]
    track: tuple[Point, ...]  # rows and what joins them
    way_out: tuple[Point, ...]  # from the start to the first row
    way_back: tuple[Point, ...]  # from the last row to the start


def cells_of(
    pieces: Sequence[Sequence[Span]],
    levels: Floats,
    short: Sequence[tuple[float, Span]],
    sweep: Sweep,
) -> list[Cell]:
    """Cells of even rows (pieces by line), and one for each short row.

    A piece goes on into the next line's when these two overlap, and no other pair does with them.
    """
    open_cells: dict[Span, list[Row]] = {}
    cells: list[list[Row]] = []
    above: Sequence[Span] = ()
    for level, spans in zip(levels, pieces, strict=True):
        onward: dict[Span, list[Row]] = {}
        for span in spans:
            row = Row(sweep.place(span[0], level), sweep.place(span[1], level))
            before = [other for other in above if _overlap(span, other)]
            alone = len(before) == 1 and sum(_overlap(other, before[0]) for other in spans) == 1
            if alone:
                cell = open_cells[before[0]]
                cell.append(row.turned if len(cell) % 2 else row)
            else:
                cell = [row]
                cells.append(cell)
            onward[span] = cell
        open_cells, above = onward, spans
    for level, span in short:
        cells.append([Row(sweep.place(span[0], level), sweep.place(span[1], level))])
    return [Cell(tuple(cell)) for cell in cells]


def in_order(cells: Sequence[Cell], path: Joiner, start: Point | None) -> RowOrder:
    """A good order for the cells, from the start and back to it if there is one.

    Cells to which no way leads are left out.
    """
    ways = _Ways(path)
    order = _nearest_first(cells, ways, start)
    if len(order) <= _MOST_CELLS:
        order = _improved(order, ways, start)
    rows = tuple(row for cell in order for row in cell.rows)
    if len(rows) <= _MOST_SINGLE:
        order = _improved([Cell((row,)) for row in rows], ways, start)
        rows = tuple(row for cell in order for row in cell.rows)
    track: list[Point] = []
    for row in rows:
        between = ways.path(track[-1], row.start) if track else (row.start,)
        track += [*between, row.end]
    way_out: tuple[Point, ...] = ()
    way_back: tuple[Point, ...] = ()
    if start is not None and rows:
        way_out, way_back = ways.path(start, track[0]), ways.path(track[-1], start)
    return RowOrder(rows, tuple(point for point, _ in groupby(track)), way_out, way_back)


class _Ways:
    """Clear ways, each found once."""

    def __init__(self, path: Joiner) -> None:
        self._path = path
        self._found: dict[tuple[Point, Point], tuple[float, tuple[Point, ...]]] = {}  # by both ends

    def length_m(self, start: Point, end: Point) -> float:
        """How long the way is; infinite if there is none."""
        return self._way(start, end)[0]

    def path(self, start: Point, end: Point) -> tuple[Point, ...]:
        """Its points, both ends included."""
        return self._way(start, end)[1]

    def _way(self, start: Point, end: Point) -> tuple[float, tuple[Point, ...]]:
        if start == end:
            return 0.0, (start,)
        if (end, start) in self._found:
            length_m, points = self._found[end, start]
            return length_m, points[::-1]
        if (start, end) not in self._found:
            points = tuple(self._path(start, end) or ())
            length_m = sum(math.dist(*leg) for leg in pairwise(points)) if points else math.inf
            self._found[start, end] = length_m, points
        return self._found[start, end]


def _nearest_first(cells: Sequence[Cell], ways: _Ways, start: Point | None) -> list[Cell]:
    """Always on to the cell whose flight can begin nearest."""
    flights = [cell.ways for cell in cells]
    entries = np.array([[flight.entry for flight in way] for way in flights])
    left = np.ones(len(cells), dtype=bool)
    if start is None:
        corner = np.argmin(entries.reshape(-1, 2).sum(axis=1))
        order = [flights[corner // 4][corner % 4]]
        left[corner // 4] = False
        here = order[0].exit
    else:
        order, here = [], start
    while left.any():
        away = np.where(left[:, None], np.hypot(*(entries - here).transpose(2, 0, 1)), np.inf)
        best_m, best = math.inf, -1
        for candidate in np.argsort(away, axis=None):
            if away.flat[candidate] >= best_m or not left[candidate // 4]:
                break
            length_m = ways.length_m(here, flights[candidate // 4][candidate % 4].entry)
            if length_m < best_m:
                best_m, best = length_m, int(candidate)
        if best < 0:
            break
        order.append(flights[best // 4][best % 4])
        left[best // 4] = False
        here = order[-1].exit
    return order


def _improved(order: list[Cell], ways: _Ways, start: Point | None) -> list[Cell]:
    """Turn stretches around, and move cells, as long as that makes the flight shorter."""
    tour = _Tour(order, ways, start)
    for _ in range(_PASSES):
        turned = tour.turn_stretches()
        if not (tour.move_cells() or turned):
            break
    return tour.order


class _Tour:
    """Cells in order, from a start and back to it (None: it costs nothing to get there).

    A change is weighed by straight distances first, for all places at once: no clear way is
    shorter. Only what could still be better is measured by true ways.
    """

    def __init__(self, order: list[Cell], ways: _Ways, start: Point | None) -> None:
        self.order = order
        self._ways = ways
        self._start = start
        self._exits: Floats  # where cells are left, in order
        self._entries: Floats  # where cells begin
        self._hops_m: Floats  # lengths between cells
        self._survey()

    def turn_stretches(self) -> bool:
        """Fly stretches backwards where that is shorter; whether any was."""
        better = False
        for first in range(len(self.order)):
            while (last := self._stretch_to_turn(first)) is not None:
                stretch = self.order[first : last + 1]
                self.order[first : last + 1] = [cell.turned for cell in stretch[::-1]]
                self._survey()
                better = True
        return better

    def _stretch_to_turn(self, first: int) -> int | None:
        before, entry = self._exits[first], self._entries[first]
        now_m = self._hops_m[first] + self._hops_m[first + 1 :]
        least_m = _away(self._exits[first + 1 :], before) + _away(self._entries[first + 1 :], entry)
        for place in np.flatnonzero(least_m < now_m - _GAIN_M):
            last = first + int(place)
            turned_m = self._hop(before, self._exits[last + 1])
            turned_m += self._hop(entry, self._entries[last + 1])
            if turned_m < now_m[place] - _GAIN_M:
                return last
        return None

    def move_cells(self) -> bool:
        """Fly cells at another place, or another way, where that is shorter; whether any was."""
        better = False
        for index in range(len(self.order)):
            if (found := self._better_place(index)) is not None:
                del self.order[index]
                self.order.insert(*found)
                self._survey()
                better = True
        return better

    def _better_place(self, index: int) -> tuple[int, Cell] | None:
        """Where among the others, and which way, a cell costs least; None: where it is."""
        flights = self.order[index].ways
        exits = np.delete(self._exits, index + 1, axis=0)
        entries = np.delete(self._entries, index, axis=0)
        hops_m = np.delete(self._hops_m, index)
        hops_m[index] = self._hop(exits[index], entries[index])
        limit_m = float(self._hops_m[index : index + 2].sum() - hops_m[index]) - _GAIN_M
        least_m = np.array(
            [
                _away(exits, np.array(flight.entry))
                + _away(entries, np.array(flight.exit))
                - hops_m
                for flight in flights
            ]
        )
        best = None
        for candidate in np.argsort(least_m, axis=None):
            if least_m.flat[candidate] >= limit_m:
                break
            way, place = divmod(int(candidate), len(hops_m))
            cost_m = self._hop(exits[place], flights[way].entry)
            cost_m += self._hop(entries[place], flights[way].exit)
            cost_m -= float(hops_m[place])
            if cost_m < limit_m:
                limit_m, best = cost_m, (place, flights[way])
        return best

    def _survey(self) -> None:
        """Where the flight is before and after every hop, and how long the hops are."""
        end = self._start if self._start is not None else (math.nan, math.nan)
        self._exits = np.array([end, *(cell.exit for cell in self.order)], dtype=float)
        self._entries = np.array([*(cell.entry for cell in self.order), end], dtype=float)
        self._hops_m = np.array(
            [self._hop(*ends) for ends in zip(self._exits, self._entries, strict=True)]
        )

    def _hop(self, start: Sequence[float] | Floats, end: Sequence[float] | Floats) -> float:
        here, there = (float(start[0]), float(start[1])), (float(end[0]), float(end[1]))
        if math.isnan(here[0]) or math.isnan(there[0]):
            return 0.0
        return self._ways.length_m(Point(*here), Point(*there))


def _away(places: Floats, place: Floats) -> Floats:
    """Straight distances; 0 to and from nowhere in particular."""
    away_m: Floats = np.hypot(places[:, 0] - place[0], places[:, 1] - place[1])
    away_m[np.isnan(away_m)] = 0.0
    return away_m


def _overlap(one: Span, other: Span) -> bool:
    return one[0] <= other[1] and other[0] <= one[1]
