"""What a UAV's camera adds to its map, fast: the same cells as `Camera.look` and `Mapper.paint`.

The ground does not change, so a cell that is known stays as it is: only those that are still
unknown are looked at, with the camera's own arithmetic.
"""

from __future__ import annotations

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
        seen_from = position, height_m, heading_deg
        if seen_from == self._last:
            return 0
        view = self._camera.view(self._raster, *seen_from)
        if view is None:
            return 0
        self._last = seen_from
        box = self.grid.cells[view.rows, view.columns]
        row, column = np.nonzero(box == Terrain.UNKNOWN)
        seen = view.shows(view.east_m[column], view.north_m[row])
        row, column = row[seen], column[seen]
        box[row, column] = self._raster.cells[view.rows, view.columns][row, column]
        self.known_cells += row.size
        return int(row.size)

    def publish(self) -> bytes | None:
        """The map for the gossip node, or None when nothing was painted since the last call."""
        if self.known_cells == self._published:
            return None
        self._published = self.known_cells
        return self.grid.encode()
