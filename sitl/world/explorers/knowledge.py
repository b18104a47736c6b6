"""What a ground robot knows: of the ground, by its eyes and by maps, and of goals.

A place within `SAME_GOAL_M` of another is the same goal. When two robots without contact claim the
same goal, the first by name keeps it as soon as they are in contact. No robot claims a goal that
any robot has visited.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from geo.frame import Geodetic, Point
from geo.grid import Cells, GridPatch, SemanticGrid, Terrain
from sitl.world.towns import GRAIN_M, SAME_GOAL_M, Cell, Lattice, coarse

Status = Literal["in_progress", "visited"]


class GoalClaim(NamedTuple):
    """A goal that a robot is on its way to, or has visited."""

    place: Point
    status: Status


@dataclass(slots=True)
class GoalBook:
    """A robot's goals.

    Attributes:
        name: Whose book it is.
        goals: Places of goals, as first received; no two are the same goal.
        claims: The robot's own claims, visited ones first; the one in progress is the last.
        failed: Goals that it has given up for now.
        version: Grows whenever the result of `free` may change.
    """

    name: str
    goals: list[Point] = field(default_factory=list)
    claims: list[GoalClaim] = field(default_factory=list)
    failed: list[Point] = field(default_factory=list)
    version: int = 0
    _others: dict[str, tuple[float, tuple[GoalClaim, ...]]] = field(default_factory=dict)

    @property
    def current(self) -> Point | None:
        """The goal that the robot is on its way to."""
        if self.claims and self.claims[-1].status == "in_progress":
            return self.claims[-1].place
        return None

    def learn(self, places: Iterable[Point]) -> None:
        """There are goals at these places."""
        for place in places:
            if not self._same(place, self.goals):
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
        self.claims.append(GoalClaim(goal, "in_progress"))
        self.version += 1

    def visit(self) -> None:
        """The current goal has been reached."""
        self.claims[-1] = GoalClaim(self.claims[-1].place, "visited")
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

    def on_claims(self, robot: str, stamp_s: float, claims: Sequence[GoalClaim]) -> bool:
        """Another robot's claims; whether the current goal is therefore not ours any more.

        Claims that are not newer than the robot's last ones change nothing.
        """
        known_s, _ = self._others.get(robot, (-math.inf, ()))
        if stamp_s <= known_s:
            return False
        self._others[robot] = stamp_s, tuple(claims)
        self.version += 1
        self.learn(claim.place for claim in claims)
        current = self.current
        return current is not None and any(
            self._same(current, (claim.place,)) and (claim.status == "visited" or robot < self.name)
            for claim in claims
        )

    def _same(self, place: Point, others: Iterable[Point]) -> bool:
        return any(math.dist(place, other) <= SAME_GOAL_M for other in others)


LEAST_VEHICLE_M2: Final = 4.0
"""Less of a vehicle than this is not taken for one: the rest may not have been in the picture."""

BLOB_M: Final = 6.0
"""Cells of vehicles within this distance of the first one belong to one vehicle."""


class MapReading(NamedTuple):
    """A map as a robot uses it.

    Attributes:
        cells: Coarse cells of the robot's lattice, flat; unknown where the map shows nothing.
        vehicles: The middles of the vehicles in it.
    """

    cells: Cells
    vehicles: tuple[Point, ...]


@lru_cache(maxsize=16)  # all robots of a process get the same map, and read it once
def read_map(data: bytes, lattice: Lattice) -> MapReading:
    """Read a map of a robot's frame.

    Args:
        data: What `SemanticGrid.encode` wrote.
        lattice: The cells that the robot thinks in.

    Raises:
        GridError: the bytes are no map, or its cells lie between those of the lattice.
    """
    grid = SemanticGrid.decode(data)
    corner = Point(lattice.west_m, lattice.south_m)
    far = Point(
        lattice.west_m + lattice.columns * GRAIN_M, lattice.south_m + lattice.rows * GRAIN_M
    )
    whole = SemanticGrid.blank(grid.origin, grid.resolution_m, corner, far)
    whole.paint(GridPatch(grid.west_m, grid.south_m, grid.resolution_m, grid.cells))
    cells = coarse(whole.cells, round(GRAIN_M / grid.resolution_m)).ravel()
    cells.setflags(write=False)
    return MapReading(cells, _vehicles(grid))


def _vehicles(grid: SemanticGrid) -> tuple[Point, ...]:
    found = np.flatnonzero(grid.cells.ravel() == Terrain.VEHICLE)
    places = np.stack(np.divmod(found, grid.cells.shape[1]), axis=-1) * grid.resolution_m
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
    """The coarse cells as a robot believes them to be; at first it knows nothing.

    Its own eyes are right: what they see overrides a map.

    Args:
        lattice: Which cell is where.
        truth: What eyes would see of each cell, flat.
        sight_m: They see cells whose middles lie within this distance of that of their own.

    Attributes:
        lattice: Which cell is where.
        cells: The belief, flat.
        version: Grows with every change.
        newly_seen: How many cells its eyes saw that no map had shown.
    """

    def __init__(self, lattice: Lattice, truth: Cells, sight_m: float) -> None:
        self.lattice = lattice
        self.cells = np.zeros(lattice.rows * lattice.columns, dtype=np.uint8)
        self.version = 0
        self.newly_seen = 0
        self._truth = truth
        self._seen = np.zeros(lattice.rows * lattice.columns, dtype=np.bool_)
        reach = math.floor(sight_m / GRAIN_M)
        steps = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
        self._in_sight = steps[:, np.hypot(*steps) * GRAIN_M <= sight_m]  # rows, columns from it

    def see(self, cell: Cell) -> bool:
        """Observe the cells around one; whether that contradicts what was believed before."""
        around = self._around(cell)
        fresh = around[~self._seen[around]]
        if not fresh.size:
            return False
        self._seen[fresh] = True
        before, now = self.cells[fresh], self._truth[fresh]
        changed, unknown = before != now, before == _UNKNOWN
        if changed.any():
            self.cells[fresh] = now
            self.version += 1
            self.newly_seen += int(np.count_nonzero(unknown))
        return bool((changed & ~unknown).any())

    def learn(self, cells: Cells) -> None:
        """Take over what a map shows of cells that are unknown so far."""
        fresh = (self.cells == _UNKNOWN) & (cells != _UNKNOWN)
        if fresh.any():
            self.cells[fresh] = cells[fresh]
            self.version += 1

    def observed_map(self, origin: Geodetic) -> SemanticGrid:
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
        lattice = self.lattice
        rows, columns = self._in_sight + np.array([divmod(cell, lattice.columns)]).T
        inside = (rows >= 0) & (rows < lattice.rows) & (columns >= 0) & (columns < lattice.columns)
        around: npt.NDArray[np.intp] = (rows * lattice.columns + columns)[inside]
        return around
