"""Single values as plain JSON data and back: numbers, texts, bytes, times, words of a list.

JSON knows no infinity and no bytes: bytes become base64, numbers that JSON cannot write the texts
"NaN", "Infinity" and "-Infinity", members of an enum their name.
"""

from __future__ import annotations

import base64
import math
import operator
from collections.abc import Callable
from datetime import datetime, time, timedelta
from enum import Enum
from pathlib import Path
from types import NoneType
from typing import Any, Final, NamedTuple

Plain = Any
"""What `json.dumps` takes and `json.loads` gives."""

_NOT_NUMBERS: Final = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


class CodecError(ValueError):
    """Plain data that are no value of the type that they should be."""


class Codec(NamedTuple):
    """How values of one declared type are written and read.

    Attributes:
        encode: The value as plain data.
        decode: The value of plain data; raises CodecError.
        schema: The JSON schema of the plain data, as far as the viewers of records understand it:
            one type each, no alternatives, nothing said of what may be null.
        takes: Whether a value is one of this type; for telling the members of a union apart.
    """

    encode: Callable[[Any], Plain]
    decode: Callable[[Plain], Any]
    schema: Callable[[], dict[str, Any]]
    takes: Callable[[Any], bool]


def _same(value: Any) -> Any:
    return value


def _need(*kinds: type) -> Callable[[Plain], Any]:
    """Take plain data of exactly these types as they are (True is no number)."""
    names = " or ".join(kind.__name__ for kind in kinds)

    def decode(plain: Plain) -> Any:
        if type(plain) not in kinds:
            raise CodecError(f"{shown(plain)} is not {names}")
        return plain

    return decode


def _simple(
    kind: type,
    schema: dict[str, Any],
    encode: Callable[[Any], Plain] = _same,
    decode: Callable[[Plain], Any] | None = None,
) -> Codec:
    return Codec(
        encode,
        decode if decode is not None else _need(kind),
        lambda: dict(schema),
        lambda value: type(value) is kind,
    )


def _write_float(value: float) -> Plain:
    if math.isfinite(value):
        return value if type(value) in {float, int} else float(value)
    return "NaN" if value != value else "Infinity" if value > 0 else "-Infinity"  # noqa: PLR0124


def _read_float(plain: Plain) -> float:
    if type(plain) is float or type(plain) is int:
        return plain
    if isinstance(plain, str) and plain in _NOT_NUMBERS:
        return _NOT_NUMBERS[plain]
    raise CodecError(f"{shown(plain)} is not a number")


def _from_text(read: Callable[[str], Any], what: str) -> Callable[[Plain], Any]:
    def decode(plain: Plain) -> Any:
        if type(plain) is not str:
            raise CodecError(f"{shown(plain)} is not {what}")
        try:
            return read(plain)
        except ValueError as error:
            raise CodecError(f"{shown(plain)} is not {what}: {error}") from None

    return decode


def _read_duration(plain: Plain) -> timedelta:
    if not isinstance(plain, list) or [type(part) for part in plain] != [int, int, int]:
        raise CodecError(f"{shown(plain)} is not days, seconds and microseconds")
    return timedelta(*plain)


def _read_base64(text: str) -> bytes:
    return base64.b64decode(text, validate=True)


TEXT: Final = {"type": "string"}
_NUMBER: Final = {"type": "number"}

SIMPLE: Final[dict[Any, Codec]] = {
    float: Codec(
        _write_float,
        _read_float,
        lambda: dict(_NUMBER),
        lambda value: isinstance(value, float | int) and not isinstance(value, bool),
    ),
    int: _simple(int, {"type": "integer"}, operator.index),
    bool: _simple(bool, {"type": "boolean"}, bool),
    str: _simple(str, TEXT, str),
    NoneType: _simple(NoneType, TEXT),
    bytes: _simple(
        bytes,
        {**TEXT, "contentEncoding": "base64"},
        lambda value: base64.b64encode(value).decode("ascii"),
        _from_text(_read_base64, "base64"),
    ),
    datetime: _simple(
        datetime,
        TEXT,
        datetime.isoformat,
        _from_text(datetime.fromisoformat, "a time"),
    ),
    time: _simple(time, TEXT, time.isoformat, _from_text(time.fromisoformat, "a time of day")),
    timedelta: _simple(
        timedelta,
        {"type": "array", "items": {"type": "integer"}},
        lambda value: [value.days, value.seconds, value.microseconds],
        _read_duration,
    ),
    Path: Codec(
        str,
        _from_text(Path, "a path"),
        lambda: dict(TEXT),
        lambda value: isinstance(value, Path),
    ),
}


def literal(words: tuple[Any, ...]) -> Codec:
    """The codec of one of some words."""

    def decode(plain: Plain) -> Any:
        if plain not in words:
            raise CodecError(f"{shown(plain)} is none of {words}")
        return plain

    return Codec(_same, decode, lambda: {**TEXT, "enum": list(words)}, lambda value: value in words)


def enum_member(kind: type[Enum]) -> Codec:
    """The codec of a member of an enum."""
    members = dict(kind.__members__)

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, str) or plain not in members:
            raise CodecError(f"{shown(plain)} is no {kind.__name__}: {', '.join(members)}")
        return members[plain]

    return Codec(
        lambda value: value.name,
        decode,
        lambda: {"type": "string", "enum": list(members)},
        lambda value: isinstance(value, kind),
    )


def shown(plain: Plain) -> str:
    """Plain data in a message, however long they are."""
    text = repr(plain)
    return text if len(text) <= 60 else f"{text[:57]}..."
