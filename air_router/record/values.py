"""Values as plain JSON data and back, exactly.

A value is written by what it is and read by the type that its dataclass declares: JSON knows no
tuples and no classes. Dataclasses become objects with their name in `type`, named tuples objects
without it, members of an enum their name, and numbers that JSON cannot write the
texts "NaN", "Infinity" and "-Infinity".
"""

import dataclasses
import math
import operator
import types
import typing
from collections.abc import Callable, Mapping
from datetime import datetime, time
from enum import Enum
from functools import cache, cached_property, partial
from itertools import repeat
from pathlib import Path
from types import NoneType
from typing import Any, Final, get_args, get_origin

import numpy as np

from air_router.errors import AirRouterError, ExitCode
from geo.airspace import Airspace, Shape, Zone

Plain = Any
"""What `json.dumps` takes and `json.loads` gives."""

Decoder = Callable[[Plain], Any]
"""Makes a value of plain data; raises CodecError."""

TYPE_KEY: Final = "type"

RECORDED_AS: Final = {"CommandAck": "Answered"}
"""Classes by name that records call otherwise: records of before are to be read."""

FIELDS_RECORDED_AS: Final = {
    ("FlightSetup", "pilot_arms"): "patient",
    ("Mission", "climb_airspace"): "column_airspace",
    ("Mission", "climb_corridors"): "columns",
    ("Airspace", "relaxed_m"): "ease_m",
}
"""The same of fields."""

_MADE_OF: Final[dict[Any, dict[str, Any]]] = {
    Airspace: {
        "fences": tuple[Shape, ...],
        "zones": tuple[Zone, ...],
        "clearance_m": float,
        "margin_m": float,
        "relaxed_m": tuple[float, float],
    }
}
"""Classes that are no dataclasses, whose constructors take what attributes of these names hold."""

_NOT_NUMBERS: Final = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


class CodecError(AirRouterError, ValueError):
    """Plain data that are no value of the type that they should be."""

    exit_code = ExitCode.INVALID_FILE


def recorded_name(kind: Any) -> str:
    """What records call a class."""
    return RECORDED_AS.get(kind.__name__, str(kind.__name__))


def encode(value: object) -> Plain:
    """A value as plain data. Raises TypeError: it, or one within it, cannot be written."""
    kind: Any = type(value)
    return _encoder(kind)(value)


@cache
def _encoder(kind: type) -> Callable[[Any], Plain]:
    fields = fields_of(kind)
    if fields is not None:
        return fields.encode
    for base, write in _WRITERS.items():
        if issubclass(kind, base):
            return write
    raise TypeError(f"a {kind.__name__} cannot be recorded: no type that is written as JSON")


@cache
def decoder(hint: Any) -> Decoder:
    """What makes a value of a declared type of plain data; it raises CodecError.

    Raises:
        TypeError: the type is none that can be written.
    """
    origin = get_origin(hint)
    if origin in _GENERIC:
        return _GENERIC[origin](get_args(hint))
    if hint in _READERS:
        return _READERS[hint]
    if isinstance(hint, type) and issubclass(hint, Enum):
        return _one_word(dict(hint.__members__), hint.__name__)
    fields = fields_of(hint)
    if fields is None:
        raise TypeError(f"{hint!r} cannot be recorded: no type that is written as JSON")
    return fields.decode


def shown(plain: Plain) -> str:
    """Plain data in a message, however long they are."""
    text = repr(plain)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _exactly(kind: type, what: str = "", read: Callable[[Any], Any] | None = None) -> Decoder:
    """Take plain data of this type (True is no number) as they are, or as `read` makes them."""
    what = what or kind.__name__

    def decode(plain: Plain) -> Any:
        if type(plain) is not kind:
            raise CodecError(f"{shown(plain)} is not {what}")
        try:
            return plain if read is None else read(plain)
        except ValueError as error:
            raise CodecError(f"{shown(plain)} is not {what}: {error}") from None

    return decode


