"""JSON files as documents whose every value knows its place: plans, GeoJSON, geozones.

JSON is nearly YAML, but not quite (tabs, surrogate pairs, long keys), and a YAML parser takes a
minute for what the standard library reads in a blink. So that one reads; what it does not mind,
and where a value stands, is looked for in the text when it is asked for.
"""

from __future__ import annotations

import json
import math
import re
from bisect import bisect_right
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import yaml

from air_router.files.whole_file import bytes_of, text_in
from mocha_link.team.document import Document, DocumentError
from mocha_link.team.error_text import Key

MAX_BYTES: Final = 4 * 1024 * 1024
MAX_DEPTH: Final = 60

_MAX_DIGITS: Final = 300
_SUSPICIOUS = re.compile(r"\\u[dD][89a-fA-F]|[eE]\+?[0-9]{3}|[0-9]{300}")
"""Text that may spell half a character or a number that is none; most files have nothing such."""

_BRACKETS = re.compile(r"[][{}]")
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"?|[][{}:,]|[^][{}:,"\s]+', re.DOTALL)
_BLANKS = re.compile(r"[ \t\r\n]*")
_ADVICE: Final = "save the file again with the program that made it"

_decode = json.JSONDecoder().raw_decode


def load_json(path: Path) -> JsonDocument:
    """A JSON file of at most 4 MiB as a document.

    Raises:
        DocumentError: the file cannot be read, is too large, is not UTF-8 or not JSON, repeats a
            key, or is nested deeper than any file in use.
    """
    return json_from_text(text_in(bytes_of(path, MAX_BYTES), path), path)


def json_from_text(text: str, path: Path) -> JsonDocument:
    """JSON text as a document; `path` only names it in messages. Raises DocumentError."""
    try:
        if _SUSPICIOUS.search(text) or _may_be_deep(text):
            _check(text)
        data = json.loads(text, object_pairs_hook=_once, parse_constant=_refuse)
    except json.JSONDecodeError as error:
        fault = _FaultError(error.pos, f"not valid JSON: {error.msg}; {_ADVICE}", "not-json")
    except _FaultError as error:
        fault = error
    except ValueError as error:
        try:
            _check(text)
        except _FaultError as found:
            fault = found
        else:
            fault = _FaultError(0, f"not valid JSON: {error}; {_ADVICE}", "not-json")
    else:
        return JsonDocument(path, data, text)
    place = _Lines(text).place(fault.index)
    raise DocumentError.at(path, str(fault), fault.code, *place) from None


def value_at(data: Any, keys: Iterable[str | int]) -> Any:
    """The value at a key path, None if there is none."""
    for key in keys:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def json_text(data: Any) -> str:
    """Plain values as JSON, laid out as QGroundControl does; keys keep their order."""
    return json.dumps(data, indent=4, ensure_ascii=False, allow_nan=False) + "\n"


class JsonDocument(Document):
    """A loaded JSON file; made by `load_json` or `json_from_text`.

    Attributes:
        text: The file's.
    """

    def __init__(self, path: Path, data: Any, text: str) -> None:
        super().__init__(path, None, data)
        self.text = text
        self._lines = _Lines(text)
        # by the start of their parent: start, end
        self._children: dict[int, dict[str, tuple[int, int]]] = {}

    def place(self, *keys: Key) -> tuple[int, int]:
        """Line and column (1-based) of the value at a key path, or of its nearest parent."""
        return self._lines.place(self._walk(keys)[1])

    def place_of_key(self, *keys: Key) -> tuple[int, int]:
        """Line and column (1-based) of the last key itself, or of its nearest parent."""
        return self._lines.place(self._walk(keys)[0])

    def node(self, *keys: Key) -> yaml.Node | None:
        """The value at a key path, or its nearest parent, as YAML's parser would give it."""
        return self._node(self._walk(keys)[1])

    def _walk(self, keys: tuple[Key, ...]) -> tuple[int, int]:
        """Where the key and the value at a key path begin."""
        start = _blanks_end(self.text, 0)
        found = (start, start)
        for key in keys:
            if self.text[found[1] : found[1] + 1] not in ("[", "{"):
                break
            found = self._inside(found[1]).get(str(key), found)
        return found

    def _inside(self, start: int) -> dict[str, tuple[int, int]]:
        """Where the keys (or numbers) and the values of the object or list at `start` begin."""
        if start not in self._children:
            self._children[start] = _children(self.text, start)
        return self._children[start]

    def _node(self, start: int) -> yaml.Node:
        value, end = _decode(self.text, start)
        marks = self._mark(start), self._mark(end)
        if isinstance(value, list):
            items = [self._node(at) for _, at in self._inside(start).values()]
            return yaml.SequenceNode("", items, *marks, flow_style=True)
        if isinstance(value, dict):
            pairs = [(self._node(key), self._node(at)) for key, at in self._inside(start).values()]
            return yaml.MappingNode("", pairs, *marks, flow_style=True)
        if isinstance(value, str):
            return yaml.ScalarNode("", value, *marks, '"')
        return yaml.ScalarNode("", self.text[start:end], *marks, None)

    def _mark(self, index: int) -> yaml.Mark:
        line, column = self._lines.place(index)
        return yaml.Mark("", index, line - 1, column - 1, None, 0)


