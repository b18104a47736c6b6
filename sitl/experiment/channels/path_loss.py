"""A radio as robots have it: power that falls with distance, fades, and is lost in buildings.

Contact begins and ends by received power, the rate follows from it, and transmissions far enough
apart do not disturb each other. `sitl.world.radio` has the model of the power itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Final

import numpy as np

from geo.grid import Terrain
from sitl.experiment.channels.channel import Change, Link, Load, Places, SpatialReuse
from sitl.experiment.settings import PathLossModel
from sitl.world.radio import Antenna, RadioModel
from sitl.world.towns.town import Town

FULL_RATE_DB: Final = 30.0
"""So much above the trigger a link carries all that it can."""

_ROOF_M: Final = 25.0
"""Antennas higher than this look over the buildings."""

_LOOK_S: Final = 1.0
_SAMPLE_M: Final = 1.0


class PathLossChannel(SpatialReuse):
    """Who hears whom in a town, and how well.

    Args:
        model: Powers and rates.
        town: Its buildings.
        names: Of the robots, in the order of their numbers.
        seed: Makes the fading.
    """

    def __init__(self, model: PathLossModel, town: Town, names: Sequence[str], seed: int) -> None:
        super().__init__(model.pull_every_s, len(names))
        self._model = model
        self._names = names
        self._raster = town.raster  # buildings that block a radio
        self._radio = RadioModel(
            tx_power_dbm=model.tx_power_dbm,
            reference_loss_db=model.reference_loss_db,
            path_loss_exponent=model.path_loss_exponent,
            ground_to_ground_loss_db=model.ground_to_ground_loss_db,
            shadowing_db=model.shadowing_db,
            shadowing_interval_s=model.shadowing_interval_s,
            sensitivity_dbm=min(model.carrier_dbm, model.trigger_dbm - model.hysteresis_db),
            seed=seed,
        )
        self._farthest_m = self._radio.longest_range_m()  # farther pairs are not looked at
        self._rssi_dbm: dict[tuple[int, int], float] = {}  # at the last look; a < b
        self._up: set[tuple[int, int]] = set()  # in contact, a < b
        self._look_at_s = 0.0  # simulated time of the next look

    def look(self, now_s: float, places: Places) -> list[Change]:
        """What the radios hear now, once a second."""
        if now_s < self._look_at_s:
            return []
        self._look_at_s = now_s + _LOOK_S
        self._measure(now_s, places)
        model, changes = self._model, []
        for pair in combinations(range(len(self._names)), 2):
            least_dbm = model.trigger_dbm - (model.hysteresis_db if pair in self._up else 0.0)
            up = self._rssi_dbm.get(pair, -np.inf) >= least_dbm
            if up != (pair in self._up):
                self._up ^= {pair}
                changes.append(Change(*pair, up))
        return changes

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002 - a port's
        """Round trips, and the bytes at the rate that the power allows."""
        model = self._model
        rssi_dbm = self._rssi_dbm.get((min(link), max(link)), model.trigger_dbm)
        share = min(max((rssi_dbm - model.trigger_dbm) / FULL_RATE_DB, 0.0), 1.0)
        rate = model.least_rate_bytes_s + share * (model.rate_bytes_s - model.least_rate_bytes_s)
        return load.round_trips * model.round_trip_s + load.size / rate

    def _measure(self, now_s: float, places: Places) -> None:
        away_m = np.sqrt(((places[:, None] - places) ** 2).sum(axis=2))
        antennas = [
            Antenna(float(east), float(north), float(up), on_ground=up < _ROOF_M)
            for east, north, up in places
        ]
        self._rssi_dbm.clear()
        self._hears = [{number} for number in range(len(self._names))]
        for row in np.argwhere(np.triu(away_m <= self._farthest_m, 1)):
            a, b = int(row[0]), int(row[1])
            rssi_dbm = self._radio.rssi_dbm(
                self._names[a], antennas[a], self._names[b], antennas[b], now_s
            )
            if rssi_dbm < self._radio.sensitivity_dbm:
                continue
            if antennas[a].on_ground and antennas[b].on_ground:
                rssi_dbm -= self._building_db(places[a], places[b])
            self._rssi_dbm[a, b] = round(rssi_dbm, 6)
            if rssi_dbm >= self._model.carrier_dbm:
                self._hears[a].add(b)
                self._hears[b].add(a)

    def _building_db(self, start: Places, end: Places) -> float:
        """What a straight line through the town loses in buildings."""
        east_m, north_m = end[0] - start[0], end[1] - start[1]
        count = max(2, int(np.hypot(east_m, north_m) / _SAMPLE_M))
        along = (np.arange(count) + 0.5) / count
        classes = self._raster.classes_at(start[0] + along * east_m, start[1] + along * north_m)
        building_m = np.count_nonzero(classes == Terrain.BUILDING) * _SAMPLE_M
        model = self._model
        return float(min(model.most_building_db, model.building_loss_db_m * building_m))
