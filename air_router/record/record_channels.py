"""The channels of a flight's record, with their JSON schemas, and how a message is written."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, Final, get_args

from air_router.controller.model.actions import Motion
from air_router.controller.model.events import CommandConfirmed, CommandFailed
from air_router.record import serialization as journal
from air_router.record.codec import TYPE_KEY, codec_of, recorded_name
from air_router.record.foxglove import schema_text
from air_router.record.log_file import ORDER_KEY, Channel
from mocha_link.links.metrics import LinkMetrics

MOTIONS: Final = get_args(Motion)
ABOUT_MOTIONS: Final = (CommandConfirmed, CommandFailed)
PATCHES: Final = Channel(
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


@cache
def channel_of(kind: str, of: Any) -> Channel:
    """The channel of a class of events or actions."""
    name = recorded_name(of)
    return Channel(f"/{kind}/{name}", f"air_router.{name}", _timed(journal.schema(of)))


NOTES: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "Clock": {"unix_s": float},
        "Reaction": {"reaction_s": float},
        "Map": {"known_cells": int},
        "MapPublished": {"known_cells": int},
        "Held": {"peer": str, "held": list[tuple[str, str, float]]},
    }
)
"""Notes that a replay or a report reads, with the types of their fields; others are for people."""


@cache
def note_channel(name: str) -> Channel:
    """The channel of a note of the shell's."""
    properties = {"t": {"type": "number"}, TYPE_KEY: {"type": "string", "const": name}}
    properties |= {field: codec_of(of).schema() for field, of in NOTES.get(name, {}).items()}
    text = json.dumps({"title": name, "type": "object", "properties": properties})
    return Channel(f"/flight/{name}", f"air_router.flight.flight.{name}", text)


@cache
def link_channel() -> Channel:
    """The channel of the metrics of links."""
    return Channel("/links", "air_router.LinkMetrics", _timed(codec_of(LinkMetrics).schema()))


def _timed(schema: dict[str, Any]) -> str:
    """The schema with the time in front."""
    order = {"type": "integer", "description": "which motion, counted from 1"}
    known = schema["title"] in {kind.__name__ for kind in (*MOTIONS, *ABOUT_MOTIONS)}
    more = {ORDER_KEY: order} if known else {}
    properties = {"t": {"type": "number"}, **more, **schema["properties"]}
    return json.dumps({**schema, "properties": properties, "required": ["t", *schema["required"]]})


@cache
def drawn_channel(topic: str, schema: str) -> Channel:
    """The channel of something that Foxglove draws."""
    return Channel(topic, schema, schema_text(schema))


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
