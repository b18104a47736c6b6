"""A town: what stands where on the ground, which vehicles are to be found, where robots start.

Positions are metres east and north of the frame's origin. A town comes from a file
(`missions/urban/town.yaml`, read by `town_file`) or from a seed (`town_generator`). It has
nothing of how anything moves. Ground robots think in coarse cells, each as bad as the worst in it:
one that a building reaches into is a building.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Final, NamedTuple

import numpy as np
import shapely

from geo.frame import LocalFrame, Point
from geo.grid import Cells, Terrain
from sitl.world.towns.terrain import LandCover, Raster, Road, layers

Ring = tuple[Point, ...]

RESOLUTION_M = 0.5
"""Edge of a cell of the town's raster, and of the UAV's map: 2 px/m as in the paper."""

REACHED_M: Final = 5.0
"""A robot within this distance has reached a goal."""

SAME_GOAL_M: Final = 17.85
"""Robots take two sightings within this distance for one goal."""


GRAIN_M: Final = 2.0
"""Edge of a coarse cell; a town's bounds are multiples of it."""

Cell = int
"""A coarse cell: row * columns + column, row 0 in the south."""

_BEST_FIRST: Final = (
    Terrain.ROAD,
    Terrain.GRAVEL,
    Terrain.GRASS,
    Terrain.HUMAN,
    Terrain.VEHICLE,
    Terrain.VEGETATION,
    Terrain.UNKNOWN,
    Terrain.BUILDING,
)
_RANKS: Final = np.array([_BEST_FIRST.index(terrain) for terrain in Terrain], dtype=np.uint8)
_OF_RANK: Final = np.array(_BEST_FIRST, dtype=np.uint8)


class Bounds(NamedTuple):
    """A rectangle in metres of the frame; its edges are multiples of `GRAIN_M`."""

    west_m: float
    south_m: float
    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True)
class Lattice:
    """Which coarse cell is where."""

    west_m: float
    south_m: float
    rows: int
    columns: int

    @classmethod
    def over(cls, bounds: Bounds) -> Lattice:
        """The coarse cells of a rectangle."""
        rows = round((bounds.north_m - bounds.south_m) / GRAIN_M)
        columns = round((bounds.east_m - bounds.west_m) / GRAIN_M)
        return cls(bounds.west_m, bounds.south_m, rows, columns)

    def cell(self, place: Point) -> Cell:
        """The cell of a place; of one outside the nearest."""
        row = math.floor((place[1] - self.south_m) / GRAIN_M)
        column = math.floor((place[0] - self.west_m) / GRAIN_M)
        row = min(max(row, 0), self.rows - 1)
        return row * self.columns + min(max(column, 0), self.columns - 1)

    def centre(self, cell: Cell) -> Point:
        """The middle of a cell."""
        row, column = divmod(cell, self.columns)
        return Point(self.west_m + (column + 0.5) * GRAIN_M, self.south_m + (row + 0.5) * GRAIN_M)

    def near(self, place: Point, distance_m: float) -> list[Cell]:
        """The cells whose middles lie within a distance, from the south-west on."""
        reach = math.ceil(distance_m / GRAIN_M)
        middle_row = math.floor((place[1] - self.south_m) / GRAIN_M)
        middle_column = math.floor((place[0] - self.west_m) / GRAIN_M)
        return [
            cell
            for row in range(max(0, middle_row - reach), min(self.rows, middle_row + reach + 1))
            for column in range(
                max(0, middle_column - reach), min(self.columns, middle_column + reach + 1)
            )
            if math.dist(place, self.centre(cell := row * self.columns + column)) <= distance_m
        ]


