"""The messages that the autopilot streams, how often, and the fields of those about its state.

Rates are PX4 1.17's on its SITL links, in simulated hertz, but ATTITUDE (50 instead of 100). Those
are left out that neither a companion nor a ground station flies by: raw sensors, odometry, servos,
SCALED_PRESSURE, VIBRATION, DISTANCE_SENSOR, Remote ID and the like.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from sitl.mavlink import motion_messages as motion
from sitl.mavlink.codec import DEFINITIONS, Outgoing
from sitl.mavlink.motion_messages import Fields
from sitl.px4sim import Autopilot, FlightMode

_VTOLS: Final = frozenset({19, 20, 21, 22, 23, 24, 25})  # MAV_TYPE
_HOVERS: Final = 3  # MAV_VTOL_STATE_MC
_PX4: Final = 12
_ARMED: Final = 128
_PRESENT: Final = 0x0300402F
_ENABLED: Final = 0x0301402F
_HEALTHY: Final = 0x0320C83F
_XY_CONTROL: Final = 0x4000
_PREARM_CHECK: Final = 0x10000000
_CAPABILITIES: Final = 59647 & ~32  # PX4's, without MAVLink FTP, which is not offered here
_STANDARD_MODES: Final = {
    FlightMode.POSCTL: 1,
    FlightMode.ALTCTL: 4,
    FlightMode.AUTO_RTL: 5,
    FlightMode.AUTO_MISSION: 6,
    FlightMode.AUTO_LAND: 7,
    FlightMode.AUTO_TAKEOFF: 8,
}


def heartbeat(autopilot: Autopilot) -> Fields:
    """Its system_status: uninitialised, standby, active, critical in a failsafe, terminated."""
    if autopilot.terminated:
        status = 8
    elif autopilot.failsafe.acting:
        status = 5
    elif autopilot.armed:
        status = 4
    else:
        status = 3 if autopilot.can_arm else 0
    return {
        "type": int(autopilot.parameters["MAV_TYPE"]),
        "autopilot": _PX4,
        "base_mode": autopilot.shown_mode.base_mode | (_ARMED if autopilot.armed else 0),
        "custom_mode": autopilot.shown_mode.custom_mode,
        "system_status": status,
        "mavlink_version": 3,
    }


def sys_status(autopilot: Autopilot) -> Fields:
    """Health and battery."""
    battery = autopilot.watchdog.battery
    ready = autopilot.can_arm or autopilot.armed
    health = _HEALTHY if autopilot.positioning.fused else _HEALTHY & ~_XY_CONTROL
    return {
        "onboard_control_sensors_present": _PRESENT,
        "onboard_control_sensors_enabled": _ENABLED,
        "onboard_control_sensors_health": health | (_PREARM_CHECK if ready else 0),
        "load": 140,
        "voltage_battery": int(battery.voltage_v * 1e3),
        "current_battery": -100,
        "battery_remaining": math.ceil(battery.remaining * 100),
        "onboard_control_sensors_health_extended": 1,
    }


def battery_status(autopilot: Autopilot) -> Fields:
    """A value that is not measured is -1, or the largest number."""
    battery = autopilot.watchdog.battery
    return {
        "battery_function": 1,
        "type": 1,
        "temperature": 32767,
        "voltages": (int(battery.voltage_v * 1e3), *(65535,) * 9),
        "current_battery": -100,
        "current_consumed": -1,
        "energy_consumed": -1,
        "battery_remaining": math.ceil(battery.remaining * 100),
        "charge_state": battery.warning + 1,
    }


def extended_sys_state(autopilot: Autopilot) -> Fields:
    """Its landed_state (1 on the ground, 2 in the air, 3 taking off, 4 landing); of a VTOL more."""
    if autopilot.situation.landed:
        state = 1
    elif autopilot.landing:
        state = 4
    else:
        state = 3 if autopilot.taking_off else 2
    vtol = autopilot.parameters["MAV_TYPE"] in _VTOLS
    return {"vtol_state": _HOVERS if vtol else 0, "landed_state": state}


def current_mode(autopilot: Autopilot) -> Fields:
    """The mode that is flown, and the one that was requested."""
    return {
        "standard_mode": _STANDARD_MODES.get(autopilot.shown_mode, 0),
        "custom_mode": autopilot.shown_mode.custom_mode,
        "intended_custom_mode": autopilot.intended.custom_mode,
    }


def flight_information(autopilot: Autopilot) -> Fields:
    """Since when it flies, in microseconds since the start; 0: it does not."""
    took_off_s = autopilot.situation.took_off_s
    return {
        "takeoff_time_utc": round((took_off_s or 0.0) * 1e6) if autopilot.armed else 0,
    }


def autopilot_version(autopilot: Autopilot) -> Fields:
    """Which PX4 it behaves as."""
    identifier = autopilot.parameters["MAV_SYS_ID"]
    return {
        "capabilities": _CAPABILITIES,
        "flight_sw_version": autopilot.behaviour.number,
        "middleware_sw_version": autopilot.behaviour.number,
        "board_version": 1,
        "uid": 0x5157000000000000 | int(identifier) & 0xFF,
    }


def system_time(autopilot: Autopilot) -> Fields:
    """Unix time of the simulation."""
    unix_s = autopilot.start_unix_s + autopilot.time_s
    return {"time_unix_usec": round(unix_s * 1e6)}


def timesync(autopilot: Autopilot) -> Fields:
    """A question for the time of the other side."""
    return {"ts1": round(autopilot.time_s * 1e6) * 1000}


def current_event_sequence(autopilot: Autopilot) -> Fields:
    """The number of the last EVENT."""
    return {"sequence": (autopilot.events_sent - 1) & 0xFFFF, "flags": 0}


@dataclass(frozen=True, slots=True)
class _Message:
    """A message: its fields, and how often it comes on PX4's links, 0: only on request."""

    fields: Callable[[Autopilot], Fields | None]
    onboard_hz: float = 0.0
    ground_hz: float = 0.0
    truth_hz: float = 0.0


