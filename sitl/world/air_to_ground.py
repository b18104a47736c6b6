"""The link between a vehicle above the roofs and a robot on the ground, as 3GPP has it.

3GPP TR 36.777 (Release 15), annex B, gives for a base station and a vehicle at 22.5 to 300 m the
probability of a line of sight (table B-1), the loss with and without one (B-2), and how much
shadowing deviates (B-3), in a town of low base stations (UMi-AV) or of high ones (UMa-AV). The base
station is the robot here. Its antenna is lower than the report's, 10 m or 25 m: that is a reading.

Line of sight and shadowing do not change with time but with place: both are functions of where the
two ends are. What they have in common after a move falls exponentially with the way, over the
distances of TR 38.901, tables 7.5-6 and 7.6.3.1-2.
"""

from __future__ import annotations

import math
import random
from statistics import NormalDist
from typing import Any, Final, Literal, Protocol

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]

AirScenario = Literal["umi_av", "uma_av"]

SHADOWING_LIMIT: Final = 3.0
"""Fading is cut at so many standard deviations, so that a link has a largest distance."""

HIGHEST_M: Final = 300.0
"""Up to this height of a vehicle the tables are for."""

ROOF_M: Final = 25.0
"""Antennas higher than this clear the buildings; the tables begin at 22.5 m."""

SIGHT_M: Final = 50.0
"""Over this distance a line of sight is kept or lost."""

SHADOWING_M: Final = {"umi_av": (10.0, 13.0), "uma_av": (37.0, 50.0)}
"""Over these distances shadowing changes, with a line of sight and without."""

_WAVES: Final = 128
_FREE_DB: Final = 20 * math.log10(40 * math.pi / 3)  # of free space, at 1 m and 1 GHz
_share_below = np.vectorize(NormalDist().cdf, otypes=[np.float64])


def sight_probability(scenario: AirScenario, height_m: Numbers, flat_m: Numbers) -> Numbers:
    """How probable a line of sight is, by the vehicle's height and the horizontal distance."""
    log_h = np.log10(height_m)
    if scenario == "umi_av":
        near_m, decay_m = 294.05 * log_h - 432.94, 233.98 * log_h - 0.95
    else:
        near_m, decay_m = 460 * log_h - 700, 4300 * log_h - 3800
    near_m = np.maximum(near_m, 18.0)
    certain = near_m / np.maximum(flat_m, near_m)
    share: Numbers = certain + np.exp(-flat_m / decay_m) * (1 - certain)
    return np.where(height_m > 100, 1.0, share) if scenario == "uma_av" else share


def path_loss_db(
    scenario: AirScenario, height_m: Numbers, away_m: Numbers, carrier_ghz: float, sight: Any
) -> Numbers:
    """The median loss, by the vehicle's height, the distance in space, and the line of sight."""
    log_h, log_d = np.log10(height_m), np.log10(away_m)
    carrier_db = 20 * math.log10(carrier_ghz)
    if scenario == "umi_av":
        sight_db = np.maximum(_FREE_DB + 20 * log_d, 30.9 + (22.25 - 0.5 * log_h) * log_d)
        blocked_db = 32.4 + (43.2 - 7.6 * log_h) * log_d
    else:
        sight_db = 28.0 + 22 * log_d
        blocked_db = _FREE_DB - 17.5 + (46 - 7 * log_h) * log_d
    loss_db: Numbers = np.where(sight, sight_db, np.maximum(sight_db, blocked_db))
    return loss_db + carrier_db


def deviation_db(scenario: AirScenario, height_m: Numbers, sight: Any) -> Numbers:
    """The standard deviation of shadowing."""
    if scenario == "umi_av":
        return np.where(sight, np.maximum(5 * np.exp(-0.01 * height_m), 2.0), 8.0)
    return np.where(sight, 4.64 * np.exp(-0.0066 * height_m), 6.0)