def _write_float(value: float) -> Plain:
    if math.isfinite(value):
        return float(value)
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"


def _read_float(plain: Plain) -> float:
    if type(plain) is float or type(plain) is int:
        return plain
    if isinstance(plain, str) and plain in _NOT_NUMBERS:
        return _NOT_NUMBERS[plain]
    raise CodecError(f"{shown(plain)} is not a number")


def _one_word(words: Mapping[Any, Any], what: str) -> Decoder:
    """What reads a word that stands for one of these members."""

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, str | int) or plain not in words:
            raise CodecError(f"{shown(plain)} is no {what}: {', '.join(map(str, words))}")
        return words[plain]

    return decode


_READERS: Final[dict[Any, Decoder]] = {
    bool: _exactly(bool),
    int: _exactly(int),
    float: _read_float,
    str: _exactly(str),
    NoneType: _exactly(NoneType),
    datetime: _exactly(str, "a time", datetime.fromisoformat),
    time: _exactly(str, "a time of day", time.fromisoformat),
    Path: _exactly(str, "a path", Path),
}

_WRITERS: Final[dict[type, Callable[[Any], Plain]]] = {  # the first that fits
    Enum: lambda value: value.name,
    bool: bool,
    int: operator.index,
    float: _write_float,
    str: str,
    NoneType: lambda _: None,
    datetime: datetime.isoformat,
    time: time.isoformat,
    Path: str,
    frozenset: lambda value: sorted(map(encode, value), key=repr),  # the same in every run
    tuple: lambda value: [encode(inner) for inner in value],
    list: lambda value: [encode(inner) for inner in value],
    Mapping: lambda value: {key: encode(inner) for key, inner in value.items()},
    np.generic: lambda value: encode(value.item()),
}


def _union(members: tuple[Any, ...]) -> Decoder:
    """The first member that the data are; objects are told apart by their `type`."""
    tagged = {fields.name: fields for m in members if (fields := fields_of(m)) and fields.tagged}
    others = [decoder(m) for m in members if m not in {fields.kind for fields in tagged.values()}]

    def decode(plain: Plain) -> Any:
        if isinstance(plain, dict) and TYPE_KEY in plain:
            name = plain[TYPE_KEY]
            if not isinstance(name, str) or name not in tagged:
                raise CodecError(f"type {shown(name)} is none of {', '.join(tagged) or 'none'}")
            return tagged[name].decode(plain)
        problem = "nothing fits"
        for read in others:
            try:
                return read(plain)
            except CodecError as error:
                if plain is not None:
                    problem = str(error)
        raise CodecError(problem)

    return decode


def _sequence(kind: Any, arguments: tuple[Any, ...]) -> Decoder:
    """Any number of one type, or a tuple of so many declared types."""
    parts = [decoder(argument) for argument in arguments if argument is not Ellipsis]
    fixed = kind is tuple and Ellipsis not in arguments

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, list):
            raise CodecError(f"{shown(plain)} is not a list")
        if fixed and len(plain) != len(parts):
            raise CodecError(f"{shown(plain)} is not a list of {len(parts)}")
        readers = parts if fixed else repeat(parts[0], len(plain))
        return kind(read(value) for read, value in zip(readers, plain, strict=True))

    return decode


def _mapping(arguments: tuple[Any, ...]) -> Decoder:
    if arguments[0] is not str:
        raise TypeError(f"keys of {arguments[0]} cannot be recorded: JSON has texts only")
    read = decoder(arguments[1])

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, dict):
            raise CodecError(f"{shown(plain)} is not an object")
        return {key: read(value) for key, value in plain.items()}

    return decode


_GENERIC: Final[dict[Any, Callable[[tuple[Any, ...]], Decoder]]] = {
    typing.Union: _union,
    types.UnionType: _union,
    typing.Literal: lambda words: _one_word({word: word for word in words}, "such word"),
    tuple: partial(_sequence, tuple),
    list: partial(_sequence, list),
    frozenset: partial(_sequence, frozenset),
    dict: _mapping,
    Mapping: _mapping,
}


