"""JSON files as documents whose every value knows its place: plans, GeoJSON, geozones.

JSON is nearly YAML, but not quite (tabs, surrogate pairs, long keys), and a YAML parser takes a
minute for what the standard library reads in a blink. So that one reads; what is wrong, and where
a value stands, is looked for in the text when it is asked for.
"""

from __future__ import annotations

import json
import re
from bisect import bisect_right
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from air_router.files.json_scan import JsonError, blanks_end, check_json
from mocha_link.team.document import Document, DocumentError, Problem
from mocha_link.team.error_text import Key

MAX_BYTES: Final = 4 * 1024 * 1024
MAX_DEPTH: Final = 60

_SUSPICIOUS = re.compile(r"\\u[dD][89a-fA-F]|[eE]\+?[0-9]{3}|[0-9]{300}")
"""Text that may spell half a character or a number that is none; most files have nothing such."""

_BRACKETS = re.compile(r"[][{}]")

_decode = json.JSONDecoder().raw_decode


def load_json(path: Path) -> JsonDocument:
    """A JSON file of at most 4 MiB as a document.

    Raises:
        DocumentError: the file cannot be read, is too large, is not UTF-8 or not JSON, repeats a
            key, or is nested deeper than any honest file.
    """
    return json_from_text(text_in(bytes_of(path, MAX_BYTES), path), path)


def bytes_of(path: Path, max_bytes: int) -> bytes:
    """A file's bytes. Raises DocumentError: it cannot be read or is too large."""
    try:
        with path.open("rb") as file:
            raw = file.read(max_bytes + 1)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        message = f"cannot read the file: {reason}; check the path"
        raise _one(path, 1, 1, message, "unreadable") from None
    if len(raw) > max_bytes:
        message = f"larger than {max_bytes} bytes; cut out the part that the mission needs"
        raise _one(path, 1, 1, message, "too-large")
    return raw


def text_in(raw: bytes, path: Path) -> str:
    """The text that bytes spell. Raises DocumentError: it is not UTF-8."""
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        column = len(before.rpartition(b"\n")[2].decode("utf-8", "replace")) + 1
        message = "not UTF-8 text; save the file as UTF-8"
        raise _one(path, before.count(b"\n") + 1, column, message, "not-utf8") from None


def json_from_text(text: str, path: Path) -> JsonDocument:
    """JSON text as a document; `path` only names it in messages. Raises DocumentError."""
    try:
        if _SUSPICIOUS.search(text) or _may_be_deep(text):
            check_json(text, MAX_DEPTH)
        data = json.loads(text, object_pairs_hook=_once, parse_constant=_refuse)
    except (ValueError, RecursionError) as reason:
        try:
            check_json(text, MAX_DEPTH)
        except JsonError as error:
            line, column = _Lines(text).place(error.index)
            raise _one(path, line, column, str(error), error.code) from None
        raise _one(path, 1, 1, f"not valid JSON: {reason}; export it again", "not-json") from None
    return JsonDocument(path, data, text)


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
    """A loaded JSON file; made by `load_json` or `json_from_text`."""

    def __init__(self, path: Path, data: Any, text: str) -> None:
        super().__init__(path, None, data)
        self._text = text
        self._lines = _Lines(text)
        self._children: dict[int, dict[str, tuple[int, int]]] = {}

    def place(self, *keys: Key) -> tuple[int, int]:
        """Line and column (1-based) of the value at a key path, or of its nearest parent."""
        return self._lines.place(self._walk(keys)[1])

    def place_of_key(self, *keys: Key) -> tuple[int, int]:
        """Line and column (1-based) of the last key itself, or of its nearest parent."""
        return self._lines.place(self._walk(keys)[0])

    def _walk(self, keys: tuple[Key, ...]) -> tuple[int, int]:
        """Where the key and the value at a key path begin."""
        start = blanks_end(self._text, 0)
        found = (start, start)
        for key in keys:
            if self._text[found[1] : found[1] + 1] not in ("[", "{"):
                break
            if found[1] not in self._children:
                self._children[found[1]] = _children(self._text, found[1])
            found = self._children[found[1]].get(str(key), found)
        return found


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


def _children(text: str, start: int) -> dict[str, tuple[int, int]]:
    """Where the keys (or numbers) and the values of the object or list at `start` begin.

    The text is known to be JSON.
    """
    children: dict[str, tuple[int, int]] = {}
    is_list = text[start] == "["
    at = blanks_end(text, start + 1)
    while text[at] not in "]}":
        key, value_at = str(len(children)), at
        if not is_list:
            key, end = _decode(text, at)
            value_at = blanks_end(text, blanks_end(text, end) + 1)
        children[key] = (at, value_at)
        _, end = _decode(text, value_at)
        at = blanks_end(text, end)
        if text[at] == ",":
            at = blanks_end(text, at + 1)
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


def _one(path: Path, line: int, column: int, message: str, code: str) -> DocumentError:
    return DocumentError([Problem(path, line, column, message, code)])
