"""Text of others in one line of a terminal: nothing in it moves the cursor or changes colours."""

from __future__ import annotations


def sanitize(text: str) -> str:
    """The text with a space for every kind of blank, and `?` for all else that shows no letter."""
    if text.isprintable():
        return text
    return "".join(map(_shown, text))


def _shown(letter: str) -> str:
    if letter.isprintable():
        return letter
    return " " if letter.isspace() else "?"
