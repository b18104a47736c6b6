"""The channels of a flight's record, with their JSON schemas, and how a message is written."""

import json
import math
import types
import typing
from collections.abc import Mapping
from datetime import timedelta
from enum import Enum
from functools import cache
from types import NoneType
from typing import Any, Final, get_args, get_origin

from air_router.controller.model.actions import Motion
from air_router.controller.model.events import CommandConfirmed, CommandFailed
from air_router.record.codec import TYPE_KEY, fields_of, recorded_name
from air_router.record.log_file import ORDER_KEY, RecordChannel
from mocha_link.links.metrics import LinkMetrics

MOTIONS: Final = get_args(Motion)
ABOUT_MOTIONS: Final = (CommandConfirmed, CommandFailed)
PATCHES: Final = RecordChannel(
    "/patches",
    "air_router.Patch",
    json.dumps(
        {
            "title": "Patch",
            "type": "object",
            "properties": {
                "t": {"type": "number"},
                "patch": {"type": "string", "contentEncoding": "base64"},
            },
        }
    ),
)

_TEXT: Final = {"type": "string"}
_SCHEMAS: Final[dict[Any, dict[str, Any]]] = {
    float: {"type": "number"},
    int: {"type": "integer"},
    bool: {"type": "boolean"},
    bytes: {**_TEXT, "contentEncoding": "base64"},
    timedelta: {"type": "array", "items": {"type": "integer"}},
}


@cache
def channel_of(kind: str, of: Any) -> RecordChannel:
    """The channel of a class of events or actions."""
    name = recorded_name(of)
    return RecordChannel(f"/{kind}/{name}", f"air_router.{name}", _timed(schema_of(of)))


NOTES: Final[Mapping[str, Mapping[str, Any]]] = {
    "Clock": {"unix_s": float},
    "Reaction": {"reaction_s": float},
    "Map": {"known_cells": int},
    "MapPublished": {"known_cells": int},
    "Held": {"peer": str, "held": list[tuple[str, str, float]]},
}
"""Notes that a replay or a report reads, with the types of their fields; others are for people."""


@cache
def note_channel(name: str) -> RecordChannel:
    """The channel of a note of the shell's."""
    properties = {"t": {"type": "number"}, TYPE_KEY: {"type": "string", "const": name}}
    properties |= {field: schema_of(of) for field, of in NOTES.get(name, {}).items()}
    text = json.dumps({"title": name, "type": "object", "properties": properties})
    return RecordChannel(f"/flight/{name}", f"air_router.flight.flight.{name}", text)


@cache
def link_channel() -> RecordChannel:
    """The channel of the metrics of links."""
    return RecordChannel("/links", "air_router.LinkMetrics", _timed(schema_of(LinkMetrics)))


def _timed(schema: dict[str, Any]) -> str:
    """The schema with the time in front."""
    order = {"type": "integer", "description": "which motion, counted from 1"}
    known = schema["title"] in {kind.__name__ for kind in (*MOTIONS, *ABOUT_MOTIONS)}
    more = {ORDER_KEY: order} if known else {}
    properties = {"t": {"type": "number"}, **more, **schema["properties"]}
    return json.dumps({**schema, "properties": properties, "required": ["t", *schema["required"]]})


def json_of(message: dict[str, Any]) -> str:
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


@cache
def schema_of(hint: Any) -> dict[str, Any]:  # noqa: PLR0911 - one for each kind of type
    """The JSON schema of a declared type, as far as the viewers of records understand it.

    One type each, no alternatives, nothing said of what may be null.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _schema_of_all([schema_of(member) for member in arguments if member is not NoneType])
    if origin is typing.Literal:
        return {**_TEXT, "enum": list(arguments)}
    if origin in (dict, Mapping):
        part = schema_of(arguments[1])
        return {"type": "object", "properties": {}, "additionalProperties": part}
    if origin in (tuple, list, frozenset):
        items = _schema_of_all([schema_of(part) for part in arguments if part is not Ellipsis])
        return _schema_of_list(items)
    fields = fields_of(hint)
    if fields is not None:
        tags = {TYPE_KEY: {**_TEXT, "const": fields.name}} if fields.tagged else {}
        return {
            "type": "object",
            "title": fields.name,
            "properties": tags
            | {key: schema_of(fields.hints[name]) for key, name in fields.recorded.items()},
            "required": [
                *tags,
                *(key for key, name in fields.recorded.items() if name in fields.needed),
            ],
        }
    if isinstance(hint, type) and issubclass(hint, Enum):
        return {**_TEXT, "enum": list(hint.__members__)}
    return _SCHEMAS.get(hint, _TEXT)


def _schema_of_all(schemas: list[dict[str, Any]]) -> dict[str, Any]:
    """One form for all members: viewers know no alternatives. Of objects it has every field."""
    if not schemas or any(schema["type"] != "object" for schema in schemas):
        return schemas[0] if schemas else dict(_TEXT)
    properties = {name: part for s in reversed(schemas) for name, part in s["properties"].items()}
    kinds = [s["title"] for s in schemas if "title" in s]
    if len(schemas) > 1 and TYPE_KEY in properties:
        properties = {**properties, TYPE_KEY: {**_TEXT, "enum": kinds}}
    return {"type": "object", "title": " or ".join(kinds), "properties": properties}


def _schema_of_list(items: dict[str, Any]) -> dict[str, Any]:
    """A list; of lists in it viewers know nothing, so that of those nothing is said."""
    known = items if items["type"] != "array" else {"type": "object", "properties": {}}
    return {"type": "array", "items": known}
