"""Values as plain JSON data and back, exactly.

A value is written by what it is and read by the type that its dataclass declares: JSON knows no
tuples and no classes. Dataclasses become objects with their name in `type`, named tuples objects
without it, members of an enum their name, bytes base64, and numbers that JSON cannot write the
texts "NaN", "Infinity" and "-Infinity".
"""

import base64
import dataclasses
import operator
import types
import typing
from collections.abc import Callable, Mapping
from datetime import datetime, time, timedelta
from enum import Enum
from functools import cache, cached_property
from pathlib import PurePath
from types import NoneType
from typing import Any, Final, get_args, get_origin

import numpy as np

from air_router.record.single_values import (
    READERS,
    CodecError,
    Plain,
    one_word,
    shown,
    write_float,
)
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Shape, Zone

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


def recorded_name(kind: Any) -> str:
    """What records call a class."""
    name: str = kind.__name__
    return RECORDED_AS.get(name, name)


# Writing


def encode(value: object) -> Plain:
    """A value as plain data. Raises TypeError: it, or one within it, cannot be written."""
    kind: Any = type(value)
    return _writer(kind)(value)


@cache
def _writer(kind: type) -> Callable[[Any], Plain]:
    fields = fields_of(kind)
    if fields is not None:
        tag: dict[str, Plain] = {TYPE_KEY: fields.name} if fields.tagged else {}
        names = fields.recorded.items()
        return lambda value: {**tag, **{key: encode(getattr(value, name)) for key, name in names}}
    for base, write in _WRITERS.items():
        if issubclass(kind, base):
            return write
    raise TypeError(f"a {kind.__name__} cannot be recorded: no type that is written as JSON")


_WRITERS: Final[dict[type, Callable[[Any], Plain]]] = {  # the first that fits
    Enum: lambda value: value.name,
    bool: bool,
    int: operator.index,
    float: write_float,
    str: str,
    NoneType: lambda _: None,
    bytes: lambda value: base64.b64encode(value).decode("ascii"),
    datetime: datetime.isoformat,
    time: time.isoformat,
    timedelta: lambda value: [value.days, value.seconds, value.microseconds],
    PurePath: str,
    frozenset: lambda value: sorted(map(encode, value), key=repr),  # the same in every run
    tuple: lambda value: [encode(inner) for inner in value],
    list: lambda value: [encode(inner) for inner in value],
    Mapping: lambda value: {key: encode(inner) for key, inner in value.items()},
    np.generic: lambda value: encode(value.item()),
}


# Reading


