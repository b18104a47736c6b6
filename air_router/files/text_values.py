"""How new values are written into a file: as YAML in blocks, or in one flow."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from mocha_link.team.document import Document

DEGREE_DECIMALS = 7
"""A hundred-millionth of the Earth's meridian is 1 cm: finer than any receiver."""

METRE_DECIMALS = 2

_DECIMALS = re.compile(r"\.([0-9]+)")
_PLAIN = re.compile(r"[^\W\d_](?:[\w .()+/-]*[\w()+/-])?")
_SHORT = 3


class Digits(float):
    """A number as it shall stand in the text: rounded to so many decimals.

    Attributes:
        decimals: The most that are written.
        fixed: Zeros at the end are written too.
    """

    def __new__(cls, value: float, decimals: int, *, fixed: bool = False) -> Self:
        """Round a number; -0 becomes 0."""
        number = super().__new__(cls, round(value, decimals) + 0.0)
        number.decimals, number.fixed = decimals, fixed
        return number

    decimals: int
    fixed: bool

    def __str__(self) -> str:
        """The number's digits."""
        text = f"{float(self):.{self.decimals}f}"
        return text.rstrip("0").rstrip(".") if "." in text and not self.fixed else text


def degrees(value: float) -> Digits:
    """Degrees with 7 decimals (1 cm)."""
    return Digits(value, DEGREE_DECIMALS, fixed=True)


def degrees_text(value: float) -> str:
    """The same as text."""
    return str(degrees(value))


def metres(value: float, decimals: int = METRE_DECIMALS) -> Digits:
    """Metres, no finer than so many decimals, without zeros that say nothing."""
    return Digits(value, decimals)


def like(old: str, number: Digits) -> str:
    """A number in the place of an old one, with as many decimals, as far as it has them."""
    kept = _DECIMALS.search(old)
    least = min(len(kept[1]), number.decimals) if kept else 0
    whole, _, fraction = f"{float(number):.{number.decimals}f}".partition(".")
    fraction = fraction.rstrip("0").ljust(least, "0")
    return f"{whole}.{fraction}" if fraction else whole


def yaml_flow(value: Any) -> str:
    """A value on one line of YAML, words without quotes where they need none."""
    if isinstance(value, Digits):
        return str(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{word(key)}: {yaml_flow(v)}" for key, v in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(yaml_flow, value)) + "]"
    return word(value) if isinstance(value, str) else json.dumps(value)


def block(value: Any, indent: str) -> list[str]:
    """A value as lines of block YAML, each with its indent; short lists stay on one line."""
    if isinstance(value, Mapping):
        lines = []
        for key, item in value.items():
            if _is_short(item):
                lines.append(f"{indent}{word(key)}: {yaml_flow(item)}")
            else:
                lines += [f"{indent}{word(key)}:", *block(item, indent + "  ")]
        return lines
    if isinstance(value, Sequence) and not isinstance(value, str) and not _is_short(value):
        lines = []
        for item in value:
            if _is_short(item):
                lines.append(f"{indent}- {yaml_flow(item)}")
            else:
                first, *others = block(item, indent + "  ")
                lines += [f"{indent}- {first.lstrip(' ')}", *others]
        return lines
    return [indent + yaml_flow(value)]


def _is_short(value: Any) -> bool:
    if isinstance(value, str) or not isinstance(value, Sequence | Mapping):
        return True
    items = list(value.values() if isinstance(value, Mapping) else value)
    return len(items) <= _SHORT and all(isinstance(item, int | float) for item in items)


def word(text: Any) -> str:
    """A word of YAML that is read back as the same text in any context; quoted if need be."""
    plain = str(text)
    if _PLAIN.fullmatch(plain) and Document.from_text(plain, Path("word")).data == plain:
        return plain
    return quoted(plain)


def quoted(text: str) -> str:
    """A word in double quotes."""
    return '"' + "".join(map(_escaped, text)) + '"'


def _escaped(letter: str) -> str:
    """A letter within YAML's double quotes."""
    if letter in '"\\':
        return "\\" + letter
    return letter if letter.isprintable() else f"\\U{ord(letter):08x}"