def coarse(cells: Cells, factor: int) -> Cells:
    """Cells `factor` times as long; each has the worst class of those in it.

    Unknown is worse than anything but a building. Remaining cells in the north and east are cut.
    """
    if factor == 1:
        return cells
    rows, columns = (size // factor for size in cells.shape)
    ranks = _RANKS[cells[: rows * factor, : columns * factor]]
    lines = reduce(np.maximum, (ranks[shift::factor] for shift in range(factor)))
    worst = reduce(np.maximum, (lines[:, shift::factor] for shift in range(factor)))
    result: Cells = _OF_RANK[worst]
    return result


class Goal(NamedTuple):
    """A vehicle that the robots are to find; `id` is unique in its town."""

    id: str
    position: Point


@dataclass(frozen=True, eq=False)
class Town:
    """A town. Compare and hash it by identity.

    Attributes:
        name: What people call it.
        frame: The local frame of all positions.
        bounds: The rectangle that the raster covers.
        outline: The border of the town; the ground beyond it is gravel.
        roads: Middle lines and widths; where robots drive best.
        vegetation: Crowns of trees; robots may drive below them.
        buildings: Robots cannot enter them, and see no vehicle behind them.
        yards: Gravel within the blocks. What nothing covers is grass or pavement.
        goals: The vehicles, in the order of the file.
        starts: Where ground robots may start, the first robot at the first; none is in a building.
        home: Where the UAV takes off and where the base station stands.
    """

    name: str
    frame: LocalFrame
    bounds: Bounds
    outline: Ring
    roads: tuple[Road, ...]
    vegetation: tuple[Ring, ...]
    buildings: tuple[Ring, ...]
    yards: tuple[Ring, ...]
    goals: tuple[Goal, ...]
    starts: tuple[Point, ...]
    home: Point

    @property
    def area_m2(self) -> float:
        """What the outline encloses."""
        return float(shapely.Polygon(self.outline).area)

    @cached_property
    def raster(self) -> Raster:
        """The view from above, in cells of `RESOLUTION_M`; drawn once, not to be changed."""
        west_m, south_m, east_m, north_m = self.bounds
        rows, columns = (
            round((north_m - south_m) / RESOLUTION_M),
            round((east_m - west_m) / RESOLUTION_M),
        )
        cells = np.full((rows, columns), Terrain.GRAVEL, dtype=np.uint8)
        raster = Raster(west_m, south_m, RESOLUTION_M, cells)
        raster.fill([(Terrain.GRASS, shapely.Polygon(self.outline)), *layers(self.land_cover)])
        cells.setflags(write=False)
        return raster

    @property
    def land_cover(self) -> LandCover:
        """What stands in it."""
        vehicles = tuple(goal.position for goal in self.goals)
        return LandCover(self.vegetation, self.roads, self.buildings, self.yards, vehicles)

    @cached_property
    def lattice(self) -> Lattice:
        """The coarse cells that ground robots think in."""
        return Lattice.over(self.bounds)

    def vehicles_seen_from(self, cell: Cell, distance_m: float) -> tuple[Goal, ...]:
        """The vehicles that one recognises from the middle of a coarse cell, in the goals' order.

        They lie within a distance, and no building is between.
        """
        key = cell, distance_m
        if key not in self._views:
            here = self.lattice.centre(cell)
            self._views[key] = tuple(
                goal
                for goal in self.goals
                if math.dist(here, goal.position) <= distance_m
                and not self._hidden(here, goal.position)
            )
        return self._views[key]

    @cached_property
    def _views(self) -> dict[tuple[Cell, float], tuple[Goal, ...]]:
        return {}

    def _hidden(self, here: Point, there: Point) -> bool:
        steps = max(1, math.ceil(math.dist(here, there) / RESOLUTION_M))
        parts = np.arange(steps + 1) / steps
        east = here[0] + parts * (there[0] - here[0])
        north = here[1] + parts * (there[1] - here[1])
        return bool((self.raster.classes_at(east, north) == Terrain.BUILDING).any())

    @cached_property
    def ground(self) -> Cells:
        """The truth about the coarse cells, flat; not to be changed."""
        cells = coarse(self.raster.cells, round(GRAIN_M / RESOLUTION_M)).ravel()
        cells.setflags(write=False)
        return cells
