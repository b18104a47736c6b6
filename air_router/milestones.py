"""What the controller watches for in telemetry: the take-off is done, it is time to come home."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from air_router.vehicle import FlightMode

if TYPE_CHECKING:
    from air_router.mission import Mission
    from air_router.vehicle import Telemetry

_ALTITUDE_M: Final = 2.0
"""PX4 corrects its home altitude in flight, so that an altitude above home is good to this."""


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
