"""What is wrong with a file, and where; its text, or why it has none. Nothing of YAML is here."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Self

from mocha_link.errors import MochaLinkError
from mocha_link.sanitize import sanitize
from mocha_link.team.path_mistakes import path_advice

MOST_OF_A_KIND: Final = 20
"""Problems of one code that are reported per file; a person fixes these and checks again."""


@dataclass(frozen=True, slots=True, order=True)
class Problem:
    """One thing wrong with a file.

    ``str()`` is ``path:line:column: message [code]``; line and column count from 1.

    Attributes:
        code: What kind of problem it is, for programs and for docs/errors.md.
        keys: The way to the value in its document, where that is known.
    """

    path: Path
    line: int  # of the value, or of the file's beginning
    column: int
    message: str  # the mistake, and the correction
    code: str
    keys: tuple[str | int, ...] = field(default=(), compare=False)

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}: {sanitize(self.message)} [{self.code}]"

    def as_json(self) -> dict[str, Any]:
        """What ``--json`` prints of it."""
        return {
            "path": str(self.path),
            "line": self.line,
            "column": self.column,
            "code": self.code,
            "message": self.message,
        }


class DocumentError(MochaLinkError):
    """A file cannot be used; carries every problem found in it, in file order."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = first_of_each_kind(problems)  # the first of each kind
        super().__init__("\n".join(map(str, self.problems)))

    @classmethod
    def at(cls, path: Path, message: str, code: str, line: int = 1, column: int = 1) -> Self:
        """Of one problem, at the file's beginning where its place is not known."""
        return cls([Problem(path, line, column, message, code)])


def first_of_each_kind(problems: Iterable[Problem]) -> tuple[Problem, ...]:
    """Problems in file order, at most `MOST_OF_A_KIND` per file and code, and how many are left."""
    collected = ProblemList()
    for problem in sorted(set(problems)):
        collected.add(problem.path, problem.code, lambda: problem)  # noqa: B023 - called at once
    return tuple(sorted(collected))


class ProblemList:
    """Collects problems, and builds only the first of each kind: to find a place takes a while.

    It iterates over these in order, then gives the number of further ones of each kind.
    """

    def __init__(self) -> None:
        self._kept: list[Problem] = []  # the first of each kind
        self._numbers: Counter[tuple[Path, str]] = Counter()  # all that were found
        self._last: dict[tuple[Path, str], Problem] = {}  # of each file and kind

    def add(self, path: Path, code: str, make: Callable[[], Problem]) -> None:
        """Note a problem; `make` is only called if it is one of the first of its kind."""
        self._numbers[path, code] += 1
        if self._numbers[path, code] <= MOST_OF_A_KIND:
            self._last[path, code] = make()
            self._kept.append(self._last[path, code])

    def __iter__(self) -> Iterator[Problem]:
        yield from self._kept
        for (path, code), last in self._last.items():
            if (left := self._numbers[path, code] - MOST_OF_A_KIND) > 0:
                message = f"{left} more problems of the kind '{code}' in this file"
                yield Problem(path, last.line, last.column + 1, message, "more")


def bytes_of(path: Path, max_bytes: int, advice: str) -> bytes:
    """A file's bytes. Raises DocumentError: it cannot be read, or is too large (with advice)."""
    try:
        with path.open("rb") as file:
            raw = file.read(max_bytes + 1)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        message = f"cannot read the file: {reason}; {path_advice(path, 'check the path')}"
        raise DocumentError.at(path, message, "unreadable") from None
    if len(raw) > max_bytes:
        raise DocumentError.at(path, f"larger than {max_bytes} bytes; {advice}", "too-large")
    return raw


_UTF_16: Final = re.compile(rb"(\0[\t\n\r -~]){2}|([\t\n\r -~]\0){2}")
"""How UTF-16 without a byte order mark begins."""


def text_in(raw: bytes, path: Path) -> str:
    """Bytes decoded as text. Raises DocumentError: they are not UTF-8."""
    if raw.startswith(b"PK\x03\x04"):
        message = "a ZIP archive (such as a spreadsheet), no text; export it as text"
        raise DocumentError.at(path, message, "not-utf8")
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")) or _UTF_16.match(raw):
        message = "UTF-16 text, as Windows programs write 'Unicode'; save the file as UTF-8"
        raise DocumentError.at(path, message, "not-utf8")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = "not UTF-8 text; save the file as UTF-8"
        place = line_column(raw[: error.start])
        raise DocumentError.at(path, message, "not-utf8", *place) from None


def line_column(before: bytes) -> tuple[int, int]:
    """The line and column, from 1, behind these bytes of a text."""
    line = before.count(b"\n") + 1
    column = len(before.rpartition(b"\n")[2].decode("utf-8", "replace")) + 1
    return line, column
