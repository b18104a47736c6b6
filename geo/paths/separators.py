"""Which zones keep two places of an airspace apart."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from shapely import LinearRing, Polygon
from shapely import Point as ShapelyPoint

from geo.airspace import FENCE, Airspace
from geo.frame import Point
from geo.paths.free_space import FreeSpace
from geo.paths.shortest import shortest_paths

_Suspects = tuple[int, ...]
"""Numbers of zones that may be in the way; -1 stands for the fences."""

_FENCES = -1


def barriers(airspace: Airspace, a: Point, b: Point) -> tuple[str, ...]:
    """Names of zones (and the fence) that together leave no way between two clear places.

    None of the names could be left out. Empty when the places are connected, or not clear.
    """
    paths = shortest_paths(airspace)
    one, other = paths.part_of(a), paths.part_of(b)
    if one is None or other is None or one == other:
        return ()
    space = paths.space
    walls = [_wall(space, space.lean[one], b), _wall(space, space.lean[other], a)]
    suspects = min((wall for wall in walls if wall), key=len, default=())
    needed = _needed(suspects, lambda some: _apart(space, some, a, b))
    return tuple(FENCE if index == _FENCES else airspace.zones[index].name for index in needed)


def _wall(space: FreeSpace, part: Polygon, beyond: Point) -> _Suspects:
    """What bounds a part of the clear area on the side of a place outside of it."""
    ring = _facing(part, beyond)
    fences = [_FENCES] if space.fence_touches(ring) else []
    return (*fences, *space.touching(ring).tolist())


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
