"""Which radios receive which: log-distance path loss, optional correlated shadowing, buildings.

The received power falls with the logarithm of the distance (Rappaport, Wireless Communications,
ch. 4: "log-distance path loss" and "log-normal shadowing"):

    rssi = tx_power - reference_loss - 10 n log10(d / 1 m) - extra loss - shadowing

Two robots on the ground pay an extra loss: their antennas are low, and the ground and whatever
stands on it lie between them. Everything here is a function of its arguments: same seed, same
times, same places, same numbers.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Final

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from geo.grid import Terrain
from sitl.world.air_to_ground import (
    ROOF_M,
    SHADOWING_LIMIT,
    AirLoss,
    Numbers,
    PlaceField,
    free_space_db,
)
from sitl.world.measured_link import AirModel
from sitl.world.towns import Raster

_SHORTEST_M: Final = 1.0  # the reference distance; closer than this the formula means nothing
_GROUND_FADING_M: Final = 13.0  # without a line of sight: TR 38.901, table 7.5-6
_SAMPLE_M: Final = 1.0

Indices = npt.NDArray[np.intp]
Positive = Annotated[float, Field(gt=0, le=1e6)]
"""What a world file may write where this stands."""


class RadioModel(BaseModel):
    """Turns distances into received power, the same in both directions; as a world file has it.

    Attributes:
        tx_power_dbm: Power of every transmitter.
        reference_loss_db: Loss over the first metre (40 dB at 2.4 GHz in free space).
        path_loss_exponent: How fast power falls: 2 in free space, 3 to 4 in towns.
        ground_to_ground_loss_db: Extra loss between two robots on the ground.
        shadowing_db: Standard deviation of slow random fading, 0 for none; cut at 3 deviations.
        shadowing_interval_s: Time over which the fading of a pair changes.
        sensitivity_dbm: The weakest signal that still carries data.
        air: The link between a vehicle above the roofs and a robot below; None: as any other.
        carrier_ghz: Frequency of such links.
        reading_interval_s: Simulated seconds between two readings of a radio.
        rate_bytes_s: What a link carries per simulated second; None: no limit.
    """

    model_config = ConfigDict(frozen=True)

    tx_power_dbm: Annotated[float, Field(ge=-50, le=60)] = 20.0
    reference_loss_db: Annotated[float, Field(ge=0, le=120)] = 40.0
    path_loss_exponent: Annotated[float, Field(ge=1, le=10)] = 2.95
    ground_to_ground_loss_db: Annotated[float, Field(ge=0, le=120)] = 10.5
    shadowing_db: Annotated[float, Field(ge=0, le=30)] = 0.0
    shadowing_interval_s: Positive = 10.0
    sensitivity_dbm: Annotated[float, Field(ge=-200, le=0)] = -76.0
    air: AirModel | None = None
    carrier_ghz: Annotated[float, Field(ge=0.5, le=100)] = 2.4
    reading_interval_s: Positive = 0.5
    rate_bytes_s: Positive | None = None

    def mean_rssi_dbm(self, away_m: Numbers, low: npt.NDArray[np.bool_]) -> Numbers:
        """Power without fading, by distance in space; `low`: both robots are on the ground."""
        loss_db = 10 * self.path_loss_exponent * np.log10(np.maximum(_SHORTEST_M, away_m))
        power_dbm: Numbers = self.tx_power_dbm - self.reference_loss_db - loss_db
        return power_dbm - self.ground_to_ground_loss_db * low

    def range_m(self, rssi_dbm: float) -> float:
        """Distance in space at which the power is `rssi_dbm`, without shadowing; at least 1 m."""
        budget_db = self.tx_power_dbm - self.reference_loss_db - rssi_dbm
        return max(_SHORTEST_M, 10 ** (budget_db / (10 * self.path_loss_exponent)))

    @property
    def longest_range_m(self) -> float:
        """No two radios farther apart than this ever receive each other, whatever the shadowing."""
        return self.range_m(self.sensitivity_dbm - SHADOWING_LIMIT * self.shadowing_db)


class PairPowers:
    """What robots receive of each other, many pairs at once; fading goes by time.

    Args:
        model: The radios'.
        names: Of the robots, in the order of their numbers.
        seed: Chooses the fading.
    """

    def __init__(self, model: RadioModel, names: Sequence[str], seed: int) -> None:
        self._model = model
        self._names = names
        self._seed = seed
        self._values: dict[int, Numbers] = {}  # of fading by knot, [a, b]; nan: not drawn yet

    def rssi_dbm(
        self, a: Indices, b: Indices, away_m: Numbers, low: npt.NDArray[np.bool_], time_s: float
    ) -> Numbers:
        """Power of some pairs at a simulated time, which never runs back.

        Args:
            a: The numbers of one robot of each pair.
            b: Those of the other one.
            away_m: How far apart they are, in space.
            low: Whether both are on the ground.
            time_s: The simulated time.
        """
        mean_dbm = self._model.mean_rssi_dbm(away_m, low)
        if self._model.shadowing_db == 0:
            return mean_dbm
        knot, part = divmod(time_s / self._model.shadowing_interval_s, 1.0)
        before, after = (self._fading(a, b, int(knot) + more) for more in (0, 1))
        self._values = {key: own for key, own in self._values.items() if key >= knot}
        # between knots the deviation would shrink; this keeps it
        blend = ((1 - part) * before + part * after) / math.hypot(1 - part, part)
        loss_db = self._model.shadowing_db * np.clip(blend, -SHADOWING_LIMIT, SHADOWING_LIMIT)
        power_dbm: Numbers = mean_dbm - loss_db
        return power_dbm

    def _fading(self, a: Indices, b: Indices, knot: int) -> Numbers:
        """Standard normal values of pairs at a knot, the same in both directions."""
        count = len(self._names)
        values = self._values.setdefault(knot, np.full((count, count), np.nan))
        new = np.flatnonzero(np.isnan(values[a, b]))
        ends = zip(a[new].tolist(), b[new].tolist(), strict=True)
        pairs = ["|".join(sorted((self._names[one], self._names[other]))) for one, other in ends]
        values[a[new], b[new]] = [_normal(f"{self._seed}|{pair}|{knot}") for pair in pairs]
        return values[a, b]


@lru_cache(maxsize=1 << 12)
def _normal(label: str) -> float:
    """A standard normal value that belongs to a label (Box-Muller on a hash)."""
    digest = hashlib.blake2b(label.encode(), digest_size=16).digest()
    first = (int.from_bytes(digest[:8], "big") + 1) / (2**64 + 1)
    second = int.from_bytes(digest[8:], "big") / 2**64
    return math.sqrt(-2 * math.log(first)) * math.cos(2 * math.pi * second)


class TownRadio:
    """Received power: distance, fading, and what buildings take from lines between low antennas.

    Args:
        radio: The loss by distance, and the fading.
        raster: Buildings.
        names: Of the robots, in the order of their numbers.
        seed: Chooses the fading.
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
        seed: int,
        *,
        building_loss_db_m: float,
        most_building_db: float,
        air: AirLoss | None = None,
    ) -> None:
        self._radio = radio
        self._raster = raster
        self._air = air
        self._building = building_loss_db_m, most_building_db
        self._count = len(names)
        self._powers = PairPowers(radio, names, seed)  # that fade by time
        self._ground = PlaceField(_GROUND_FADING_M, f"{seed} ground")  # by place
        self._farthest_m = radio.longest_range_m  # farther pairs are not computed

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
        received = rssi_dbm >= self._radio.sensitivity_dbm
        a, b, low, rssi_dbm = a[received], b[received], low[received], rssi_dbm[received]
        rssi_dbm[low] -= self.building_db(places[a[low], :2], places[b[low], :2])
        received_dbm = np.full((self._count, self._count), -np.inf)
        received_dbm[a, b] = received_dbm[b, a] = np.round(rssi_dbm, 6)
        return received_dbm

    def _by_place_dbm(self, air: AirLoss, places: Numbers, away_m: Numbers) -> Numbers:
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
