"""What there is to be seen of a simulated flight: its true state, its phases, and its end."""

from __future__ import annotations

from typing import Final

from sitl.mavlink import ONBOARD_RATES_HZ
from sitl.px4sim import Autopilot, FlightMode
from sitl.rehearsal.companion import Companion
from sitl.rehearsal.judge import Sample

_RECEIVED: Final = (
    *("HEARTBEAT", "SYS_STATUS", "SYSTEM_TIME", "GPS_RAW_INT", "GLOBAL_POSITION_INT"),
    *("HOME_POSITION", "EXTENDED_SYS_STATE", "CURRENT_MODE", "POSITION_TARGET_GLOBAL_INT"),
)
_FEWER_HZ: Final = {"GLOBAL_POSITION_INT": 10.0, "POSITION_TARGET_GLOBAL_INT": 2.0}
RATES_HZ: Final = {name: ONBOARD_RATES_HZ[name] for name in _RECEIVED} | _FEWER_HZ
"""PX4's rates, of the messages that a companion reads; positions as it requests them."""

MOST_S: Final = 600.0
LANDS: Final = frozenset({FlightMode.AUTO_LAND, FlightMode.AUTO_RTL})
"""Modes that end on the ground: the companion's last announcements are waited for."""

PILOT_S: Final = 25.0
"""For so long a pilot (or nothing) is watched after the vehicle was given away."""

LANDED_S: Final = 10.0
"""What a companion gets to end its flight once the vehicle is disarmed."""

_REFUSED_S: Final = 5.1
"""A companion that has ended until then, and left the vehicle disarmed, was refused."""


def true_degrees(autopilot: Autopilot) -> tuple[float, float]:
    """Where the vehicle really is: latitude and longitude."""
    airframe = autopilot.airframe
    return autopilot.situation.projection.to_global(airframe.north_m, airframe.east_m)


def true_state(autopilot: Autopilot, now_s: float) -> Sample:
    """The vehicle as it really is at a simulated time."""
    return Sample(
        now_s,
        *true_degrees(autopilot),
        autopilot.place.altitude_m + autopilot.airframe.up_m,
        autopilot.armed,
        autopilot.airframe.on_ground,
        autopilot.mode.custom_mode,
        autopilot.failsafe.acting,
    )


def phases(autopilot: Autopilot, companion: Companion | None) -> list[str]:
    """The phases of its flight that a vehicle is in, by the names of `faults.PHASES`."""
    found = ["armed"] if autopilot.armed else []
    if autopilot.taking_off:
        found.append("climb")
    if autopilot.landing:
        found.append("landing")
    if companion is not None:
        found.append(companion.flight.controller.state.name)
    return found


class Ending:
    """Follows a flight to its end.

    Attributes:
        flown: Whether the vehicle was armed.
    """

    def __init__(self) -> None:
        self.flown = False
        self._disarmed_s: float | None = None  # after a flight; None again once it is armed
        self._given_away_s: float | None = None  # since then no companion has it, or will

    def has_come(self, now_s: float, in_charge: bool | None, *, armed: bool, done: bool) -> bool:
        """Look at it, some times a second.

        Args:
            now_s: Simulated seconds.
            in_charge: Whether the companion holds the vehicle for its own; None: there is none.
            armed: Whether the vehicle is.
            done: Whether everything that can happen has happened, and it does not come down.
        """
        if armed:
            self.flown, self._disarmed_s = True, None
        elif self.flown and self._disarmed_s is None:
            self._disarmed_s = now_s
        if now_s > MOST_S or (self._disarmed_s is not None and now_s > self._disarmed_s + LANDED_S):
            return True
        if in_charge is None and not self.flown and now_s > _REFUSED_S:
            return True
        given_away = in_charge is None or (self.flown and not in_charge)
        if not given_away or not done or not armed:
            self._given_away_s = None
        elif self._given_away_s is None:
            self._given_away_s = now_s
        return self._given_away_s is not None and now_s > self._given_away_s + PILOT_S
