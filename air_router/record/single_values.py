"""Single values as plain JSON data: numbers, texts, times and words; each comes back as it was."""

import base64
import math
from collections.abc import Callable, Mapping
from datetime import datetime, time, timedelta
from pathlib import Path
from types import NoneType
from typing import Any, Final

from air_router.errors import AirRouterError, ExitCode

Plain = Any
"""What `json.dumps` takes and `json.loads` gives."""

_NOT_NUMBERS: Final = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


class CodecError(AirRouterError, ValueError):
    """Plain data that are no value of the type that they should be."""

    exit_code = ExitCode.INVALID_FILE


def shown(plain: Plain) -> str:
    """Plain data in a message, however long they are."""
    text = repr(plain)
    return text if len(text) <= 60 else f"{text[:57]}..."


def write_float(value: float) -> Plain:
    """A number; a text for what JSON has no number for."""
    if math.isfinite(value):
        return float(value)
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"


def _exactly(*kinds: type) -> Callable[[Plain], Any]:
    """Take plain data of these types as they are (True is no number)."""

    def decode(plain: Plain) -> Any:
        if type(plain) not in kinds:
            raise CodecError(f"{shown(plain)} is not {' or '.join(k.__name__ for k in kinds)}")
        return plain

    return decode


def _read_float(plain: Plain) -> float:
    if type(plain) is float or type(plain) is int:
        return plain
    if isinstance(plain, str) and plain in _NOT_NUMBERS:
        return _NOT_NUMBERS[plain]
    raise CodecError(f"{shown(plain)} is not a number")


def _read_duration(plain: Plain) -> timedelta:
    if not isinstance(plain, list) or [type(part) for part in plain] != [int, int, int]:
        raise CodecError(f"{shown(plain)} is not days, seconds and microseconds")
    return timedelta(*plain)


def _from_text(read: Callable[[str], Any], what: str) -> Callable[[Plain], Any]:
    def decode(plain: Plain) -> Any:
        if type(plain) is not str:
            raise CodecError(f"{shown(plain)} is not {what}")
        try:
            return read(plain)
        except ValueError as error:
            raise CodecError(f"{shown(plain)} is not {what}: {error}") from None

    return decode


def one_word(members: Mapping[Any, Any], what: str) -> Callable[[Plain], Any]:
    """What reads a word that stands for one of these members."""

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, str | int) or plain not in members:
            raise CodecError(f"{shown(plain)} is no {what}: {', '.join(map(str, members))}")
        return members[plain]

    return decode


READERS: Final[dict[Any, Callable[[Plain], Any]]] = {
    float: _read_float,
    int: _exactly(int),
    bool: _exactly(bool),
    str: _exactly(str),
    NoneType: _exactly(NoneType),
    bytes: _from_text(lambda text: base64.b64decode(text, validate=True), "base64"),
    datetime: _from_text(datetime.fromisoformat, "a time"),
    time: _from_text(time.fromisoformat, "a time of day"),
    timedelta: _read_duration,
    Path: _from_text(Path, "a path"),
}
"""What reads plain data as a type, and takes nothing else for it (True is no number)."""
