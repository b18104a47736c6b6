"""Orbit mode (DO_ORBIT): circles round a point."""

from __future__ import annotations

import math
from typing import Final

from sitl.px4sim.motion.direct_control import Direct
from sitl.px4sim.motion.guidance import Setpoint, SetpointKind
from sitl.px4sim.state.situation import Situation

_RADIUS_M: Final = 10.0
_SPEED_M_S: Final = 1.0
_GAIN: Final = 0.5
_MOST_M_S2: Final = 2.0


class OrbitFlight:
    """Flies a circle with even speed, looking at its centre."""

    def __init__(self) -> None:
        self._centre: tuple[float, float] | None = None
        self._altitude_m: float | None = None
        self._radius_m = _RADIUS_M
        self._speed_m_s = _SPEED_M_S

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

    def activate(self, situation: Situation, last: Setpoint) -> None:
        """See `Flight`."""
        del last
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
