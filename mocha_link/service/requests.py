"""Requests of other programs as JSON over ZeroMQ: a table of verbs, and an answer to each request.

A request is a JSON object: `request` names the verb, `id` comes back with the answer, the rest are
the verb's fields; frames of data may follow. So it is with answers, which say whether they are
`ok`. REQ, DEALER and ROUTER sockets may ask, with or without the empty frame that REQ sends.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple, TypeVar

import zmq
from pydantic import BaseModel, Field, ValidationError

from mocha_link.errors import MochaLinkError
from mocha_link.team.error_text import request_error_text

MAX_UNREAD = 16  # answers that a client may leave unread before more of them are dropped

Frames = list[bytes]
AnySocket = TypeVar("AnySocket", bound=zmq.Socket[Any])


class RequestError(MochaLinkError):
    """A request that is none, or cannot be done. `again`: the same may be taken later."""

    def __init__(self, message: str, *, again: bool = False) -> None:
        super().__init__(message)
        self.again = again


class Request(BaseModel, extra="forbid", strict=True):
    """What every request has; each verb adds its own fields."""

    request: str
    id: Annotated[str, Field(max_length=64)] | int | None = None


class Answer(NamedTuple):
    """The fields of an answer to a request that was done, and the data behind them."""

    fields: Mapping[str, Any]  # JSON
    data: Sequence[bytes] = ()  # frames behind it


class Verb(NamedTuple):
    """What may be asked for.

    Attributes:
        model: The fields of a request.
        run: Takes the request and the data behind it; None: the answer comes later.
        frames: How many frames of data may be behind it.
    """

    model: type[Request]
    run: Callable[[Any, Sequence[bytes]], Answer | None]
    frames: int = 0


def router(context: zmq.Context[AnySocket], max_bytes: int) -> AnySocket:
    """A socket that answers, to be bound: no client fills the memory with unread answers."""
    socket = context.socket(zmq.ROUTER)
    socket.setsockopt(zmq.LINGER, 0)
    socket.setsockopt(zmq.SNDHWM, MAX_UNREAD)
    socket.setsockopt(zmq.RCVHWM, MAX_UNREAD)
    socket.setsockopt(zmq.MAXMSGSIZE, max_bytes)
    return socket


def split(frames: Frames) -> tuple[Frames, Frames]:
    """Of what a router received: the envelope that the answer needs, and the request's frames."""
    start = 2 if len(frames) > 1 and not frames[1] else 1
    return frames[:start], frames[start:]


def send(socket: zmq.Socket[bytes], frames: Frames) -> None:
    """Send an answer, its envelope first, if the client takes it."""
    with contextlib.suppress(zmq.Again):  # it does not read what it asks for
        socket.send_multipart(frames, zmq.NOBLOCK)


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


def reply(number: object, answer: Answer) -> Frames:
    """The frames that answer a request which was done; `number` is its id."""
    return [_json({"ok": True, "id": number, **answer.fields}), *answer.data]


def refusal(number: object, error: str, *, again: bool) -> Frames:
    """The frames that answer one which was not; `again`: the same may be taken later."""
    known = number if isinstance(number, str | int) else None
    return [_json({"ok": False, "id": known, "error": error, "again": again})]


def _json(fields: Mapping[str, Any]) -> bytes:
    return json.dumps(fields, separators=(",", ":")).encode()
