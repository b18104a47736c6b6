"""Parallel lines over an area: the exact pieces of them that lie inside.

Every crossing of a line with the area's border is computed from the border's own corners (even-odd
rule, all lines at once), nothing is rastered. A line through a corner counts the corner once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from geo.airspace.zone import polygons_of
from geo.frame import Point

Floats = npt.NDArray[np.float64]
Span = tuple[float, float]
"""From where to where on a line, in metres along it."""


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
