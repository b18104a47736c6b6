"""A clear area cut into triangles: which lie next to each other, and which hold a point.

The triangles are a constrained Delaunay triangulation: its corners are those of the area's border,
so every corner that a shortest path can turn at is a vertex, and no triangle crosses the border.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Point as ShapelyPoint
from shapely import Polygon, STRtree

from geo.frame import Point
from geo.paths.triangles import triangles_of

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.intp]

ON_M = 1e-6
"""A point so near to a triangle counts as in it: points computed to lie on a border hardly do."""

_REFLEX = math.pi + 1e-9
_MOST_HELD = 16


Place = tuple[float, float]
Entry = tuple[int, int, int, int, int]
"""A side of a triangle, seen by who comes in over it: its left, its right and the opposite vertex,
and the entries into the next triangles over the sides left-opposite and opposite-right (-1: none,
or a dead end: triangles that lead to no others).
"""


class Mesh:
    """The triangles of an area.

    Entry `3 * t + k` leads into triangle `t`. Entries and vertices are plain lists, which Python
    reads faster than arrays.

    Args:
        parts: the connected parts of the area; they touch in single points at most.

    Attributes:
        entries: every side of every triangle as an `Entry`, that leads into no dead end.
        back: for every side of a triangle, the entry into the neighbour behind it; -1: border.
        places: the vertices.
        corner: whether paths turn at a vertex: the area takes more than half of the way around it.
        part: for every triangle, the number of the part that it belongs to.
    """

    def __init__(self, parts: Sequence[Polygon]) -> None:
        pieces, part = triangles_of(parts)
        outlines = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
        triangles, east_m, north_m = _vertices(outlines)
        back, left, right = _neighbours(triangles, len(east_m))
        self.part = part
        dead_ends = _dead_ends(back)
        closed = np.append(np.isin(np.arange(back.size), dead_ends), False)  # -1 is the last
        left, right = np.where(closed[left], -1, left), np.where(closed[right], -1, right)
        # Each number is one object in all lists; -1 finds the last.
        numbers = np.append(np.arange(max(back.size, east_m.size)), -1).astype(object)

        def listed(values: Integers) -> list[int]:
            found: list[int] = numbers[values.ravel()].tolist()
            return found

        self.back = listed(back)
        self._dead_ends = listed(dead_ends)  # entry into each triangle of one; else -1
        self.places: list[Place] = list(zip(east_m.tolist(), north_m.tolist(), strict=True))
        sides = (listed(np.roll(triangles, -step, axis=1)) for step in range(3))
        self.entries: list[Entry] = list(zip(*sides, listed(left), listed(right), strict=True))
        self.corner: list[bool] = _reflex(triangles, east_m, north_m).tolist()
        border = np.flatnonzero(back < 0)
        ends = np.roll(triangles, -1, axis=1).ravel()[border]
        self._border_part = part[border // 3]  # part of each side
        self._border = np.stack([east_m, north_m], axis=1)[  # starts and ends of sides
            np.stack([triangles.ravel()[border], ends])
        ]
        self._tree = STRtree(pieces)  # for `holding`
        self._held: dict[Point, list[int]] = {}  # cached results: a route locates its ends twice

    def __len__(self) -> int:
        return len(self.part)

    def entries_towards(self, triangles: Iterable[int]) -> list[Entry]:
        """The entries, with those that lead to some triangles in dead ends."""
        entries = self.entries
        for triangle in triangles:
            while (inward := self._dead_ends[triangle]) >= 0:
                if entries is self.entries:
                    entries = entries.copy()
                triangle, side = divmod(self.back[inward], 3)  # noqa: PLW2901 - outwards, step by step
                first, second = 3 * triangle + (side + 1) % 3, 3 * triangle + (side + 2) % 3
                entries[first] = (*entries[first][:3], inward, entries[first][4])
                entries[second] = (*entries[second][:4], inward)
        return entries

    def holding(self, point: Point) -> list[int]:
        """The triangles that a point is in: several where it lies on a side or on a vertex."""
        if not math.isfinite(point[0] + point[1]):
            return []
        held = self._held.get(point)
        if held is None:
            found = self._tree.query(ShapelyPoint(point), predicate="dwithin", distance=ON_M)
            held = np.sort(found).tolist()
            if len(self._held) >= _MOST_HELD:
                self._held.clear()
            self._held[point] = held
        return held

    def part_of(self, point: Point) -> int | None:
        """The number of the part that a point lies in; None if it is outside of the area."""
        held = self.holding(point)
        return int(self.part[held[0]]) if held else None

    def parts_of(self, points: Sequence[Point]) -> list[int | None]:
        """`part_of` of many points, in bulk."""
        places = np.array(points, dtype=float).reshape(-1, 2)
        finite = np.flatnonzero(np.isfinite(places).all(axis=1))
        which, held = self._tree.query(
            shapely.points(places[finite]), predicate="dwithin", distance=ON_M
        )
        first = np.full(len(places), len(self))
        np.minimum.at(first, finite[which], held)
        numbers = [*self.part.tolist(), None]
        return [numbers[triangle] for triangle in first.tolist()]

    def nearest(self, point: Point, part: int | None = None) -> tuple[Point, int]:
        """The place on the border (of one part) nearest to a point, and in which part it is.

        The area (or that part of it) is not empty.
        """
        mine = np.flatnonzero(self._border_part == part) if part is not None else slice(None)
        places, away_m = self._feet(point, mine)
        best = int(np.argmin(away_m))
        return Point(*places[best].tolist()), int(self._border_part[mine][best])

    def all_around(self, point: Point, directions: int) -> list[Point]:
        """The nearest place on the border in each of so many directions, nearest first."""
        places, away_m = self._feet(point, slice(None))
        bearing = np.arctan2(places[:, 1] - point[1], places[:, 0] - point[0])
        sector = np.floor((bearing / math.tau + 0.5) * directions).astype(np.intp) % directions
        order = np.lexsort((away_m, sector))
        _, first = np.unique(sector[order], return_index=True)
        nearest = order[first]
        nearest = nearest[np.argsort(away_m[nearest], kind="stable")]
        return [Point(*place) for place in places[nearest].tolist()]

    def corners_within(self, point: Point, reach_m: float) -> list[Point]:
        """The corners of the border that are so near to a point, nearest first."""
        corners = self._border[0]
        away_m = np.hypot(*(corners - point).T)
        near = np.flatnonzero(away_m <= reach_m)
        near = near[np.argsort(away_m[near], kind="stable")]
        return [Point(*place) for place in corners[near].tolist()]

    def _feet(self, point: Point, sides: Integers | slice) -> tuple[Floats, Floats]:
        """The nearest place to a point on every side of the border, and how far it is."""
        starts, ends = self._border[0][sides], self._border[1][sides]
        along = ends - starts
        share = ((np.array(point) - starts) * along).sum(axis=1) / (along**2).sum(axis=1)
        places = starts + along * np.clip(share, 0, 1)[:, None]
        return places, np.hypot(*(places - point).T)


def _vertices(outlines: Floats) -> tuple[Integers, Floats, Floats]:
    """The vertices of each triangle, anticlockwise, and the places of all vertices."""
    flat = np.ascontiguousarray(outlines).reshape(-1, 2).view(np.complex128).ravel()
    places, triangles = np.unique(flat, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    a, b, c = outlines[:, 0], outlines[:, 1], outlines[:, 2]
    clockwise = _cross(*(b - a).T, *(c - a).T) < 0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return triangles, np.ascontiguousarray(places.real), np.ascontiguousarray(places.imag)


def _neighbours(triangles: Integers, vertices: int) -> tuple[Integers, Integers, Integers]:
    """For every side the entry behind it, and those behind the two sides that follow.

    The side of entry `h` runs from its left to its right vertex with the triangle on its left
    hand; the neighbour's side there runs the other way.
    """
    starts = triangles.ravel()
    ends = np.roll(triangles, -1, axis=1).ravel()
    keys, wanted = starts * vertices + ends, ends * vertices + starts
    order = np.argsort(keys)
    found = np.minimum(np.searchsorted(keys, wanted, sorter=order), max(len(keys) - 1, 0))
    back = np.where(keys[order[found]] == wanted, order[found], -1)
    sides = back.reshape(-1, 3)
    # From `left` to `right` to `ahead` and back: the second side is on the right, the third left.
    return back, np.roll(sides, -2, axis=1).ravel(), np.roll(sides, -1, axis=1).ravel()


def _dead_ends(back: Integers) -> Integers:
    """For every triangle the entry into it, if all that lies behind that are dead ends; -1: not."""
    inward = np.full(len(back) // 3, -1)
    open_ = back.reshape(-1, 3) >= 0
    ends = np.flatnonzero(open_.sum(axis=1) == 1)
    while len(ends):
        entry = 3 * ends + open_[ends].argmax(axis=1)
        outer = back[entry] // 3
        last = np.isin(outer, ends) & (ends < outer)  # two that only lead to each other
        ends, entry, outer = ends[~last], entry[~last], outer[~last]
        inward[ends] = entry
        open_.ravel()[entry] = open_.ravel()[back[entry]] = False
        outer = np.unique(outer)
        ends = outer[open_[outer].sum(axis=1) == 1]
    return inward


def _reflex(triangles: Integers, east_m: Floats, north_m: Floats) -> npt.NDArray[np.bool_]:
    """Around which vertices the triangles span more than half a turn."""
    east, north = east_m[triangles], north_m[triangles]
    to_next = np.roll(east, -1, axis=1) - east, np.roll(north, -1, axis=1) - north
    to_last = np.roll(east, -2, axis=1) - east, np.roll(north, -2, axis=1) - north
    dot = to_next[0] * to_last[0] + to_next[1] * to_last[1]
    angles = np.arctan2(_cross(*to_next, *to_last), dot)
    return np.bincount(triangles.ravel(), angles.ravel(), minlength=len(east_m)) > _REFLEX


def _cross(a_east: Floats, a_north: Floats, b_east: Floats, b_north: Floats) -> Floats:
    return a_east * b_north - a_north * b_east
