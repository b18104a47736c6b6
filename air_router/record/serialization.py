"""What happens in a flight as messages of a record: their channels, JSON schemas, and contents.

Whatever joins `Event` or `Action` is written and read without a line here; a test walks all.
"""

import json
import math
import types
import typing
from collections.abc import Mapping
from enum import Enum
from functools import cache
from types import NoneType
from typing import Any, Final, NamedTuple, get_args, get_origin

from air_router.controller.model import Action, CommandConfirmed, CommandFailed, Event, Motion
from air_router.record import values
from air_router.record.values import TYPE_KEY, CodecError, decoder, fields_of, recorded_name
from mocha_link.links import LinkMetrics

ORDER_KEY: Final = "of"
"""Which motion a motion is, or a confirmation of one: there may be several alike."""

RECENT: Final = 64
"""A motion is confirmed, or fails, before so many others have been decided."""

ABOUT_MOTIONS: Final = (CommandConfirmed, CommandFailed)


class RecordChannel(NamedTuple):
    """A channel of messages in JSON: its topic, and the name and text of their JSON schema."""

    topic: str
    schema_name: str
    schema: str  # JSON schema


# Events and actions


@cache
def members() -> dict[str, type]:
    """Every class of event and action, by the name that records call it.

    Raises:
        TypeError: two of them have one name.
    """
    found: dict[str, type] = {}
    for kind in (*get_args(Event), *get_args(Action)):
        if found.setdefault(recorded_name(kind), kind) is not kind:
            raise TypeError(f"two events or actions are called {recorded_name(kind)}")
    return found


def encode(value: object) -> dict[str, Any]:
    """An event or action as an object that `json.dumps` takes; `type` is its class.

    Raises:
        TypeError: it is neither.
    """
    kind: Any = type(value)
    if members().get(recorded_name(kind)) is not kind:
        raise TypeError(f"{value!r} cannot be recorded: neither an event nor an action")
    plain: dict[str, Any] = values.encode(value)
    return plain


def decode(data: object) -> Any:
    """The event or action of an object that `encode` made: equal to it in every bit.

    A field that is missing has its default, or is nothing (None, an empty tuple) where it may be:
    so older records can be read.

    Raises:
        CodecError: the object says of no event or action what that has.
    """
    if not isinstance(data, dict):
        raise CodecError(f"{type(data).__name__} is no event or action: not an object")
    name = data.get(TYPE_KEY)
    kind = members().get(name) if isinstance(name, str) else None
    if kind is None:
        raise CodecError(f"type {str(name)[:60]!r} is no event or action")
    return decoder(kind)(data)


def json_of(message: Mapping[str, Any]) -> str:
    """JSON that any reader takes: a number that is none becomes null."""
    try:
        return json.dumps(message, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError):
        return json.dumps(_finite(message), separators=(",", ":"), default=str)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(inner) for key, inner in value.items()}
    return [_finite(inner) for inner in value] if isinstance(value, list | tuple) else value


# Channels

NOTES: Final[Mapping[str, Mapping[str, Any]]] = {
    "Clock": {"unix_s": float},
    "Reaction": {"reaction_s": float},
    "HomeBy": {"home_by_s": float},
    "Map": {"known_cells": int},
    "MapPublished": {"known_cells": int},
    "Held": {"peer": str, "held": list[tuple[str, str, float]]},
}
"""Notes that a replay or a report reads, with the types of their fields; others are for people."""

_TEXT: Final = {"type": "string"}
_NUMBER: Final = {"type": "number"}
_SCHEMAS: Final[dict[Any, dict[str, Any]]] = {
    float: _NUMBER,
    int: {"type": "integer"},
    bool: {"type": "boolean"},
}


def _channel(topic: str, title: str, properties: dict[str, Any], **more: Any) -> RecordChannel:
    schema = {"title": title, "type": "object", "properties": {"t": _NUMBER, **properties}, **more}
    return RecordChannel(topic, f"air_router.{title}", json.dumps(schema))


PATCHES: Final = _channel("/patches", "Patch", {"patch": {**_TEXT, "contentEncoding": "base64"}})


@cache
def channel_of(kind: str, of: Any) -> RecordChannel:
    """The channel of a class of events or actions."""
    return _timed(f"/{kind}/{recorded_name(of)}", of)


@cache
def link_channel() -> RecordChannel:
    """The channel of the metrics of links."""
    return _timed("/links", LinkMetrics)


@cache
def note_channel(name: str) -> RecordChannel:
    """The channel of a note of the shell's."""
    parts = {part: schema_of(of) for part, of in NOTES.get(name, {}).items()}
    made = _channel(f"/flight/{name}", name, {TYPE_KEY: {**_TEXT, "const": name}, **parts})
    return made._replace(schema_name=f"air_router.flight.flight.{name}")


def _timed(topic: str, of: Any) -> RecordChannel:
    """The channel of a class, with the time in front."""
    schema = schema_of(of)
    order = {"type": "integer", "description": "which motion, counted from 1"}
    more = {ORDER_KEY: order} if of in (*get_args(Motion), *ABOUT_MOTIONS) else {}
    properties, required = {**more, **schema["properties"]}, ["t", *schema["required"]]
    return _channel(topic, schema["title"], properties, required=required)


@cache
def schema_of(hint: Any) -> dict[str, Any]:
    """The JSON schema of a declared type, as far as the viewers of records understand it.

    One type each, no alternatives, nothing said of what may be null.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    parts = [of for of in arguments if of not in (NoneType, Ellipsis)]
    fields = fields_of(hint)
    if origin in (typing.Union, types.UnionType):
        return _schema_of_any([schema_of(part) for part in parts])
    if origin in (dict, Mapping):
        return {
            "type": "object",
            "properties": {},
            "additionalProperties": schema_of(arguments[1]),
        }
    if origin in (tuple, list, frozenset):
        items = _schema_of_any([schema_of(part) for part in parts])
        # Of lists in lists viewers know nothing, so that of those nothing is said.
        known = items if items["type"] != "array" else {"type": "object", "properties": {}}
        return {"type": "array", "items": known}
    if fields is not None:
        return _schema_of_fields(fields)
    is_enum = isinstance(hint, type) and issubclass(hint, Enum)
    if is_enum or origin is typing.Literal:
        return {**_TEXT, "enum": list(hint.__members__ if is_enum else arguments)}
    return _SCHEMAS.get(hint, _TEXT)


def _schema_of_fields(fields: values.Fields) -> dict[str, Any]:
    tags = {TYPE_KEY: {**_TEXT, "const": fields.name}} if fields.tagged else {}
    parts = {key: schema_of(fields.hints[name]) for key, name in fields.recorded.items()}
    needed = [key for key, name in fields.recorded.items() if name in fields.needed]
    return {
        "type": "object",
        "title": fields.name,
        "properties": tags | parts,
        "required": [*tags, *needed],
    }


def _schema_of_any(schemas: list[dict[str, Any]]) -> dict[str, Any]:
    """One form for all members: viewers know no alternatives. Of objects it has every field."""
    if not schemas or any(schema["type"] != "object" for schema in schemas):
        return schemas[0] if schemas else dict(_TEXT)
    properties = {name: part for s in reversed(schemas) for name, part in s["properties"].items()}
    kinds = [s["title"] for s in schemas if "title" in s]
    if len(schemas) > 1 and TYPE_KEY in properties:
        properties = {**properties, TYPE_KEY: {**_TEXT, "enum": kinds}}
    return {"type": "object", "title": " or ".join(kinds), "properties": properties}
