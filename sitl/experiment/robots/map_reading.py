"""What a ground robot reads from a map that gossip brought: coarse cells, and vehicles."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import numpy as np

from geo.frame import Geodetic, Point
from geo.grid import Cells, GridError, SemanticGrid, Terrain
from sitl.experiment.model.lattice import GRAIN_M, Lattice, coarse

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
