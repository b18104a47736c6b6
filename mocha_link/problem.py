"""What is wrong with a file, and where; for those who only tell it, without what reads files."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mocha_link.errors import MochaLinkError
from mocha_link.printable import printable

if TYPE_CHECKING:
    from collections.abc import Iterable


@dataclass(frozen=True, slots=True, order=True)
class Problem:
    """One thing wrong with a file.

    ``str()`` is ``path:line:column: message [code]``; line and column count from 1.

    Attributes:
        code: What kind of problem it is, for programs and for docs/errors.md.
        keys: The way to the value in its document, where that is known.
    """

    path: Path
    line: int
    column: int
    message: str
    code: str
    keys: tuple[str | int, ...] = field(default=(), compare=False)

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}: {printable(self.message)} [{self.code}]"

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
        self.problems = tuple(sorted(set(problems)))
        super().__init__("\n".join(map(str, self.problems)))
