"""Messages about where the vehicle is and how it moves: the estimate's, and the truth's.

Each function makes the fields of the message that is called as it is, but for the vehicle's clock;
None: nothing to send.
"""

import math
from typing import Any, Final

from sitl.px4sim import FEWEST_SATELLITES, HOME_AFTER_S, Autopilot
from sitl.px4sim.motion import SetpointKind

POSITION_AFTER_S: Final = 3.2
_GPS_NOISE_M: Final = 0.2
_GPS_ALTITUDE_NOISE_M: Final = 0.45
_GLOBAL_INT: Final = 5  # MAV_FRAME

Fields = dict[str, Any]


def gps_raw_int(autopilot: Autopilot) -> Fields:
    """The receiver's output: the truth with its own noise, not the estimate."""
    airframe, noise = autopilot.airframe, autopilot.errors.sensor_noise
    latitude, longitude = _degrees_e7(
        autopilot, airframe.north_m + noise(_GPS_NOISE_M), airframe.east_m + noise(_GPS_NOISE_M)
    )
    north, east, _ = autopilot.situation.velocity_m_s
    altitude_m = autopilot.place.altitude_m + airframe.up_m + noise(_GPS_ALTITUDE_NOISE_M)
    satellites = int(autopilot.parameters.limited("SIM_GPS_USED", 0, 254))
    fix = satellites >= FEWEST_SATELLITES
    return {
        "fix_type": 3 if fix else 0,
        "lat": latitude,
        "lon": longitude,
        "alt": _int32(altitude_m * 1e3),
        "eph": 70 if fix else 10000,
        "epv": 110 if fix else 10000,
        "vel": _uint16(math.hypot(north, east) * 100),
        "cog": _uint16(math.degrees(math.atan2(east, north)) % 360 * 100),
        "satellites_visible": satellites,
        "alt_ellipsoid": _int32(altitude_m * 1e3),
        "h_acc": 900 if fix else 100000,
        "v_acc": 1780 if fix else 100000,
        "vel_acc": 400,
    }


def attitude(autopilot: Autopilot) -> Fields:
    """In radians."""
    roll, pitch, yaw = autopilot.airframe.attitude_rad()
    return {
        "roll": roll,
        "pitch": pitch,
        "yaw": yaw,
        "yawspeed": autopilot.airframe.yaw_rate_rad_s,
    }


def local_position_ned(autopilot: Autopilot) -> Fields:
    """From where it was started."""
    situation = autopilot.situation
    north, east, up = situation.velocity_m_s
    return {
        "x": situation.north_m,
        "y": situation.east_m,
        "z": autopilot.place.altitude_m - situation.altitude_m,
        "vx": north,
        "vy": east,
        "vz": -up,
    }


def global_position_int(autopilot: Autopilot) -> Fields | None:
    """Not before the estimate has settled."""
    situation = autopilot.situation
    if situation.time_s < POSITION_AFTER_S:
        return None
    latitude, longitude = _degrees_e7(autopilot, *situation.here)
    north, east, up = situation.velocity_m_s
    return {
        "lat": latitude,
        "lon": longitude,
        "alt": _int32(situation.altitude_m * 1e3),
        "relative_alt": _int32((situation.altitude_m - situation.home_altitude_m) * 1e3),
        "vx": _int16(north * 100),
        "vy": _int16(east * 100),
        "vz": _int16(-up * 100),
        "hdg": _uint16(math.degrees(situation.heading_rad) % 360 * 100),
    }


def position_target_global_int(autopilot: Autopilot) -> Fields | None:
    """The setpoint, where it is a position."""
    setpoint = autopilot.situation.setpoint
    target = (setpoint.north_m, setpoint.east_m, setpoint.altitude_m)
    if setpoint.direct is not None:
        if setpoint.direct.position is None or setpoint.direct.altitude_m is None:
            return None
        target = (*setpoint.direct.position, setpoint.direct.altitude_m)
    elif setpoint.kind in (SetpointKind.IDLE, SetpointKind.LAND):
        return None
    north_m, east_m, altitude_m = target
    if not math.isfinite(altitude_m):
        return None
    latitude, longitude = _degrees_e7(autopilot, north_m, east_m)
    return {
        "coordinate_frame": _GLOBAL_INT,
        "lat_int": latitude,
        "lon_int": longitude,
        "alt": altitude_m,
        "yaw": autopilot.situation.heading_rad,
    }


