"""Values as plain JSON data and back, exactly, by the types that their dataclasses declare.

JSON knows no tuples and no classes; the declared type says what was meant. Dataclasses become
objects with their name in `type`, named tuples objects without it; `plain_values` are the rest.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Callable, Mapping
from enum import Enum
from functools import cache
from types import NoneType
from typing import Any, Final, get_args, get_origin

from air_router.record.plain_values import (
    SIMPLE,
    TEXT,
    Codec,
    CodecError,
    Plain,
    enum_member,
    literal,
    shown,
)
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Shape, Zone

__all__ = ["TYPE_KEY", "Codec", "CodecError", "codec_of", "recorded_name"]

TYPE_KEY: Final = "type"

RECORDED_AS: Final = {"CommandAck": "Answered"}
"""Classes by name that records call otherwise: records of before are to be read."""


def recorded_name(kind: Any) -> str:
    """What records call a class."""
    name: str = kind.__name__
    return RECORDED_AS.get(name, name)


@cache
def codec_of(hint: Any) -> Codec:
    """The codec of a declared type.

    Raises:
        TypeError: the type, or one of a field within it, is none that can be written.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in _GENERIC:
        return _GENERIC[origin](arguments)
    if hint in SIMPLE:
        return SIMPLE[hint]
    if hint in _MADE_OF:
        return _Object(hint, _MADE_OF[hint]).codec()
    if isinstance(hint, type) and issubclass(hint, Enum):
        return enum_member(hint)
    if isinstance(hint, type) and (dataclasses.is_dataclass(hint) or hasattr(hint, "_fields")):
        return _Object(hint).codec()
    raise TypeError(f"{hint!r} cannot be recorded: no type that is written as JSON")


def _union(members: tuple[Any, ...]) -> Codec:
    """The first member that the value is one of; objects are told apart by their `type`."""
    codecs = [codec_of(member) for member in members]
    tagged = {recorded_name(m): c for m, c in zip(members, codecs, strict=True) if _is_tagged(m)}
    others = [c for m, c in zip(members, codecs, strict=True) if not _is_tagged(m)]
    by_class = {m: c for m, c in zip(members, codecs, strict=True) if isinstance(m, type)}

    def encode(value: Any) -> Plain:
        codec = by_class.get(type(value))
        if codec is None:
            codec = next((c for c in codecs if c.takes(value)), None)
        if codec is None:
            raise TypeError(f"{value!r} cannot be recorded: none of {members}")
        return codec.encode(value)

    def decode(plain: Plain) -> Any:
        if isinstance(plain, dict) and TYPE_KEY in plain:
            name = plain[TYPE_KEY]
            if not isinstance(name, str) or name not in tagged:
                raise CodecError(f"type {shown(name)} is none of {', '.join(tagged) or 'none'}")
            return tagged[name].decode(plain)
        problem = "nothing fits"
        for codec in others:
            try:
                return codec.decode(plain)
            except CodecError as error:
                if plain is not None:
                    problem = str(error)
        raise CodecError(problem)

    return Codec(
        encode,
        decode,
        lambda: _union_schema(
            [c.schema() for m, c in zip(members, codecs, strict=True) if m is not NoneType]
        ),
        lambda value: any(codec.takes(value) for codec in codecs),
    )


def _union_schema(schemas: list[dict[str, Any]]) -> dict[str, Any]:
    """One form for all members: viewers know no alternatives. Of objects it has every field."""
    if not schemas or any(schema["type"] != "object" for schema in schemas):
        return schemas[0] if schemas else dict(TEXT)
    properties = {name: part for s in reversed(schemas) for name, part in s["properties"].items()}
    kinds = [s["title"] for s in schemas if "title" in s]
    if len(schemas) > 1 and TYPE_KEY in properties:
        properties = {**properties, TYPE_KEY: {**TEXT, "enum": kinds}}
    return {"type": "object", "title": " or ".join(kinds), "properties": properties}


def _is_tagged(member: Any) -> bool:
    return member in _MADE_OF or (isinstance(member, type) and dataclasses.is_dataclass(member))


def _array_schema(items: dict[str, Any]) -> dict[str, Any]:
    """An array; of arrays viewers know nothing, so that of those nothing is said."""
    known = items if items["type"] != "array" else {"type": "object", "properties": {}}
    return {"type": "array", "items": known}


def _tuple(arguments: tuple[Any, ...]) -> Codec:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        return _collection(tuple, arguments[0])
    parts = [codec_of(argument) for argument in arguments]

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, list) or len(plain) != len(parts):
            raise CodecError(f"{shown(plain)} is not a list of {len(parts)}")
        return tuple(part.decode(value) for part, value in zip(parts, plain, strict=True))

    return Codec(
        lambda value: [part.encode(inner) for part, inner in zip(parts, value, strict=True)],
        decode,
        lambda: _array_schema(_union_schema([part.schema() for part in parts])),
        lambda value: isinstance(value, tuple) and len(value) == len(parts),
    )


def _collection(kind: Any, of: Any) -> Codec:
    part = codec_of(of)
    write, read = part.encode, part.decode

    def encode(value: Any) -> Plain:
        plain = [write(inner) for inner in value]
        return sorted(plain, key=repr) if kind is frozenset else plain  # the same in every run

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, list):
            raise CodecError(f"{shown(plain)} is not a list")
        return kind(read(inner) for inner in plain)

    return Codec(
        encode,
        decode,
        lambda: _array_schema(part.schema()),
        lambda value: isinstance(value, kind),
    )


