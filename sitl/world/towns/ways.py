"""The cheapest ways over ground that a robot knows.

A way leads from the middle of a coarse cell to that of a neighbour, diagonally only where both
cells beside the step are free as well; so a robot that follows one is never in a building.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from geo.frame import Point
from geo.grid import Cells, Terrain
from mocha_link.errors import needs_extra
from sitl.world.towns.town import GRAIN_M, Cell, Lattice

Floats = npt.NDArray[np.float64]

COSTS: Final[Mapping[Terrain, float]] = {
    Terrain.ROAD: 1.0,
    Terrain.GRAVEL: 1.5,
    Terrain.GRASS: 2.0,
    Terrain.HUMAN: 3.0,
    Terrain.VEHICLE: 4.0,
    Terrain.VEGETATION: 6.0,
    Terrain.UNKNOWN: math.inf,
    Terrain.BUILDING: math.inf,
}
"""What a metre costs. The order is the paper's, the numbers are ours."""

_COSTS: Final = np.array([COSTS[terrain] for terrain in Terrain])
PASSABLE: Final = np.isfinite(_COSTS)
"""By class: whether robots drive there."""

_STEPS: Final = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
_FARTHEST: Final = 1e9
_NOWHERE: Final = -9999  # the library's value for cells that no way leads to


class Ways:
    """The cheapest ways from one cell to all that can be reached."""

    __slots__ = ("_before", "costs", "lattice", "start")

    def __init__(self, lattice: Lattice, ground: Cells, start: Cell) -> None:
        """Find them.

        Args:
            lattice: Which cell is where.
            ground: The known terrain of each cell, flat.
            start: Where the ways begin; no way leads out of a cell that no robot drives into.
        """
        self.lattice = lattice
        self.start = start
        costs, before = _cheapest(lattice, ground, start)
        self.costs: Floats = costs  # by cell; inf: none leads there
        self._before: npt.NDArray[np.int32] = before  # by cell: the one before it on the way

    def nearest(self, place: Point, within_m: float) -> Cell | None:
        """The cell within a distance of a place that is cheapest to reach; None: there is none."""
        cells = self.lattice.near(place, within_m)
        if not cells:
            return None
        cheapest = cells[int(np.argmin(self.costs[cells]))]
        return cheapest if math.isfinite(self.costs[cheapest]) else None

    def nearest_edge(self, ground: Cells) -> Cell | None:
        """The cheapest cell that has an unknown one beside it; None: there is none to reach."""
        shape = self.lattice.rows, self.lattice.columns
        unknown = np.zeros((shape[0] + 2, shape[1] + 2), dtype=np.bool_)
        unknown[1:-1, 1:-1] = (ground == Terrain.UNKNOWN).reshape(shape)
        beside = unknown[:-2, 1:-1] | unknown[2:, 1:-1] | unknown[1:-1, :-2] | unknown[1:-1, 2:]
        costs = np.where(beside.ravel(), self.costs, math.inf)
        cheapest = int(np.argmin(costs))
        return cheapest if math.isfinite(costs[cheapest]) else None

    def to(self, cell: Cell) -> list[Cell]:
        """The cells on the way, from the first step to `cell`; empty if that is the start."""
        way = []
        while cell != self.start:
            if cell == _NOWHERE:
                raise ValueError("no way leads to this cell; call `costs` or `nearest` before")
            way.append(cell)
            cell = int(self._before[cell])
        way.reverse()
        return way


def length_m(lattice: Lattice, start: Point, way: list[Cell]) -> float:
    """How long a way is that begins at a place."""
    places = [start, *map(lattice.centre, way)]
    return math.fsum(map(math.dist, places, places[1:]))


@lru_cache(maxsize=4)
def _neighbours(rows: int, columns: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Indices and index pointers of a matrix that has eight neighbours for every cell."""
    cells = np.arange(rows * columns, dtype=np.int32)
    steps = np.array([row * columns + column for row, column in _STEPS], dtype=np.int32)
    indices = np.clip(cells[:, None] + steps, 0, rows * columns - 1).ravel()
    return indices, np.arange(0, 8 * rows * columns + 1, 8, dtype=np.int32)


def _cheapest(lattice: Lattice, ground: Cells, start: Cell) -> tuple[Floats, npt.NDArray[np.int32]]:
    """What every cell costs from the start, and the cell before it on the way.

    Raises:
        MissingExtraError: only worlds with ways need SciPy, and it is not installed.
    """
    with needs_extra("a world with ways for its robots", "experiments", "air-router"):
        from scipy.sparse import csr_array  # noqa: PLC0415 - an extra
        from scipy.sparse.csgraph import dijkstra  # noqa: PLC0415 - an extra
    graph = csr_array(_steps(lattice, ground), shape=(lattice.rows * lattice.columns,) * 2)
    found: tuple[Floats, npt.NDArray[np.int32]] = dijkstra(
        graph, indices=start, return_predecessors=True, limit=_FARTHEST
    )
    return found


def _steps(
    lattice: Lattice, ground: Cells
) -> tuple[Floats, npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """What the steps between neighbours cost; inf where there is none: a sparse matrix' parts."""
    rows, columns = lattice.rows, lattice.columns
    costs = np.full((rows + 2, columns + 2), math.inf)
    costs[1:-1, 1:-1] = (_COSTS * (GRAIN_M / 2))[ground].reshape(rows, columns)
    middle = costs[1:-1, 1:-1]
    closed = np.where(np.isinf(costs), math.inf, 0.0)
    steps = np.empty((rows, columns, 8))
    for index, (row, column) in enumerate(_STEPS):
        other = costs[1 + row : rows + 1 + row, 1 + column : columns + 1 + column]
        if row and column:
            beside = (
                closed[1 + row : rows + 1 + row, 1:-1]
                + closed[1:-1, 1 + column : columns + 1 + column]
            )
            steps[..., index] = (middle + other) * math.sqrt(2) + beside
        else:
            steps[..., index] = middle + other
    indices, pointers = _neighbours(rows, columns)
    return steps.ravel(), indices, pointers
