"""Messages about where the vehicle is and how it moves: the estimate's, and the truth's."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from sitl.mavlink.mavlink_codec import DEFINITIONS
from sitl.px4sim.autopilot import HOME_AFTER_S, Autopilot
from sitl.px4sim.positioning import FEWEST_SATELLITES

POSITION_AFTER_S: Final = 3.2
_GPS_NOISE_M: Final = 0.2
_GPS_ALTITUDE_NOISE_M: Final = 0.45

Fields = dict[str, Any]

Builders = dict[str, Callable[[], Fields | None]]
"""By message name; None means: nothing to say."""


class MessageBuilder:
    """Builds the fields of some of a vehicle's messages: a method is called as its message.

    Attributes:
        boot_ms: time_boot_ms.
        boot_us: time_usec.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._situation = autopilot.situation  # one object for ever, renewed in every step

    def builders(self) -> Builders:
        """By message name."""
        named = {name: getattr(self, f"_{name.lower()}", None) for name in DEFINITIONS}
        return {name: builder for name, builder in named.items() if builder is not None}

    @property
    def boot_ms(self) -> int:
        """Milliseconds since the start."""
        return round(self._situation.time_s * 1e3)

    @property
    def boot_us(self) -> int:
        """Microseconds since the start."""
        return round(self._situation.time_s * 1e6)


