"""The channels of a record: topics, messages, and schemas for viewers."""

import json
from collections.abc import Mapping
from functools import cache
from typing import Any, Final, NamedTuple, get_args

from pydantic_core import to_json

from air_router.controller import FlightStatus
from air_router.controller.model import CommandConfirmed, CommandFailed, Motion
from air_router.record.serialization import RECORDED, TYPE_KEY, adapter, encode
from mocha_link.links import LinkMetrics

TIME_KEY: Final = "t"
"""Seconds on the vehicle's clock, in every message."""

ORDER_KEY: Final = "of"
"""The number of a motion, also in its confirmation: several motions may be equal."""

RECENT: Final = 64
"""A motion is confirmed or fails before this many others are decided."""

ABOUT_MOTIONS: Final = (CommandConfirmed, CommandFailed)

NOTES: Final[Mapping[str, Mapping[str, Any]]] = {
    "Clock": {"unix_s": float},
    "Reaction": {"reaction_s": float},
    "HomeBy": {"home_by_s": float},
    "Map": {"known_cells": int},
    "MapPublished": {"known_cells": int},
    "Held": {"peer": str, "held": tuple[tuple[str, str, float], ...]},
}
"""Notes read by a replay or a report, with the types of their fields; others are for people."""

Plain = dict[str, Any]

_TEXT: Final = {"type": "string"}
_NUMBER: Final = {"type": "number"}
_KEPT: Final = ("type", "title", "enum", "const", "additionalProperties", "required")


class RecordChannel(NamedTuple):
    """A channel of messages.

    Attributes:
        topic: Its name.
        schema_name: The name of the messages' schema; `schema`: its bytes.
        encoding: Encoding of the messages: "json", or "protobuf" for drawings.
    """

    topic: str
    schema_name: str
    schema: bytes
    encoding: str = "json"

    @property
    def root(self) -> str:
        """The first part of its topic."""
        return f"{self.topic}/".split("/")[1]

    @property
    def schema_encoding(self) -> str:
        """The encoding of the schema."""
        return "jsonschema" if self.encoding == "json" else self.encoding


def message_of(value: object, now_s: float, order: int | None = None) -> bytes:
    """An event, action, setup or link as a message, with its time and motion number.

    Raises:
        TypeError: It cannot be recorded.
    """
    more = {} if order is None else {ORDER_KEY: order}
    head = to_json({TIME_KEY: now_s, **more}, inf_nan_mode="strings")
    return b"%b,%b" % (head[:-1], encode(value)[1:])  # two objects become one


def status_message_of(status: FlightStatus, now_s: float) -> bytes:
    """The flight's status as a message. Raises TypeError: it cannot be recorded."""
    head = to_json({TIME_KEY: now_s})
    return b"%b,%b" % (head[:-1], encode(status, of=FlightStatus)[1:])


# Channels


def _channel(topic: str, title: str, properties: Plain, **more: Any) -> RecordChannel:
    schema = {"type": "object", **more, "title": title, "properties": properties}
    schema["properties"] = {TIME_KEY: _NUMBER, **properties}
    return RecordChannel(topic, f"air_router.{title}", json.dumps(schema).encode())


PATCHES: Final = _channel("/patches", "Patch", {"patch": {**_TEXT, "contentEncoding": "base64"}})


@cache
def channel_of(kind: str, of: Any) -> RecordChannel:
    """The channel of a class of events or actions."""
    return _timed(f"/{kind}/{of.__name__}", of)


@cache
def status_channel() -> RecordChannel:
    """The channel of the flight's status."""
    return _timed("/status", FlightStatus)


@cache
def link_channel() -> RecordChannel:
    """The channel of the metrics of links."""
    return _timed("/links", LinkMetrics)


@cache
def note_channel(name: str) -> RecordChannel:
    """The channel of a note of the flight loop."""
    parts = {part: viewer_schema(of) for part, of in NOTES.get(name, {}).items()}
    made = _channel(f"/flight/{name}", name, {TYPE_KEY: {**_TEXT, "const": name}, **parts})
    return made._replace(schema_name=f"air_router.flight.{name}")


def _timed(topic: str, of: Any) -> RecordChannel:
    """The channel of a class, with the time as first field."""
    schema = viewer_schema(of)
    order = {"type": "integer", "description": "which motion, counted from 1"}
    more = {ORDER_KEY: order} if of in (*get_args(Motion), *ABOUT_MOTIONS) else {}
    needed = [TIME_KEY, *schema["required"]]
    return _channel(topic, of.__name__, {**more, **schema["properties"]}, required=needed)


@cache
def viewer_schema(of: Any) -> Plain:
    """The JSON schema of a type, limited to the features that viewers of records support.

    One type per value, without alternatives, references or null.
    """
    if of in _recorded_classes():
        defined = _recorded_schemas()
        return _understood(defined[of.__name__], defined)
    full = adapter(of).json_schema()
    return _understood(full, full.get("$defs", {}))


@cache
def _recorded_classes() -> frozenset[Any]:
    return frozenset(get_args(RECORDED))


@cache
def _recorded_schemas() -> Mapping[str, Plain]:
    """The schemas of all recorded classes; cached, because making them is slow."""
    defined: Mapping[str, Plain] = adapter(RECORDED).json_schema()["$defs"]
    return defined


def _understood(schema: Plain, defined: Mapping[str, Plain]) -> Plain:
    if "$ref" in schema:
        return _understood(defined[schema["$ref"].rpartition("/")[2]], defined)
    choices = schema.get("anyOf") or schema.get("oneOf")
    if choices:
        return _any_of([_understood(c, defined) for c in choices if c.get("type") != "null"])
    kept: Plain = {key: schema[key] for key in _KEPT if key in schema}
    if isinstance(schema["type"], list):  # a number that may be None
        return {"type": schema["type"][0]}
    if schema["type"] == "object":
        properties = schema.get("properties", {})
        kept["properties"] = {name: _understood(p, defined) for name, p in properties.items()}
        if isinstance(inner := schema.get("additionalProperties"), dict):
            kept["additionalProperties"] = _understood(inner, defined)
        kept.setdefault("required", [])
    elif schema["type"] == "array":
        parts = [schema["items"]] if "items" in schema else schema.get("prefixItems", [])
        items = _any_of([_understood(part, defined) for part in parts])
        # Viewers do not support nested lists, so those have no schema.
        nested = items["type"] == "array"
        kept["items"] = {"type": "object", "properties": {}} if nested else items
    return kept


def _any_of(schemas: list[Plain]) -> Plain:
    """One schema for all members, with the fields of all: viewers do not support alternatives."""
    if not schemas or any(schema["type"] != "object" for schema in schemas):
        return schemas[0] if schemas else dict(_TEXT)
    if len(schemas) == 1:
        return schemas[0]
    properties = {name: part for s in reversed(schemas) for name, part in s["properties"].items()}
    kinds = [schema["title"] for schema in schemas]
    properties[TYPE_KEY] = {**_TEXT, "enum": kinds}
    return {"type": "object", "title": " or ".join(kinds), "properties": properties}
