"""From the target of the vehicle, or the demand of the sticks, to the velocity to have now.

The speed profile is PX4's (position smoothing of its multicopter tasks): as fast as allowed, but
never faster than lets it stop, with its acceleration and jerk limits, at the target. Between two
mission waypoints it follows their connecting line, and it does not stop at a waypoint that it
only passes.

Sticks are flown without a smooth path: PX4's position controller makes a velocity of a position
error in proportion (MPC_XY_P, MPC_Z_P), up to the vehicle's greatest speed.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

from sitl.px4sim.motion.dynamics import Limits, MotionDemand

_XY_GAIN: Final = 0.95
_Z_GAIN: Final = 1.0
_AGILE: Final = Limits(
    acceleration_m_s2=8.0,
    jerk_m_s3=20.0,
    climb_acceleration_m_s2=5.0,
    sink_acceleration_m_s2=5.0,
    vertical_jerk_m_s3=20.0,
)
_LOOK_AHEAD_M: Final = 5.0
_HEADING_DISTANCE_M: Final = 2.0


@dataclass(frozen=True, slots=True)
class Direct:
    """The demand of the sticks; None leaves an axis to the others, or at rest.

    Attributes:
        position: North, east in metres.
        altitude_m: AMSL.
        velocity_m_s: North, east; with a position it is added.
        up_m_s: With an altitude it is added.
        yaw_rate_rad_s: Turning.
    """

    position: tuple[float, float] | None = None
    altitude_m: float | None = None
    velocity_m_s: tuple[float, float] = (0.0, 0.0)
    up_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0


class SetpointKind(Enum):
    """What the autopilot wants of the position controller."""

    IDLE = "idle"
    TAKEOFF = "takeoff"
    POSITION = "position"
    LAND = "land"
    DIRECT = "direct"


_WITH_ALTITUDE: Final = frozenset({SetpointKind.TAKEOFF, SetpointKind.POSITION})


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Where to go; north, east in metres, altitudes AMSL.

    Attributes:
        kind: See `SetpointKind`.
        north_m: Target.
        east_m: Target.
        altitude_m: Target, AMSL; of no meaning for IDLE and LAND.
        previous: Start (north, east) of the line to follow; None flies straight from anywhere.
        following: Where it goes after the target (north, east); None stops there.
        yaw_rad: Heading; None points along the flight path.
        acceptance_m: How near counts as there; corners are cut by about that much.
        direct: The demand in DIRECT; the other fields do not count then.
    """

    kind: SetpointKind = SetpointKind.IDLE
    north_m: float = 0.0
    east_m: float = 0.0
    altitude_m: float = 0.0
    previous: tuple[float, float] | None = None
    following: tuple[float, float] | None = None
    yaw_rad: float | None = None
    acceptance_m: float = 2.0
    direct: Direct | None = None

    @property
    def held_altitude_m(self) -> float | None:
        """The altitude AMSL to come to and to keep; None where it only climbs or sinks."""
        if self.direct is not None:
            return self.direct.altitude_m
        return self.altitude_m if self.kind in _WITH_ALTITUDE else None


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """Speed limits in m/s and m/s2: the vehicle's parameters that shape a flight.

    Attributes:
        up_m_s: MPC_Z_V_AUTO_UP.
        down_m_s: MPC_Z_V_AUTO_DN.
        takeoff_m_s: MPC_TKO_SPEED.
        land_m_s: MPC_LAND_SPEED.
        acceleration_m_s2: MPC_ACC_HOR.
        jerk_m_s3: MPC_JERK_AUTO.
        most_m_s: MPC_XY_VEL_MAX; this and the next two limit the sticks.
        most_up_m_s: MPC_Z_VEL_MAX_UP.
        most_down_m_s: MPC_Z_VEL_MAX_DN.
    """

    up_m_s: float = 3.0
    down_m_s: float = 1.5
    takeoff_m_s: float = 1.5
    land_m_s: float = 0.7
    acceleration_m_s2: float = 3.0
    jerk_m_s3: float = 4.0
    most_m_s: float = 12.0
    most_up_m_s: float = 3.0
    most_down_m_s: float = 1.5


def approach_speed(distance_m: float, speed_limits: SpeedLimits, final_m_s: float = 0.0) -> float:
    """The greatest speed at a distance from which the wanted final speed can still be reached."""
    acceleration = speed_limits.acceleration_m_s2
    ramp = 4.0 * acceleration * acceleration / speed_limits.jerk_m_s3
    root = math.sqrt(
        ramp * ramp + 4.0 * (2.0 * acceleration * max(distance_m, 0.0) + final_m_s * final_m_s)
    )
    return max(0.5 * (root - ramp), final_m_s)


def braking_distance(speed_m_s: float, speed_limits: SpeedLimits) -> float:
    """How far ahead PX4 puts the place to hold at, on a Hold command at some speed."""
    return speed_m_s * (speed_m_s / (2.0 * speed_limits.acceleration_m_s2) + 0.6)


