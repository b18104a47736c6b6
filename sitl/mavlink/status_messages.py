"""Messages about the vehicle's state: modes, health, battery, versions.

Each function makes the fields of the message that is called as it is.
"""

import math
from typing import Final

from sitl.mavlink.motion_messages import POSITION_AFTER_S, Fields, boot_ms, boot_us
from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.state import FlightMode

_QUADROTOR: Final = 2
_PX4: Final = 12
_ARMED: Final = 128
_PRESENT: Final = 0x0300402F
_ENABLED: Final = 0x0301402F
_HEALTHY: Final = 0x0320C83F
_XY_CONTROL: Final = 0x4000
_PREARM_CHECK: Final = 0x10000000
_CAPABILITIES: Final = 59647 & ~32  # PX4's, without MAVLink FTP, which is not offered here
_VERSION: Final = 0x011100FF  # 1.17.0
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
        "type": _QUADROTOR,
        "autopilot": _PX4,
        "base_mode": autopilot.mode.base_mode | (_ARMED if autopilot.armed else 0),
        "custom_mode": autopilot.mode.custom_mode,
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
    """What is not measured is -1, or the largest number."""
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


def estimator_status(autopilot: Autopilot) -> Fields:
    """The flags of PX4's estimator on the ground, in flight, and in flight without satellites."""
    if autopilot.time_s < POSITION_AFTER_S:
        flags = 229
    elif autopilot.situation.landed:
        flags = 831
    else:
        flags = 895 if autopilot.positioning.fused else 101
    ratios = ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio", "hagl_ratio")
    return {
        "time_usec": boot_us(autopilot),
        "flags": flags,
        **dict.fromkeys(ratios, 0.1),
        "tas_ratio": math.nan,
        "pos_horiz_accuracy": autopilot.positioning.accuracy_m,
        "pos_vert_accuracy": 0.3,
    }


def extended_sys_state(autopilot: Autopilot) -> Fields:
    """Its landed_state: 1 on the ground, 2 in the air, 3 taking off, 4 landing."""
    if autopilot.situation.landed:
        state = 1
    elif autopilot.landing:
        state = 4
    else:
        state = 3 if autopilot.taking_off else 2
    return {"vtol_state": 0, "landed_state": state}


def current_mode(autopilot: Autopilot) -> Fields:
    """The mode that is flown, and the one that was asked for."""
    return {
        "standard_mode": _STANDARD_MODES.get(autopilot.mode, 0),
        "custom_mode": autopilot.mode.custom_mode,
        "intended_custom_mode": autopilot.intended.custom_mode,
    }


def flight_information(autopilot: Autopilot) -> Fields:
    """Since when it flies, in microseconds since the start; 0: it does not."""
    took_off_s = autopilot.situation.took_off_s
    return {
        "time_boot_ms": boot_ms(autopilot),
        "takeoff_time_utc": round((took_off_s or 0.0) * 1e6) if autopilot.armed else 0,
    }


def autopilot_version(autopilot: Autopilot) -> Fields:
    """PX4 1.17.0."""
    identifier = autopilot.parameters["MAV_SYS_ID"]
    return {
        "capabilities": _CAPABILITIES,
        "flight_sw_version": _VERSION,
        "middleware_sw_version": _VERSION,
        "board_version": 1,
        "uid": 0x5157000000000000 | int(identifier) & 0xFF,
    }
