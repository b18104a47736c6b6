"""How the simulated multirotor moves: a point mass with limited acceleration and jerk.

North, east and up in metres of a local frame whose up is zero at the ground, which is flat.
The vehicle follows a wanted velocity as well as its limits allow; who wants what is decided in
`sitl.px4sim.motion.guidance`. No clock: time comes in as a step.
"""

import math
from dataclasses import dataclass
from typing import Final

GRAVITY_M_S2: Final = 9.80665
_HELP_FELT: Final = 0.2
_ACROSS_FELT: Final = 0.2
_ON_THE_WAY_M_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Limits:
    """What the airframe can do; PX4's defaults (MPC_ACC_HOR, MPC_JERK_AUTO, ...).

    Attributes:
        acceleration_m_s2: Horizontally.
        jerk_m_s3: Horizontally: how fast the acceleration, which is the tilt, may change.
        climb_acceleration_m_s2: Up.
        sink_acceleration_m_s2: Down.
        vertical_jerk_m_s3: Up and down.
    """

    acceleration_m_s2: float = 3.0
    jerk_m_s3: float = 4.0
    climb_acceleration_m_s2: float = 4.0
    sink_acceleration_m_s2: float = 3.0
    vertical_jerk_m_s3: float = 8.0


_OWN: Final = Limits()
_YAW_RATE_RAD_S: Final = math.radians(60.0)


@dataclass(frozen=True, slots=True)
class MotionDemand:
    """What the vehicle is to do in this step.

    Attributes:
        north_m_s: Velocity over ground.
        east_m_s: Velocity over ground.
        up_m_s: Velocity.
        yaw_rad: Heading; None: turn with the rate.
        yaw_rate_rad_s: Where there is no heading.
        limits: That hold in this step; None: the airframe's own.
    """

    north_m_s: float = 0.0
    east_m_s: float = 0.0
    up_m_s: float = 0.0
    yaw_rad: float | None = None
    yaw_rate_rad_s: float = 0.0
    limits: Limits | None = None


