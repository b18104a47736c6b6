"""Requests of other programs as JSON over ZeroMQ: a table of verbs, and a reply to each request.

A request is a JSON object: `request` names the verb, `id` returns with the reply, the rest are
the verb's fields; frames of data may follow. Replies have the same form, with `ok`.
REQ, DEALER and ROUTER sockets may send requests, with or without the empty frame that REQ sends.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, Field, ValidationError

from mocha_link.errors import RequestError
from mocha_link.team import request_error_text

MAX_ID = 64  # letters or digits of a request's id

Frames = list[bytes]


class Request(BaseModel, extra="forbid", strict=True):
    """What every request has; each verb adds its own fields."""

    request: str
    id: (
        Annotated[str, Field(max_length=MAX_ID)]
        | Annotated[int, Field(ge=-(2**63), lt=2**63)]
        | None
    ) = None


class Response(NamedTuple):
    """The fields of the reply to an executed request, and the data frames after them."""

    fields: Mapping[str, Any]  # JSON
    data: Sequence[bytes] = ()  # frames behind it


class Verb(NamedTuple):
    """One kind of request.

    Attributes:
        model: The fields of a request.
        run: executes the request with its data; None: the reply follows later.
        frames: How many frames of data may be behind it.
    """

    model: type[Request]
    run: Callable[[Any, Sequence[bytes]], Response | None]
    frames: int = 0


def parse(frames: Sequence[bytes], max_bytes: int) -> dict[str, Any]:
    """The JSON object that a request begins with. Raises RequestError."""
    if not frames or len(frames[0]) > max_bytes:
        raise RequestError(f"a request begins with a JSON object of up to {max_bytes} bytes")
    try:
        values = json.loads(frames[0])
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, dict):
        raise RequestError("a request begins with a JSON object")
    return values


def check(
    values: Mapping[str, Any], data: Sequence[bytes], verbs: Mapping[str, Verb]
) -> tuple[Verb, Request]:
    """The verb of a request, and its fields. Raises RequestError."""
    name = values.get("request")
    if not isinstance(name, str) or name not in verbs:
        raise RequestError(f"no request {str(name)[:40]!r}; use one of {', '.join(verbs)}")
    verb = verbs[name]
    try:
        request = verb.model.model_validate(values)
    except ValidationError as error:
        raise RequestError(f"{name}: {request_error_text(error, verb.model)}") from None
    if len(data) > verb.frames:
        raise RequestError(f"{name}: {len(data)} frames of data; at most {verb.frames} of them")
    return verb, request


def reply(number: object, response: Response) -> Frames:
    """The frames of the reply to an executed request; `number` is its id."""
    return [_json({"ok": True, "id": number, **response.fields}), *response.data]


def refusal(number: object, error: str, *, again: bool) -> Frames:
    """The frames of the reply to a refused request; `again`: it may succeed later."""
    short = isinstance(number, str | int) and len(str(number)) <= MAX_ID
    known = number if short else None
    return [_json({"ok": False, "id": known, "error": error, "again": again})]


def _json(fields: Mapping[str, Any]) -> bytes:
    return json.dumps(fields, separators=(",", ":")).encode()
