"""Events and actions as JSON objects and back, exactly: what every record of a flight is made of.

Whatever joins `Event` or `Action` is written and read without a line here. A member that cannot
be written is a TypeError at its first use; a test walks all of them.
"""

from __future__ import annotations

from functools import cache
from typing import Any, get_args

from air_router.controller.model.actions import Action
from air_router.controller.model.events import Event
from air_router.errors import AirRouterError, ExitCode
from air_router.record.codec import TYPE_KEY, CodecError, codec_of, recorded_name


class JournalError(AirRouterError, ValueError):
    """Data that are no event and no action."""

    exit_code = ExitCode.INVALID_FILE


def encode(value: object) -> dict[str, Any]:
    """An event or action as an object that `json.dumps` takes; `type` is its class.

    Raises:
        TypeError: it is neither.
    """
    kind: Any = type(value)
    if members().get(recorded_name(kind)) is not kind:
        raise TypeError(f"{value!r} cannot be recorded: neither an event nor an action")
    plain: dict[str, Any] = codec_of(kind).encode(value)
    return plain


def decode(data: object) -> Any:
    """The event or action of an object that `encode` made: equal to it in every bit.

    A field that is missing has its default, or is nothing (None, an empty tuple) where it may be:
    so older records can be read.

    Raises:
        JournalError: the object says of no event or action what that has.
    """
    if not isinstance(data, dict):
        raise JournalError(f"{type(data).__name__} is no event or action: not an object")
    name = data.get(TYPE_KEY)
    kind = members().get(name) if isinstance(name, str) else None
    if kind is None:
        raise JournalError(f"type {str(name)[:60]!r} is no event or action")
    try:
        return codec_of(kind).decode(data)
    except CodecError as error:
        raise JournalError(str(error)) from None


def schema(kind: type) -> dict[str, Any]:
    """The JSON schema of the objects that one class of events or actions becomes."""
    return codec_of(kind).schema()


@cache
def members() -> dict[str, type]:
    """Every class of event and action, by name.

    Raises:
        TypeError: two of them have one name.
    """
    found: dict[str, type] = {}
    for kind in (*get_args(Event), *get_args(Action)):
        if found.setdefault(recorded_name(kind), kind) is not kind:
            raise TypeError(f"two events or actions are called {recorded_name(kind)}")
    return found
