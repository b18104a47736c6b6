"""What stands where in the simulated world, as a raster made once, and what a camera sees of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import numpy.typing as npt
import shapely
from pydantic import BaseModel, ConfigDict, Field
from shapely.geometry.base import BaseGeometry

from geo.frame import Point
from geo.grid import Cells, GridPatch, Terrain

Floats = npt.NDArray[np.float64]

VEHICLE_RADIUS_M = 2.2
"""A parked vehicle covers the cells whose centres lie within this distance."""

MAX_CELLS = 4_000_000


class TerrainError(ValueError):
    """The world cannot be drawn as a raster; the message has the cause and a remedy."""


@dataclass(frozen=True, slots=True)
class Road:
    """A road: its middle line in metres east/north, and its width."""

    points: tuple[Point, ...]
    width_m: float


@dataclass(frozen=True, slots=True)
class LandCover:
    """The things in a world, in metres of the local frame; what they leave over is grass.

    Where they overlap, the later is seen: vegetation, roads, buildings, yards of gravel, vehicles.
    """

    vegetation: tuple[tuple[Point, ...], ...] = ()
    roads: tuple[Road, ...] = ()
    buildings: tuple[tuple[Point, ...], ...] = ()
    yards: tuple[tuple[Point, ...], ...] = ()
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
        cls, land_cover: LandCover, around: Sequence[Point], resolution_m: float, margin_m: float
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
        cells = np.full((rows, columns), Terrain.GRASS, dtype=np.uint8)
        raster = cls(west * resolution_m, south * resolution_m, resolution_m, cells)
        raster.fill(layers(land_cover))
        return raster

    def fill(self, layers: Iterable[tuple[Terrain, BaseGeometry]]) -> None:
        """Draw shapes, the later over the earlier: into cells whose centres lie inside."""
        size_m = self.resolution_m
        rows, columns = self.cells.shape
        for terrain, shape in layers:
            if shape.is_empty:
                continue
            west_m, south_m, east_m, north_m = shape.bounds
            left = max(0, int((west_m - self.west_m) / size_m))
            right = min(columns, int((east_m - self.west_m) / size_m) + 1)
            bottom = max(0, int((south_m - self.south_m) / size_m))
            top = min(rows, int((north_m - self.south_m) / size_m) + 1)
            if left >= right or bottom >= top:
                continue
            east = self.west_m + (np.arange(left, right) + 0.5) * size_m
            north = self.south_m + (np.arange(bottom, top) + 0.5) * size_m
            shapely.prepare(shape)
            inside = shapely.contains_xy(shape, *np.meshgrid(east, north))
            self.cells[bottom:top, left:right][inside] = terrain

    def classes_at(self, east_m: Floats, north_m: Floats) -> Cells:
        """The classes at places; unknown where the raster shows nothing."""
        columns = np.floor((east_m - self.west_m) / self.resolution_m).astype(np.intp)
        rows = np.floor((north_m - self.south_m) / self.resolution_m).astype(np.intp)
        height, width = self.cells.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        found = self.cells[rows.clip(0, height - 1), columns.clip(0, width - 1)]
        return np.where(inside, found, np.uint8(Terrain.UNKNOWN))


def layers(land_cover: LandCover) -> Iterator[tuple[Terrain, BaseGeometry]]:
    """The shapes of what a scene has; where they overlap, the later is seen."""
    for ring in land_cover.vegetation:
        yield Terrain.VEGETATION, shapely.Polygon(ring)
    for road in land_cover.roads:
        if len(road.points) > 1:
            yield Terrain.ROAD, shapely.LineString(road.points).buffer(road.width_m / 2)
    for ring in land_cover.buildings:
        yield Terrain.BUILDING, shapely.Polygon(ring)
    for ring in land_cover.yards:
        yield Terrain.GRAVEL, shapely.Polygon(ring)
    for place in land_cover.vehicles:
        yield Terrain.VEHICLE, shapely.Point(place).buffer(VEHICLE_RADIUS_M)


class Camera(BaseModel):
    """A down-looking camera whose picture is sorted into terrain classes without errors.

    As a world file has it.

    Attributes:
        fov_across_deg: Field of view to the sides of the vehicle.
        fov_along_deg: Field of view ahead and behind.
        min_height_m: Lower than this it sees nothing useful.
        interval_s: Simulated seconds between two pictures.
    """

    model_config = ConfigDict(frozen=True)

    fov_across_deg: Annotated[float, Field(gt=0, le=150)] = 75.0
    fov_along_deg: Annotated[float, Field(gt=0, le=150)] = 60.0
    min_height_m: Annotated[float, Field(ge=0, le=1e4)] = 5.0
    interval_s: Annotated[float, Field(gt=0, le=1e6)] = 1.0

    def picture(
        self, raster: Raster, position: Point, height_m: float, heading_deg: float
    ) -> GridPatch | None:
        """What the camera sees of the ground; cells beside the footprint stay unknown.

        Args:
            raster: The true terrain.
            position: Where the camera is, metres east/north.
            height_m: Height above the ground.
            heading_deg: Where the upper edge of the picture points, clockwise from north.

        Returns:
            The cells whose centres are seen, or None: too low, or outside of the world.
        """
        if height_m < self.min_height_m:
            return None
        # Half the footprint on flat ground: to the sides, and ahead.
        across_m = height_m * math.tan(math.radians(self.fov_across_deg) / 2)
        along_m = height_m * math.tan(math.radians(self.fov_along_deg) / 2)
        sine = math.sin(math.radians(heading_deg))
        cosine = math.cos(math.radians(heading_deg))
        reach_east_m = abs(across_m * cosine) + abs(along_m * sine)
        reach_north_m = abs(across_m * sine) + abs(along_m * cosine)
        size_m = raster.resolution_m
        rows, columns = raster.cells.shape
        west = max(0, math.floor((position.east_m - reach_east_m - raster.west_m) / size_m))
        east = min(columns, math.ceil((position.east_m + reach_east_m - raster.west_m) / size_m))
        south = max(0, math.floor((position.north_m - reach_north_m - raster.south_m) / size_m))
        north = min(rows, math.ceil((position.north_m + reach_north_m - raster.south_m) / size_m))
        if west >= east or south >= north:
            return None
        east_m = raster.west_m + (np.arange(west, east) + 0.5) * size_m - position.east_m
        north_m = raster.south_m + (np.arange(south, north) + 0.5) * size_m - position.north_m
        sideways_m = east_m * cosine - north_m[:, None] * sine
        ahead_m = east_m * sine + north_m[:, None] * cosine
        seen = (np.abs(sideways_m) <= across_m) & (np.abs(ahead_m) <= along_m)
        cells = np.where(seen, raster.cells[south:north, west:east], np.uint8(Terrain.UNKNOWN))
        return GridPatch(
            raster.west_m + west * size_m, raster.south_m + south * size_m, size_m, cells
        )
