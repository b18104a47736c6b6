"""The MAVLink commands sent to a PX4."""

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from air_router.vehicle import FlightMode
from air_router.vehicle.px4.mavlink_values import (
    CUSTOM_MODE,
    GLOBAL_INT,
    GROUND_SPEED,
    MAIN_AUTO,
    NOWHERE,
    MavCmd,
)
from air_router.vehicle.px4.px4_streams import sub_mode

UNUSED: Final = math.nan
"""The value of a parameter that is not used."""


class Target(NamedTuple):
    """A place on Earth: degrees times ten million, altitude in meters above mean sea level."""

    latitude_deg_e7: int
    longitude_deg_e7: int
    altitude_amsl_m: float


@dataclass(frozen=True, slots=True)
class Px4Order:
    """One command.

    Attributes:
        words: The command as text, for the beginning of a message.
        leads_to: The vehicle's mode once it follows.
        command: MAV_CMD.
        params: param1 to param4; to param7 without a target.
        target: Its destination; None: sent as COMMAND_LONG.
    """

    words: str
    leads_to: FlightMode
    command: int
    params: tuple[float, ...]
    target: Target | None = None

    @property
    def moves(self) -> bool:
        """Whether it changes the mode or the vehicle's destination."""
        return self.command not in {MavCmd.DO_CHANGE_SPEED, MavCmd.COMPONENT_ARM_DISARM}

    @property
    def only_in_hold(self) -> bool:
        """Whether PX4 accepts it in Hold mode only, because it changes no mode."""
        return self.command == MavCmd.DO_REPOSITION and not self.params[1]

    def wire(self, confirmation: int) -> tuple[str, dict[str, Any]]:
        """Name and fields of the message; `confirmation` counts earlier transmissions."""
        values = {f"param{n}": _plain(value) for n, value in enumerate(self.params, start=1)}
        fields = {"command": self.command, **values}
        if self.target is None:
            return "COMMAND_LONG", {**fields, "confirmation": confirmation}
        x, y, z = self.target
        frame = {"frame": GLOBAL_INT, "current": 0, "autocontinue": 0}
        return "COMMAND_INT", {**fields, **frame, "x": x, "y": y, "z": _plain(z)}


def set_current(item: int) -> tuple[str, dict[str, Any]]:
    """The message (not a command) that sets the current plan item."""
    return "MISSION_SET_CURRENT", {"seq": item}


def choose(mode: FlightMode) -> Px4Order:
    """Enter Mission or Hold mode."""
    params = (CUSTOM_MODE, float(MAIN_AUTO), float(sub_mode(mode)), 0.0, 0.0, 0.0, 0.0)
    return Px4Order(f"{mode.value} mode", mode, MavCmd.DO_SET_MODE, params)


def arm(mode: FlightMode) -> Px4Order:
    """Arm in the current mode."""
    return Px4Order("arming", mode, MavCmd.COMPONENT_ARM_DISARM, (1.0, *(0.0,) * 6))


def land() -> Px4Order:
    """Land here."""
    params = (0.0, 0.0, 0.0, UNUSED, UNUSED, UNUSED, UNUSED)
    return Px4Order("Land mode", FlightMode.LAND, MavCmd.NAV_LAND, params)


def change_speed(speed_m_s: float) -> Px4Order:
    """Set the ground speed of missions, until the mode changes."""
    params = (GROUND_SPEED, speed_m_s, -1.0, 0.0, 0.0, 0.0, 0.0)
    return Px4Order(
        f"a speed of {speed_m_s:.1f} m/s", FlightMode.MISSION, MavCmd.DO_CHANGE_SPEED, params
    )


def reposition(
    latitude_deg: float,
    longitude_deg: float,
    altitude_amsl_m: float,
    speed_m_s: float,
    *,
    change_mode: bool = True,
) -> Px4Order:
    """Fly straight to a place (WGS 84) and hover there in Hold mode; the heading stays.

    Without a change of mode PX4 accepts it only in Hold mode.
    """
    target = Target(round(latitude_deg * 1e7), round(longitude_deg * 1e7), altitude_amsl_m)
    params = (speed_m_s, float(change_mode), 0.0, UNUSED)
    return Px4Order("a reposition", FlightMode.HOLD, MavCmd.DO_REPOSITION, params, target)


def stop(*, change_mode: bool = True) -> Px4Order:
    """Stop and hover here in Hold mode, also from Hold mode: a reposition without a place."""
    params = (-1.0, float(change_mode), 0.0, UNUSED)
    target = Target(NOWHERE, NOWHERE, UNUSED)
    return Px4Order("a stop", FlightMode.HOLD, MavCmd.DO_REPOSITION, params, target)


def _plain(value: float) -> float | None:
    """A JSON number: None if it is not finite."""
    return None if math.isnan(value) else value
