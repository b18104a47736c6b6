"""Which places can be reached from one another at all, and which zones keep others apart."""

from __future__ import annotations

from collections.abc import Sequence

import shapely
from shapely import Point as ShapelyPoint
from shapely import Polygon, STRtree

from geo.airspace import FENCE, Airspace
from geo.frame import Point
from geo.zone import polygons_of

_MOST_NAMES = 40
"""Up to so many zones we look for the ones that matter among those that surround a place."""


class Regions:
    """The connected parts of an airspace's clear area."""

    def __init__(self, airspace: Airspace) -> None:
        self._airspace = airspace
        self._parts = polygons_of(airspace.free)
        self._tree = STRtree(self._parts)
        self._reach_m = _reach_m(airspace)

    def __len__(self) -> int:
        return len(self._parts)

    def of(self, point: Point) -> int | None:
        """The number of the region that a place lies in; None if it is not clear."""
        place = ShapelyPoint(point)
        hits = self._tree.query_nearest(place, max_distance=self._reach_m, all_matches=False)
        return int(hits[0]) if len(hits) else None

    def connected(self, a: Point, b: Point) -> bool:
        """Whether a clear way from one place to the other exists."""
        region = self.of(a)
        return region is not None and region == self.of(b)

    def separators(self, a: Point, b: Point) -> tuple[str, ...]:
        """Names of zones (and the fence) that together leave no way between two clear places.

        None of the names could be left out. Empty when the places are connected, or not clear.
        """
        if self.of(a) is None or self.of(b) is None or self.connected(a, b):
            return ()
        names = [FENCE] if self._airspace.fences else []
        names += [zone.name for zone in self._airspace.zones]
        wall = _wall_between(a, b, self._airspace)
        if wall is not None:
            shapes = self._airspace.inflated(self._reach_m)
            zones = zip(self._airspace.zones, shapes, strict=True)
            near = {zone.name for zone, shape in zones if shape.intersects(wall)}
            names = [name for name in names if name in near or name == FENCE]
        if len(names) <= _MOST_NAMES:
            names = _needed(a, b, names, self._airspace)
        return tuple(names)


def _needed(a: Point, b: Point, names: Sequence[str], airspace: Airspace) -> list[str]:
    """The names without those that can be left out, one after the other."""
    every = {FENCE, *(zone.name for zone in airspace.zones)}
    needed = list(names)
    for name in names:
        fewer = [other for other in needed if other != name]
        if _wall_between(a, b, airspace.without(tuple(every - set(fewer)))) is not None:
            needed = fewer
    return needed


def _wall_between(a: Point, b: Point, airspace: Airspace) -> Polygon | None:
    """The connected obstacle that separates two places: no two obstacles do it only together."""
    free = airspace.free
    west, south, east, north = shapely.total_bounds(
        [free, ShapelyPoint(a), ShapelyPoint(b)]
    ).tolist()
    world = shapely.box(west - 10, south - 10, east + 10, north + 10)
    for wall in polygons_of(world.difference(free)):
        if _side(wall, a, _reach_m(airspace)) != _side(wall, b, _reach_m(airspace)):
            return wall
    return None


def _reach_m(airspace: Airspace) -> float:
    """How far a legal place may lie outside of the clear area, which is drawn a bit too small."""
    kept_m = max(airspace.fence_distance_m, *airspace.distances_m, 0.0)
    return 0.04 + 0.005 * kept_m


def _side(wall: Polygon, point: Point, reach_m: float) -> int:
    """Which hole of the wall a place lies in; -1 if it is around the wall or in the wall itself."""
    place = ShapelyPoint(point)
    for number, hole in enumerate(wall.interiors):
        if Polygon(hole).dwithin(place, reach_m):
            return number
    return -1
