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
_SUB_MODES: Final = MappingProxyType({mode: sub for sub, mode in _AUTO_MODES.items()})


def flight_mode(custom_mode: int) -> FlightMode:
    """The mode in HEARTBEAT.custom_mode or CURRENT_MODE.custom_mode: main and sub mode bytes."""
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    if main != MAIN_AUTO:
        return FlightMode.OTHER
    return _AUTO_MODES.get(sub, FlightMode.OTHER)


def sub_mode(mode: FlightMode) -> int:
    """The sub mode of one of the automatic modes, which is the main mode `MAIN_AUTO`.

    Raises:
        KeyError: it is none of them.
    """
    return _SUB_MODES[mode]
