"""Converts recorded values to JSON and back, with one type adapter for all of them.

Pydantic handles the declared types. Dataclasses, named tuples and airspaces are JSON objects,
recreated by their own constructors, which validate them. An enum member is written as its name,
because its value may be a sentence. In a union of dataclasses `type` names the class. NaN and
infinite numbers are the texts "NaN", "Infinity" and "-Infinity".

New members of `Event` or `Action` need no change here; a test covers all of them.
"""

import dataclasses
import json
import operator
import types
import typing
from collections.abc import Callable, Mapping
from enum import Enum
from functools import cache, reduce
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NotRequired, Union, get_args, get_origin

import numpy as np
from pydantic import (
    AfterValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainSerializer,
    SerializerFunctionWrapHandler,
    Tag,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    WrapSerializer,
    with_config,
)
from pydantic_core import PydanticSerializationError, to_json
from typing_extensions import TypeAliasType, TypedDict

from air_router.controller.model import Action, Event, FlightSetup
from air_router.errors import AirRouterError, ExitCode
from geo.airspace import Airspace, Shape, Zone
from mocha_link.links import LinkMetrics

SCHEMA_VERSION: Final = 2
"""Version of the records' content. It changes when older programs can no longer read new records,
or this program old ones. The schemas of each version are in docs/schemas."""

TYPE_KEY: Final = "type"

_SETTINGS: Final = ConfigDict(extra="forbid", ser_json_inf_nan="strings")
_AIRSPACE: Final[dict[str, Any]] = {
    "fences": tuple[Shape, ...],
    "zones": tuple[Zone, ...],
    "clearance_m": float,
    "margin_m": float,
    "relaxed_m": tuple[float, float],
}
"""Constructor arguments and attributes of an airspace, which is no dataclass."""


def _truth(value: object) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{value!r} is no truth value")
    return bool(value)


def _text(value: object) -> str:
    """A text without invalid characters, as in a file name that is not UTF-8."""
    if not isinstance(value, str | Path):
        raise TypeError(f"{value!r} is no text")
    text = str(value)
    return text if text.isascii() else text.encode(errors="replace").decode()


# Unions are serialized strictly: integers in float fields, and NumPy's numbers, must be converted
# to the declared type.
_SINGLE: Final[dict[Any, Any]] = {
    float: Annotated[
        float,
        PlainSerializer(float, return_type=float),
        WithJsonSchema({"type": ["number", "string"], "pattern": "^(NaN|-?Infinity)$"}),
    ],
    int: Annotated[int, Field(strict=True), PlainSerializer(operator.index, return_type=int)],
    bool: Annotated[bool, Field(strict=True), PlainSerializer(_truth, return_type=bool)],
    str: Annotated[str, PlainSerializer(_text, return_type=str)],
    Path: Annotated[Path, PlainSerializer(_text, return_type=str)],
}


class CodecError(AirRouterError, ValueError):
    """JSON does not match the expected type."""

    exit_code = ExitCode.INVALID_FILE


# Declared types for pydantic


@cache
def written_as(hint: Any, *, tagged: bool = False) -> Any:
    """The pydantic type of a declared type; `tagged`: with its name in `type`."""
    origin = get_origin(hint)
    if origin in _GENERIC:
        return _GENERIC[origin](get_args(hint))
    if isinstance(hint, type) and issubclass(hint, Enum):
        by_name = AfterValidator(lambda name: hint[name]), PlainSerializer(lambda m: m.name)
        return Annotated[Literal[*hint.__members__], *by_name]
    parts = _parts(hint)
    return _SINGLE.get(hint, hint) if parts is None else _object(hint, parts, tagged=tagged)


def _mapping(arguments: tuple[Any, ...]) -> Any:
    copied = WrapSerializer(lambda value, write: write(dict(value)))
    return Annotated[dict[arguments[0], written_as(arguments[1])], copied]  # type: ignore[misc, valid-type]


def _set(arguments: tuple[Any, ...]) -> Any:
    in_order = PlainSerializer(sorted)  # deterministic
    return Annotated[frozenset[written_as(arguments[0])], in_order]  # type: ignore[misc]


def _tuple(arguments: tuple[Any, ...]) -> Any:
    return tuple[*(part if part is ... else written_as(part) for part in arguments)]  # type: ignore[misc]


def _union(members: tuple[Any, ...]) -> Any:
    """A union; `type` discriminates several classes."""
    classes: list[Any] = [member for member in members if dataclasses.is_dataclass(member)]
    others = [written_as(member) for member in members if member not in classes]
    if len(classes) == 1:
        return reduce(operator.or_, [written_as(classes[0]), *others])
    if not classes:
        return Union[*others]
    choices = [Annotated[written_as(c, tagged=True), Tag(c.__name__)] for c in classes]
    choice = Annotated[Union[*choices], _WHICH]  # type: ignore[valid-type]
    return Union[choice, *others]


