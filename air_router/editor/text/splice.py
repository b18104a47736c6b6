"""Pieces of a text that are replaced by others; everything between them stays as it is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class Splice:
    """From `start` up to, not including, `end` (in characters) the text becomes `text`."""

    start: int
    end: int
    text: str


def spliced(text: str, splices: Iterable[Splice]) -> str:
    """The text with all pieces replaced at once.

    Raises:
        ValueError: two pieces overlap.
    """
    parts: list[str] = []
    done = 0
    for splice in sorted(splices):
        if splice.start < done:
            raise ValueError(f"pieces overlap at character {splice.start}")
        parts += [text[done : splice.start], splice.text]
        done = splice.end
    return "".join([*parts, text[done:]])
