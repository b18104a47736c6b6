"""PX4's parameters and its parameter microservice.

Names, types and defaults are those of a PX4 1.17 SITL quadrotor, all 887 that are in use there; a
few dozen mean something to this simulation. PX4 answers neither a name that it does not know nor a
value of the wrong type, and it stores values out of range.
"""

from __future__ import annotations

import logging
import math
import re
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final

_log = logging.getLogger(__name__)

INT32: Final = 6  # MAV_PARAM_TYPE
REAL32: Final = 9
_PER_STEP: Final = 20  # PX4 sends 887 parameters in 0.87 s

_FILE: Final = "px4_1_17_sihsim_quadx.params"
_HASH: Final = "_HASH_CHECK"
_UINT32: Final = 5
_NO_INDEX: Final = 65535
# What the vehicle itself changes; PX4 leaves these out of the hash.
_VOLATILE: Final = re.compile(
    r"(CAL_(ACC|BARO|GYRO|MAG)\d_.*(OFF|SCALE|COMP|ODIAG)|LND_FLIGHT_T_..|ASPD_SCALE_1"
    r"|COM_FLIGHT_UUID|EKF2_MAG_DECL|SENS_DPRES_OFF)\Z"
)


def _recorded() -> dict[str, int | float]:
    """The defaults, in PX4's order: that of the names."""
    text = resources.files("sitl").joinpath(_FILE).read_text()
    values: dict[str, int | float] = {}
    for line in text.splitlines():
        if not line.startswith("#"):
            _, _, name, value, kind = line.split("\t")
            values[name] = int(value) if int(kind) == INT32 else float(value)
    return values


DEFAULTS: Final[Mapping[str, int | float]] = _recorded()


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
        self._values: dict[str, int | float] = dict(DEFAULTS)  # with PX4's types
        for name, value in (changes or {}).items():
            if name not in DEFAULTS:
                raise UnknownParameterError(f"{name}: not a parameter of this simulation")
            self._values[name] = type(DEFAULTS[name])(value)
        self._limited: dict[tuple[str, float, float], float] = {}  # asked for in every step
        self._names = tuple(DEFAULTS)  # by param_index
        self._numbers = {name: number for number, name in enumerate(self._names)}  # param_index

    def __getitem__(self, name: str) -> float:
        """The value as a number to calculate with; the default where a NaN was stored."""
        value = self._values[name]
        return value if math.isfinite(value) else DEFAULTS[name]

    def limited(self, name: str, least: float, most: float) -> float:
        """The value, kept within limits that the simulation can fly with."""
        asked = (name, least, most)
        value = self._limited.get(asked)
        if value is None:
            value = self._limited[asked] = max(least, min(most, self[name]))
        return value

    def read(self, name: str, index: int) -> list[ParamValue]:
        """Answer to PARAM_REQUEST_READ: by index if that is not negative. Unknown: silence."""
        if index < 0 and name == _HASH:
            return [self._hash()]
        if 0 <= index < len(self._names):
            return [self._value(self._names[index])]
        if index < 0 and name in self._values:
            return [self._value(name)]
        _log.warning("parameter %s (%d) was asked for: unknown, not answered", name, index)
        return []

    def set(self, name: str, value: float, param_type: int) -> list[ParamValue]:
        """Answer to PARAM_SET: one PARAM_VALUE, a second if it changed; else silence."""
        if name not in self._values:
            _log.warning("parameter %s was to be set: unknown, not answered", name)
            return []
        kind = type(DEFAULTS[name])
        if param_type != (INT32 if kind is int else REAL32):
            _log.warning("parameter %s was to be set as type %d: not answered", name, param_type)
            return []
        number: int | float = _bits(value) if kind is int else value
        changed = self._values[name] != number
        self._values[name] = number
        self._limited.clear()
        return [self._value(name)] * (2 if changed else 1)

    def listed(self, first: int) -> list[ParamValue]:
        """The parameters from an index on, as many as go out in one step of a listing.

        The first step also has the hash, by which ground stations know what they have already.
        """
        before = [self._hash()] if first == 0 else []
        return before + [self._value(name) for name in self._names[first : first + _PER_STEP]]

    def _value(self, name: str) -> ParamValue:
        value = self._values[name]
        if isinstance(value, int):
            wire, kind = _unbits(value), INT32
        else:
            wire, kind = value, REAL32
        return ParamValue(name, wire, kind, len(self._names), self._numbers[name])

    def _hash(self) -> ParamValue:
        number = 0
        for name, value in self._values.items():
            if _VOLATILE.match(name) is None:
                layout = "<i" if isinstance(value, int) else "<f"
                for data in (name.encode(), struct.pack(layout, value)):
                    number = zlib.crc32(data, number ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
        wire = float(struct.unpack("<f", struct.pack("<I", number))[0])
        return ParamValue(_HASH, wire, _UINT32, len(self._names), _NO_INDEX)


def _bits(value: float) -> int:
    return int(struct.unpack("<i", struct.pack("<f", value))[0])


def _unbits(value: int) -> float:
    return float(struct.unpack("<f", struct.pack("<i", value))[0])
