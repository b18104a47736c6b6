"""Altitude limits of zones as files have them, and what they mean above home."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from geo.zone import Band


class Reference(StrEnum):
    """What an altitude counts from: the ground at home, the sea, or the ground below."""

    HOME = "home"
    AMSL = "amsl"
    GROUND = "ground"


@dataclass(frozen=True, slots=True)
class Limit:
    """An altitude, in metres above a reference."""

    metres: float
    reference: Reference = Reference.HOME

    def range_above_home(
        self, home_amsl_m: float | None, terrain_relief_m: float
    ) -> tuple[float, float]:
        """Between which altitudes above home it may lie.

        Raises:
            HomeAltitudeError: it counts from the sea, and home's altitude is not known.
        """
        if self.reference is Reference.AMSL:
            if home_amsl_m is None:
                raise HomeAltitudeError
            return self.metres - home_amsl_m, self.metres - home_amsl_m
        relief_m = terrain_relief_m if self.reference is Reference.GROUND else 0.0
        return self.metres - relief_m, self.metres + relief_m


class HomeAltitudeError(ValueError):
    """An altitude above the sea says nothing without that of home."""


@dataclass(frozen=True, slots=True)
class Altitudes:
    """From a lower to an upper limit; None: from the ground up, or without end."""

    lower: Limit | None = None
    upper: Limit | None = None

    def band(self, home_amsl_m: float | None, terrain_relief_m: float) -> Band:
        """The band above home that is sure to hold these altitudes.

        The ground below may lie `terrain_relief_m` higher or lower than the ground at home.

        Raises:
            HomeAltitudeError: as `Limit.range_above_home`.
            ZoneError: the upper limit lies below the lower one.
        """
        lower_m, upper_m = -math.inf, math.inf
        if self.lower is not None:
            lower_m, _ = self.lower.range_above_home(home_amsl_m, terrain_relief_m)
        if self.upper is not None:
            _, upper_m = self.upper.range_above_home(home_amsl_m, terrain_relief_m)
        return Band(lower_m, upper_m)
