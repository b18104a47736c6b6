"""Who hears whom: log-distance path loss with optional correlated shadowing.

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
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

_SHORTEST_M = 1.0  # the reference distance; closer than this the formula means nothing
SHADOWING_LIMIT = 3.0  # standard deviations; so that a link has a largest distance

Numbers = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Antenna:
    """Where a radio is: metres east/north in the local frame, `up_m` above the ground."""

    east_m: float
    north_m: float
    up_m: float
    on_ground: bool

    @property
    def place(self) -> tuple[float, float, float]:
        """East, north, up."""
        return self.east_m, self.north_m, self.up_m

    def distance_m(self, other: Antenna) -> float:
        """Distance in space, in metres."""
        return math.dist(self.place, other.place)


@dataclass(frozen=True, slots=True)
class RadioModel:
    """Turns distances into received power; the same in both directions.

    Attributes:
        tx_power_dbm: Power of every transmitter.
        reference_loss_db: Loss over the first metre (40 dB at 2.4 GHz in free space).
        path_loss_exponent: How fast power falls: 2 in free space, 3 to 4 in towns.
        ground_to_ground_loss_db: Extra loss between two robots on the ground.
        shadowing_db: Standard deviation of slow random fading, 0 for none; cut at 3 deviations.
        shadowing_interval_s: Time over which the fading of a pair changes.
        sensitivity_dbm: The weakest signal that still carries data.
        seed: Chooses the fading.
    """

    tx_power_dbm: float = 20.0
    reference_loss_db: float = 40.0
    path_loss_exponent: float = 2.95
    ground_to_ground_loss_db: float = 10.5
    shadowing_db: float = 0.0
    shadowing_interval_s: float = 10.0
    sensitivity_dbm: float = -76.0
    seed: int = 0

    def rssi_dbm(self, name_a: str, a: Antenna, name_b: str, b: Antenna, time_s: float) -> float:
        """Power that either of two radios receives from the other at a simulated time."""
        low = np.array([a.on_ground and b.on_ground])
        mean_dbm = self.mean_rssi_dbm(np.array([a.distance_m(b)]), low)[0]
        if self.shadowing_db == 0:
            return float(mean_dbm)
        knot, part = divmod(time_s / self.shadowing_interval_s, 1.0)
        before, after = (self.fading(name_a, name_b, int(knot) + more) for more in (0, 1))
        return float(mean_dbm - self.shadowing_loss_db(before, after, part))

    def mean_rssi_dbm(self, away_m: Numbers, low: npt.NDArray[np.bool_]) -> Numbers:
        """Power without fading, by distance in space; `low`: both robots are on the ground."""
        loss_db = 10 * self.path_loss_exponent * np.log10(np.maximum(_SHORTEST_M, away_m))
        power_dbm: Numbers = self.tx_power_dbm - self.reference_loss_db - loss_db
        return power_dbm - self.ground_to_ground_loss_db * low

    def fading(self, name_a: str, name_b: str, knot: int) -> float:
        """The standard normal value of a pair of robots at a knot, the same in both directions."""
        pair = "|".join(sorted((name_a, name_b)))
        return _normal(f"{self.seed}|{pair}|{knot}")

    def shadowing_loss_db(self, before: Any, after: Any, part: float) -> Any:
        """The loss between two knots with such values, `part` of the way; numbers or arrays."""
        # between knots the deviation would shrink; this keeps it
        blend = ((1 - part) * before + part * after) / math.hypot(1 - part, part)
        return self.shadowing_db * np.clip(blend, -SHADOWING_LIMIT, SHADOWING_LIMIT)

    def hears(self, rssi_dbm: float) -> bool:
        """Whether a signal is strong enough to carry data."""
        return rssi_dbm >= self.sensitivity_dbm

    def range_m(self, rssi_dbm: float, *, ground_to_ground: bool = False) -> float:
        """Distance in space at which the power is `rssi_dbm`, without shadowing; at least 1 m."""
        budget_db = self.tx_power_dbm - self.reference_loss_db - rssi_dbm
        if ground_to_ground:
            budget_db -= self.ground_to_ground_loss_db
        return max(_SHORTEST_M, 10 ** (budget_db / (10 * self.path_loss_exponent)))

    def longest_range_m(self, *, ground_to_ground: bool = False) -> float:
        """No two radios farther apart than this ever hear each other, whatever the shadowing."""
        return self.range_m(
            self.sensitivity_dbm - SHADOWING_LIMIT * self.shadowing_db,
            ground_to_ground=ground_to_ground,
        )


class PairPowers:
    """The powers of many pairs of robots at once: what `RadioModel.rssi_dbm` says of each.

    Args:
        model: The radios'.
        names: Of the robots, in the order of their numbers.
    """

    def __init__(self, model: RadioModel, names: Sequence[str]) -> None:
        self._model = model
        self._names = names
        self._values: dict[int, Numbers] = {}  # of fading by knot, [a, b]; nan: not asked for yet

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
        power_dbm: Numbers = mean_dbm - self._model.shadowing_loss_db(before, after, part)
        return power_dbm

    def _fading(self, a: Indices, b: Indices, knot: int) -> Numbers:
        count = len(self._names)
        values = self._values.setdefault(knot, np.full((count, count), np.nan))
        new = np.flatnonzero(np.isnan(values[a, b]))
        pairs = zip(a[new].tolist(), b[new].tolist(), strict=True)
        values[a[new], b[new]] = [
            self._model.fading(self._names[one], self._names[other], knot) for one, other in pairs
        ]
        return values[a, b]


@lru_cache(maxsize=1 << 12)
def _normal(label: str) -> float:
    """A standard normal value that belongs to a label (Box-Muller on a hash)."""
    digest = hashlib.blake2b(label.encode(), digest_size=16).digest()
    first = (int.from_bytes(digest[:8], "big") + 1) / (2**64 + 1)
    second = int.from_bytes(digest[8:], "big") / 2**64
    return math.sqrt(-2 * math.log(first)) * math.cos(2 * math.pi * second)
