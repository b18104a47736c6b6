"""What a ground robot knows of the ground: what it has seen, and what maps have shown it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from geo.frame import Geodetic
from geo.grid import Cells, SemanticGrid, Terrain
from sitl.experiment.model.lattice import GRAIN_M, Cell, Lattice

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
