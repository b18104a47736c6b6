"""Which places can be reached from one another at all, and which zones keep others apart."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from shapely import LinearRing, Polygon
from shapely import Point as ShapelyPoint

from geo.airspace.airspace import FENCE, Airspace
from geo.frame import Point
from geo.paths.free_space import FreeSpace
from geo.paths.shortest import shortest_paths

_Suspects = tuple[int, ...]
"""Numbers of zones that may be in the way; -1 stands for the fences."""

_FENCES = -1


class Regions:
    """The connected parts of an airspace's clear area."""

    def __init__(self, airspace: Airspace) -> None:
        self._airspace = airspace
        self._paths = shortest_paths(airspace)

    def __len__(self) -> int:
        return len(self._paths.space.lean)

    def of(self, point: Point) -> int | None:
        """The number of the region that a place lies in; None if it is not clear."""
        return self._paths.part_of(point)

    def connected(self, a: Point, b: Point) -> bool:
        """Whether a clear way from one place to the other exists."""
        return self._paths.connected(a, b)

    def separators(self, a: Point, b: Point) -> tuple[str, ...]:
        """Names of zones (and the fence) that together leave no way between two clear places.

        None of the names could be left out. Empty when the places are connected, or not clear.
        """
        one, other = self.of(a), self.of(b)
        if one is None or other is None or self.connected(a, b):
            return ()
        space = self._paths.space
        walls = [self._wall(space.lean[one], b), self._wall(space.lean[other], a)]
        suspects = min((wall for wall in walls if wall), key=len, default=())
        needed = _needed(suspects, lambda some: _apart(space, some, a, b))
        zones = self._airspace.zones
        return tuple(FENCE if index == _FENCES else zones[index].name for index in needed)

    def _wall(self, part: Polygon, beyond: Point) -> _Suspects:
        """What bounds a part of the clear area on the side of a place outside of it."""
        ring = _facing(part, beyond)
        zones = self._paths.space.touching(ring).tolist()
        fences = [_FENCES] if self._paths.space.fence_touches(ring) else []
        return (*fences, *zones)


def _facing(part: Polygon, beyond: Point) -> LinearRing:
    """The ring of a polygon's border that a place outside of it lies behind."""
    east_m, north_m = beyond
    west, south, east, north = shapely.bounds(shapely.get_rings(part)[1:]).reshape(-1, 4).T
    near = (west <= east_m) & (east_m <= east) & (south <= north_m) & (north_m <= north)
    for index in np.flatnonzero(near).tolist():
        hole = part.interiors[index]
        if Polygon(hole).intersects(ShapelyPoint(beyond)):
            return hole
    return part.exterior


def _needed(suspects: _Suspects, separate: Callable[[_Suspects], bool]) -> _Suspects:
    """Those without which the others do not separate: ever smaller groups are left out on trial."""
    if not separate(suspects):
        return suspects
    size = (len(suspects) + 1) // 2
    while size:
        first = 0
        while first < len(suspects):
            fewer = suspects[:first] + suspects[first + size :]
            if separate(fewer):
                suspects = fewer
            else:
                first += size
        size //= 2
    return suspects


def _apart(space: FreeSpace, suspects: _Suspects, a: Point, b: Point) -> bool:
    """Whether no way would lead from one place to the other if there were only the suspects."""
    zones = np.array([index for index in suspects if index != _FENCES], dtype=np.intp)
    parts = np.array(space.around(zones, fenced=_FENCES in suspects), dtype=object)
    homes = [shapely.distance(parts, ShapelyPoint(place)).argmin() for place in (a, b)]
    return bool(homes[0] != homes[1])
