"""PX4's parameters, those that this simulation knows, and its parameter microservice.

Names, types and defaults are those of PX4 1.17 for a multicopter in SITL. PX4 answers neither a
name that it does not know nor a value of the wrong type, and it stores values out of range.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

INT32: Final = 6  # MAV_PARAM_TYPE
REAL32: Final = 9
_PER_STEP: Final = 40  # PX4 sends 900 parameters in 0.45 s

DEFAULTS: Final[Mapping[str, int | float]] = {
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "BAT_LOW_THR": 0.15,
    "BAT1_N_CELLS": 4,
    "CAL_ACC0_ID": 1310988,
    "CAL_GYRO0_ID": 1310988,
    "CAL_MAG0_ID": 197388,
    "COM_ARM_BAT_MIN": -1.0,
    "COM_ARM_WO_GPS": 1,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_DL_LOSS_T": 10,
    "COM_FAIL_ACT_T": 5.0,
    "COM_HOME_EN": 1,
    "COM_LOW_BAT_ACT": 3,
    "COM_OBC_LOSS_T": 5.0,
    "COM_OBL_RC_ACT": 0,
    "COM_OF_LOSS_T": 1.0,
    "COM_RC_IN_MODE": 1,
    "COM_RC_LOSS_T": 0.5,
    "COM_SPOOLUP_TIME": 1.0,
    "COM_TAKEOFF_ACT": 0,
    "GF_ACTION": 2,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
    "GF_PREDICT": 0,
    "GF_SOURCE": 0,
    "MAV_COMP_ID": 1,
    "MAV_SYS_ID": 1,
    "MAV_TYPE": 2,
    "MIS_DIST_1WP": 10000.0,
    "MIS_TAKEOFF_ALT": 2.5,
    "MIS_TKO_LAND_REQ": 0,
    "MIS_YAW_ERR": 12.0,
    "MIS_YAW_TMT": -1.0,
    "MPC_ACC_DOWN_MAX": 3.0,
    "MPC_ACC_HOR": 3.0,
    "MPC_ACC_UP_MAX": 4.0,
    "MPC_JERK_AUTO": 4.0,
    "MPC_LAND_SPEED": 0.7,
    "MPC_TKO_RAMP_T": 3.0,
    "MPC_TKO_SPEED": 1.5,
    "MPC_XY_CRUISE": 5.0,
    "MPC_XY_VEL_MAX": 12.0,
    "MPC_YAWRAUTO_MAX": 60.0,
    "MPC_Z_V_AUTO_DN": 1.5,
    "MPC_Z_V_AUTO_UP": 3.0,
    "NAV_ACC_RAD": 2.0,
    "NAV_DLL_ACT": 0,
    "NAV_LOITER_RAD": 80.0,
    "NAV_MC_ALT_RAD": 0.8,
    "NAV_RCL_ACT": 2,
    "RTL_CONE_ANG": 45,
    "RTL_DESCEND_ALT": 10.0,
    "RTL_LAND_DELAY": 0.0,
    "RTL_MIN_DIST": 10.0,
    "RTL_RETURN_ALT": 30.0,
    "RTL_TYPE": 0,
    "SDLOG_MODE": 1,
    "SIM_BAT_DRAIN": 60.0,
    "SIM_BAT_MIN_PCT": 50.0,
    "SYS_AUTOSTART": 10040,
    "SYS_HITL": 0,
}


class UnknownParameterError(Exception):
    """No such parameter here; the message names it."""


@dataclass(frozen=True, slots=True)
class ParamValue:
    """One PARAM_VALUE; integers travel bytewise in the float field, as PX4 has it."""

    name: str
    value: float
    type: int
    count: int
    index: int

    def fields(self) -> dict[str, Any]:
        """Fields of the MAVLink message."""
        return {
            "param_id": self.name.encode(),
            "param_value": self.value,
            "param_type": self.type,
            "param_count": self.count,
            "param_index": self.index,
        }


class Parameters:
    """The values on board.

    Args:
        changes: Values that differ from PX4's defaults.

    Raises:
        UnknownParameterError: one of `changes` is not known.
    """

    def __init__(self, changes: Mapping[str, int | float] | None = None) -> None:
        self._values: dict[str, int | float] = dict(DEFAULTS)
        for name, value in (changes or {}).items():
            if name not in DEFAULTS:
                raise UnknownParameterError(f"{name}: not a parameter of this simulation")
            self._values[name] = type(DEFAULTS[name])(value)
        self._names = tuple(sorted(DEFAULTS))

    def __getitem__(self, name: str) -> float:
        """The value as a number to calculate with; the default where a NaN was stored."""
        value = self._values[name]
        return value if math.isfinite(value) else DEFAULTS[name]

    def limited(self, name: str, least: float, most: float) -> float:
        """The value, kept within limits that the simulation can fly with."""
        return max(least, min(most, self[name]))

    def read(self, name: str, index: int) -> list[ParamValue]:
        """Answer to PARAM_REQUEST_READ: by index if that is not negative. Unknown: silence."""
        if 0 <= index < len(self._names):
            return [self._value(self._names[index])]
        return [self._value(name)] if index < 0 and name in self._values else []

    def set(self, name: str, value: float, param_type: int) -> list[ParamValue]:
        """Answer to PARAM_SET: one PARAM_VALUE, a second if it changed; else silence."""
        if name not in self._values:
            return []
        kind = type(DEFAULTS[name])
        if param_type != (INT32 if kind is int else REAL32):
            return []
        number: int | float = _bits(value) if kind is int else value
        changed = self._values[name] != number
        self._values[name] = number
        return [self._value(name)] * (2 if changed else 1)

    def listed(self, first: int) -> list[ParamValue]:
        """The parameters from an index on, as many as go out in one step of a listing."""
        return [self._value(name) for name in self._names[first : first + _PER_STEP]]

    def _value(self, name: str) -> ParamValue:
        value = self._values[name]
        if isinstance(value, int):
            wire, kind = _unbits(value), INT32
        else:
            wire, kind = value, REAL32
        return ParamValue(name, wire, kind, len(self._names), self._names.index(name))


def _bits(value: float) -> int:
    return int(struct.unpack("<i", struct.pack("<f", value))[0])


def _unbits(value: int) -> float:
    return float(struct.unpack("<f", struct.pack("<i", value))[0])
