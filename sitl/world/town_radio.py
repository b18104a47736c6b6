"""What robots in a town receive of each other, all pairs at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from geo.grid import Terrain
from sitl.world.air_to_ground import ROOF_M, AirToGround, PlaceField, free_space_db
from sitl.world.radio import SHADOWING_LIMIT, Numbers, PairPowers, RadioModel
from sitl.world.terrain import Raster

_GROUND_FADING_M: Final = 13.0  # without a line of sight: TR 38.901, table 7.5-6
_SAMPLE_M: Final = 1.0


class TownRadio:
    """Received power: distance, fading, and what buildings take from lines between low antennas.

    Args:
        radio: What is lost by distance, and how it fades.
        raster: Buildings.
        names: Of the robots, in the order of their numbers.
        building_loss_db_m: Loss per metre of building.
        most_building_db: No line loses more than this to buildings.
        air: The link between a robot above the roofs and one below. With it all fading is by place
            and not by time, and vehicles above the roofs have free space between them. None: above
            the roofs and below all lose the same by distance.
    """

    def __init__(  # noqa: PLR0913 - what a radio in a town depends on
        self,
        radio: RadioModel,
        raster: Raster,
        names: Sequence[str],
        *,
        building_loss_db_m: float,
        most_building_db: float,
        air: AirToGround | None = None,
    ) -> None:
        self._radio = radio
        self._raster = raster
        self._air = air
        self._building = building_loss_db_m, most_building_db
        self._count = len(names)
        self._powers = PairPowers(radio, names)  # that fade by time
        self._ground = PlaceField(_GROUND_FADING_M, f"{radio.seed} ground")  # by place
        self._farthest_m = radio.longest_range_m()  # farther pairs are not looked at

    def rssi_dbm(self, now_s: float, places: Numbers) -> Numbers:
        """By the numbers of both robots; -inf where it is too weak to count.

        Args:
            now_s: Simulated time, which never runs back.
            places: Where robots are: east, north, height above ground in m, by number.
        """
        away_m = np.sqrt(((places[:, None] - places) ** 2).sum(axis=2))
        near = away_m <= self._farthest_m
        grounded = places[:, 2] < ROOF_M
        if self._air is not None:
            near |= ~(grounded[:, None] & grounded)
        a, b = np.nonzero(np.triu(near, 1))
        low = grounded[a] & grounded[b]
        if self._air is None:
            rssi_dbm = self._powers.rssi_dbm(a, b, away_m[a, b], low, now_s)
        else:
            rssi_dbm = self._by_place_dbm(self._air, places, away_m)[a, b]
        heard = rssi_dbm >= self._radio.sensitivity_dbm
        a, b, low, rssi_dbm = a[heard], b[heard], low[heard], rssi_dbm[heard]
        rssi_dbm[low] -= self.building_db(places[a[low], :2], places[b[low], :2])
        received_dbm = np.full((self._count, self._count), -np.inf)
        received_dbm[a, b] = received_dbm[b, a] = np.round(rssi_dbm, 6)
        return received_dbm

    def _by_place_dbm(self, air: AirToGround, places: Numbers, away_m: Numbers) -> Numbers:
        """Power between all robots; of a pair the upper right half counts."""
        radio = self._radio
        low, high = np.flatnonzero(places[:, 2] < ROOF_M), np.flatnonzero(places[:, 2] >= ROOF_M)
        power_dbm = radio.tx_power_dbm - free_space_db(away_m, air.carrier_ghz)
        lost_db = air.loss_db(places[high], places[low])
        power_dbm[np.ix_(high, low)] = radio.tx_power_dbm - lost_db
        power_dbm[np.ix_(low, high)] = radio.tx_power_dbm - lost_db.T
        fading = np.clip(
            self._ground.at(places[low], places[low]), -SHADOWING_LIMIT, SHADOWING_LIMIT
        )
        grounded = np.ix_(low, low)
        mean_dbm = radio.mean_rssi_dbm(away_m[grounded], np.array(True))
        power_dbm[grounded] = mean_dbm - radio.shadowing_db * fading
        return power_dbm

    def building_db(self, starts: Numbers, ends: Numbers) -> Numbers:
        """What straight lines through the town lose in buildings; places are east and north."""
        ways_m = ends - starts
        counts = np.maximum(2, (np.hypot(*ways_m.T) / _SAMPLE_M).astype(np.intp))
        firsts = np.cumsum(counts) - counts  # of the samples of each line among all
        line = np.repeat(np.arange(len(counts)), counts)
        along = (np.arange(len(line)) - firsts[line] + 0.5) / counts[line]
        samples = starts[line] + along[:, None] * ways_m[line]
        hit = self._raster.classes_at(samples[:, 0], samples[:, 1]) == Terrain.BUILDING
        building_m = np.bincount(line, hit, len(counts)) * _SAMPLE_M
        loss_db_m, most_db = self._building
        loss_db: Numbers = np.minimum(most_db, loss_db_m * building_m)
        return loss_db
