"""Objects as plain data and back, by tables of words. Knows no names of the program."""

import enum
import math
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any, NamedTuple

NAN = "number:nan"
HEX = "bytes:"
TIME = "time:"


class Tape(NamedTuple):
    """The events of one object, and its decisions.

    Attributes:
        setup: What it was made of.
        steps: (time, reaction time, event, decisions) of each.
    """

    setup: dict[str, Any]
    steps: list[tuple[float, float | None, dict[str, Any], list[Any]]]


class _Row(NamedTuple):
    word: str
    make: Callable[..., Any]
    fields: Mapping[str, str]  # word -> attribute


class Tongue:
    """Says objects in plain data.

    Args:
        tables: By the word of a kind: its class, and its fields, "word" where the class has a
            field of that name and "word=field" where not.
        words: Single values.
        place: The class of places, pairs of numbers.
    """

    def __init__(
        self,
        tables: tuple[Mapping[str, tuple[Any, str]], ...],
        words: Mapping[str, Any],
        place: Any,
    ) -> None:
        self._rows: dict[Any, _Row] = {}
        for word, (kind, text) in (item for table in tables for item in table.items()):
            pairs = [field.partition("=") for field in text.split()]
            row = _Row(word, kind, {name: field or name for name, _, field in pairs})
            self._rows[word] = self._rows[kind] = row
        self._words = {NAN: math.nan, **words}
        self._word_of = {value: word for word, value in words.items()}
        self._place = place
        self._make: dict[type, Callable[[Any], Any]] = {
            dict: self._instance,
            list: self._tuple,
            str: self._text,
        }

    def kind_of(self, value: Any) -> str:
        """The word for an object's kind."""
        return self._rows[type(value)].word

    def plain_of(  # noqa: PLR0911 - one for each kind of value
        self, value: Any, digits: int = 3
    ) -> Any:
        """An object as plain data; numbers are rounded.

        Raises:
            TypeError: there is no word for it, or for something in it.
        """
        if value is None or type(value) in {bool, int, str}:
            return value
        if isinstance(value, float):
            nan = NAN if math.isnan(value) else None
            return self._word_of.get(value) or nan or round(value, digits)
        if isinstance(value, self._place):
            return [round(float(each), digits) for each in value]
        row = self._rows.get(type(value))
        if row is not None:
            fields = {n: self.plain_of(getattr(value, a), digits) for n, a in row.fields.items()}
            return {"kind": row.word, **fields}
        if isinstance(value, enum.Enum) and value in self._word_of:
            return self._word_of[value]
        if isinstance(value, datetime):
            return TIME + value.isoformat()
        if isinstance(value, bytes | memoryview):
            return HEX + value.hex()
        if isinstance(value, tuple | list):
            return [self.plain_of(each, digits) for each in value]
        raise TypeError(f"there is no word for {value!r}")

    def object_of(self, plain: Any) -> Any:
        """What `plain_of` was given."""
        make = self._make.get(type(plain))
        return plain if make is None else make(plain)

    def _instance(self, plain: Mapping[str, Any]) -> Any:
        row = self._rows[plain["kind"]]
        values = {row.fields[n]: self.object_of(v) for n, v in plain.items() if n != "kind"}
        return row.make(**values)

    def _text(self, plain: str) -> Any:
        if plain.startswith(HEX):
            return bytes.fromhex(plain[len(HEX) :])
        if plain.startswith(TIME):
            return datetime.fromisoformat(plain[len(TIME) :])
        return self._words.get(plain, plain)

    def _tuple(self, plain: list[Any]) -> Any:
        if len(plain) == 2 and type(plain[0]) is type(plain[1]) is float:
            return self._place(*plain)
        return tuple(map(self.object_of, plain))
