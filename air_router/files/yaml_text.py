"""A YAML text by its values and its lines, the pieces of it that are replaced, and new values.

These are written as YAML in blocks or in one flow, with as many digits as a mission needs.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import yaml

from air_router.files.mission_document import Keys
from mocha_link.team import Document


@dataclass(frozen=True, slots=True)
class YamlValue:
    """A value of a YAML text.

    Attributes:
        node: What it is.
        begin: Its first character, or that of its key.
        keys: The way to it.
        key_end: Behind its key; None for an item of a list and for the whole.
        in_flow: It stands in brackets or braces of another value.
    """

    node: yaml.Node
    begin: int
    keys: Keys = ()
    key_end: int | None = None
    in_flow: bool = False

    @property
    def start(self) -> int:
        """Its first character."""
        return int(self.node.start_mark.index)

    @property
    def indent(self) -> str:
        """The blanks before its first character, if it is alone on its line."""
        return " " * int(self.node.start_mark.column)

    @property
    def is_word(self) -> bool:
        """Whether it is a single value."""
        return isinstance(self.node, yaml.ScalarNode)

    @property
    def flow(self) -> bool:
        """Whether it stands in brackets or braces of its own."""
        return isinstance(self.node, yaml.CollectionNode) and bool(self.node.flow_style)

    @property
    def named(self) -> str:
        """The path in words: 'no_fly_zones[2].name'."""
        path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in self.keys)
        return f"'{path.removeprefix('.')}'"

    def entries(self) -> Iterator[YamlValue]:
        """The items of a list, or the values of a mapping with their keys; none of a word."""
        inside = self.in_flow or self.flow
        if isinstance(self.node, yaml.MappingNode):
            for key, value in self.node.value:
                start, end = int(key.start_mark.index), int(key.end_mark.index)
                yield YamlValue(value, start, (*self.keys, str(key.value)), end, inside)
        elif isinstance(self.node, yaml.SequenceNode):
            for index, item in enumerate(self.node.value):
                start = int(item.start_mark.index)
                yield YamlValue(item, start, (*self.keys, index), None, inside)


class YamlText:
    """A text by its lines, and the pieces of it that are to be replaced.

    Attributes:
        source: The text.
        newline: Its line break.
        root: The whole as a value.
    """

    def __init__(self, text: str, root: yaml.Node) -> None:
        self.source = text
        self.newline = "\r\n" if "\r\n" in text else "\n"
        # ids of nodes that are used more than once, through aliases, which need an anchor
        self._shared = _shared(root) if "&" in text else set()
        self.root = YamlValue(root, int(root.start_mark.index))
        self._pieces: list[tuple[int, int, str]] = []  # from, up to, what is there then

    def text(self) -> str:
        """The text with all pieces replaced at once. Raises ValueError: two of them overlap."""
        parts: list[str] = []
        done = 0
        for start, end, new in sorted(self._pieces):
            if start < done:
                raise ValueError(f"pieces overlap at character {start}")
            parts += (self.source[done:start], new)
            done = end
        return "".join([*parts, self.source[done:]])

    def replace_lines(self, entry: YamlValue, lines: str) -> None:
        """Put whole lines in the place of a key and its value."""
        start, end = self.line_start(entry.begin), self.next_line(self.end(entry.node))
        self.put(start, end, lines.replace("\n", self.newline))

    def is_shared(self, node: yaml.Node) -> bool:
        """Whether the text uses it more than once, through YAML's aliases."""
        return id(node) in self._shared

    def put(self, start: int, end: int, text: str) -> None:
        """Have another text from a character up to, not including, another."""
        self._pieces.append((start, end, text))

    def lines(self, lines: Iterable[str]) -> str:
        """Lines with this text's line break between them."""
        return self.newline.join(lines)

    def before(self, at: int) -> str:
        """What stands before a character on its line."""
        return self.source[self.line_start(at) : at]

    def after(self, at: int) -> str:
        """What stands behind a character on its line."""
        return self.source[at : self.line_end(at)]

    def line_start(self, at: int) -> int:
        """The first character of the line."""
        return self.source.rfind("\n", 0, at) + 1

    def line_end(self, at: int) -> int:
        """The end of the line, before its line break."""
        end = self.source.find("\n", at)
        if end < 0:
            return len(self.source)
        return end - 1 if self.source[max(end - 1, at) : end] == "\r" else end

    def next_line(self, at: int) -> int:
        """The first character of the line below; line breaks of a file may differ."""
        end = self.source.find("\n", at)
        return len(self.source) if end < 0 else end + 1

    def remove_lines(self, start: int, end: int) -> None:
        """Take out the lines on which these characters are, and all between them."""
        first, behind = self.line_start(start), self.next_line(end)
        if behind == len(self.source) and not self.source.endswith("\n") and first:
            first -= len(self.newline)  # the last line of all has no line break
        self.put(first, behind, "")

    def end(self, node: yaml.Node) -> int:
        """Behind a node; a list or mapping without brackets ends with its last value."""
        start, end = int(node.start_mark.index), int(node.end_mark.index)
        if isinstance(node, yaml.ScalarNode) and node.style in ("|", ">"):
            return start + len(self.source[start:end].rstrip())
        if not isinstance(node, yaml.CollectionNode) or node.flow_style or not node.value:
            return end
        last = node.value[-1]
        last = last[1] if isinstance(last, tuple) else last
        if id(last) not in self._shared:
            return self.end(last)
        lines = self.source[start:end].splitlines(keepends=True)
        while lines and (not lines[-1].strip() or lines[-1].lstrip().startswith("#")):
            lines.pop()
        return start + len("".join(lines).rstrip())


def _shared(root: yaml.Node) -> set[int]:
    """Ids of the nodes that a text uses more than once, through YAML's aliases."""
    counts: Counter[int] = Counter()
    rest = [root]
    while rest:
        node = rest.pop()
        counts[id(node)] += 1
        if counts[id(node)] == 1 and isinstance(node, yaml.CollectionNode):
            for entry in node.value:
                rest += entry if isinstance(entry, tuple) else [entry]
    return {node for node, count in counts.items() if count > 1}


# New values


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
