"""JSON files as documents whose every value knows its place: plans, GeoJSON, geozones.

JSON is nearly YAML, but not quite (tabs, surrogate pairs, long keys), and a YAML parser takes a
minute for what the standard library reads in a blink. So that one reads; what it does not mind,
and where a value stands, is searched for in the text on demand.
"""

from __future__ import annotations

import json
import math
import re
from bisect import bisect_right
from collections.abc import Callable, Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, Final, TypeGuard

from air_router.files.json_mistakes import json_mistake
from air_router.files.whole_file import bytes_within
from mocha_link.team import Document, DocumentError, Key, text_in

MAX_BYTES: Final = 4 * 1024 * 1024
MAX_DEPTH: Final = 60

_MAX_DIGITS: Final = 300
_SUSPICIOUS = re.compile(
    r"(?:^|[\[,:\s])-?(?:[0-9]{200}|[0-9]+(?:\.[0-9]+)?[eE]\+?[0-9]{3})"  # where a number begins
    r"|\\u[dD][89abAB][0-9a-fA-F]{2}(?!\\u[dD][c-fC-F])"
    r"|(?<!\\u[dD][89abAB][0-9a-fA-F]{2})\\u[dD][c-fC-F]"
)
"""Text that may spell half a character or a number that is none; most files have nothing such."""

NUMBER = re.compile(r"-?[0-9]{1,9}(\.[0-9]{1,9})?")
"""A number as programs write it in text."""

_BRACKETS = re.compile(r"[][{}]")
_TEXT_OR_BRACKET = re.compile(r'"(?:[^"\\]|\\.)*"?|[][{}]', re.DOTALL)
_BLANKS = re.compile(r"[ \t\r\n]*")
_ADVICE: Final = "save the file again with the program that made it"

_QGC_LAYOUT: Final = '{\n    "version": 1\n}\n'
_DECODER = json.JSONDecoder(parse_int=lambda t: int(t) if len(t) <= _MAX_DIGITS else math.inf)
_decode = _DECODER.raw_decode


def load_json(path: Path) -> JsonDocument:
    """A JSON file of at most 4 MiB as a document.

    Raises:
        DocumentError: the file cannot be read, is too large, is not UTF-8 or not JSON, repeats a
            key, or is nested deeper than any file in use.
    """
    return json_from_text(text_in(bytes_within(path, MAX_BYTES), path), path)


def json_from_text(text: str, path: Path) -> JsonDocument:
    """JSON text as a document; `path` only names it in messages. Raises DocumentError."""
    try:
        if _SUSPICIOUS.search(text) or _may_be_deep(text):
            _check(text)
        try:
            data = json.loads(text, object_pairs_hook=_once, parse_constant=_refuse)
        except _StrangeError:
            _check(text)
            raise
    except json.JSONDecodeError as error:
        fault = _FaultError(*json_mistake(error), "not-json")
    except _FaultError as error:
        fault = error
    else:
        return JsonDocument(path, data, text)
    place = JsonDocument(path, None, text).line_column(fault.index)
    raise DocumentError.at(path, str(fault), fault.code, *place) from None


def value_at(data: Any, keys: Iterable[str | int]) -> Any:
    """The value at a key path, None if there is none."""
    for key in keys:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def json_text(data: Any, like: str = _QGC_LAYOUT) -> str:
    """Plain values as JSON; keys keep their order.

    Args:
        data: The values.
        like: A text of whose layout it is: its indent, its line breaks, its empty lists, its end.
            Without one it is QGroundControl's.
    """
    unit = re.search(r"\n([ \t]*)\S", like)
    text = json.dumps(data, indent=unit and unit[1], ensure_ascii=False, allow_nan=False)
    if re.search(r"\[\r?\n[ \t]*\]", like):  # as Qt writes them
        text = re.sub(r"(?m)^([ \t]*)(.*)\[\](,?)$", r"\1\2[\n\1]\3", text)
    newline = "\r\n" if "\r\n" in like else "\n"
    return text.replace("\n", newline) + (newline if like.endswith("\n") else "")


class JsonDocument(Document):
    """A loaded JSON file; made by `load_json` or `json_from_text`.

    Attributes:
        text: The file's.
    """

    def __init__(self, path: Path, data: Any, text: str) -> None:
        super().__init__(path, None, data)
        self.text = text
        self._children: dict[int, dict[str, tuple[int, int]]] = {}  # by the start of their parent

    def place(self, *keys: Key) -> tuple[int, int]:
        """Line and column (1-based) of the value at a key path, or of its nearest parent."""
        return self.line_column(self._walk(keys)[1])

    def place_of_key(self, *keys: Key) -> tuple[int, int]:
        """Line and column (1-based) of the last key itself, or of its nearest parent."""
        return self.line_column(self._walk(keys)[0])

    def line_column(self, index: int) -> tuple[int, int]:
        """Line and column (1-based) of a character of the text."""
        line = bisect_right(self._line_starts, index)
        return line, index - self._line_starts[line - 1] + 1

    @cached_property
    def _line_starts(self) -> list[int]:
        return [0, *(match.end() for match in re.finditer("\n", self.text))]

    def _walk(self, keys: tuple[Key, ...]) -> tuple[int, int]:
        """Where the key and the value at a key path begin."""
        start = _blanks_end(self.text, 0)
        found = (start, start)
        for key in keys:
            _, start = found
            if self.text[start : start + 1] not in ("[", "{"):
                break
            if start not in self._children:
                self._children[start] = _children(self.text, start)
            found = self._children[start].get(str(key), found)
        return found


