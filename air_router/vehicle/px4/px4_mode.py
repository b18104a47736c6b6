"""PX4's custom modes (`px4_custom_mode.h`) as the flight modes that matter to a mission."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from air_router.vehicle.vehicle import FlightMode

MAIN_AUTO: Final = 4

_AUTO_MODES: Final[Mapping[int, FlightMode]] = {
    2: FlightMode.TAKEOFF,
    3: FlightMode.HOLD,
    4: FlightMode.MISSION,
    5: FlightMode.RETURN,
    6: FlightMode.LAND,
}
_MANUAL_MODES: Final = MappingProxyType({2: FlightMode.ALTITUDE, 3: FlightMode.POSITION})
_SUB_MODES: Final = MappingProxyType({mode: sub for sub, mode in _AUTO_MODES.items()})


def flight_mode(custom_mode: int) -> FlightMode:
    """The mode in HEARTBEAT.custom_mode or CURRENT_MODE.custom_mode: main and sub mode bytes."""
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    if main != MAIN_AUTO:
        return FlightMode.OTHER if sub else _MANUAL_MODES.get(main, FlightMode.OTHER)
    return _AUTO_MODES.get(sub, FlightMode.OTHER)


def sub_mode(mode: FlightMode) -> int:
    """The sub mode of one of the automatic modes, which is the main mode `MAIN_AUTO`.

    Raises:
        KeyError: it is none of them.
    """
    return _SUB_MODES[mode]


CRITICAL: Final = 5  # MAV_STATE_CRITICAL: a failsafe acts
TERMINATED: Final = 8  # MAV_STATE_FLIGHT_TERMINATION: or a kill switch
ARMED: Final = 128  # MAV_MODE_FLAG_SAFETY_ARMED

SETTLED_S: Final = 1.5
"""After so long on our clock a mode is told for itself: HEARTBEAT comes once a second."""


@dataclass(slots=True)
class ModeState:
    """Mode, arming and failsafe, from HEARTBEAT and CURRENT_MODE as they come.

    PX4 falls back to the mode from before a landing when it disarms. CURRENT_MODE, which knows
    nothing of arming, may tell that up to a second before HEARTBEAT: until then `told` stays Land,
    and another mode intended than Land is no failsafe.

    Attributes:
        mode: As told last by either.
        told: The same, but Land until it is known whether it was left by disarming.
        armed, terminated: As HEARTBEAT said last.
        failsafe: As the newer of the two says: critical, or in another mode than intended.
        known: Whether a HEARTBEAT came.
    """

    mode: FlightMode = FlightMode.OTHER
    told: FlightMode = FlightMode.OTHER
    armed: bool = False
    terminated: bool = False
    failsafe: bool = False
    known: bool = False
    _landing_left_s: float | None = None  # LAND showed its end; PX4 may disarm
    _overruled: bool = False  # it flies another mode than intended

    def heartbeat(self, fields: Mapping[str, Any]) -> bool:
        """Take a HEARTBEAT; whether the mode is another."""
        self.known = True
        self.armed = bool(fields["base_mode"] & ARMED)
        self.failsafe = fields["system_status"] >= CRITICAL
        self.terminated = fields["system_status"] == TERMINATED
        before, self.mode = self.mode, flight_mode(fields["custom_mode"])
        self._landing_left_s, self._overruled = None, False
        self.told = self.mode
        return self.mode is not before

    def current_mode(self, fields: Mapping[str, Any], now_s: float) -> bool:
        """Take a CURRENT_MODE; whether the mode is another."""
        custom, intended = fields["custom_mode"], fields.get("intended_custom_mode", 0)
        before, self.mode = self.mode, flight_mode(custom)
        self._overruled = self.armed and intended not in {0, custom}
        landed = before is FlightMode.LAND and (self._overruled or self.mode is not before)
        if landed and self._landing_left_s is None:
            self._landing_left_s = now_s
        self.settle(now_s)
        return self.mode is not before

    def settle(self, now_s: float) -> None:
        """Time goes on: a mode whose HEARTBEAT does not come is told all the same."""
        since_s = self._landing_left_s
        in_doubt = self._overruled or self.mode is not self.told
        if since_s is not None and now_s - since_s < SETTLED_S and in_doubt:
            return
        self._landing_left_s = None
        self.told = self.mode
        self.failsafe = self.failsafe or self._overruled