def vfr_hud(autopilot: Autopilot) -> Fields:
    """Without an airspeed."""
    situation = autopilot.situation
    north, east, up = situation.velocity_m_s
    return {
        "airspeed": math.nan,
        "groundspeed": math.hypot(north, east),
        "heading": int(math.degrees(situation.heading_rad) % 360),
        "throttle": 0 if situation.landed else 56,
        "alt": situation.altitude_m,
        "climb": up,
    }


def altitude(autopilot: Autopilot) -> Fields:
    """In metres; nothing is known of the terrain."""
    situation = autopilot.situation
    return {
        "altitude_monotonic": situation.altitude_m,
        "altitude_amsl": situation.altitude_m,
        "altitude_local": situation.altitude_m - autopilot.place.altitude_m,
        "altitude_relative": situation.altitude_m - situation.home_altitude_m,
        "altitude_terrain": math.nan,
        "bottom_clearance": math.nan,
    }


def wind_cov(autopilot: Autopilot) -> Fields | None:
    """Estimated in flight, where that is switched on."""
    if autopilot.parameters["EKF2_DRAG_CTRL"] == 0 or autopilot.situation.landed:
        return None
    return {
        "wind_x": autopilot.wind.north_m_s,
        "wind_y": autopilot.wind.east_m_s,
        "var_horiz": 0.2,
        "wind_alt": autopilot.situation.altitude_m,
    }


def home_position(autopilot: Autopilot) -> Fields | None:
    """Once it is set."""
    situation = autopilot.situation
    if situation.home is None or situation.time_s < HOME_AFTER_S:
        return None
    latitude, longitude = _degrees_e7(autopilot, *situation.home)
    return {
        "latitude": latitude,
        "longitude": longitude,
        "altitude": _int32(situation.home_altitude_m * 1e3),
        "x": situation.home[0],
        "y": situation.home[1],
        "z": autopilot.place.altitude_m - situation.home_altitude_m,
        "q": (1.0, 0.0, 0.0, 0.0),
    }


def hil_state_quaternion(autopilot: Autopilot) -> Fields:
    """Where the vehicle really is."""
    airframe = autopilot.airframe
    latitude, longitude = _degrees_e7(autopilot, airframe.north_m, airframe.east_m)
    speed = _uint16(math.hypot(airframe.velocity_north_m_s, airframe.velocity_east_m_s) * 100)
    return {
        "attitude_quaternion": _quaternion(*airframe.attitude_rad()),
        "lat": latitude,
        "lon": longitude,
        "alt": _int32((autopilot.place.altitude_m + airframe.up_m) * 1e3),
        "vx": _int16(airframe.velocity_north_m_s * 100),
        "vy": _int16(airframe.velocity_east_m_s * 100),
        "vz": _int16(-airframe.velocity_up_m_s * 100),
        "ind_airspeed": speed,
        "true_airspeed": speed,
        "zacc": -1000,
        "yawspeed": airframe.yaw_rate_rad_s,
    }


def _quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
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


def _degrees_e7(autopilot: Autopilot, north_m: float, east_m: float) -> tuple[int, int]:
    """Latitude and longitude of a local place as MAVLink has them in integers."""
    latitude_deg, longitude_deg = autopilot.situation.projection.to_global(north_m, east_m)
    return _int32(latitude_deg * 1e7), _int32(longitude_deg * 1e7)


def _int32(value: float) -> int:
    return round(max(-2147483648.0, min(2147483647.0, value)))


def _int16(value: float) -> int:
    return round(max(-32768.0, min(32767.0, value)))


def _uint16(value: float) -> int:
    return round(max(0.0, min(65535.0, value)))
