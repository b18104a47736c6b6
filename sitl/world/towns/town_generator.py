"""Makes towns of any size from a seed: streets in an uneven grid, houses, trees, vehicles."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import networkx as nx
import numpy as np
import shapely

from geo.frame import Geodetic, LocalFrame, Point
from geo.grid import MAX_CELLS
from sitl.world.towns.terrain import Road
from sitl.world.towns.town import GRAIN_M, RESOLUTION_M, Bounds, Ring, Town
from sitl.world.towns.town_draws import half_metres, scatter

_ORIGIN: Final = Geodetic(38.5, -98.5)  # an open field
_SPACING_M: Final = (48.0, 80.0)
_WIDTHS_M: Final = (7.0, 9.0, 12.0)
_SWAY_M: Final = 4.0
_PAVEMENT_M: Final = 3.0
_WALL_M: Final = 7.0
_BORDER_M: Final = 4.0
_START_APART_M: Final = 4.0

Crossing = tuple[int, int]


def generate(
    seed: int, blocks_east: int, blocks_north: int, *, goals: int = 15, starts: int = 50
) -> Town:
    """A town of so many blocks of about 65 m; the same seed makes the same town.

    It is closed: houses stand all around it. Every goal and every start can be reached from every
    other by road.

    Args:
        seed: Makes all choices.
        blocks_east: How many blocks there are from west to east.
        blocks_north: How many from south to north.
        goals: How many vehicles stand beside its roads.
        starts: How many places there are where robots may start, around home in its middle.

    Raises:
        ValueError: no blocks, a town too large for a raster, or too small for so many goals.
    """
    if blocks_east < 1 or blocks_north < 1:
        raise ValueError(f"{blocks_east} x {blocks_north} blocks; a town has one each way at least")
    chance = random.Random(seed)  # noqa: S311 - a town, not a secret
    streets = _Streets.laid(chance, blocks_east, blocks_north)
    west_m, south_m, east_m, north_m = streets.border()
    margin_m = 2 * GRAIN_M
    bounds = Bounds(
        *(math.floor((side - margin_m) / GRAIN_M) * GRAIN_M for side in (west_m, south_m)),
        *(math.ceil((side + margin_m) / GRAIN_M) * GRAIN_M for side in (east_m, north_m)),
    )
    area_m2 = (bounds.east_m - bounds.west_m) * (bounds.north_m - bounds.south_m)
    if area_m2 / RESOLUTION_M**2 > MAX_CELLS:
        raise ValueError(f"{blocks_east} x {blocks_north} blocks are too large a town; take fewer")
    wall_m = _WALL_M
    buildings = [
        _box(west_m, south_m, east_m, south_m + wall_m),
        _box(west_m, north_m - wall_m, east_m, north_m),
        _box(west_m, south_m + wall_m, west_m + wall_m, north_m - wall_m),
        _box(east_m - wall_m, south_m + wall_m, east_m, north_m - wall_m),
    ]
    trees: list[Ring] = []
    for block in streets.blocks():
        _fill(chance, block, buildings, trees)
    home = streets.places[blocks_east // 2, blocks_north // 2]
    town = Town(
        name=f"Town {seed}, {blocks_east} x {blocks_north} blocks",
        frame=LocalFrame(_ORIGIN),
        bounds=bounds,
        outline=_box(west_m, south_m, east_m, north_m),
        roads=streets.roads(),
        vegetation=tuple(trees),
        buildings=tuple(buildings),
        yards=(),
        goals=(),
        starts=(home,),
        home=home,
    )
    return scatter(replace(town, starts=_starts(town, starts)), seed, goals)


@dataclass(frozen=True, slots=True)
class _Streets:
    """Streets between crossings; some of a full grid are missing."""

    places: dict[Crossing, Point]
    graph: nx.Graph[Crossing]
    widths_m: tuple[tuple[float, ...], tuple[float, ...]]
    """Of the streets that run north, from west to east, and of those that run east."""

    @classmethod
    def laid(cls, chance: random.Random, blocks_east: int, blocks_north: int) -> _Streets:
        columns, rows = _lines(chance, blocks_east), _lines(chance, blocks_north)
        places = {
            (i, j): Point(
                columns[i] + half_metres(chance.uniform(-_SWAY_M, _SWAY_M)),
                rows[j] + half_metres(chance.uniform(-_SWAY_M, _SWAY_M)),
            )
            for i, j in product(range(len(columns)), range(len(rows)))
        }
        graph: nx.Graph[Crossing] = nx.grid_2d_graph(len(columns), len(rows))
        for a, b in sorted(graph.edges):
            outer = any(
                a[axis] == b[axis] and a[axis] in {0, last}
                for axis, last in enumerate((blocks_east, blocks_north))
            )
            if outer or chance.random() > 0.15 or min(graph.degree[a], graph.degree[b]) < 3:
                continue
            graph.remove_edge(a, b)
            if not nx.has_path(graph, a, b):
                graph.add_edge(a, b)
        widths = (
            tuple(chance.choice(_WIDTHS_M) for _ in columns),
            tuple(chance.choice(_WIDTHS_M) for _ in rows),
        )
        return cls(places, graph, widths)

    def roads(self) -> tuple[Road, ...]:
        """Every street as far as it runs without a gap."""
        roads: list[Road] = []
        for axis in (0, 1):
            for line, width_m in enumerate(self.widths_m[axis]):
                run: list[Point] = []
                for k in range(len(self.widths_m[1 - axis])):
                    here = (line, k) if axis == 0 else (k, line)
                    after = (line, k + 1) if axis == 0 else (k + 1, line)
                    run.append(self.places[here])
                    if not self.graph.has_edge(here, after):
                        if len(run) > 1:
                            roads.append(Road(tuple(run), width_m))
                        run = []
        return tuple(roads)

    def border(self) -> tuple[float, float, float, float]:
        """Where the town ends: west, south, east, north."""
        room_m = max(_WIDTHS_M) / 2 + _BORDER_M + _WALL_M
        east = [place.east_m for place in self.places.values()]
        north = [place.north_m for place in self.places.values()]
        return (min(east) - room_m, min(north) - room_m, max(east) + room_m, max(north) + room_m)

    def blocks(self) -> Iterator[tuple[float, float, float, float]]:
        """The ground between four crossings without the streets and the pavement."""
        for i, j in product(range(len(self.widths_m[0]) - 1), range(len(self.widths_m[1]) - 1)):
            sw, se, nw, ne = (self.places[i + a, j + b] for b in (0, 1) for a in (0, 1))
            yield (
                max(sw.east_m, nw.east_m) + self.widths_m[0][i] / 2 + _PAVEMENT_M,
                max(sw.north_m, se.north_m) + self.widths_m[1][j] / 2 + _PAVEMENT_M,
                min(se.east_m, ne.east_m) - self.widths_m[0][i + 1] / 2 - _PAVEMENT_M,
                min(nw.north_m, ne.north_m) - self.widths_m[1][j + 1] / 2 - _PAVEMENT_M,
            )


def _lines(chance: random.Random, blocks: int) -> list[float]:
    """Where the streets of one direction run, around 0."""
    steps = [half_metres(chance.uniform(*_SPACING_M)) for _ in range(blocks)]
    return [sum(steps[:k]) - half_metres(sum(steps) / 2) for k in range(blocks + 1)]


def _fill(
    chance: random.Random,
    block: tuple[float, float, float, float],
    buildings: list[Ring],
    trees: list[Ring],
) -> None:
    """Houses with passages between them, or a park."""
    west_m, south_m, east_m, north_m = block
    if chance.random() < 0.12:
        for _ in range(chance.randint(1, 3)):
            middle = Point(chance.uniform(west_m, east_m), chance.uniform(south_m, north_m))
            trees.append(_crown(chance, middle))
        return
    columns = _cut(chance, west_m, east_m)
    rows = _cut(chance, south_m, north_m)
    for (left, right), (bottom, top) in product(columns, rows):
        if chance.random() < 0.12:
            trees.append(_crown(chance, Point((left + right) / 2, (bottom + top) / 2)))
        else:
            buildings.append(_box(left, bottom, right, top))


def _cut(chance: random.Random, low_m: float, high_m: float) -> list[tuple[float, float]]:
    """One span, or two with a passage between."""
    if high_m - low_m < 30 or chance.random() < 0.4:
        return [(low_m, high_m)]
    middle_m = half_metres(low_m + (high_m - low_m) * chance.uniform(0.35, 0.65))
    return [(low_m, middle_m - 3), (middle_m + 3, high_m)]


def _crown(chance: random.Random, middle: Point) -> Ring:
    radius_m = chance.uniform(4, 10)
    corners = []
    for k in range(8):
        reach_m = radius_m * chance.uniform(0.8, 1.2)
        angle = k * math.tau / 8
        corners.append(
            Point(
                half_metres(middle.east_m + reach_m * math.cos(angle)),
                half_metres(middle.north_m + reach_m * math.sin(angle)),
            )
        )
    return tuple(corners)


def _starts(town: Town, count: int) -> tuple[Point, ...]:
    """Places on roads around home, the nearest first."""
    roads = shapely.union_all(
        [shapely.LineString(r.points).buffer(r.width_m / 2 - 1) for r in town.roads]
    )
    reach = math.ceil(math.sqrt(count)) * 12
    steps = np.arange(-reach, reach + 1) * _START_APART_M
    east, north = (grid.ravel() for grid in np.meshgrid(steps, steps))
    east, north = east + town.home.east_m, north + town.home.north_m
    on_road = shapely.contains_xy(roads, east, north)
    places = [
        Point(e, n) for e, n in zip(east[on_road].tolist(), north[on_road].tolist(), strict=True)
    ]
    places.sort(key=lambda place: (math.dist(place, town.home), place))
    if len(places) < count:
        raise ValueError(f"only {len(places)} robots find a start in {town.name}, not {count}")
    return tuple(places[:count])


def _box(west_m: float, south_m: float, east_m: float, north_m: float) -> Ring:
    return (
        Point(west_m, south_m),
        Point(east_m, south_m),
        Point(east_m, north_m),
        Point(west_m, north_m),
    )