_MESSAGES: Final[Mapping[str, _Message]] = {
    "HEARTBEAT": _Message(heartbeat, 1.0, 1.0, 1.0),
    "SYS_STATUS": _Message(sys_status, 5.0, 1.0),
    "SYSTEM_TIME": _Message(system_time, 1.0),
    "GPS_RAW_INT": _Message(motion.gps_raw_int, 8.0, 5.0),
    "ATTITUDE": _Message(motion.attitude, 50.0, 50.0),
    "LOCAL_POSITION_NED": _Message(motion.local_position_ned, 30.0, 50.0),
    "GLOBAL_POSITION_INT": _Message(motion.global_position_int, 50.0, 50.0),
    "VFR_HUD": _Message(motion.vfr_hud, 10.0, 4.0),
    "TIMESYNC": _Message(timesync, 10.0),
    "ALTITUDE": _Message(motion.altitude, 10.0, 1.0),
    "BATTERY_STATUS": _Message(battery_status, 0.5, 0.5),
    "HOME_POSITION": _Message(motion.home_position, 0.5, 0.5),
    "EXTENDED_SYS_STATE": _Message(extended_sys_state, 5.0, 1.0),
    "CURRENT_EVENT_SEQUENCE": _Message(current_event_sequence, 1.0 / 3.0, 1.0 / 3.0),
    "CURRENT_MODE": _Message(current_mode, 0.5, 0.5),
    "POSITION_TARGET_GLOBAL_INT": _Message(motion.position_target_global_int, 10.0, 10.0),
    "WIND_COV": _Message(motion.wind_cov, 10.0, 0.5),
    "HIL_STATE_QUATERNION": _Message(motion.hil_state_quaternion, truth_hz=25.0),
    "FLIGHT_INFORMATION": _Message(flight_information),
    "AUTOPILOT_VERSION": _Message(autopilot_version),
}
_CLOCKS: Final = {"time_boot_ms": 1e3, "time_usec": 1e6}  # of a second, since the start
_CLOCK_FIELDS: Final = {n: _CLOCKS.keys() & DEFINITIONS[n].defaults.keys() for n in _MESSAGES}
ONBOARD_RATES_HZ: Final = {n: m.onboard_hz for n, m in _MESSAGES.items() if m.onboard_hz}
GROUND_RATES_HZ: Final = {n: m.ground_hz for n, m in _MESSAGES.items() if m.ground_hz}
TRUTH_RATES_HZ: Final = {n: m.truth_hz for n, m in _MESSAGES.items() if m.truth_hz}


def knows(name: str) -> bool:
    """Whether a message can be streamed or requested."""
    return name in _MESSAGES


def message(name: str, autopilot: Autopilot) -> Outgoing | None:
    """The message as it is now; None if there is nothing to send yet."""
    fields = _MESSAGES[name].fields(autopilot)
    if fields is None:
        return None
    clock = {field: round(autopilot.time_s * _CLOCKS[field]) for field in _CLOCK_FIELDS[name]}
    return Outgoing(name, fields | clock)


class StreamSchedule:
    """Message intervals of one link, in simulated seconds.

    Args:
        rates_hz: The link's default rates by message name.
    """

    def __init__(self, rates_hz: Mapping[str, float]) -> None:
        self._defaults_s = {name: 1.0 / rate for name, rate in rates_hz.items()}  # for interval 0
        self._intervals_s = dict(self._defaults_s)  # streams that are off are missing
        self._due_s = dict.fromkeys(self._intervals_s, 0.0)  # simulated time, of the same

    def set_interval(self, name: str, interval_us: float) -> None:
        """SET_MESSAGE_INTERVAL: microseconds; 0 is the default, below 0 is never."""
        if interval_us > 0:
            self._intervals_s[name] = interval_us / 1e6
        elif interval_us == 0 and name in self._defaults_s:
            self._intervals_s[name] = self._defaults_s[name]
        else:
            self._intervals_s.pop(name, None)
            self._due_s.pop(name, None)
            return
        self._due_s[name] = 0.0

    def due(self, now_s: float) -> list[str]:
        """The messages to be sent now, each once however late."""
        names = [name for name, due_s in self._due_s.items() if due_s <= now_s + 1e-9]
        for name in names:
            following_s = self._due_s[name] + self._intervals_s[name]
            if following_s <= now_s:
                following_s = now_s + self._intervals_s[name]
            self._due_s[name] = following_s
        return names
