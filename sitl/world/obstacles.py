"""The link between a vehicle above the roofs and a robot below, by what stands between them.

Free space, and what the straight line loses in buildings and in trees, whose heights are drawn by
the seed: no map shows them. Trees lose as Recommendation ITU-R P.833 has it for one terminal in
vegetation,

    loss = Am (1 - exp(-d gamma / Am))

with the Am that it gives for a mixed park at 2.1 GHz. Buildings lose by the metre, up to a limit
beyond which waves go around. Shadowing deviates more where something stands in between.
"""

from __future__ import annotations

import random
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely

from geo.grid import Terrain
from sitl.world.air_to_ground import SHADOWING_LIMIT, Numbers, PlaceField, free_space_db
from sitl.world.towns import Raster, Town

ROOFS_M: Final = (5.0, 20.0)
CROWNS_M: Final = (4.0, 14.0)
"""Between these heights those of buildings and of trees are drawn, evenly."""

TREES_DB_M: Final = 0.5
"""P.833's gamma: over a short way a tree in leaf loses so much per metre, about 2 GHz."""

MOST_TREES_DB: Final = 34.1
"""P.833's Am."""

FADING_M: Final = 12.0
"""Over this distance of either end shadowing changes."""

CLEAR_DB, BLOCKED_DB = 2.0, 5.0
"""Standard deviations of shadowing, with a line of sight and without."""

_STEP_M: Final = 1.0  # of height, between samples along a line


class Obstacles:
    """What vehicles above the roofs and robots on the ground lose on the way to each other.

    Args:
        town: Its buildings and trees.
        carrier_ghz: Frequency.
        seed: Chooses heights and shadowing.
        building_loss_db_m: Loss per metre of building.
        most_building_db: No line loses more than this to buildings.
    """

    def __init__(
        self,
        town: Town,
        carrier_ghz: float,
        seed: int,
        *,
        building_loss_db_m: float,
        most_building_db: float,
    ) -> None:
        self.carrier_ghz = carrier_ghz
        self._building = building_loss_db_m, most_building_db
        self._raster = town.raster
        self._heights_m = heights_m(town, seed)
        self._fading = PlaceField(FADING_M, f"{seed} obstacles")
        self._steps_m = np.arange(_STEP_M / 2, max(*ROOFS_M, *CROWNS_M), _STEP_M)  # above ground

    def loss_db(self, air: Numbers, ground: Numbers) -> Numbers:
        """Loss of all pairs of places, by air and ground; shadowing is cut at 3 deviations."""
        pairs = (len(air), len(ground))
        starts = np.broadcast_to(ground[None, :, :2], (*pairs, 2)).reshape(-1, 2)
        ends = np.broadcast_to(air[:, None, :2], (*pairs, 2)).reshape(-1, 2)
        up_m = np.broadcast_to(air[:, None, 2] - ground[None, :, 2], pairs).reshape(-1)
        away_m = np.sqrt(((ends - starts) ** 2).sum(axis=1) + up_m**2)
        building_m, tree_m = self.crossed_m(starts, ends, up_m, away_m)
        loss_db_m, most_db = self._building
        building_db = np.minimum(loss_db_m * building_m, most_db)
        tree_db = MOST_TREES_DB * (1 - np.exp(-tree_m * TREES_DB_M / MOST_TREES_DB))
        deviation_db = np.where(building_m + tree_m > 0, BLOCKED_DB, CLEAR_DB)
        fading = np.clip(self._fading.at(air, ground), -SHADOWING_LIMIT, SHADOWING_LIMIT)
        loss_db = free_space_db(away_m, self.carrier_ghz) + building_db + tree_db
        return loss_db.reshape(pairs) + fading * deviation_db.reshape(pairs)

    def crossed_m(
        self, starts: Numbers, ends: Numbers, up_m: Numbers, away_m: Numbers
    ) -> tuple[Numbers, Numbers]:
        """Metres of building and of trees on lines from the ground into the air.

        Args:
            starts: East and north of the lower ends.
            ends: Those of the upper ends.
            up_m: How much higher these are.
            away_m: Lengths of the lines.
        """
        share = self._steps_m / up_m[:, None]  # of the line, from below
        east = starts[:, :1] + share * (ends - starts)[:, :1]
        north = starts[:, 1:] + share * (ends - starts)[:, 1:]
        classes = self._raster.classes_at(east, north)
        below = self._steps_m < _at(self._heights_m, self._raster, east, north)
        each_m = _STEP_M / up_m * away_m
        found = [
            each_m * np.count_nonzero((classes == kind) & below, axis=1)
            for kind in (Terrain.BUILDING, Terrain.VEGETATION)
        ]
        return found[0], found[1]


def heights_m(town: Town, seed: int) -> npt.NDArray[np.float32]:
    """How high what stands on each cell of a town's raster is; 0 where nothing does."""
    chance = random.Random(f"{seed} heights")  # noqa: S311 - repeatable on purpose
    raster = town.raster
    rows, columns = raster.cells.shape
    east = raster.west_m + (np.arange(columns) + 0.5) * raster.resolution_m
    north = raster.south_m + (np.arange(rows) + 0.5) * raster.resolution_m
    found = np.zeros(raster.cells.shape, dtype=np.float32)
    for kind, rings, span_m in (
        (Terrain.VEGETATION, town.vegetation, CROWNS_M),
        (Terrain.BUILDING, town.buildings, ROOFS_M),
    ):
        for ring in rings:
            high_m = chance.uniform(*span_m)
            shape = shapely.Polygon(ring)
            west_m, south_m, east_m, north_m = shape.bounds
            columns_in = slice(*np.searchsorted(east, (west_m, east_m)))
            rows_in = slice(*np.searchsorted(north, (south_m, north_m)))
            inside = shapely.contains_xy(shape, *np.meshgrid(east[columns_in], north[rows_in]))
            inside &= raster.cells[rows_in, columns_in] == kind
            found[rows_in, columns_in][inside] = high_m
    return found


def _at(
    values: npt.NDArray[np.float32], raster: Raster, east_m: Numbers, north_m: Numbers
) -> npt.NDArray[np.float32]:
    """Values of a raster's cells at places, the nearest cell's outside."""
    rows, columns = values.shape
    column = np.floor((east_m - raster.west_m) / raster.resolution_m).astype(np.intp)
    row = np.floor((north_m - raster.south_m) / raster.resolution_m).astype(np.intp)
    found: npt.NDArray[np.float32] = values[row.clip(0, rows - 1), column.clip(0, columns - 1)]
    return found
