"""What a ground robot knows: of the ground, by its eyes and by maps, and of goals.

A place within `same_goal_m` of another is the same goal. Of two robots that claim one goal without
having heard each other, the first by name keeps it as soon as they hear; a goal that any robot has
visited is no longer claimed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from geo.frame import Geodetic, Point
from geo.grid import Cells, GridError, SemanticGrid, Terrain
from sitl.world.towns.town import GRAIN_M, Cell, Lattice, coarse

MOST_GOALS = 1_000
"""More are not remembered."""


class Status(Enum):
    """What becomes of a claimed goal."""

    IN_PROGRESS = "in_progress"
    VISITED = "visited"


@dataclass(frozen=True, slots=True)
class Claim:
    """A goal that a robot is on its way to, or has visited."""

    place: Point
    status: Status


@dataclass(slots=True)
class GoalBook:
    """A robot's goals.

    Attributes:
        name: Whose book it is.
        same_goal_m: Places within this distance are one goal.
        goals: Places of goals, as first heard of; no two are the same goal.
        claims: The robot's own claims, visited ones first; the one in progress is the last.
        failed: Goals that it has given up for now.
        version: Grows whenever the answer of `free` may be another.
    """

    name: str
    same_goal_m: float
    goals: list[Point] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    failed: list[Point] = field(default_factory=list)
    version: int = 0
    _others: dict[str, tuple[float, tuple[Claim, ...]]] = field(default_factory=dict)

    @property
    def current(self) -> Point | None:
        """The goal that the robot is on its way to."""
        if self.claims and self.claims[-1].status is Status.IN_PROGRESS:
            return self.claims[-1].place
        return None

    def learn(self, places: Iterable[Point]) -> None:
        """There are goals at these places."""
        for place in places:
            if len(self.goals) < MOST_GOALS and not self._same(place, self.goals):
                self.goals.append(place)
                self.version += 1

    def free(self, here: Point) -> list[Point]:
        """Goals that no robot has claimed or visited and that were not given up; nearest first."""
        taken = [claim.place for claim in self.claims]
        taken += [claim.place for _, claims in self._others.values() for claim in claims]
        taken += self.failed
        free = [goal for goal in self.goals if not self._same(goal, taken)]
        return sorted(free, key=lambda goal: math.dist(here, goal))

    def claim(self, goal: Point) -> None:
        """Be on the way to a goal."""
        self.claims.append(Claim(goal, Status.IN_PROGRESS))
        self.version += 1

    def visit(self) -> None:
        """The current goal has been reached."""
        self.claims[-1] = Claim(self.claims[-1].place, Status.VISITED)
        self.version += 1

    def give_up(self, *, failed: bool) -> None:
        """Leave the current goal to others; with `failed` it is not tried again for now."""
        place = self.claims.pop().place
        if failed:
            self.failed.append(place)
        self.version += 1

    def forgive(self) -> None:
        """Goals that failed may be tried again."""
        if self.failed:
            self.failed.clear()
            self.version += 1

    def hear(self, robot: str, stamp_s: float, claims: Sequence[Claim]) -> bool:
        """Another robot's claims; whether the current goal is therefore not ours any more.

        News that are not newer than what the robot has said before change nothing.
        """
        if robot == self.name:
            return False
        known = self._others.get(robot)
        if known is not None and stamp_s <= known[0]:
            return False
        self._others[robot] = stamp_s, tuple(claims)
        self.version += 1
        self.learn(claim.place for claim in claims)
        current = self.current
        return current is not None and any(
            self._same(current, (claim.place,))
            and (claim.status is Status.VISITED or robot < self.name)
            for claim in claims
        )

    def _same(self, place: Point, others: Iterable[Point]) -> bool:
        return any(math.dist(place, other) <= self.same_goal_m for other in others)


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
        self._rows = np.array([row for row, _ in steps])  # of cells in sight, from its own
        self._columns = np.array([column for _, column in steps])

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
        rows, columns = self._rows + row, self._columns + column
        inside = (
            (rows >= 0)
            & (rows < self.lattice.rows)
            & (columns >= 0)
            & (columns < self.lattice.columns)
        )
        cut: npt.NDArray[np.intp] = (rows * self.lattice.columns + columns)[inside]
        return cut
