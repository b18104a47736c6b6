"""The steps about parameters."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Any, Final

from sitl.conformance.sending import send
from sitl.conformance.session import DepartureError, Session

_INT32, _REAL32 = 6, 9  # MAV_PARAM_TYPE
_QUIET_S: Final = 1.0


def set_parameter(session: Session, name: str, value: float, answers: int = 2) -> None:
    """Send PARAM_SET, and count the PARAM_VALUEs that answer it.

    Args:
        session: With the vehicle.
        name: Of the parameter.
        value: An int is sent as INT32, bytewise, as PX4 has it; a float as REAL32.
        answers: How many PARAM_VALUEs come: two (on a busy machine sometimes three) for a change,
            one for none, none if refused.
    """
    whole = isinstance(value, int)
    sent = struct.unpack("<f", struct.pack("<i", value))[0] if whole else value
    kind = _INT32 if whole else _REAL32
    send(session, "PARAM_SET", {"param_id": name, "param_value": sent, "param_type": kind})
    values = _values(session, name, answers)
    session.notes.append(f"{name}: {len(values)} answers {values}")
    wanted = struct.unpack("<f", struct.pack("<f", value))[0]
    enough = len(values) >= 2 if answers == 2 else len(values) == answers
    if not enough or any(abs(got - wanted) > 1e-6 for got in values):
        raise DepartureError(f"expected {answers} PARAM_VALUEs, heard {values}")


def parameter(session: Session, name: str, value: float | None) -> None:
    """Ask for a parameter by name; None: silence is expected."""
    wanted = [] if value is None else [value]
    values = _read(session, name, len(wanted))
    if len(values) != len(wanted) or not all(map(math.isclose, values, wanted)):
        raise DepartureError(f"expected {value}, heard {values or 'silence'}")


def read_parameter(session: Session, name: str) -> float:
    """The value of a parameter: an int where PX4 has one.

    Raises:
        DepartureError: no answer.
    """
    values = _read(session, name, 1)
    if not values:
        raise DepartureError(f"expected the parameter {name}, heard silence")
    return values[0]


def all_parameters(session: Session, among: Sequence[str], fewest: int, within_s: float) -> None:
    """Send PARAM_REQUEST_LIST: every parameter comes in time, these among them."""
    send(session, "PARAM_REQUEST_LIST")
    names: set[str] = set()
    counts: set[int] = set()

    def complete() -> bool:
        for heard in session.since("PARAM_VALUE"):
            if heard.fields["param_index"] < 65535:
                names.add(heard.fields["param_id"])
                counts.add(heard.fields["param_count"])
        return bool(counts) and len(names) >= max(counts)

    begun_s = session.now_s
    done = session.run(within_s, complete)
    session.notes.append(f"{len(names)} parameters in {session.now_s - begun_s:.2f} s")
    missing = [name for name in among if name not in names]
    if not done or len(names) < fewest or missing:
        raise DepartureError(
            f"expected {fewest} parameters within {within_s:g} s, "
            f"heard {len(names)} of {counts}, without {missing}"
        )


def _read(session: Session, name: str, answers: int) -> list[float]:
    send(session, "PARAM_REQUEST_READ", {"param_id": name, "param_index": -1})
    return _values(session, name, answers)


def _values(session: Session, name: str, wanted: int) -> list[float]:
    def values() -> list[float]:
        return [
            _value(heard.fields)
            for heard in session.since("PARAM_VALUE")
            if heard.fields["param_id"] == name
        ]

    session.run(_QUIET_S, lambda: wanted > 0 and len(values()) >= wanted)
    session.run(0.2)
    return values()


def _value(fields: dict[str, Any]) -> float:
    value: float = fields["param_value"]
    if fields["param_type"] == _INT32:
        whole: int = struct.unpack("<i", struct.pack("<f", value))[0]
        return whole
    return value
