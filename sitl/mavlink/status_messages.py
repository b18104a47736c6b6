"""Messages about the vehicle's state: modes, health, battery, time."""

from __future__ import annotations

import math
from typing import Final

from sitl.mavlink.position_messages import POSITION_AFTER_S, Fields, MessageBuilder
from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.state.px4_modes import FlightMode

_QUADROTOR: Final = 2
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


class StatusMessages(MessageBuilder):
    """Builds the fields of status messages.

    Args:
        autopilot: Whose.
        start_unix_s: Unix time of the simulation's start; SYSTEM_TIME goes on from it.
        version: AUTOPILOT_VERSION.flight_sw_version.

    Attributes:
        events_sent: How many EVENTs there were, for their sequence numbers.
    """

    def __init__(self, autopilot: Autopilot, start_unix_s: float, version: int) -> None:
        super().__init__(autopilot)
        self._start_unix_s = start_unix_s
        self._version_number = version
        self.events_sent = 0

    def _heartbeat(self) -> Fields:
        autopilot = self._autopilot
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

    def _sys_status(self) -> Fields:
        battery = self._autopilot.battery
        ready = self._autopilot.can_arm or self._autopilot.armed
        health = _HEALTHY if self._autopilot.positioning.fused else _HEALTHY & ~_XY_CONTROL
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

    def _system_time(self) -> Fields:
        unix_s = self._start_unix_s + self._situation.time_s
        return {"time_unix_usec": round(unix_s * 1e6), "time_boot_ms": self.boot_ms}

    def _timesync(self) -> Fields:
        return {
            "ts1": self.boot_us * 1000,
        }

    def _battery_status(self) -> Fields:
        battery = self._autopilot.battery
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

    def _estimator_status(self) -> Fields:
        return {
            "time_usec": self.boot_us,
            "flags": self._estimator_flags(),
            **dict.fromkeys(
                ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio", "hagl_ratio"), 0.1
            ),
            "tas_ratio": math.nan,
            "pos_horiz_accuracy": self._autopilot.positioning.accuracy_m,
            "pos_vert_accuracy": 0.3,
        }

    def _estimator_flags(self) -> int:
        if self._situation.time_s < POSITION_AFTER_S:
            return 229
        if not self._situation.landed:
            return 895 if self._autopilot.positioning.fused else 101
        return 831

    def _extended_sys_state(self) -> Fields:
        autopilot = self._autopilot
        if autopilot.situation.landed:
            state = 1
        elif autopilot.landing:
            state = 4
        else:
            state = 3 if autopilot.taking_off else 2
        return {"vtol_state": 0, "landed_state": state}

    def _current_event_sequence(self) -> Fields:
        return {"sequence": (self.events_sent - 1) & 0xFFFF, "flags": 0}

    def _current_mode(self) -> Fields:
        mode, intended = self._autopilot.mode, self._autopilot.intended
        return {
            "standard_mode": _STANDARD_MODES.get(mode, 0),
            "custom_mode": mode.custom_mode,
            "intended_custom_mode": intended.custom_mode,
        }

    def _flight_information(self) -> Fields:
        situation = self._situation
        flies = situation.armed and situation.took_off_s is not None
        return {
            "time_boot_ms": self.boot_ms,
            "takeoff_time_utc": round((situation.took_off_s or 0.0) * 1e6) if flies else 0,
        }

    def _autopilot_version(self) -> Fields:
        identifier = self._autopilot.parameters["MAV_SYS_ID"]
        return {
            "capabilities": _CAPABILITIES,
            "flight_sw_version": self._version_number,
            "middleware_sw_version": self._version_number,
            "board_version": 1,
            "uid": 0x5157000000000000 | int(identifier) & 0xFF,
        }
