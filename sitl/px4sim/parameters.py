"""PX4's parameters and its parameter microservice.

Names, types and defaults are those of a PX4 1.17 SITL quadrotor, all 887 that are in use there; a
few dozen mean something to this simulation; `px4sim.versions` has what is different in others of
PX4. PX4 answers neither a name that it does not know nor a
value of the wrong type, and it stores values out of range.
"""

import logging
import math
import struct
from collections.abc import Mapping
from importlib import resources
from typing import Any, Final

from sitl.px4sim.versions import BEHAVIOURS, USUAL, Px4Behaviour

_log = logging.getLogger(__name__)

_INT32, _REAL32 = 6, 9  # MAV_PARAM_TYPE
_PER_STEP: Final = 20  # PX4 sends 887 parameters in 0.87 s
_FILE: Final = "px4_1_17_sihsim_quadx.params"


def _recorded() -> dict[str, int | float]:
    """The defaults, in PX4's order: that of the names."""
    text = resources.files("sitl").joinpath(_FILE).read_text()
    values: dict[str, int | float] = {}
    for line in text.splitlines():
        if not line.startswith("#"):
            _, _, name, value, kind = line.split("\t")
            values[name] = int(value) if int(kind) == _INT32 else float(value)
    return values


DEFAULTS: Final[Mapping[str, int | float]] = _recorded()
"""Of `RECORDED`."""

BATTERY_MINUTES: Final = 22.5
"""Endurance of a full battery of `sitl vehicle` and `sitl px4`, and of experiments that fly a
mission in its own world: their flights are compared."""


def defaults(behaviour: Px4Behaviour) -> dict[str, int | float]:
    """Those of a version of PX4, in its order."""
    kept = {name: value for name, value in DEFAULTS.items() if name not in behaviour.without}
    return dict(sorted((kept | dict(behaviour.values)).items()))


class UnknownParameterError(Exception):
    """No such parameter here; the message names it."""


class Parameters:
    """The values on board; reading and setting them over MAVLink returns fields of PARAM_VALUE.

    Args:
        changes: Values that differ from PX4's defaults.
        behaviour: Of which version.

    Attributes:
        behaviour: The same.

    Raises:
        UnknownParameterError: one of `changes` is not known.
    """

    def __init__(
        self,
        changes: Mapping[str, int | float] | None = None,
        behaviour: Px4Behaviour = BEHAVIOURS[USUAL],
    ) -> None:
        self.behaviour = behaviour
        self._defaults = defaults(behaviour)
        self._names = tuple(self._defaults)  # by param_index
        self._values = dict(self._defaults)  # with PX4's types
        for name, value in (changes or {}).items():
            if name not in self._defaults:
                raise UnknownParameterError(f"{name}: not a parameter of this simulation")
            self._values[name] = type(self._defaults[name])(value)
        self._limited: dict[tuple[str, float, float], float] = {}  # read in every step

    def __getitem__(self, name: str) -> float:
        """The value as a number to calculate with; the default where a NaN was stored."""
        value = self._values[name]
        return value if math.isfinite(value) else self._defaults[name]

    def get(self, name: str, otherwise: float) -> float:
        """The value; `otherwise` if this version of PX4 does not have the parameter."""
        return self[name] if name in self._values else otherwise

    def limited(self, name: str, least: float, most: float) -> float:
        """The value, kept within limits that the simulation can fly with."""
        key = (name, least, most)
        value = self._limited.get(key)
        if value is None:
            value = self._limited[key] = max(least, min(most, self[name]))
        return value

    def change(self, name: str, value: float) -> None:
        """Store a value by no message, in the parameter's own type."""
        self._values[name] = type(self._defaults[name])(value)
        self._limited.clear()

    def read(self, name: str, index: int) -> list[dict[str, Any]]:
        """Answer to PARAM_REQUEST_READ: by index if that is not negative. Unknown: silence."""
        if 0 <= index < len(self._names):
            return [self._message(self._names[index])]
        if index < 0 and name in self._values:
            return [self._message(name)]
        _log.warning("parameter %s (%d) was requested: unknown, not answered", name, index)
        return []

    def set(self, name: str, value: float, param_type: int) -> list[dict[str, Any]]:
        """Answer to PARAM_SET: one PARAM_VALUE, a second if it changed; else silence."""
        if name not in self._values:
            _log.warning("parameter %s was to be set: unknown, not answered", name)
            return []
        whole = isinstance(self._defaults[name], int)
        if param_type != (_INT32 if whole else _REAL32):
            _log.warning("parameter %s was to be set as type %d: not answered", name, param_type)
            return []
        number = struct.unpack("<i", struct.pack("<f", value))[0] if whole else value
        changed = self._values[name] != number
        self.change(name, number)
        return [self._message(name)] * (2 if changed else 1)

    def listed(self, first: int) -> list[dict[str, Any]]:
        """The parameters from an index on, as many as go out in one step of a listing."""
        return [self._message(name) for name in self._names[first : first + _PER_STEP]]

    def _message(self, name: str) -> dict[str, Any]:
        """Fields of PARAM_VALUE; integers travel bytewise in the float field, as PX4 has it."""
        value = self._values[name]
        whole = isinstance(value, int)
        return {
            "param_id": name.encode(),
            "param_value": struct.unpack("<f", struct.pack("<i", value))[0] if whole else value,
            "param_type": _INT32 if whole else _REAL32,
            "param_count": len(self._names),
            "param_index": self._names.index(name),
        }
