"""Modes that fly by what is asked for directly: Offboard, Orbit, Position and Altitude."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from sitl.px4sim.modes.auto_modes import Flight
from sitl.px4sim.motion.guidance import Direct, Setpoint, SetpointKind
from sitl.px4sim.state.px4_modes import FlightMode
from sitl.px4sim.state.situation import Situation


class OffboardFlight(Flight):
    """Flies the last setpoint that came in."""

    def __init__(self) -> None:
        self._direct = Direct()
        self._heard_s = -math.inf  # simulated time of the last setpoint

    def hear(self, direct: Direct, situation: Situation) -> None:
        """A setpoint came in."""
        self._direct, self._heard_s = direct, situation.time_s

    def available(self, situation: Situation) -> bool:
        """Whether setpoints are coming: the last one is not older than COM_OF_LOSS_T."""
        patience_s = situation.parameters.limited("COM_OF_LOSS_T", 0.0, 60.0)
        return situation.time_s - self._heard_s <= patience_s + _SLACK_S

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        if situation.landed and not self._direct.lifts:
            return Setpoint()
        return Setpoint(SetpointKind.DIRECT, direct=self._direct)


_SLACK_S: Final = 0.02


_RADIUS_M: Final = 10.0
_SPEED_M_S: Final = 1.0
_GAIN: Final = 0.5
_MOST_M_S2: Final = 2.0


class OrbitFlight(Flight):
    """Flies a circle with even speed, looking at its centre."""

    def __init__(self) -> None:
        self._centre: tuple[float, float] | None = None  # north, east; None: where it is entered
        self._altitude_m: float | None = None  # AMSL; None: as it is entered
        self._radius_m = _RADIUS_M  # negative: anticlockwise
        self._speed_m_s = _SPEED_M_S  # along the circle

    def request(
        self,
        centre: tuple[float, float] | None,
        altitude_m: float | None,
        radius_m: float,
        speed_m_s: float,
    ) -> None:
        """What is to be circled; None is where the vehicle is. A negative radius: anticlockwise."""
        self._centre, self._altitude_m = centre, altitude_m
        self._radius_m = radius_m if math.isfinite(radius_m) and radius_m else _RADIUS_M
        speed = abs(speed_m_s) if math.isfinite(speed_m_s) and speed_m_s else _SPEED_M_S
        self._speed_m_s = min(speed, math.sqrt(_MOST_M_S2 * abs(self._radius_m)))

    def activate(self, situation: Situation) -> None:
        """See `Flight`."""
        self._centre = self._centre or (situation.north_m, situation.east_m)
        if self._altitude_m is None:
            self._altitude_m = situation.altitude_m

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        if self._centre is None or situation.landed:
            return Setpoint()
        north = situation.north_m - self._centre[0]
        east = situation.east_m - self._centre[1]
        distance_m = math.hypot(north, east)
        out_north, out_east = (north / distance_m, east / distance_m) if distance_m else (1.0, 0.0)
        sense = math.copysign(1.0, self._radius_m)
        outward = (abs(self._radius_m) - distance_m) * _GAIN
        outward = max(-self._speed_m_s * 2, min(self._speed_m_s * 2, outward))
        velocity = (
            out_north * outward - out_east * sense * self._speed_m_s,
            out_east * outward + out_north * sense * self._speed_m_s,
        )
        yaw_rad = math.atan2(-east, -north)
        direct = Direct(None, self._altitude_m, velocity, None, yaw_rad)
        return Setpoint(SetpointKind.DIRECT, direct=direct)


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
        self._heard_s = -math.inf  # simulated time of the last MANUAL_CONTROL
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


class StickFlight(Flight):
    """A mode that flies by sticks.

    Args:
        pilot: Whose.
        mode: Which mode.
    """

    def __init__(self, pilot: Pilot, mode: FlightMode) -> None:
        self._pilot = pilot
        self._mode = mode
        self._place: tuple[float, float] | None = None  # north, east, held while the sticks rest
        self._altitude_m: float | None = None  # AMSL, held while the throttle rests

    def activate(self, situation: Situation) -> None:  # noqa: ARG002 - see `Flight`
        """See `Flight`."""
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
        if up == 0.0:
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