class Multirotor:
    """Position, velocity and attitude of the airframe.

    Attributes are public to be read; only `step` changes them.
    """

    def __init__(self) -> None:
        self.north_m = self.east_m = self.up_m = 0.0  # the truth, from where it was started
        self.velocity_north_m_s = self.velocity_east_m_s = self.velocity_up_m_s = 0.0  # over ground
        self.acceleration_north_m_s2 = self.acceleration_east_m_s2 = 0.0  # without the wind's push
        self.acceleration_up_m_s2 = 0.0  # 0 when it hovers
        self.yaw_rad = 0.0  # clockwise from north, -pi to pi
        self.yaw_rate_rad_s = 0.0  # in the last step
        self.on_ground = True  # touching it; `GroundContact` decides what counts as landed

    def step(
        self,
        step_s: float,
        wanted: MotionDemand | None,
        push_m_s2: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Move on by `step_s`.

        Args:
            step_s: Seconds.
            wanted: What it is to do; None means that the motors are off.
            push_m_s2: What the wind does to it, north and east.
        """
        if wanted is None:
            self._fall(step_s)
        else:
            self._follow(step_s, wanted)
        if not self.on_ground:
            north, east = push_m_s2 if wanted is None else self._felt(push_m_s2, wanted)
            self.velocity_north_m_s += north * step_s
            self.velocity_east_m_s += east * step_s
        self.north_m += self.velocity_north_m_s * step_s
        self.east_m += self.velocity_east_m_s * step_s
        self.up_m += self.velocity_up_m_s * step_s
        self.on_ground = self.up_m <= 0.0
        if self.on_ground:
            self._touch_ground()

    def attitude_rad(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw: the tilt that makes the present acceleration."""
        cos_yaw, sin_yaw = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        north, east = self.acceleration_north_m_s2, self.acceleration_east_m_s2
        forward = north * cos_yaw + east * sin_yaw
        right = east * cos_yaw - north * sin_yaw
        return (
            math.atan2(right, GRAVITY_M_S2),
            -math.atan2(forward, GRAVITY_M_S2),
            self.yaw_rad,
        )

    def _felt(self, push_m_s2: tuple[float, float], wanted: MotionDemand) -> tuple[float, float]:
        """How much of a push is felt.

        A push that helps acts in part: the controller lowers the thrust. So does one from the side:
        the controller holds the line.
        """
        north, east = push_m_s2
        missing_north = wanted.north_m_s - self.velocity_north_m_s
        missing_east = wanted.east_m_s - self.velocity_east_m_s
        if north * missing_north + east * missing_east > 0:
            return north * _HELP_FELT, east * _HELP_FELT
        speed = math.hypot(wanted.north_m_s, wanted.east_m_s)
        if speed < _ON_THE_WAY_M_S:
            return push_m_s2
        way_north, way_east = wanted.north_m_s / speed, wanted.east_m_s / speed
        along = north * way_north + east * way_east
        return (
            along * way_north + (north - along * way_north) * _ACROSS_FELT,
            along * way_east + (east - along * way_east) * _ACROSS_FELT,
        )

    def _follow(self, step_s: float, wanted: MotionDemand) -> None:
        limits = wanted.limits or _OWN
        missing_north = wanted.north_m_s - self.velocity_north_m_s
        missing_east = wanted.east_m_s - self.velocity_east_m_s
        missing = math.hypot(missing_north, missing_east)
        gain = _acceleration(missing, limits.acceleration_m_s2, limits.jerk_m_s3) / (missing or 1.0)
        change_north = missing_north * gain - self.acceleration_north_m_s2
        change_east = missing_east * gain - self.acceleration_east_m_s2
        change = math.hypot(change_north, change_east)
        allowed = limits.jerk_m_s3 * step_s
        part = 1.0 if change <= allowed else allowed / change
        self.acceleration_north_m_s2 += change_north * part
        self.acceleration_east_m_s2 += change_east * part
        self.velocity_north_m_s += self.acceleration_north_m_s2 * step_s
        self.velocity_east_m_s += self.acceleration_east_m_s2 * step_s
        self._follow_vertically(step_s, wanted.up_m_s, limits)
        self._turn(step_s, wanted)

    def _follow_vertically(self, step_s: float, up_m_s: float, limits: Limits) -> None:
        missing = up_m_s - self.velocity_up_m_s
        most = limits.climb_acceleration_m_s2 if missing > 0 else limits.sink_acceleration_m_s2
        aim = math.copysign(_acceleration(abs(missing), most, limits.vertical_jerk_m_s3), missing)
        allowed = limits.vertical_jerk_m_s3 * step_s
        change = max(-allowed, min(allowed, aim - self.acceleration_up_m_s2))
        self.acceleration_up_m_s2 += change
        self.velocity_up_m_s += self.acceleration_up_m_s2 * step_s

    def _turn(self, step_s: float, wanted: MotionDemand) -> None:
        if wanted.yaw_rad is None:
            self.yaw_rate_rad_s = wanted.yaw_rate_rad_s
            self.yaw_rad = math.remainder(self.yaw_rad + self.yaw_rate_rad_s * step_s, math.tau)
            return
        missing = math.remainder(wanted.yaw_rad - self.yaw_rad, math.tau)
        most = _YAW_RATE_RAD_S * step_s
        turn = max(-most, min(most, missing * min(1.0, 3.0 * step_s)))
        self.yaw_rate_rad_s = turn / step_s
        self.yaw_rad = math.remainder(self.yaw_rad + turn, math.tau)

    def _fall(self, step_s: float) -> None:
        self.acceleration_north_m_s2 = self.acceleration_east_m_s2 = 0.0
        self.acceleration_up_m_s2 = self.yaw_rate_rad_s = 0.0
        if not self.on_ground:
            self.velocity_up_m_s = max(self.velocity_up_m_s - GRAVITY_M_S2 * step_s, -50.0)

    def _touch_ground(self) -> None:
        self.up_m = 0.0
        self.velocity_north_m_s = self.velocity_east_m_s = 0.0
        self.acceleration_north_m_s2 = self.acceleration_east_m_s2 = 0.0
        self.velocity_up_m_s = max(self.velocity_up_m_s, 0.0)
        self.acceleration_up_m_s2 = max(self.acceleration_up_m_s2, 0.0)


def _acceleration(missing_m_s: float, most_m_s2: float, jerk_m_s3: float) -> float:
    """The acceleration with which a missing speed is made up for without overshoot.

    It falls with the square root of the missing speed, so that it can reach zero, at half the jerk
    limit, when nothing is missing any more; and linearly near the end, so that it settles.
    """
    return min(most_m_s2, math.sqrt(jerk_m_s3 * missing_m_s), 2.5 * missing_m_s)