def _mapping(arguments: tuple[Any, ...]) -> Codec:
    if arguments[0] is not str:
        raise TypeError(f"keys of {arguments[0]} cannot be recorded: JSON has texts only")
    part = codec_of(arguments[1])

    def decode(plain: Plain) -> Any:
        if not isinstance(plain, dict):
            raise CodecError(f"{shown(plain)} is not an object")
        return {key: part.decode(value) for key, value in plain.items()}

    return Codec(
        lambda value: {key: part.encode(inner) for key, inner in value.items()},
        decode,
        lambda: {"type": "object", "properties": {}, "additionalProperties": part.schema()},
        lambda value: isinstance(value, Mapping),
    )


class _Object:
    """A dataclass, a named tuple or a class of known parts, made by its constructor."""

    def __init__(self, kind: Any, hints: dict[str, Any] | None = None) -> None:
        self._kind = kind
        self._hints = hints
        self._name = recorded_name(kind)
        self._tag: str | None = None
        optional: set[str] = set()
        if hints is not None:
            self._tag = self._name
            self._names = list(hints)
        elif dataclasses.is_dataclass(kind):
            self._tag = self._name
            fields = [field for field in dataclasses.fields(kind) if field.init]
            self._names = [field.name for field in fields]
            missing = dataclasses.MISSING
            for field in fields:
                if field.default is not missing or field.default_factory is not missing:
                    optional.add(field.name)
        else:
            self._names, optional = list(kind._fields), set(kind._field_defaults)
        if TYPE_KEY in self._names:
            raise TypeError(f"{self._name} cannot be recorded: it has a field `{TYPE_KEY}`")
        self._needed = frozenset(self._names) - optional
        self._parts: dict[str, Codec] | None = None
        self._absent: dict[str, Any] = {}

    def codec(self) -> Codec:
        return Codec(
            self._encode, self._decode, self._schema, lambda value: type(value) is self._kind
        )

    def _codecs(self) -> dict[str, Codec]:
        """Made at the first use, because a class may contain itself."""
        if self._parts is None:
            hints = self._hints or typing.get_type_hints(self._kind)
            self._parts = {name: codec_of(hints[name]) for name in self._names}
            self._absent = {n: _nothing(hints[n]) for n in self._needed if _may_lack(hints[n])}
        return self._parts

    def _encode(self, value: Any) -> Plain:
        plain: dict[str, Plain] = {} if self._tag is None else {TYPE_KEY: self._tag}
        for name, codec in (self._parts or self._codecs()).items():
            plain[name] = codec.encode(getattr(value, name))
        return plain

    def _decode(self, plain: Plain) -> Any:
        name = self._name
        if not isinstance(plain, dict) or plain.get(TYPE_KEY) != self._tag:
            raise CodecError(f"{shown(plain)} is no {name}")
        values = {key: self._field(key, part) for key, part in plain.items() if key != TYPE_KEY}
        for key in self._needed - values.keys():
            if key in self._absent:
                values[key] = self._absent[key]
        if missing := self._needed - values.keys():
            raise CodecError(f"{name} without {', '.join(sorted(missing))}")
        try:
            return self._kind(**values)
        except Exception as error:  # noqa: BLE001 - whatever the class refuses
            raise CodecError(f"no {name}: {error}") from None

    def _field(self, key: str, plain: Plain) -> Any:
        codec = self._codecs().get(key)
        if codec is None:
            raise CodecError(f"{self._name} has no {shown(key)}")
        try:
            return codec.decode(plain)
        except CodecError as error:
            raise CodecError(f"{self._name}.{key}: {error}") from None

    def _schema(self) -> dict[str, Any]:
        tags = {} if self._tag is None else {TYPE_KEY: {"type": "string", "const": self._tag}}
        properties = {name: codec.schema() for name, codec in self._codecs().items()}
        return {
            "type": "object",
            "title": self._name,
            "properties": {**tags, **properties},
            "required": [*tags, *(name for name in self._names if name in self._needed)],
        }


_MADE_OF: Final[dict[Any, dict[str, Any]]] = {
    Airspace: {
        "fences": tuple[Shape, ...],
        "zones": tuple[Zone, ...],
        "clearance_m": float,
        "margin_m": float,
        "ease_m": tuple[float, float],
    }
}
"""Classes that are no dataclasses, whose constructors take what attributes of these names hold."""

_GENERIC: Final[dict[Any, Callable[[tuple[Any, ...]], Codec]]] = {
    typing.Union: _union,
    types.UnionType: _union,
    typing.Literal: literal,
    tuple: _tuple,
    list: lambda arguments: _collection(list, arguments[0]),
    frozenset: lambda arguments: _collection(frozenset, arguments[0]),
    dict: _mapping,
    Mapping: _mapping,
}


def _may_lack(hint: Any) -> bool:
    """Whether a value of a type can be nothing: an older record knew no such field."""
    arguments = get_args(hint)
    return NoneType in arguments or (get_origin(hint) is tuple and Ellipsis in arguments)


def _nothing(hint: Any) -> Any:
    return None if NoneType in get_args(hint) else ()