class PlaceField:
    """Standard normal values of pairs of places, alike where both places are near.

    A sum of waves in the space of both places (S. Jaeckel and others, "Efficient Sum-of-Sinusoids
    based Spatial Consistency for the 3GPP New-Radio Channel Model", IEEE Globecom Workshops 2018).
    Wave vectors with a Cauchy distribution make the correlation exp(-(way of one end + way of the
    other) / scale).

    Args:
        scale_m: Of that fall.
        label: Chooses the values.
    """

    def __init__(self, scale_m: float, label: str) -> None:
        chance = random.Random(label)  # noqa: S311 - repeatable on purpose
        waves = []
        for _ in range(_WAVES):
            ends = [[chance.gauss(0, 1) for _ in range(4)] for _ in range(2)]
            waves.append([[part / abs(w) / scale_m for part in vector] for *vector, w in ends])
        self._ones, self._others = np.array(waves).transpose(1, 2, 0)  # rad/m
        self._phases = np.array([chance.uniform(0, 2 * math.pi) for _ in range(_WAVES)])

    def at(self, ones: Numbers, others: Numbers) -> Numbers:
        """The values of all pairs, by one and other; places are rows of east, north and up in m."""
        here, there = ones @ self._ones + self._phases, others @ self._others
        # the cosine of the sum of both
        values: Numbers = np.cos(here) @ np.cos(there).T - np.sin(here) @ np.sin(there).T
        return values * math.sqrt(2 / _WAVES)


class AirLoss(Protocol):
    """What vehicles above the roofs and robots on the ground lose on the way to each other."""

    @property
    def carrier_ghz(self) -> float:
        """Frequency."""

    def loss_db(self, air: Numbers, ground: Numbers) -> Numbers:
        """Loss of all pairs of places, by air and ground; rows are east, north and up in m."""


class AirToGround:
    """What vehicles above the roofs and robots on the ground lose on the way to each other.

    Args:
        scenario: Which of the tables' towns it is.
        carrier_ghz: Frequency.
        seed: Chooses where there is a line of sight, and the shadowing.
    """

    def __init__(self, scenario: AirScenario, carrier_ghz: float, seed: int) -> None:
        self._scenario: AirScenario = scenario
        self.carrier_ghz = carrier_ghz
        self._sight = PlaceField(SIGHT_M, f"{seed} sight")
        near_m, far_m = SHADOWING_M[scenario]
        self._clear = PlaceField(near_m, f"{seed} seen")  # shadowing with a line of sight
        self._blocked = PlaceField(far_m, f"{seed} blocked")  # and without

    def sighted(self, air: Numbers, ground: Numbers) -> npt.NDArray[np.bool_]:
        """Whether a line of sight is between places in the air and on the ground."""
        flat_m = np.hypot(*(air[:, None, :2] - ground[:, :2]).transpose(2, 0, 1))
        share = sight_probability(self._scenario, air[:, 2:], flat_m)
        return np.asarray(_share_below(self._sight.at(air, ground)) < share)

    def loss_db(self, air: Numbers, ground: Numbers) -> Numbers:
        """Loss of all pairs of places, by air and ground; shadowing is cut at 3 deviations."""
        sight, height_m = self.sighted(air, ground), air[:, 2:]
        away_m = np.sqrt(((air[:, None] - ground) ** 2).sum(axis=2))
        fading = np.where(sight, self._clear.at(air, ground), self._blocked.at(air, ground))
        fading = np.clip(fading, -SHADOWING_LIMIT, SHADOWING_LIMIT)
        median_db = path_loss_db(self._scenario, height_m, away_m, self.carrier_ghz, sight)
        return median_db + fading * deviation_db(self._scenario, height_m, sight)


def free_space_db(away_m: Numbers, carrier_ghz: float) -> Numbers:
    """Loss between vehicles that are both above the roofs, by the distance in space."""
    loss_db: Numbers = _FREE_DB + 20 * np.log10(np.maximum(away_m, 1.0) * carrier_ghz)
    return loss_db
