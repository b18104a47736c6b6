"""A YAML text by its values and its lines, and the pieces of it that are replaced."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import yaml

from air_router.files.mission_document import Keys


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
        self._shared = _shared(root)  # ids of nodes that are used more than once, through aliases
        self.root = YamlValue(root, int(root.start_mark.index))
        self._pieces: list[tuple[int, int, str]] = []  # from, up to, what is there then

    def text(self) -> str:
        """The text with all pieces replaced at once. Raises ValueError: two of them overlap."""
        parts: list[str] = []
        done = 0
        for start, end, text in sorted(self._pieces):
            if start < done:
                raise ValueError(f"pieces overlap at character {start}")
            parts += [self.source[done:start], text]
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
        """The first character of the line below."""
        return min(self.line_end(at) + len(self.newline), len(self.source))

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
