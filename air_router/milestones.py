"""What the controller watches for: the end of the take-off, reasons to return, silence."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from air_router.vehicle import FlightMode

if TYPE_CHECKING:
    from air_router.mission import Mission
    from air_router.vehicle import Telemetry

_ALTITUDE_M: Final = 2.0
"""PX4 corrects its home altitude in flight, so that an altitude above home is good to this."""

_TOLD_S: Final = 10.0
"""How often a silence that goes on is told, wall-clock seconds."""


def took_off(mission: Mission, telemetry: Telemetry) -> bool:
    """Whether the vehicle hovers above home in Mission mode, where the take-off ends."""
    radius_m = mission.planner.acceptance_radius_m + 1.0
    altitude_m = mission.altitude_above_home_m
    return (
        telemetry.in_air
        and telemetry.mode is FlightMode.MISSION
        and math.dist(telemetry.position, mission.home) <= radius_m
        and telemetry.altitude_m >= altitude_m - min(_ALTITUDE_M, altitude_m / 2)
    )


def reason_to_return(mission: Mission, telemetry: Telemetry, airborne_s: float) -> str | None:
    """Why the vehicle comes home now, `airborne_s` seconds after take-off; None to stay out."""
    if telemetry.battery is not None and telemetry.battery <= mission.battery_reserve:
        return f"battery at {telemetry.battery:.0%}"
    if mission.duration_s is not None and airborne_s >= mission.duration_s:
        return f"{mission.duration_s:.0f} s of mission are over"
    return None


class Silence:
    """What is told of a vehicle that is not heard: at once, then now and then."""

    def __init__(self) -> None:
        self._told_s = 0.0

    def news(self, silent_s: float) -> str | None:
        """What to tell after `silent_s` wall-clock seconds without a word; None: no news."""
        if silent_s < self._told_s:
            self._told_s = 0.0  # it was heard meanwhile: another silence
        if self._told_s > 0.0 and silent_s < self._told_s + _TOLD_S:
            return None
        self._told_s = silent_s
        return f"nothing heard from the vehicle for {silent_s:.0f} s"