class _FaultError(ValueError):
    """What is wrong with a text, at which character, and its code."""

    def __init__(self, index: int, message: str, code: str) -> None:
        super().__init__(message)
        self.index, self.code = index, code  # character in the text


class _Lines:
    """Where the lines of a text begin."""

    def __init__(self, text: str) -> None:
        self._text = text

    @cached_property
    def _starts(self) -> list[int]:
        return [0, *(match.end() for match in re.finditer("\n", self._text))]

    def place(self, index: int) -> tuple[int, int]:
        line = bisect_right(self._starts, index)
        return line, index - self._starts[line - 1] + 1


def _blanks_end(text: str, start: int) -> int:
    """Where the next token begins."""
    match = _BLANKS.match(text, start)
    return match.end() if match else start


def _children(text: str, start: int) -> dict[str, tuple[int, int]]:
    children: dict[str, tuple[int, int]] = {}
    is_list = text[start] == "["
    at = _blanks_end(text, start + 1)
    while text[at] not in "]}":
        key, value_at = str(len(children)), at
        if not is_list:
            key, end = _decode(text, at)
            value_at = _blanks_end(text, _blanks_end(text, end) + 1)
        children[key] = (at, value_at)
        _, end = _decode(text, value_at)
        at = _blanks_end(text, end)
        if text[at] == ",":
            at = _blanks_end(text, at + 1)
    return children


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        raise ValueError("a key is repeated")
    return result


def _refuse(word: str) -> None:
    raise ValueError(word)


def _may_be_deep(text: str) -> bool:
    """Whether more lists and objects than allowed may be open somewhere: a cheap upper bound."""
    depth = 0
    for mark in _BRACKETS.findall(text):
        depth += 1 if mark in "[{" else -1
        if depth > MAX_DEPTH:
            return True
    return False


def _check(text: str) -> None:
    """Look for what the standard library reads and we do not. Raises _FaultError."""
    inside: list[dict[str, int]] = []  # of each open object the keys so far, and where they stand
    before = ""
    for match in _TOKEN.finditer(text):
        symbol, at = match[0], match.start()
        if symbol in "[{":
            inside.append({})
            if len(inside) > MAX_DEPTH:
                raise _FaultError(at, f"nested more than {MAX_DEPTH} deep; {_ADVICE}", "too-deep")
        elif symbol in "]}":
            del inside[-1:]
        elif symbol.startswith('"'):
            word, behind = _word(symbol, at), _blanks_end(text, match.end())
            if inside and before in ("{", ",") and text[behind : behind + 1] == ":":
                _check_key(word, at, inside[-1], text)
        elif symbol not in ":,":
            _check_value(symbol, at)
        before = symbol


def _word(symbol: str, at: int) -> str:
    try:
        word = str(json.loads(symbol))
        word.encode()
    except UnicodeEncodeError:
        message = "half a character (a lone surrogate) in text; remove it"
        raise _FaultError(at, message, "not-json") from None
    except ValueError:
        raise _FaultError(at, f"not valid JSON: a wrong text; {_ADVICE}", "not-json") from None
    return word


def _check_key(word: str, at: int, known: dict[str, int], text: str) -> None:
    if word in known:
        line = text.count("\n", 0, known[word]) + 1
        message = f"key '{word[:40]}' is already on line {line}; remove one"
        raise _FaultError(at, message, "repeated-key")
    known[word] = at


def _check_value(symbol: str, at: int) -> None:
    if symbol in ("NaN", "Infinity", "-Infinity"):
        raise _FaultError(at, f"not valid JSON: {symbol} is no number; correct it", "not-json")
    try:
        finite = len(symbol) <= _MAX_DIGITS and math.isfinite(float(symbol))
    except ValueError:  # a word; the standard library says what is wrong with it
        return
    if not finite:
        message = f"the number {symbol[:20]}... is none that a map can have; correct it"
        raise _FaultError(at, message, "out-of-range")
