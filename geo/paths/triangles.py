"""An area cut into triangles: a constrained Delaunay triangulation, its corners those of the area.

GEOS clips ears, which takes the square of the number of zones: four seconds for 5,000 of them. In a
large area nearly all triangles are those that Delaunay's rule makes of the corners alone, without
the sides, in a tenth of that. GEOS cuts the rest, where these would cross a side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Polygon, STRtree

Shapes = npt.NDArray[np.object_]
Integers = npt.NDArray[np.intp]

LARGE = 10_000
"""An area of so many corners is not left to GEOS as a whole."""


def triangles_of(parts: Sequence[Polygon], large: int = LARGE) -> tuple[Shapes, Integers]:
    """The triangles of areas, and the number of the area that each of them is of.

    Args:
        parts: the areas.
        large: the corners of a large one.
    """
    counts = shapely.get_num_coordinates(np.array(parts, dtype=object))
    cut = [
        _of_corners(part) if count >= large else _clipped(part)
        for part, count in zip(parts, counts, strict=True)
    ]
    pieces = np.concatenate([np.array([], dtype=object), *cut])
    return pieces, np.repeat(np.arange(len(parts)), [len(some) for some in cut])


def _clipped(areas: Polygon | Shapes) -> Shapes:
    pieces: Shapes = shapely.get_parts(shapely.constrained_delaunay_triangles(areas))
    return pieces


def _of_corners(part: Polygon) -> Shapes:
    """The triangles of an area, from those of its corners."""
    corners = _Corners(part)
    pieces = shapely.get_parts(shapely.delaunay_triangles(shapely.multipoints(corners.places)))
    triangles = corners.of(pieces)
    lacking = corners.border_without(corners.sides(triangles).ravel())
    if len(lacking):
        lines = corners.lines(lacking)
        crossed = np.unique(STRtree(pieces).query(lines, predicate="crosses")[1])
        around, times = np.unique(corners.sides(triangles[crossed]), return_counts=True)
        rim = around[(times == 1) | np.isin(around, corners.border)]
        faces = shapely.get_parts(shapely.polygonize([*corners.lines(rim), *lines]))
        among = STRtree(pieces[crossed])  # a face with none of these is whole, with gaps around it
        gaps, _ = among.query(shapely.point_on_surface(faces), predicate="intersects")
        more = _clipped(faces[np.unique(gaps)])
        pieces = np.concatenate([np.delete(pieces, crossed), more])
        triangles = np.concatenate([np.delete(triangles, crossed, axis=0), corners.of(more)])
    pieces = pieces[corners.inside(triangles)]
    # Rounding may make one too many, without an area; where rings meet, corners are not
    # distinguished.
    whole = math.isclose(shapely.area(pieces).sum(), part.area, rel_tol=1e-9)
    return pieces if whole and len(pieces) == corners.triangles else _clipped(part)


class _Corners:
    """The corners of an area by number, and its border: sides from one corner to another.

    Attributes:
        places: east and north of each corner.
        border: its sides, each as one number, the least first.
        triangles: how many fill the area.
    """

    def __init__(self, part: Polygon) -> None:
        rings = shapely.get_rings(part)
        places, ring = shapely.get_coordinates(rings, return_index=True)
        on = np.append(ring[1:] == ring[:-1], False)  # not the last one, which is the first again
        self._sorted, corner = np.unique(_complex(places), return_inverse=True)
        self.places = np.stack([self._sorted.real, self._sorted.imag], axis=1)
        self.triangles = len(self._sorted) + 2 * len(rings) - 4
        self.border = np.sort(self._numbers(corner[on], np.roll(corner, -1)[on]))
        self._ring, self._along = (np.zeros(len(self._sorted), dtype=np.intp) for _ in range(2))
        self._ring[corner[on]], self._along[corner[on]] = ring[on], np.flatnonzero(on)
        # Of each ring whether the area is on the left hand of who goes along it.
        self._left = shapely.is_ccw(rings) == (np.arange(len(rings)) == 0)

    def of(self, pieces: Shapes) -> Integers:
        """The corners of triangles."""
        ends = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
        found: Integers = np.searchsorted(self._sorted, _complex(ends))
        return found.reshape(-1, 3)

    def sides(self, triangles: Integers) -> Integers:
        """The three sides of each triangle: both corners as one number."""
        return self._numbers(triangles, np.roll(triangles, -1, axis=1))

    def border_without(self, sides: Integers) -> Integers:
        """The sides of the border that are none of these."""
        at = np.minimum(np.searchsorted(self.border, sides), len(self.border) - 1)
        return np.delete(self.border, at[self.border[at] == sides])

    def lines(self, sides: Integers) -> Shapes:
        """Sides as lines."""
        ends = self.places[np.stack(np.divmod(sides, len(self.places)), axis=1)]
        lines: Shapes = shapely.linestrings(ends)
        return lines

    def inside(self, triangles: Integers) -> npt.NDArray[np.bool_]:
        """Which triangles lie in the area; none of them lies across a side of it.

        One between two rings always does. Along a ring, those on its one hand are passed in its
        own sense, and those on the other against it.
        """
        ring = self._ring[triangles]
        passed = np.argsort(self._along[triangles], axis=1)
        places = self.places[np.take_along_axis(triangles, passed, axis=1)]
        (b_east, b_north), (c_east, c_north) = (places[:, 1:] - places[:, :1]).transpose(1, 2, 0)
        turns_left = b_east * c_north - b_north * c_east > 0
        one_ring = (ring == ring[:, :1]).all(axis=1)
        return np.asarray(~one_ring | (turns_left == self._left[ring[:, 0]]))

    def _numbers(self, one: Integers, other: Integers) -> Integers:
        return np.minimum(one, other) * len(self.places) + np.maximum(one, other)


def _complex(places: npt.NDArray[np.float64]) -> npt.NDArray[np.complex128]:
    return np.ascontiguousarray(places).view(np.complex128).ravel()