class Fields:
    """The parts of a dataclass, a named tuple or a class of known parts.

    Attributes:
        kind: The class; `name`: what records call it.
        recorded: Its fields that the constructor takes, by what records call each.
        needed: Those of them that have no default.
        tagged: It is written with its name; named tuples are not.
    """

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        self.name = recorded_name(kind)
        self.tagged = True
        defaults: set[str] = set()
        if kind in _MADE_OF:
            names = tuple(_MADE_OF[kind])
        elif dataclasses.is_dataclass(kind):
            parts = [part for part in dataclasses.fields(kind) if part.init]
            names = tuple(part.name for part in parts)
            defaults = {part.name for part in parts if part.default is not part.default_factory}
        else:
            names, self.tagged = tuple(kind._fields), False
            defaults = set(kind._field_defaults)
        if TYPE_KEY in names:
            raise TypeError(f"{self.name} cannot be recorded: it has a field `{TYPE_KEY}`")
        self.recorded = {FIELDS_RECORDED_AS.get((self.name, name), name): name for name in names}
        self.needed = frozenset(names) - defaults

    @cached_property
    def hints(self) -> dict[str, Any]:
        """The declared types of the fields."""
        found = _MADE_OF.get(self.kind) or typing.get_type_hints(self.kind)
        return {name: found[name] for name in self.recorded.values()}

    @cached_property
    def _decoders(self) -> dict[str, Decoder]:
        """Made at the first use, because a class may contain itself."""
        return {key: decoder(self.hints[name]) for key, name in self.recorded.items()}

    @cached_property
    def _absent(self) -> dict[str, Any]:
        """What stands for a field that an older record did not know, where it may be nothing."""
        found: dict[str, Any] = {}
        for name in self.needed:
            hint, arguments = self.hints[name], get_args(self.hints[name])
            if NoneType in arguments:
                found[name] = None
            elif get_origin(hint) is tuple and Ellipsis in arguments:
                found[name] = ()
        return found

    def encode(self, value: Any) -> Plain:
        """A value of the class as an object."""
        plain: dict[str, Plain] = {TYPE_KEY: self.name} if self.tagged else {}
        for key, name in self.recorded.items():
            part = getattr(value, name)
            kind: Any = type(part)
            plain[key] = _encoder(kind)(part)
        return plain

    def decode(self, plain: Plain) -> Any:
        """A value of the class, made by its constructor."""
        tag = self.name if self.tagged else None
        if not isinstance(plain, dict) or plain.get(TYPE_KEY) != tag:
            raise CodecError(f"{shown(plain)} is no {self.name}")
        values = dict(self._absent)
        for key, part in plain.items():
            if key != TYPE_KEY:
                values[self.recorded.get(str(key), "")] = self._field(key, part)
        if lacking := self.needed - values.keys():
            raise CodecError(f"{self.name} without {', '.join(sorted(lacking))}")
        try:
            return self.kind(**values)
        except Exception as error:  # noqa: BLE001 - whatever the class refuses
            raise CodecError(f"no {self.name}: {error}") from None

    def _field(self, key: str, plain: Plain) -> Any:
        read = self._decoders.get(key)
        if read is None:
            raise CodecError(f"{self.name} has no {shown(key)}")
        try:
            return read(plain)
        except CodecError as error:
            raise CodecError(f"{self.name}.{key}: {error}") from None


@cache
def fields_of(hint: Any) -> Fields | None:
    """The parts of a type; None of one that has none."""
    if not isinstance(hint, type) or get_origin(hint) is not None:
        return None
    known = hint in _MADE_OF or dataclasses.is_dataclass(hint) or hasattr(hint, "_fields")
    return Fields(hint) if known else None
