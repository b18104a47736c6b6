"""A town: what stands where on the ground, which vehicles are to be found, where robots start.

Positions are metres east and north of the frame's origin. A town comes from a file
(`missions/urban/town.yaml`, read by `town_file`) or from a seed (`town_generator`). It says nothing
of how anything moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from geo.frame import LocalFrame, Point
from geo.grid import Cells, Terrain
from sitl.world.terrain import VEHICLE_RADIUS_M, Raster, Road
from sitl.world.towns.lattice import GRAIN_M, Bounds, Cell, Lattice, coarse

Ring = tuple[Point, ...]

RESOLUTION_M = 0.5
"""Edge of a cell of the town's raster, and of the UAV's map: 2 px/m as in the paper."""

REACHED_M: Final = 5.0
"""A robot within this distance has reached a goal."""

SAME_GOAL_M: Final = 17.85
"""Robots take two sightings within this distance for one goal."""


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
        """What is seen from above, in cells of `RESOLUTION_M`; drawn once, not to be changed."""
        west_m, south_m, east_m, north_m = self.bounds
        rows, columns = (
            round((north_m - south_m) / RESOLUTION_M),
            round((east_m - west_m) / RESOLUTION_M),
        )
        cells = np.full((rows, columns), Terrain.GRAVEL, dtype=np.uint8)
        raster = Raster(west_m, south_m, RESOLUTION_M, cells)
        raster.fill(self._layers())
        cells.setflags(write=False)
        return raster

    def _layers(self) -> Iterator[tuple[Terrain, BaseGeometry]]:
        yield Terrain.GRASS, shapely.Polygon(self.outline)
        for ring in self.vegetation:
            yield Terrain.VEGETATION, shapely.Polygon(ring)
        for road in self.roads:
            yield Terrain.ROAD, shapely.LineString(road.points).buffer(road.width_m / 2)
        for ring in self.buildings:
            yield Terrain.BUILDING, shapely.Polygon(ring)
        for ring in self.yards:
            yield Terrain.GRAVEL, shapely.Polygon(ring)
        for goal in self.goals:
            yield Terrain.VEHICLE, shapely.Point(goal.position).buffer(VEHICLE_RADIUS_M)

    @cached_property
    def lattice(self) -> Lattice:
        """The coarse cells that ground robots think in."""
        return Lattice.over(self.bounds)

    def vehicles_seen_from(self, cell: Cell, distance_m: float) -> tuple[Goal, ...]:
        """The vehicles that one recognises from the middle of a coarse cell, in the goals' order.

        They lie within a distance, and no building is between.
        """
        key = cell, distance_m
        seen = self._views.get(key)
        if seen is None:
            here = self.lattice.centre(cell)
            seen = self._views[key] = tuple(
                goal
                for goal in self.goals
                if math.dist(here, goal.position) <= distance_m
                and not self._hidden(here, goal.position)
            )
        return seen

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
