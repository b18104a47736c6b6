"""What stands where in the simulated world: a raster of terrain classes, made once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from geo.frame import Point
from geo.grid import Cells, Terrain

VEHICLE_RADIUS_M = 2.2
"""A parked vehicle covers the cells whose centres lie within this distance."""

MAX_CELLS = 4_000_000


class TerrainError(ValueError):
    """The world cannot be drawn as a raster; the message says why and what to do."""


@dataclass(frozen=True, slots=True)
class Road:
    """A road: its middle line in metres east/north, and its width."""

    points: tuple[Point, ...]
    width_m: float


@dataclass(frozen=True, slots=True)
class Scene:
    """The things in a world, in metres of the local frame; what they leave over is grass.

    Where they overlap, the later in this order is seen: vegetation, roads, buildings, vehicles.
    """

    vegetation: tuple[tuple[Point, ...], ...] = ()
    roads: tuple[Road, ...] = ()
    buildings: tuple[tuple[Point, ...], ...] = ()
    vehicles: tuple[Point, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """Terrain classes of square cells; row = north, column = east, [0, 0] is the south-west one.

    Attributes:
        west_m: East coordinate of the western edge, a whole number of cells from 0.
        south_m: North coordinate of the southern edge, a whole number of cells from 0.
        resolution_m: Edge of a cell.
        cells: The classes (`geo.grid.Terrain`).
    """

    west_m: float
    south_m: float
    resolution_m: float
    cells: Cells = field(repr=False)

    @classmethod
    def draw(
        cls, scene: Scene, around: Sequence[Point], resolution_m: float, margin_m: float
    ) -> Raster:
        """Draw the scene over the rectangle around some points, widened by a margin.

        Raises:
            TerrainError: the raster would have more than `MAX_CELLS` cells.
        """
        west = math.floor((min(p.east_m for p in around) - margin_m) / resolution_m)
        south = math.floor((min(p.north_m for p in around) - margin_m) / resolution_m)
        east = math.ceil((max(p.east_m for p in around) + margin_m) / resolution_m)
        north = math.ceil((max(p.north_m for p in around) + margin_m) / resolution_m)
        columns, rows = east - west, north - south
        if not 0 < rows * columns <= MAX_CELLS:
            raise TerrainError(
                f"the world would have {rows} x {columns} cells of {resolution_m} m, more than "
                f"{MAX_CELLS}; make resolution_m coarser"
            )
        east_m = (np.arange(west, east) + 0.5) * resolution_m
        north_m = (np.arange(south, north) + 0.5) * resolution_m
        centres = np.meshgrid(east_m, north_m)
        cells = np.full((rows, columns), Terrain.GRASS, dtype=np.uint8)
        for terrain, shape in _layers(scene):
            shapely.prepare(shape)
            cells[shapely.contains_xy(shape, *centres)] = terrain
        return cls(west * resolution_m, south * resolution_m, resolution_m, cells)


def _layers(scene: Scene) -> Iterable[tuple[Terrain, shapely.Geometry]]:
    yield Terrain.VEGETATION, shapely.union_all([shapely.Polygon(r) for r in scene.vegetation])
    roads = [
        shapely.LineString(road.points).buffer(road.width_m / 2)
        for road in scene.roads
        if len(road.points) > 1
    ]
    yield Terrain.ROAD, shapely.union_all(roads)
    yield Terrain.BUILDING, shapely.union_all([shapely.Polygon(r) for r in scene.buildings])
    vehicles = [shapely.Point(place).buffer(VEHICLE_RADIUS_M) for place in scene.vehicles]
    yield Terrain.VEHICLE, shapely.union_all(vehicles)
