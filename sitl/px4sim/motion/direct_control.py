"""Flying by what is asked for directly: Offboard setpoints and sticks, without a smooth path.

PX4's position controller makes a velocity of a position error in proportion (MPC_XY_P, MPC_Z_P),
up to the vehicle's greatest speed: faster than its automatic modes fly, and with more overshoot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from sitl.px4sim.motion.dynamics import Limits, Wanted

_XY_GAIN: Final = 0.95
_Z_GAIN: Final = 1.0
_AGILE: Final = Limits(
    acceleration_m_s2=8.0,
    jerk_m_s3=20.0,
    climb_acceleration_m_s2=5.0,
    sink_acceleration_m_s2=5.0,
    vertical_jerk_m_s3=20.0,
)

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Direct:
    """What is asked for; None leaves an axis to the others, or at rest.

    Attributes:
        position: North, east in metres.
        altitude_m: AMSL.
        velocity: North, east in m/s; with a position it is added.
        up_m_s: With an altitude it is added.
        yaw_rad: Heading.
        yaw_rate_rad_s: Turning, where there is no heading.
    """

    position: Pair | None = None
    altitude_m: float | None = None
    velocity: Pair | None = None
    up_m_s: float | None = None
    yaw_rad: float | None = None
    yaw_rate_rad_s: float = 0.0

    @property
    def lifts(self) -> bool:
        """Whether a vehicle on the ground would take off for it."""
        return self.altitude_m is not None or (self.up_m_s or 0.0) > 0.0


@dataclass(frozen=True, slots=True)
class Reach:
    """The greatest speeds: MPC_XY_VEL_MAX, MPC_Z_VEL_MAX_UP and MPC_Z_VEL_MAX_DN, in m/s."""

    horizontal_m_s: float = 12.0
    up_m_s: float = 3.0
    down_m_s: float = 1.5


def direct_velocity(direct: Direct, position: tuple[float, float, float], reach: Reach) -> Wanted:
    """The velocity to have now, at a position north, east in metres and altitude AMSL."""
    north_m, east_m, altitude_m = position
    north, east = direct.velocity or (0.0, 0.0)
    if direct.position is not None:
        north += _finite(direct.position[0] - north_m) * _XY_GAIN
        east += _finite(direct.position[1] - east_m) * _XY_GAIN
    speed = math.hypot(north, east)
    if speed > reach.horizontal_m_s:
        north, east = (part * reach.horizontal_m_s / speed for part in (north, east))
    up = direct.up_m_s or 0.0
    if direct.altitude_m is not None:
        up += _finite(direct.altitude_m - altitude_m) * _Z_GAIN
    return Wanted(
        north,
        east,
        max(-reach.down_m_s, min(reach.up_m_s, up)),
        direct.yaw_rad,
        direct.yaw_rate_rad_s,
        _AGILE,
    )


def _finite(value: float) -> float:
    """A position that is no number is taken as "here": the vehicle stays."""
    return value if math.isfinite(value) else 0.0
