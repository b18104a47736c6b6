"""The link between a vehicle in the air and a robot on the ground, as it was measured.

The platform AERPAW flew UAVs with a receiver at 3.32 GHz over the fields and woods of Lake Wheeler,
Raleigh, to find a ground robot that transmitted from 1.5 m above ground: the AFAR challenge of
December 2023 (S. Masrur and others, "Collection: Datasets from AFAR Challenge", arXiv:2505.06823).
The numbers below are our own statistics of its 14 flights at 19 to 47 m, 9,141 means over a second,
as published by M. Rahman and others with "Elevation- and Tilt-Aware Shadow Fading Correlation
Modeling for UAV Communications", arXiv:2512.05332 (github.com/MPACT-Lab/shadow-fading-ang-corr).
`benchmarks.measured_link` computes them.

What a link loses beyond free space goes by its elevation: far aside the land shadows it, above the
robot both antennas have their null. The dataset's powers have no absolute level. So the best
elevations lose `BEST_DB`, as in AERPAW's calibrated LTE flights around a tower (S. J. Maeng and
others, "Kriging-Based 3-D Spectrum Awareness for Radio Dynamic Zones Using Aerial Spectrum
Sensors", IEEE Sensors Journal 2024): there medians are 1 to 3.6 dB between 30 and 60 degrees, at 70
to 110 m.

It was measured at one place, in winter, with one pair of antennas, from lower than 25 m in part.
Other carriers differ here by their free space only.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from sitl.world.air_to_ground import (
    SHADOWING_LIMIT,
    AirLoss,
    AirScenario,
    AirToGround,
    Numbers,
    PlaceField,
    free_space_db,
)

AirModel = Literal[AirScenario, "aerpaw"]
"""The models of links between air and ground that a world file may name."""

ELEVATIONS_DEG: Final = (4.1, 7.6, 12.2, 17.2, 24.5, 37.4, 50.9, 65.8, 80.7)
"""Mean elevations of the measurements in each band; between them values are linear."""

EXCESS_DB: Final = (27.4, 22.6, 16.6, 11.9, 6.5, 0.0, 3.4, 8.6, 18.3)
"""Mean loss beyond free space there, less that at the best elevation."""

DEVIATIONS_DB: Final = (16.8, 14.9, 13.9, 10.7, 9.5, 7.6, 7.5, 8.3, 10.2)
"""Standard deviations of the measurements there."""

BEST_DB: Final = 2.0
"""Loss beyond free space at the best elevation."""

FADING_M: Final = 30.0
"""Over this distance of the UAV the correlation of the deviations falls to 1/e."""


class MeasuredLink:
    """What vehicles in the air and robots on the ground lose on the way to each other.

    Args:
        carrier_ghz: Frequency.
        seed: Chooses the deviations.
    """

    def __init__(self, carrier_ghz: float, seed: int) -> None:
        self.carrier_ghz = carrier_ghz
        self._fading = PlaceField(FADING_M, f"{seed} measured")

    def loss_db(self, air: Numbers, ground: Numbers) -> Numbers:
        """Loss of all pairs of places, by air and ground; fading is cut at 3 deviations."""
        ways = air[:, None] - ground
        away_m = np.sqrt((ways**2).sum(axis=2))
        flat_m = np.hypot(ways[..., 0], ways[..., 1])
        elevation_deg = np.degrees(np.arctan2(ways[..., 2], flat_m))
        mean_db = BEST_DB + np.interp(elevation_deg, ELEVATIONS_DEG, EXCESS_DB)
        deviation_db = np.interp(elevation_deg, ELEVATIONS_DEG, DEVIATIONS_DB)
        fading = np.clip(self._fading.at(air, ground), -SHADOWING_LIMIT, SHADOWING_LIMIT)
        loss_db: Numbers = free_space_db(away_m, self.carrier_ghz) + mean_db + fading * deviation_db
        return loss_db


def air_loss(model: AirModel, carrier_ghz: float, seed: int) -> AirLoss:
    """The links between air and ground of a model."""
    if model == "aerpaw":
        return MeasuredLink(carrier_ghz, seed)
    return AirToGround(model, carrier_ghz, seed)