class PositionMessages(MessageBuilder):
    """Of position and attitude."""

    def _gps_raw_int(self) -> Fields:
        """What the receiver says: the truth and its own noise, not the estimate."""
        airframe, noise = self._autopilot.airframe, self._autopilot.errors.sensor_noise
        latitude, longitude = degrees_e7(
            *self._situation.projection.to_global(
                airframe.north_m + noise(_GPS_NOISE_M), airframe.east_m + noise(_GPS_NOISE_M)
            )
        )
        north, east, _ = self._situation.velocity_m_s
        altitude_m = self._autopilot.place.altitude_m + airframe.up_m + noise(_GPS_ALTITUDE_NOISE_M)
        altitude_mm = _int32(altitude_m * 1e3)
        satellites = int(self._situation.parameters.limited("SIM_GPS_USED", 0, 254))
        fix = satellites >= FEWEST_SATELLITES
        return {
            "time_usec": self.boot_us,
            "fix_type": 3 if fix else 0,
            "lat": latitude,
            "lon": longitude,
            "alt": altitude_mm,
            "eph": 70 if fix else 10000,
            "epv": 110 if fix else 10000,
            "vel": _uint16(math.hypot(north, east) * 100),
            "cog": _uint16(math.degrees(math.atan2(east, north)) % 360 * 100),
            "satellites_visible": satellites,
            "alt_ellipsoid": altitude_mm,
            "h_acc": 900 if fix else 100000,
            "v_acc": 1780 if fix else 100000,
            "vel_acc": 400,
        }

    def _attitude(self) -> Fields:
        roll, pitch, yaw = self._autopilot.airframe.attitude_rad()
        return {
            "time_boot_ms": self.boot_ms,
            "yawspeed": self._autopilot.airframe.yaw_rate_rad_s,
            "roll": roll,
            "pitch": pitch,
            "yaw": yaw,
        }

    def _attitude_quaternion(self) -> Fields:
        q1, q2, q3, q4 = quaternion(*self._autopilot.airframe.attitude_rad())
        return {
            "time_boot_ms": self.boot_ms,
            "q1": q1,
            "q2": q2,
            "q3": q3,
            "q4": q4,
            "yawspeed": self._autopilot.airframe.yaw_rate_rad_s,
        }

    def _local_position_ned(self) -> Fields:
        situation = self._situation
        north, east, up = situation.velocity_m_s
        return {
            "time_boot_ms": self.boot_ms,
            "x": situation.north_m,
            "y": situation.east_m,
            "z": self._autopilot.place.altitude_m - situation.altitude_m,
            "vx": north,
            "vy": east,
            "vz": -up,
        }

    def _global_position_int(self) -> Fields | None:
        situation = self._situation
        if situation.time_s < POSITION_AFTER_S:
            return None
        latitude, longitude = self._estimated_degrees_e7()
        north, east, up = situation.velocity_m_s
        return {
            "time_boot_ms": self.boot_ms,
            "lat": latitude,
            "lon": longitude,
            "alt": _int32(situation.altitude_m * 1e3),
            "relative_alt": _int32((situation.altitude_m - situation.home_altitude_m) * 1e3),
            "vx": _int16(north * 100),
            "vy": _int16(east * 100),
            "vz": _int16(-up * 100),
            "hdg": _uint16(math.degrees(situation.heading_rad) % 360 * 100),
        }

    def _vfr_hud(self) -> Fields:
        north, east, up = self._situation.velocity_m_s
        return {
            "airspeed": math.nan,
            "groundspeed": math.hypot(north, east),
            "heading": int(math.degrees(self._situation.heading_rad) % 360),
            "throttle": 0 if self._situation.landed else 56,
            "alt": self._situation.altitude_m,
            "climb": up,
        }

    def _altitude(self) -> Fields:
        situation = self._situation
        return {
            "time_usec": self.boot_us,
            "altitude_monotonic": situation.altitude_m,
            "altitude_amsl": situation.altitude_m,
            "altitude_local": situation.altitude_m - self._autopilot.place.altitude_m,
            "altitude_relative": situation.altitude_m - situation.home_altitude_m,
            "altitude_terrain": math.nan,
            "bottom_clearance": math.nan,
        }

    def _wind_cov(self) -> Fields | None:
        """Estimated in flight, where that is switched on."""
        autopilot = self._autopilot
        if autopilot.parameters["EKF2_DRAG_CTRL"] == 0 or self._situation.landed:
            return None
        return {
            "time_usec": self.boot_us,
            "wind_x": autopilot.wind.north_m_s,
            "wind_y": autopilot.wind.east_m_s,
            "var_horiz": 0.2,
            "wind_alt": self._situation.altitude_m,
        }

    def _home_position(self) -> Fields | None:
        situation = self._situation
        if situation.home is None or situation.time_s < HOME_AFTER_S:
            return None
        latitude, longitude = degrees_e7(*situation.projection.to_global(*situation.home))
        return {
            "latitude": latitude,
            "longitude": longitude,
            "altitude": _int32(situation.home_altitude_m * 1e3),
            "x": situation.home[0],
            "y": situation.home[1],
            "z": self._autopilot.place.altitude_m - situation.home_altitude_m,
            "q": (1.0, 0.0, 0.0, 0.0),
            "time_usec": self.boot_us,
        }

    def _hil_state_quaternion(self) -> Fields:
        airframe, place = self._autopilot.airframe, self._autopilot.place
        latitude, longitude = degrees_e7(
            *self._situation.projection.to_global(airframe.north_m, airframe.east_m)
        )
        speed = _uint16(math.hypot(airframe.velocity_north_m_s, airframe.velocity_east_m_s) * 100)
        return {
            "time_usec": self.boot_us,
            "attitude_quaternion": quaternion(*airframe.attitude_rad()),
            "lat": latitude,
            "lon": longitude,
            "alt": _int32((place.altitude_m + airframe.up_m) * 1e3),
            "vx": _int16(airframe.velocity_north_m_s * 100),
            "vy": _int16(airframe.velocity_east_m_s * 100),
            "vz": _int16(-airframe.velocity_up_m_s * 100),
            "ind_airspeed": speed,
            "true_airspeed": speed,
            "zacc": -1000,
            "yawspeed": airframe.yaw_rate_rad_s,
        }

    def _estimated_degrees_e7(self) -> tuple[int, int]:
        situation = self._situation
        return degrees_e7(*situation.projection.to_global(situation.north_m, situation.east_m))


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Of an attitude in radians: w, x, y, z."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def degrees_e7(latitude_deg: float, longitude_deg: float) -> tuple[int, int]:
    """Degrees as MAVLink has them in integers."""
    return _int32(latitude_deg * 1e7), _int32(longitude_deg * 1e7)


def _int32(value: float) -> int:
    return round(max(-2147483648.0, min(2147483647.0, value)))


def _int16(value: float) -> int:
    return round(max(-32768.0, min(32767.0, value)))


def _uint16(value: float) -> int:
    return round(max(0.0, min(65535.0, value)))
