"""Altitude limits of zones as files have them, and what they mean above home."""

import math
from dataclasses import dataclass
from enum import StrEnum

from geo.airspace.zone import Band


class Reference(StrEnum):
    """What an altitude counts from: the ground at home, the sea, or the ground below."""

    HOME = "home"
    AMSL = "amsl"
    GROUND = "ground"


_WORDS = {Reference.HOME: "home", Reference.AMSL: "the sea", Reference.GROUND: "ground"}


@dataclass(frozen=True, slots=True)
class AltitudeLimit:
    """An altitude, in metres above a reference."""

    metres: float
    reference: Reference = Reference.HOME

    def __str__(self) -> str:
        return f"{self.metres:g} m above {_WORDS[self.reference]}"

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

    lower: AltitudeLimit | None = None
    upper: AltitudeLimit | None = None

    def band(self, home_amsl_m: float | None, terrain_relief_m: float) -> Band:
        """The band above home that is sure to hold these altitudes.

        The ground below may lie `terrain_relief_m` higher or lower than the ground at home. Limits
        of different references that leave nothing between them (see `contradicts`) are none: the
        file says which altitudes it means for a place that is higher or lower than home.

        Raises:
            HomeAltitudeError: as `Limit.range_above_home`.
            ZoneError: the upper limit lies below the lower one, both from the same reference.
        """
        if self.contradicts(home_amsl_m, terrain_relief_m):
            return Band()
        return Band(*self._range(home_amsl_m, terrain_relief_m))

    def contradicts(self, home_amsl_m: float | None, terrain_relief_m: float) -> bool:
        """Whether limits that count from different references exclude each other at home.

        Raises:
            HomeAltitudeError: as `Limit.range_above_home`.
        """
        if self.lower is None or self.upper is None:
            return False
        lower_m, upper_m = self._range(home_amsl_m, terrain_relief_m)
        return self.lower.reference is not self.upper.reference and lower_m > upper_m

    def _range(self, home_amsl_m: float | None, terrain_relief_m: float) -> tuple[float, float]:
        lower_m, upper_m = -math.inf, math.inf
        if self.lower is not None:
            lower_m, _ = self.lower.range_above_home(home_amsl_m, terrain_relief_m)
        if self.upper is not None:
            _, upper_m = self.upper.range_above_home(home_amsl_m, terrain_relief_m)
        return lower_m, upper_m
