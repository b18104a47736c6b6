"""The coarse cells that ground robots think in, laid over a town.

A coarse cell is as bad as the worst in it: one that a building reaches into is a building.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import Final, NamedTuple

import numpy as np

from geo.frame import Point
from geo.grid import Cells, Terrain

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

    Unknown is worse than anything but a building. What is left over in the north and east is cut.
    """
    if factor == 1:
        return cells
    rows, columns = (size // factor for size in cells.shape)
    ranks = _RANKS[cells[: rows * factor, : columns * factor]]
    lines = reduce(np.maximum, (ranks[shift::factor] for shift in range(factor)))
    worst = reduce(np.maximum, (lines[:, shift::factor] for shift in range(factor)))
    result: Cells = _OF_RANK[worst]
    return result