def wanted_velocity(
    setpoint: Setpoint,
    position: tuple[float, float, float],
    ground_altitude_m: float,
    cruise_m_s: float,
    speed_limits: SpeedLimits,
) -> MotionDemand:
    """The velocity to have now.

    Args:
        setpoint: Where to go.
        position: North, east in metres and altitude AMSL, as the autopilot believes it.
        ground_altitude_m: AMSL; landing slows down above it.
        cruise_m_s: Horizontal speed, at most.
        speed_limits: Limits.
    """
    north_m, east_m, altitude_m = position
    if setpoint.kind is SetpointKind.IDLE:
        return MotionDemand()
    if setpoint.direct is not None:
        return direct_velocity(setpoint.direct, position, speed_limits)
    to_north, to_east = setpoint.north_m - north_m, setpoint.east_m - east_m
    distance_m = math.hypot(to_north, to_east)
    speed = approach_speed(distance_m, speed_limits, _corner_speed(setpoint, speed_limits))
    speed = min(speed, cruise_m_s)
    aim_north, aim_east = _line_point(setpoint, north_m, east_m, to_north, to_east)
    aim = math.hypot(aim_north, aim_east) or 1.0
    yaw_rad = setpoint.yaw_rad
    if yaw_rad is None and distance_m > _HEADING_DISTANCE_M:
        yaw_rad = math.atan2(to_east, to_north)
    return MotionDemand(
        speed * aim_north / aim,
        speed * aim_east / aim,
        _vertical(
            setpoint, altitude_m, ground_altitude_m, distance_m / max(speed, 0.3), speed_limits
        ),
        yaw_rad,
    )


def direct_velocity(
    direct: Direct, position: tuple[float, float, float], speed_limits: SpeedLimits
) -> MotionDemand:
    """The velocity for sticks, at a position north, east in metres and altitude AMSL."""
    north_m, east_m, altitude_m = position
    north, east = direct.velocity_m_s
    if direct.position is not None:
        north += (direct.position[0] - north_m) * _XY_GAIN
        east += (direct.position[1] - east_m) * _XY_GAIN
    speed = math.hypot(north, east)
    if speed > speed_limits.most_m_s:
        north, east = (part * speed_limits.most_m_s / speed for part in (north, east))
    up = direct.up_m_s
    if direct.altitude_m is not None:
        up += (direct.altitude_m - altitude_m) * _Z_GAIN
    up = max(-speed_limits.most_down_m_s, min(speed_limits.most_up_m_s, up))
    return MotionDemand(north, east, up, None, direct.yaw_rate_rad_s, _AGILE)


def _line_point(
    setpoint: Setpoint, north_m: float, east_m: float, to_north: float, to_east: float
) -> tuple[float, float]:
    """The vector to a point a little ahead on the line to follow, or to the target."""
    if setpoint.previous is None or math.hypot(to_north, to_east) <= _LOOK_AHEAD_M:
        return to_north, to_east
    line_north = setpoint.north_m - setpoint.previous[0]
    line_east = setpoint.east_m - setpoint.previous[1]
    length_m = math.hypot(line_north, line_east)
    if length_m < 1e-3:
        return to_north, to_east
    line_north, line_east = line_north / length_m, line_east / length_m
    from_north, from_east = north_m - setpoint.previous[0], east_m - setpoint.previous[1]
    along_m = from_north * line_north + from_east * line_east
    across_m = from_east * line_north - from_north * line_east
    ahead_m = math.sqrt(max(_LOOK_AHEAD_M**2 - across_m**2, 0.0))
    reach_m = min(max(along_m + ahead_m, 0.0), length_m)
    return (
        setpoint.previous[0] + reach_m * line_north - north_m,
        setpoint.previous[1] + reach_m * line_east - east_m,
    )


def _corner_speed(setpoint: Setpoint, speed_limits: SpeedLimits) -> float:
    """How fast a waypoint may be passed: that of a circle that fits into the corner."""
    if setpoint.previous is None or setpoint.following is None:
        return 0.0
    in_north = setpoint.previous[0] - setpoint.north_m
    in_east = setpoint.previous[1] - setpoint.east_m
    out_north = setpoint.following[0] - setpoint.north_m
    out_east = setpoint.following[1] - setpoint.east_m
    lengths = math.hypot(in_north, in_east) * math.hypot(out_north, out_east)
    if lengths < 1e-6:
        return 0.0
    cosine = max(-1.0, min(1.0, (in_north * out_north + in_east * out_east) / lengths))
    tangent = math.tan(min(math.acos(cosine), math.pi - 1e-6) / 2.0)
    # PX4 turns with half of its acceleration, and its corner is the acceptance circle.
    return math.sqrt(0.5 * speed_limits.acceleration_m_s2 * setpoint.acceptance_m * tangent)


def _vertical(
    setpoint: Setpoint,
    altitude_m: float,
    ground_altitude_m: float,
    time_left_s: float,
    speed_limits: SpeedLimits,
) -> float:
    if setpoint.kind is SetpointKind.LAND:
        height_m = altitude_m - ground_altitude_m
        part = max(0.0, min(1.0, (height_m - 5.0) / 5.0))  # MPC_LAND_ALT2 .. MPC_LAND_ALT1
        return -(speed_limits.land_m_s + part * (speed_limits.down_m_s - speed_limits.land_m_s))
    missing_m = setpoint.altitude_m - altitude_m
    limit = speed_limits.down_m_s if missing_m < 0 else speed_limits.up_m_s
    if setpoint.kind is SetpointKind.TAKEOFF and missing_m > 0:
        limit = speed_limits.takeoff_m_s
    speed = min(limit, approach_speed(abs(missing_m), speed_limits))
    if setpoint.kind is SetpointKind.POSITION and time_left_s > 1.0:
        # On the way to a waypoint the height changes evenly, along the straight line to it.
        speed = min(speed, abs(missing_m) / time_left_s)
    return math.copysign(speed, missing_m)
