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
from dataclasses import dataclass
from functools import lru_cache

_SHORTEST_M = 1.0  # the reference distance; closer than this the formula means nothing
_SHADOWING_LIMIT = 3.0  # standard deviations; so that a link has a largest distance


@dataclass(frozen=True, slots=True)
class Antenna:
    """Where a radio is: metres east/north in the local frame, `up_m` above the ground."""

    east_m: float
    north_m: float
    up_m: float
    on_ground: bool

    def distance_m(self, other: Antenna) -> float:
        """Distance in space, in metres."""
        return math.dist(
            (self.east_m, self.north_m, self.up_m), (other.east_m, other.north_m, other.up_m)
        )


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
        loss_db = self.reference_loss_db
        loss_db += self._distance_loss_db(a.distance_m(b))
        if a.on_ground and b.on_ground:
            loss_db += self.ground_to_ground_loss_db
        return self.tx_power_dbm - loss_db - self._shadowing_db(name_a, name_b, time_s)

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
            self.sensitivity_dbm - _SHADOWING_LIMIT * self.shadowing_db,
            ground_to_ground=ground_to_ground,
        )

    def _distance_loss_db(self, distance_m: float) -> float:
        return 10 * self.path_loss_exponent * math.log10(max(_SHORTEST_M, distance_m))

    def _shadowing_db(self, name_a: str, name_b: str, time_s: float) -> float:
        """Normal values at fixed times, one stream per pair, with straight lines between them."""
        if self.shadowing_db == 0:
            return 0.0
        knot, part = divmod(time_s / self.shadowing_interval_s, 1.0)
        pair = "|".join(sorted((name_a, name_b)))
        before = _normal(f"{self.seed}|{pair}|{int(knot)}")
        after = _normal(f"{self.seed}|{pair}|{int(knot) + 1}")
        # between knots the deviation would shrink; this keeps it
        blend = ((1 - part) * before + part * after) / math.hypot(1 - part, part)
        return self.shadowing_db * max(-_SHADOWING_LIMIT, min(_SHADOWING_LIMIT, blend))


@lru_cache(maxsize=1 << 14)
def _normal(label: str) -> float:
    """A standard normal value that belongs to a label (Box-Muller on a hash)."""
    digest = hashlib.blake2b(label.encode(), digest_size=16).digest()
    first = (int.from_bytes(digest[:8], "big") + 1) / (2**64 + 1)
    second = int.from_bytes(digest[8:], "big") / 2**64
    return math.sqrt(-2 * math.log(first)) * math.cos(2 * math.pi * second)
