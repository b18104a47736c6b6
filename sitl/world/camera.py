"""A camera that looks straight down, on a gimbal: it sees a rectangle of the ground below it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geo.frame import Point
from geo.grid import GridPatch, Terrain
from sitl.world.terrain import Raster


@dataclass(frozen=True, slots=True)
class Camera:
    """A down-looking camera whose picture is sorted into terrain classes without errors.

    Attributes:
        fov_across_deg: Field of view to the sides of the vehicle.
        fov_along_deg: Field of view ahead and behind.
        min_height_m: Lower than this it sees nothing useful.
    """

    fov_across_deg: float = 75.0
    fov_along_deg: float = 60.0
    min_height_m: float = 5.0

    def half_sizes_m(self, height_m: float) -> tuple[float, float]:
        """Half the footprint on flat ground: to the sides, and ahead."""
        return (
            height_m * math.tan(math.radians(self.fov_across_deg) / 2),
            height_m * math.tan(math.radians(self.fov_along_deg) / 2),
        )

    def look(
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
        across_m, along_m = self.half_sizes_m(height_m)
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
