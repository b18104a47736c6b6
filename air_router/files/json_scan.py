"""What is wrong with a JSON text, and at which character; without recursion."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field

_TOKEN = re.compile(
    r'(?P<text>"(?:[^"\\\x00-\x1f]|\\.)*")'
    r"|(?P<number>-?(?:0|[1-9][0-9]*)(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?)"
    r"|(?P<word>true|false|null)"
    r"|(?P<mark>[][{},:])"
)
_BLANKS = re.compile(r"[ \t\r\n]*")
_MAX_DIGITS = 300
_ADVICE = "save the file again with the program that made it"


class JsonError(ValueError):
    """What is wrong with a text, and at which character.

    Attributes:
        index: The character.
        code: The same for programs.
    """

    def __init__(self, index: int, message: str, code: str = "not-json") -> None:
        super().__init__(message)
        self.index = index
        self.code = code


def blanks_end(text: str, start: int) -> int:
    """Where the next token begins."""
    match = _BLANKS.match(text, start)
    return match.end() if match else start


def check_json(text: str, max_depth: int) -> None:
    """Read a text as JSON. Raises JsonError: it is none, repeats a key, or is nested too deep."""
    _Scanner(text, max_depth).scan()


@dataclass(slots=True)
class _Open:
    """A list or an object that the scanner is in, and the keys that it has so far."""

    closing: str
    keys: dict[str, int] = field(default_factory=dict)


class _Scanner:
    def __init__(self, text: str, max_depth: int) -> None:
        self._text = text
        self._max_depth = max_depth
        self._at = 0
        self._inside: list[_Open] = []

    def scan(self) -> None:
        while True:
            start, kind = self._token()
            if kind in ("[", "{"):
                if len(self._inside) >= self._max_depth:
                    message = f"nested more than {self._max_depth} deep; {_ADVICE}"
                    raise JsonError(start, message, "too-deep")
                self._inside.append(_Open("]" if kind == "[" else "}"))
                if self._next() != self._inside[-1].closing:
                    self._key()
                    continue
                self._token()
                self._inside.pop()
            elif kind != "value":
                found = f"'{kind}'" if kind else "the end of the file"
                raise JsonError(start, f"not valid JSON: found {found}, not a value; {_ADVICE}")
            if not self._goes_on():
                break
        start, kind = self._token()
        if kind:
            raise JsonError(start, f"not valid JSON: more text after the end; {_ADVICE}")

    def _goes_on(self) -> bool:
        """After a value: close what ends here. Whether another value follows."""
        while self._inside:
            closing = self._inside[-1].closing
            start, kind = self._token()
            if kind == ",":
                if self._next() == closing:
                    raise JsonError(start, f"not valid JSON: a comma before '{closing}'; remove it")
                self._key()
                return True
            if kind != closing:
                message = f"not valid JSON: a ',' or '{closing}' belongs here; {_ADVICE}"
                raise JsonError(start, message)
            self._inside.pop()
        return False

    def _key(self) -> None:
        if self._inside[-1].closing == "]":
            return
        start, kind = self._token()
        if kind != "value" or self._text[start] != '"':
            raise JsonError(start, f'not valid JSON: a key in "quotes" belongs here; {_ADVICE}')
        key = json.loads(self._text[start : self._at])
        keys = self._inside[-1].keys
        if key in keys:
            line = self._text.count("\n", 0, keys[key]) + 1
            message = f"key '{key[:40]}' is already on line {line}; remove one"
            raise JsonError(start, message, "repeated-key")
        keys[key] = start
        start, kind = self._token()
        if kind != ":":
            raise JsonError(start, f"not valid JSON: a ':' belongs here; {_ADVICE}")

    def _next(self) -> str:
        before = self._at
        _, kind = self._token()
        self._at = before
        return kind

    def _token(self) -> tuple[int, str]:
        """Place and kind of what comes next: a mark itself, "value", or "" for the end."""
        start = blanks_end(self._text, self._at)
        match = _TOKEN.match(self._text, start)
        if match is None:
            if start >= len(self._text):
                return start, ""
            shown = self._text[start : start + 10].split("\n")[0]
            raise JsonError(start, f"not valid JSON at {shown!r}; {_ADVICE}")
        self._at = match.end()
        word = match.group()
        if match.lastgroup == "mark":
            return start, word
        if match.lastgroup == "text":
            _check_text(word, start)
        elif match.lastgroup == "number":
            _check_number(word, start)
        return start, "value"


def _check_text(word: str, start: int) -> None:
    try:
        json.loads(word).encode()
    except json.JSONDecodeError:
        raise JsonError(start, f"not valid JSON: a wrong escape in text; {_ADVICE}") from None
    except UnicodeEncodeError:
        raise JsonError(start, "half a character (a lone surrogate) in text; remove it") from None


def _check_number(word: str, start: int) -> None:
    if len(word) > _MAX_DIGITS or not math.isfinite(float(word)):
        message = f"the number {word[:20]}... is none that a map can have; correct it"
        raise JsonError(start, message, "out-of-range")
