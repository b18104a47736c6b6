"""A pilot's sticks (MANUAL_CONTROL) and the modes that fly by them.

Position and Altitude follow PX4's; Stabilized, Manual and Acro are flown alike here, as a vehicle
that keeps level: throttle is climb, the other sticks tilt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from sitl.px4sim.motion.direct_control import Direct
from sitl.px4sim.motion.guidance import Setpoint, SetpointKind
from sitl.px4sim.state.px4_modes import FlightMode
from sitl.px4sim.state.situation import Situation

_DEAD_ZONE: Final = 0.1
_EXPONENT: Final = 0.6
_SLOW_M_S: Final = 0.3
_TILT_SPEED_M_S: Final = 12.0
_YAW_RATE_RAD_S: Final = math.radians(150.0)
_TAKE_OFF: Final = 0.6


@dataclass(frozen=True, slots=True)
class Sticks:
    """Where the sticks are: -1 to 1, throttle too (0 is its middle); pitch forward is positive."""

    pitch: float = 0.0
    roll: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0


class Pilot:
    """What is known of the pilot's sticks.

    Attributes:
        sticks: As heard last.
    """

    def __init__(self) -> None:
        self.sticks = Sticks()
        self._heard_s = -math.inf
        self._rest = Sticks()

    def hear(self, sticks: Sticks, situation: Situation) -> None:
        """MANUAL_CONTROL came in."""
        if not self.present(situation):
            self._rest = sticks
        self.sticks, self._heard_s = sticks, situation.time_s

    def present(self, situation: Situation) -> bool:
        """Whether sticks are heard: COM_RC_IN_MODE lets joysticks in, COM_RC_LOSS_T is patience."""
        if int(situation.parameters["COM_RC_IN_MODE"]) == _NO_STICKS:
            return False
        patience_s = situation.parameters.limited("COM_RC_LOSS_T", 0.0, 60.0)
        return situation.time_s - self._heard_s <= patience_s

    def takes_over(self, situation: Situation) -> bool:
        """Whether the sticks are moved so far that a pilot means it (COM_RC_STICK_OV)."""
        if not self.present(situation):
            return False
        threshold = situation.parameters.limited("COM_RC_STICK_OV", 5.0, 80.0) / 100.0
        now, rest = self.sticks, self._rest
        moved = max(abs(now.pitch - rest.pitch), abs(now.roll - rest.roll), abs(now.yaw - rest.yaw))
        return moved > threshold


class StickFlight:
    """A mode that flies by sticks.

    Args:
        pilot: Whose.
        mode: Which mode.
    """

    def __init__(self, pilot: Pilot, mode: FlightMode) -> None:
        self._pilot = pilot
        self._mode = mode
        self._place: tuple[float, float] | None = None
        self._altitude_m: float | None = None

    def activate(self, situation: Situation, last: Setpoint) -> None:
        """See `Flight`."""
        del last
        situation.speed_m_s = None
        self._place = self._altitude_m = None

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        sticks = self._pilot.sticks if self._pilot.present(situation) else Sticks()
        if situation.landed and sticks.throttle < _TAKE_OFF:
            return Setpoint()
        position, velocity = self._horizontal(sticks, situation)
        altitude_m, up_m_s = self._vertical(sticks, situation)
        turn = shaped(sticks.yaw) * _YAW_RATE_RAD_S
        direct = Direct(position, altitude_m, velocity, up_m_s, None, turn)
        return Setpoint(SetpointKind.DIRECT, direct=direct)

    def _horizontal(
        self, sticks: Sticks, situation: Situation
    ) -> tuple[tuple[float, float] | None, tuple[float, float]]:
        """Position and velocity."""
        holds = self._mode is FlightMode.POSCTL
        most = situation.parameters.limited("MPC_VEL_MANUAL", 3.0, 20.0)
        speed = most if holds else _TILT_SPEED_M_S
        forward, right = shaped(sticks.pitch) * speed, shaped(sticks.roll) * speed
        if holds and forward == right == 0.0:
            north, east, _ = situation.velocity_m_s
            if self._place is None and math.hypot(north, east) < _SLOW_M_S:
                self._place = (situation.north_m, situation.east_m)
            return self._place, (0.0, 0.0)
        self._place = None
        cosine, sine = math.cos(situation.heading_rad), math.sin(situation.heading_rad)
        return None, (forward * cosine - right * sine, forward * sine + right * cosine)

    def _vertical(self, sticks: Sticks, situation: Situation) -> tuple[float | None, float | None]:
        up = shaped(sticks.throttle)
        if up == 0.0 and self._mode in _KEEP_HEIGHT:
            if self._altitude_m is None and abs(situation.velocity_m_s[2]) < _SLOW_M_S:
                self._altitude_m = situation.altitude_m
            return self._altitude_m, 0.0
        self._altitude_m = None
        name = "MPC_Z_VEL_MAX_UP" if up > 0 else "MPC_Z_VEL_MAX_DN"
        return None, up * situation.parameters.limited(name, 0.5, 8.0)


def shaped(value: float) -> float:
    """A stick as PX4 shapes it: a dead zone in the middle, then finer there than at the end."""
    sign = math.copysign(1.0, value)
    part = (min(abs(value), 1.0) - _DEAD_ZONE) / (1.0 - _DEAD_ZONE)
    if part <= 0.0:
        return 0.0
    return sign * ((1.0 - _EXPONENT) * part + _EXPONENT * part**3)


_NO_STICKS: Final = 4  # COM_RC_IN_MODE
_KEEP_HEIGHT: Final = frozenset({FlightMode.POSCTL, FlightMode.ALTCTL})
