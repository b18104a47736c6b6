"""Messages about what the vehicle is told to do, and about its motion as sensors see it."""

from __future__ import annotations

import math
from typing import Final

from sitl.mavlink.position_messages import (
    Fields,
    MessageBuilder,
    degrees_e7,
    quaternion,
)
from sitl.px4sim.motion.dynamics import GRAVITY_M_S2
from sitl.px4sim.motion.guidance import SetpointKind

_LOCAL_NED: Final = 1  # MAV_FRAME
_BODY_FRD: Final = 12
_GLOBAL_INT: Final = 5
_IDLE_US: Final = 900
_HOVER_US: Final = 1560
_ALL_IMU_FIELDS: Final = 0x1FFF
_NAN: Final = math.nan
_NO_COVARIANCE: Final = (_NAN, *(0.0,) * 20)


class ControlMessages(MessageBuilder):
    """Of targets, servos and sensors."""

    def _target(self) -> tuple[float, float, float]:
        """North, east and altitude that are flown to; NaN where there are none."""
        setpoint = self._situation.setpoint
        if setpoint.kind is SetpointKind.IDLE:
            return _NAN, _NAN, _NAN
        if setpoint.direct is not None:
            north, east = setpoint.direct.position or (_NAN, _NAN)
            altitude_m = setpoint.direct.altitude_m
            return north, east, _NAN if altitude_m is None else altitude_m
        landing = setpoint.kind is SetpointKind.LAND
        return setpoint.north_m, setpoint.east_m, _NAN if landing else setpoint.altitude_m

    def _position_target_local_ned(self) -> Fields:
        north, east, altitude_m = self._target()
        velocity_north, velocity_east, velocity_up = self._situation.velocity_m_s
        return {
            "time_boot_ms": self.boot_ms,
            "coordinate_frame": _LOCAL_NED,
            "x": north,
            "y": east,
            "z": self._autopilot.place.altitude_m - altitude_m,
            "vx": velocity_north,
            "vy": velocity_east,
            "vz": -velocity_up,
            "yaw": self._situation.heading_rad,
        }

    def _position_target_global_int(self) -> Fields | None:
        north, east, altitude_m = self._target()
        if not (math.isfinite(north) and math.isfinite(altitude_m)):
            return None
        latitude, longitude = degrees_e7(*self._situation.projection.to_global(north, east))
        return {
            "time_boot_ms": self.boot_ms,
            "coordinate_frame": _GLOBAL_INT,
            "lat_int": latitude,
            "lon_int": longitude,
            "alt": altitude_m,
            "yaw": self._situation.heading_rad,
        }

    def _servo_output_raw(self) -> Fields:
        turning = self._autopilot.armed and not self._autopilot.terminated
        pulse = _HOVER_US if turning and not self._situation.landed else _IDLE_US
        return {
            "time_usec": self.boot_us & 0xFFFFFFFF,
            **{f"servo{number}_raw": pulse if number <= 4 else 0 for number in range(1, 17)},
        }

    def _odometry(self) -> Fields:
        situation = self._situation
        north, east, up = situation.velocity_m_s
        cosine, sine = math.cos(situation.heading_rad), math.sin(situation.heading_rad)
        return {
            "time_usec": self.boot_us,
            "frame_id": _LOCAL_NED,
            "child_frame_id": _BODY_FRD,
            "x": situation.north_m,
            "y": situation.east_m,
            "z": self._autopilot.place.altitude_m - situation.altitude_m,
            "q": quaternion(*self._autopilot.airframe.attitude_rad()),
            "vx": north * cosine + east * sine,
            "vy": east * cosine - north * sine,
            "vz": -up,
            "yawspeed": self._autopilot.airframe.yaw_rate_rad_s,
            "pose_covariance": _NO_COVARIANCE,
            "velocity_covariance": _NO_COVARIANCE,
            "reset_counter": self._autopilot.errors.resets & 0xFF,
            "estimator_type": 8,
        }

    def _highres_imu(self) -> Fields:
        airframe, noise = self._autopilot.airframe, self._autopilot.errors.sensor_noise
        roll, pitch, _ = airframe.attitude_rad()
        return {
            "time_usec": self.boot_us,
            "xacc": GRAVITY_M_S2 * math.sin(pitch) + noise(0.04),
            "yacc": -GRAVITY_M_S2 * math.sin(roll) + noise(0.04),
            "zacc": -GRAVITY_M_S2 - airframe.acceleration_up_m_s2 + noise(0.05),
            "xgyro": noise(0.002),
            "ygyro": noise(0.002),
            "zgyro": airframe.yaw_rate_rad_s + noise(0.002),
            "xmag": 0.21 + noise(0.001),
            "ymag": 0.01 + noise(0.001),
            "zmag": 0.42,
            "abs_pressure": 1013.25 * (1 - 2.25577e-5 * self._situation.altitude_m) ** 5.25588,
            "pressure_alt": self._situation.altitude_m + noise(0.1),
            "temperature": 15.0,
            "fields_updated": _ALL_IMU_FIELDS,
        }
