"""PX4's custom modes (`px4_custom_mode.h`) as the flight modes that matter to a mission."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from air_router.vehicle import FlightMode

MAIN_AUTO: Final = 4

_AUTO_MODES: Final = MappingProxyType(
    {
        2: FlightMode.TAKEOFF,
        3: FlightMode.HOLD,
        4: FlightMode.MISSION,
        5: FlightMode.RETURN,
        6: FlightMode.LAND,
    }
)


def flight_mode(custom_mode: int) -> FlightMode:
    """The mode in HEARTBEAT.custom_mode or CURRENT_MODE.custom_mode: main and sub mode bytes."""
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    if main != MAIN_AUTO:
        return FlightMode.OTHER
    return _AUTO_MODES.get(sub, FlightMode.OTHER)