@cache
def decoder(hint: Any) -> Callable[[Plain], Any]:
    """What makes a value of a declared type of plain data; it raises CodecError.

    Raises:
        TypeError: the type is none that can be written.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in _GENERIC:
        return _GENERIC[origin](arguments)
    if hint in READERS:
        return READERS[hint]
    if isinstance(hint, type) and issubclass(hint, Enum):
        return one_word(dict(hint.__members__), hint.__name__)
    fields = fields_of(hint)
    if fields is None:
        raise TypeError(f"{hint!r} cannot be recorded: no type that is written as JSON")
    return fields.decode


def _union(members: tuple[Any, ...]) -> Callable[[Plain], Any]:
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


def _tuple(arguments: tuple[Any, ...]) -> Callable[[Plain], Any]:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        return _collection(tuple, arguments)
    parts = [decoder(argument) for argument in arguments]

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, list) or len(plain) != len(parts):
            raise CodecError(f"{shown(plain)} is not a list of {len(parts)}")
        return tuple(part(value) for part, value in zip(parts, plain, strict=True))

    return decode


def _collection(kind: Any, arguments: tuple[Any, ...]) -> Callable[[Plain], Any]:
    read = decoder(arguments[0])

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, list):
            raise CodecError(f"{shown(plain)} is not a list")
        return kind(read(inner) for inner in plain)

    return decode


def _mapping(arguments: tuple[Any, ...]) -> Callable[[Plain], Any]:
    if arguments[0] is not str:
        raise TypeError(f"keys of {arguments[0]} cannot be recorded: JSON has texts only")
    read = decoder(arguments[1])

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, dict):
            raise CodecError(f"{shown(plain)} is not an object")
        return {key: read(value) for key, value in plain.items()}

    return decode


_GENERIC: Final[dict[Any, Callable[[tuple[Any, ...]], Callable[[Plain], Any]]]] = {
    typing.Union: _union,
    types.UnionType: _union,
    typing.Literal: lambda words: one_word({word: word for word in words}, "such word"),
    tuple: _tuple,
    list: lambda arguments: _collection(list, arguments),
    frozenset: lambda arguments: _collection(frozenset, arguments),
    dict: _mapping,
    Mapping: _mapping,
}


class Fields:
    """The parts of a dataclass, a named tuple or a class of known parts.

    Attributes:
        kind: The class; `name`: what records call it.
        names: Its fields that the constructor takes.
        recorded: The same, by what records call each.
        needed: Those of them that have no default.
        tagged: It is written with its name; named tuples are not.
    """

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        self.name = recorded_name(kind)
        self.tagged = True
        missing = dataclasses.MISSING
        optional: set[str] = set()
        if kind in _MADE_OF:
            self.names = tuple(_MADE_OF[kind])
        elif dataclasses.is_dataclass(kind):
            fields = [field for field in dataclasses.fields(kind) if field.init]
            self.names = tuple(field.name for field in fields)
            optional = {
                field.name
                for field in fields
                if field.default is not missing or field.default_factory is not missing
            }
        else:
            self.names, self.tagged = tuple(kind._fields), False
            optional = set(kind._field_defaults)
        if TYPE_KEY in self.names:
            raise TypeError(f"{self.name} cannot be recorded: it has a field `{TYPE_KEY}`")
        called = {name: FIELDS_RECORDED_AS.get((self.name, name), name) for name in self.names}
        self.recorded = {key: name for name, key in called.items()}
        self.needed = frozenset(self.names) - optional

    @cached_property
    def hints(self) -> dict[str, Any]:
        """The declared types of the fields."""
        found = _MADE_OF.get(self.kind) or typing.get_type_hints(self.kind)
        return {name: found[name] for name in self.names}

    @cached_property
    def _readers(self) -> dict[str, Callable[[Plain], Any]]:
        """Made at the first use, because a class may contain itself."""
        return {name: decoder(hint) for name, hint in self.hints.items()}

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

    def decode(self, plain: Plain) -> Any:
        """A value of the class, made by its constructor."""
        tag = self.name if self.tagged else None
        if not isinstance(plain, dict) or plain.get(TYPE_KEY) != tag:
            raise CodecError(f"{shown(plain)} is no {self.name}")
        values = dict(self._absent)
        for key, part in plain.items():
            if key != TYPE_KEY:
                values[self.recorded[key]] = self._field(key, part)
        if lacking := self.needed - values.keys():
            raise CodecError(f"{self.name} without {', '.join(sorted(lacking))}")
        try:
            return self.kind(**values)
        except Exception as error:  # noqa: BLE001 - whatever the class refuses
            raise CodecError(f"no {self.name}: {error}") from None

    def _field(self, key: str, plain: Plain) -> Any:
        read = self._readers.get(self.recorded.get(key, ""))
        if read is None:
            raise CodecError(f"{self.name} has no {shown(key)}")
        try:
            return read(plain)
        except CodecError as error:
            raise CodecError(f"{self.name}.{key}: {error}") from None


@cache
def fields_of(hint: Any) -> Fields | None:
    """The parts of a type; None of one that has none."""
    is_class = isinstance(hint, type) and get_origin(hint) is None
    if is_class and (
        hint in _MADE_OF or dataclasses.is_dataclass(hint) or hasattr(hint, "_fields")
    ):
        return Fields(hint)
    return None
