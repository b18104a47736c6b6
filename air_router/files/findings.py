"""What is wrong with a file, and what its operator should know: each finding with its place."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self

from geo.airspace import Ring
from geo.frame import Point
from mocha_link.team import Problem

Keys = tuple[str | int, ...]
"""The way to a value in a document."""


class DocumentSource(Protocol):
    """A file that is read: it knows where its values stand."""

    @property
    def path(self) -> Path:
        """The file."""

    def problem(self, keys: Sequence[str | int], message: str, code: str) -> Problem:
        """A problem with the value at these keys."""


@dataclass(frozen=True, slots=True)
class RefusedRing:
    """A ring that bounds no area, for pictures; `place` is where its border is wrong."""

    name: str
    ring: Ring
    place: Point | None


@dataclass(slots=True)
class Findings:
    """What reading and checking a file have found, in this order.

    Attributes:
        source: The file.
        problems: They keep it from being flown.
        notes: They do not.
        refused: Rings that bound no area.
    """

    source: DocumentSource
    problems: list[Problem] = field(default_factory=list)
    notes: list[Problem] = field(default_factory=list)
    refused: list[RefusedRing] = field(default_factory=list)

    def report(self, keys: Keys, message: str, code: str, of: DocumentSource | None = None) -> None:
        """Add a problem with the value at these keys; `of`: another file that the value is of."""
        self.problems.append((of or self.source).problem(keys, message, code))

    def note(self, keys: Keys, message: str, code: str, of: DocumentSource | None = None) -> None:
        """Add a note on the value at these keys; `of`: another file that the value is of."""
        self.notes.append((of or self.source).problem(keys, message, code))

    def copied(self) -> Self:
        """The same, to which others can be added."""
        return type(self)(self.source, [*self.problems], [*self.notes], [*self.refused])