Report = Callable[[tuple[str | int, ...], str, str], None]
"""Takes the keys of a value, its problem, and the code."""


class JsonValues:
    """Reads values of plain data, and reports those that are of the wrong kind.

    Args:
        data: The values.
        report: Takes problems.
    """

    def __init__(self, data: Any, report: Report) -> None:
        self._data, self._report = data, report

    def at(self, *keys: str | int) -> Any:
        """The value at a key path, None if there is none."""
        return value_at(self._data, keys)

    def number(
        self, keys: tuple[str | int, ...], what: str = "", *, in_text: bool = False
    ) -> float | None:
        """A number, with `in_text` perhaps in quotes; None, and reported, if it is none.

        In messages it is called `what`, or by its last key.
        """
        value = self.at(*keys)
        if in_text and isinstance(value, str) and NUMBER.fullmatch(value):
            value = float(value)
        if is_number(value):
            return float(value)
        self.wrong(keys, f"{what or named(keys)} must be a number")
        return None

    def entries(
        self, keys: tuple[str | int, ...], what: str = "", advice: str = "correct it"
    ) -> list[tuple[str | int, ...]]:
        """The keys of a list's entries; none, and reported, if it is something else."""
        value = self.at(*keys)
        if isinstance(value, list):
            return [(*keys, index) for index in range(len(value))]
        self.wrong(keys, f"{what or named(keys)} must be a list", advice)
        return []

    def wrong(self, keys: tuple[str | int, ...], message: str, advice: str = "correct it") -> None:
        """Report a value of the wrong kind, or its absence."""
        value = self.at(*keys)
        code = "missing-key" if value is None else "wrong-type"
        self._report(keys, f"{message}, found {shown(value)}; {advice}", code)


def is_number(value: Any) -> TypeGuard[float]:
    """Whether JSON has a number here; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def named(keys: tuple[str | int, ...]) -> str:
    """A value's key and place in lists, for messages: 'params[4]'."""
    name = ""
    for key in reversed(keys):
        name = f"[{key}]{name}" if isinstance(key, int) else f"{key}{name}"
        if isinstance(key, str):
            break
    return f"'{name}'"


def shown(value: Any) -> str:
    """A value as a message shows it."""
    return "nothing" if value is None else json.dumps(value, ensure_ascii=False)[:40]


class _FaultError(ValueError):
    """The problem of a text, its character, and its code."""

    def __init__(self, index: int, message: str, code: str) -> None:
        super().__init__(message)
        self.index, self.code = index, code  # character in the text


class _StrangeError(ValueError):
    """Something that the standard library reads and we do not is somewhere in a text."""


def _blanks_end(text: str, start: int) -> int:
    """Where the next token begins."""
    match = _BLANKS.match(text, start)
    return match.end() if match else start


def _children(text: str, start: int) -> dict[str, tuple[int, int]]:
    """Where keys (or numbers) and values of the object or list at a character begin.

    Raises:
        _FaultError: a key is repeated.
    """
    children: dict[str, tuple[int, int]] = {}
    is_list = text[start] == "["
    at = _blanks_end(text, start + 1)
    while text[at] not in "]}":
        key, value_at = str(len(children)), at
        if not is_list:
            key, end = _decode(text, at)
            value_at = _blanks_end(text, _blanks_end(text, end) + 1)
        if key in children:
            line = text.count("\n", 0, children[key][0]) + 1
            message = f"key '{key[:40]}' is already on line {line}; remove one"
            raise _FaultError(at, message, "repeated-key")
        children[key] = (at, value_at)
        _, end = _decode(text, value_at)
        at = _blanks_end(text, end)
        if text[at] == ",":
            at = _blanks_end(text, at + 1)
    return children


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        raise _StrangeError("a key is repeated")
    return result


def _refuse(literal: str) -> None:
    raise _StrangeError(literal)


def _may_be_deep(text: str) -> bool:
    """Whether more lists and objects than allowed may be open somewhere: a cheap upper bound."""
    depth = 0
    for mark in _BRACKETS.findall(text):
        depth += 1 if mark in "[{" else -1
        if depth > MAX_DEPTH:
            return True
    return False


def _check(text: str) -> None:
    """Search for what the standard library accepts and we do not.

    Raises:
        _FaultError: there is something such.
        JSONDecodeError: it is not JSON.
    """
    depth = 0
    for match in _TEXT_OR_BRACKET.finditer(text):
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(match[0], 0)
        if depth > MAX_DEPTH:
            message = f"nested more than {MAX_DEPTH} deep; {_ADVICE}"
            raise _FaultError(match.start(), message, "too-deep")
    _DECODER.decode(text)
    _check_value(text, _blanks_end(text, 0))


def _check_value(text: str, at: int) -> None:
    value, end = _decode(text, at)
    if isinstance(value, dict | list):
        for key_at, value_at in _children(text, at).values():
            if key_at != value_at:
                _check_value(text, key_at)
            _check_value(text, value_at)
    elif isinstance(value, str) and re.search("[\ud800-\udfff]", value):
        message = "half a character (a lone surrogate) in text; remove it"
        raise _FaultError(at, message, "not-json")
    elif isinstance(value, float) and not math.isfinite(value):
        if text[end - 1].isdigit():
            message = f"the number {text[at:end][:20]}... is none that a map can have; correct it"
            raise _FaultError(at, message, "out-of-range")
        message = f"not valid JSON: {text[at:end]} is no number; correct it"
        raise _FaultError(at, message, "not-json")