_GENERIC: Final[dict[Any, Callable[[tuple[Any, ...]], Any]]] = {
    Union: _union,
    types.UnionType: _union,
    Mapping: _mapping,
    frozenset: _set,
    tuple: _tuple,
}


def _name_of(value: Any) -> str:
    """The tag of an object or of its JSON in a union."""
    return str(value.get(TYPE_KEY)) if isinstance(value, dict) else type(value).__name__


_WHICH: Final = Discriminator(
    _name_of,
    custom_error_type="unknown_type",
    custom_error_message="its type is not allowed here",
)


def _parts(kind: Any) -> dict[str, Any] | None:
    """The declared types of a class's fields; those with a default are not required."""
    if kind is Airspace:
        return _AIRSPACE
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        defaults = {
            part.name: part.default is not part.default_factory
            for part in dataclasses.fields(kind)
            if part.init
        }
    elif hasattr(kind, "_fields"):  # a named tuple
        defaults = {name: name in kind._field_defaults for name in kind._fields}
    else:
        return None
    hints = typing.get_type_hints(kind)
    return {
        name: NotRequired[hints[name]] if optional else hints[name]
        for name, optional in defaults.items()
    }


def _object(kind: Any, parts: Mapping[str, Any], *, tagged: bool) -> Any:
    """A class as a JSON object of its fields."""
    tag = {TYPE_KEY: kind.__name__} if tagged else {}
    fields = {TYPE_KEY: Literal[kind.__name__]} if tagged else {}
    for name, hint in parts.items():
        optional = get_origin(hint) is NotRequired
        field = written_as(get_args(hint)[0] if optional else hint)
        fields[name] = NotRequired[field] if optional else field

    def made(plain: dict[str, Any]) -> Any:
        try:
            return kind(**{name: part for name, part in plain.items() if name in parts})
        except Exception as error:  # noqa: BLE001 - whatever the class refuses
            raise ValueError(str(error)) from None

    def written(value: Any, write: SerializerFunctionWrapHandler) -> Any:
        if not isinstance(value, kind):
            raise TypeError(f"{value!r} is no {kind.__name__}")
        return write({**tag, **{name: getattr(value, name) for name in parts}})

    plain = with_config(_SETTINGS)(TypedDict(kind.__name__, fields))  # type: ignore[operator]
    return Annotated[plain, AfterValidator(made), WrapSerializer(written)]


# Writing and reading


@cache
def adapter(hint: Any) -> TypeAdapter[Any]:
    """The type adapter of a declared type; unions have the classes' names."""
    named: Any = TypeAliasType("named", written_as(hint))  # so that the settings apply to any type
    return TypeAdapter(named, config=_SETTINGS)


RECORDED: Final = Event | Action | FlightSetup | LinkMetrics


def encode(value: object, of: Any = RECORDED) -> bytes:
    """Encode an event, action, setup or link as a JSON object; `type` is its class.

    Args:
        value: What is recorded.
        of: The declared type, where it is another.

    Raises:
        TypeError: It is none of these, or contains a value of another type than declared.
    """
    try:
        return adapter(of).dump_json(value, warnings="error")
    except PydanticSerializationError as error:
        raise TypeError(f"{value!r:.200} cannot be recorded: {error}") from None


def plain_of(value: object) -> dict[str, Any]:
    """The same as plain data."""
    plain: dict[str, Any] = json.loads(encode(value))
    return plain


def decode(plain: object) -> Any:
    """Decode an event, action, setup or link from plain data, bit-exact.

    A missing field has its default.

    Raises:
        CodecError: They match no recorded class.
    """
    return read(RECORDED, plain)


def read(hint: Any, plain: object) -> Any:
    """Decode a value of a declared type from plain data. Raises CodecError if it does not match."""
    try:
        return adapter(hint).validate_python(plain)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        text = f"{shown(first['input'])}: {first['msg']}"
        raise CodecError(f"{place}: {text}" if place else text) from None


def shown(plain: Any) -> str:
    """Plain data for an error message, shortened."""
    text = repr(plain)
    return text if len(text) <= 60 else f"{text[:57]}..."


def json_schema(title: str, hint: Any) -> dict[str, Any]:
    """The JSON schema of a declared type, with the version of records."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:air-router:record:{SCHEMA_VERSION}:{title.lower().replace(' ', '-')}",
        "title": title,
        "description": f"Version {SCHEMA_VERSION} of what records of air_router say.",
        **adapter(hint).json_schema(),
    }


def json_of(message: Mapping[str, Any]) -> str:
    """JSON for any reader: NaN becomes null."""
    try:
        return to_json(message, inf_nan_mode="null", fallback=str).decode()
    except PydanticSerializationError:  # a file's name that is no UTF-8, perhaps
        text = json.dumps(message, default=str)
        plain = json.loads(text, parse_constant=lambda _: None)
        return json.dumps(plain, ensure_ascii=False).encode(errors="replace").decode()
