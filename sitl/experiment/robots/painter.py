"""What a UAV's camera adds to its map, fast: the same cells as `Camera.look` and `Mapper.paint`.

The ground does not change, so a cell that is known stays as it is: only those that are still
unknown are looked at, with the camera's own arithmetic.
"""

from __future__ import annotations

import math

import numpy as np

from geo.frame import Point
from geo.grid import SemanticGrid, Terrain
from sitl.experiment.towns.town import Town
from sitl.world.camera import Camera


class Painter:
    """The map that a UAV paints of a town, as `air_router.gossip.mapper.Mapper` does from patches.

    Attributes:
        grid: The map, over the town's bounds at the raster's resolution.
        known_cells: How many of its cells are known.
    """

    def __init__(self, town: Town, camera: Camera) -> None:
        self._raster = raster = town.raster
        self._camera = camera
        self._last: tuple[Point, float, float] | None = None
        self._published = 0
        self.known_cells = 0
        self.grid = SemanticGrid(
            town.frame.origin,
            raster.resolution_m,
            raster.west_m,
            raster.south_m,
            np.zeros_like(raster.cells),
        )

    @property
    def known_share(self) -> float:
        """How much of the town's bounds is known, 0..1."""
        return self.known_cells / self.grid.cells.size

    def look(self, position: Point, height_m: float, heading_deg: float) -> int:
        """Take a picture from above; returns how many cells became known.

        Args:
            position: Where the camera is, metres east/north.
            height_m: Height above the ground.
            heading_deg: Where the upper edge of the picture points, clockwise from north.
        """
        view = position, height_m, heading_deg
        if view == self._last or height_m < self._camera.min_height_m:
            return 0
        self._last = view
        across_m, along_m = self._camera.half_sizes_m(height_m)
        sine = math.sin(math.radians(heading_deg))
        cosine = math.cos(math.radians(heading_deg))
        reach_east_m = abs(across_m * cosine) + abs(along_m * sine)
        reach_north_m = abs(across_m * sine) + abs(along_m * cosine)
        raster, size_m = self._raster, self._raster.resolution_m
        rows, columns = raster.cells.shape
        west = max(0, math.floor((position.east_m - reach_east_m - raster.west_m) / size_m))
        east = min(columns, math.ceil((position.east_m + reach_east_m - raster.west_m) / size_m))
        south = max(0, math.floor((position.north_m - reach_north_m - raster.south_m) / size_m))
        north = min(rows, math.ceil((position.north_m + reach_north_m - raster.south_m) / size_m))
        if west >= east or south >= north:
            return 0
        box = self.grid.cells[south:north, west:east]
        row, column = np.nonzero(box == Terrain.UNKNOWN)
        if not row.size:
            return 0
        east_m = raster.west_m + (np.arange(west, east) + 0.5) * size_m - position.east_m
        north_m = raster.south_m + (np.arange(south, north) + 0.5) * size_m - position.north_m
        sideways_m = (east_m * cosine)[column] - (north_m * sine)[row]
        ahead_m = (east_m * sine)[column] + (north_m * cosine)[row]
        seen = (np.abs(sideways_m) <= across_m) & (np.abs(ahead_m) <= along_m)
        row, column = row[seen], column[seen]
        box[row, column] = raster.cells[south:north, west:east][row, column]
        self.known_cells += row.size
        return int(row.size)

    def publish(self) -> bytes | None:
        """The map for the gossip node, or None when nothing was painted since the last call."""
        if self.known_cells == self._published:
            return None
        self._published = self.known_cells
        return self.grid.encode()
