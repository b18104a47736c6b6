"""Events and actions as JSON objects and back, exactly: what every record of a flight is made of.

Whatever joins `Event` or `Action` is written and read without a line here; a test walks all.
"""

from functools import cache
from typing import Any, get_args

from air_router.controller.model.actions import Action
from air_router.controller.model.events import Event
from air_router.record import codec
from air_router.record.codec import TYPE_KEY, decoder, recorded_name
from air_router.record.single_values import CodecError


def encode(value: object) -> dict[str, Any]:
    """An event or action as an object that `json.dumps` takes; `type` is its class.

    Raises:
        TypeError: it is neither.
    """
    kind: Any = type(value)
    if members().get(recorded_name(kind)) is not kind:
        raise TypeError(f"{value!r} cannot be recorded: neither an event nor an action")
    plain: dict[str, Any] = codec.encode(value)
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
