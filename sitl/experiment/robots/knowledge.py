"""What a ground robot knows of the ground: what it has seen, and what maps have shown it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from geo.frame import Geodetic, Point
from geo.grid import Cells, GridError, SemanticGrid, Terrain
from sitl.experiment.lattice import GRAIN_M, Cell, Lattice, coarse

LEAST_VEHICLE_M2: Final = 4.0
"""Less of a vehicle than this is not taken for one: the rest may not have been in the picture."""

BLOB_M: Final = 6.0
"""Cells of vehicles within this distance of the first one belong to one vehicle."""

MOST_CELLS: Final = 20_000
"""A map that shows more cells of vehicles is refused: 300 vehicles at half a metre."""


@dataclass(frozen=True, slots=True, eq=False)
class MapReading:
    """A map as a robot uses it.

    Attributes:
        cells: Coarse cells of the robot's lattice, flat; unknown where the map shows nothing.
        vehicles: The middles of the vehicles in it.
    """

    cells: Cells = field(repr=False)
    vehicles: tuple[Point, ...]


@lru_cache(maxsize=16)  # all robots of a process get the same map, and read it once
def read_map(data: bytes, lattice: Lattice, origin: Geodetic) -> MapReading:
    """Read a map.

    Args:
        data: What `SemanticGrid.encode` wrote.
        lattice: The cells that the robot thinks in.
        origin: Of the robot's frame.

    Raises:
        GridError: the bytes are no map, it has another origin, its cells do not fit into the coarse
            ones, or it shows too many vehicles.
    """
    grid = SemanticGrid.decode(data)
    if grid.origin != origin:
        raise GridError(f"a map of another frame: origin {grid.origin}, expected {origin}")
    factor = round(GRAIN_M / grid.resolution_m)
    if factor < 1 or abs(factor * grid.resolution_m - GRAIN_M) > 1e-9:
        raise GridError(f"cells of {grid.resolution_m} m do not fit into cells of {GRAIN_M} m")
    row = (grid.south_m - lattice.south_m) / grid.resolution_m
    column = (grid.west_m - lattice.west_m) / grid.resolution_m
    if row != round(row) or column != round(column):
        raise GridError("the cells do not align with the lattice")
    fitted = _fitted(grid.cells, round(row), round(column), lattice, factor)
    cells = coarse(fitted, factor).ravel()
    cells.setflags(write=False)
    return MapReading(cells, _vehicles(grid))


def _fitted(cells: Cells, row: int, column: int, lattice: Lattice, factor: int) -> Cells:
    """The part of a map that lies on the lattice; unknown where it shows nothing of that."""
    rows, columns = lattice.rows * factor, lattice.columns * factor
    if (row, column) == (0, 0) and cells.shape == (rows, columns):
        return cells
    fitted = np.zeros((rows, columns), dtype=np.uint8)
    top, right = min(rows, row + cells.shape[0]), min(columns, column + cells.shape[1])
    bottom, left = max(row, 0), max(column, 0)
    if bottom < top and left < right:
        fitted[bottom:top, left:right] = cells[
            bottom - row : top - row, left - column : right - column
        ]
    return fitted


def _vehicles(grid: SemanticGrid) -> tuple[Point, ...]:
    found = np.flatnonzero(grid.cells.ravel() == Terrain.VEHICLE)
    places = np.stack(np.divmod(found, grid.cells.shape[1]), axis=-1) * grid.resolution_m
    if len(places) > MOST_CELLS:
        raise GridError(f"{len(places)} cells of vehicles in a map; allowed are {MOST_CELLS}")
    least = LEAST_VEHICLE_M2 / grid.resolution_m**2
    corner = np.array([grid.south_m, grid.west_m]) + grid.resolution_m / 2
    vehicles: list[Point] = []
    while len(places):
        near = np.hypot(*(places - places[0]).T) <= BLOB_M
        if np.count_nonzero(near) >= least:
            north_m, east_m = (places[near].mean(axis=0) + corner).tolist()
            vehicles.append(Point(east_m, north_m))
        places = places[~near]
    return tuple(vehicles)


_UNKNOWN = np.uint8(Terrain.UNKNOWN)


class Knowledge:
    """The coarse cells as a robot believes them to be.

    Its own eyes are right: what they see overrides what a map has said.

    Attributes:
        lattice: Which cell is where.
        cells: The belief, flat.
        version: Grows with every change.
        first_seen: How many cells its eyes saw that no map had shown.
    """

    def __init__(self, lattice: Lattice, truth: Cells, sight_m: float) -> None:
        """Know nothing.

        Args:
            lattice: Which cell is where.
            truth: What eyes would see of each cell, flat.
            sight_m: They see cells whose middles lie within this distance of that of their own.
        """
        self.lattice = lattice
        self.cells = np.zeros(lattice.rows * lattice.columns, dtype=np.uint8)
        self.version = 0
        self.first_seen = 0
        self._truth = truth
        self._seen = np.zeros(lattice.rows * lattice.columns, dtype=np.bool_)
        reach = math.floor(sight_m / GRAIN_M)
        steps = [
            (row, column)
            for row in range(-reach, reach + 1)
            for column in range(-reach, reach + 1)
            if math.hypot(row, column) * GRAIN_M <= sight_m
        ]
        self._reach = reach
        self._rows = np.array([row for row, _ in steps])
        self._columns = np.array([column for _, column in steps])
        self._flat = self._rows * lattice.columns + self._columns

    def see(self, cell: Cell) -> bool:
        """Look around in a cell; whether that contradicts what was believed before."""
        around = self._around(cell)
        fresh = around[~self._seen[around]]
        if not fresh.size:
            return False
        self._seen[fresh] = True
        before, now = self.cells[fresh], self._truth[fresh]
        changed = before != now
        if not changed.any():
            return False
        unknown = before == _UNKNOWN
        self.cells[fresh] = now
        self.version += 1
        self.first_seen += int(np.count_nonzero(unknown))
        return bool((changed & ~unknown).any())

    def learn(self, cells: Cells) -> bool:
        """Take over what a map shows of cells that are unknown so far; whether it showed any."""
        fresh = (self.cells == _UNKNOWN) & (cells != _UNKNOWN)
        if not fresh.any():
            return False
        self.cells[fresh] = cells[fresh]
        self.version += 1
        return True

    def seen_map(self, origin: Geodetic) -> SemanticGrid:
        """What its own eyes have seen, as a map that just covers it."""
        shape = (self.lattice.rows, self.lattice.columns)
        cells = np.where(self._seen, self.cells, _UNKNOWN).reshape(shape)
        rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
        if not rows.size:
            rows = columns = np.zeros(1, dtype=np.intp)
        cut = cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        west_m = self.lattice.west_m + int(columns[0]) * GRAIN_M
        south_m = self.lattice.south_m + int(rows[0]) * GRAIN_M
        return SemanticGrid(origin, GRAIN_M, west_m, south_m, np.ascontiguousarray(cut))

    def _around(self, cell: Cell) -> npt.NDArray[np.intp]:
        row, column = divmod(cell, self.lattice.columns)
        reach = self._reach
        if (
            reach <= row < self.lattice.rows - reach
            and reach <= column < self.lattice.columns - reach
        ):
            around: npt.NDArray[np.intp] = self._flat + cell
            return around
        rows, columns = self._rows + row, self._columns + column
        inside = (
            (rows >= 0)
            & (rows < self.lattice.rows)
            & (columns >= 0)
            & (columns < self.lattice.columns)
        )
        cut: npt.NDArray[np.intp] = (rows * self.lattice.columns + columns)[inside]
        return cut
