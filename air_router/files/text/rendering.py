"""How new values are written into a mission file: as YAML in blocks, or in one flow as in JSON."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mocha_link.team.document import Document

DEGREE_DECIMALS = 7
"""A hundred-millionth of the Earth's meridian is 1 cm: finer than any receiver."""

METRE_DECIMALS = 2

_DECIMALS = re.compile(r"\.([0-9]+)")
_PLAIN = re.compile(r"[^\W\d_](?:[\w .()+/-]*[\w()+/-])?")
_SHORT = 3


class Digits(str):
    """A number as it shall stand in the text."""

    __slots__ = ()


def degrees(value: float) -> Digits:
    """Degrees with 7 decimals (1 cm)."""
    return Digits(f"{value + 0.0:.{DEGREE_DECIMALS}f}")


def metres(value: float, decimals: int = METRE_DECIMALS) -> Digits:
    """Metres, no finer than so many decimals, without zeros that say nothing."""
    rounded = round(value, decimals) + 0.0
    return Digits(str(int(rounded)) if rounded.is_integer() else repr(rounded))


def like(old: str, value: float, decimals: int) -> Digits | None:
    """A number in the place of an old one, with at least as many decimals; None: no change.

    `decimals` is how fine the value means to be. An old number that is the same at that fineness
    stays as it is written, however many digits it has.
    """
    try:
        before = float(old)
    except ValueError:
        before = math.nan
    if abs(before - value) < 0.5 * 10.0**-decimals:
        return None
    text = f"{round(value, decimals) + 0.0:.{decimals}f}"
    kept = _DECIMALS.search(old)
    least = min(len(kept[1]), decimals) if kept else 0
    whole, _, fraction = text.partition(".")
    fraction = fraction.rstrip("0").ljust(least, "0")
    return Digits(f"{whole}.{fraction}" if fraction else whole)


def flow(value: Any) -> str:
    """A value on one line, in words that are both YAML and JSON."""
    if isinstance(value, Digits):
        return str(value)
    if isinstance(value, Mapping):
        inside = (f"{json.dumps(key)}: {flow(item)}" for key, item in value.items())
        return "{" + ", ".join(inside) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(flow, value)) + "]"
    return _quoted(value) if isinstance(value, str) else json.dumps(value)


def flow_lines(value: Any, indent: str, unit: str) -> str:
    """A value as JSON over several lines; the first one without its indent."""
    if isinstance(value, Mapping) and value:
        items = [
            f"{json.dumps(key)}: {flow_lines(item, indent + unit, unit)}"
            for key, item in value.items()
        ]
        left, right = "{}"
    elif isinstance(value, Sequence) and not isinstance(value, str) and value:
        items = [flow_lines(item, indent + unit, unit) for item in value]
        left, right = "[]"
    else:
        return flow(value)
    inside = f",\n{indent}{unit}".join(items)
    return f"{left}\n{indent}{unit}{inside}\n{indent}{right}"


def yaml_flow(value: Any) -> str:
    """A value on one line of YAML, words without quotes where they need none."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{word(key)}: {yaml_flow(v)}" for key, v in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(yaml_flow, value)) + "]"
    return word(value) if isinstance(value, str) and not isinstance(value, Digits) else flow(value)


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
    return len(items) <= _SHORT and all(isinstance(item, Digits | int | float) for item in items)


def word(text: Any) -> str:
    """A word of YAML that is read back as the same text in any context; quoted if need be."""
    plain = str(text)
    if _PLAIN.fullmatch(plain) and Document.from_text(plain, Path("word")).data == plain:
        return plain
    return '"' + "".join(map(_escaped, plain)) + '"'


def _escaped(letter: str) -> str:
    """A letter within YAML's double quotes."""
    if letter in '"\\':
        return "\\" + letter
    return letter if letter.isprintable() else f"\\U{ord(letter):08x}"


def _quoted(text: str) -> str:
    """In double quotes, as JSON and YAML both read them."""
    return json.dumps(text, ensure_ascii=not text.isprintable())
