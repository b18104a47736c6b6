"""PX4's modes in HEARTBEAT, by name."""

from __future__ import annotations

from sitl.px4sim.state.px4_modes import FlightMode


def mode_name(custom_mode: int) -> str:
    """The name of a HEARTBEAT.custom_mode."""
    for mode in FlightMode:
        if mode.custom_mode == custom_mode:
            return mode.name
    return f"{custom_mode >> 16 & 0xFF}/{custom_mode >> 24 & 0xFF}"
