"""The text of a mission file, edited at the marks of its values.

YAML and JSON alike: JSON is YAML in one flow. Each method says which pieces of the text make one
change; whatever they do not touch stays as it is, comments and all.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from air_router.files.mission_document import Keys
from air_router.files.text.nodes import Nodes, SourceError, Span, named
from air_router.files.text.rendering import block, flow, flow_lines, like, word, yaml_flow
from mocha_link.team.document import Document

_REST = re.compile(r"[ \t]*(,?)[ \t]*(#.*)?")
"""What may stand behind an item that has its line for itself."""


@dataclass(frozen=True, slots=True, order=True)
class Splice:
    """From `start` up to, not including, `end` (in characters) the text becomes `text`."""

    start: int
    end: int
    text: str


def spliced(text: str, splices: Iterable[Splice]) -> str:
    """The text with all pieces replaced at once; everything between them stays as it is.

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


class TextSource:
    """A text, and how to change it.

    Attributes:
        text: the whole file's text.
        json: whether it must stay JSON.
        nodes: where its values stand.
    """

    def __init__(self, text: str, root: yaml.Node | None, *, json: bool) -> None:
        self.text = text
        self.json = json
        self.nodes = Nodes(text, root)
        unit = re.search(r"\n([ \t]+)\S", text)
        self._unit = unit[1] if unit else "    "  # one step of indent

    @classmethod
    def of_yaml(cls, text: str, path: Path) -> TextSource:
        """Of YAML; `path` only names it in messages. Raises DocumentError: it is none."""
        return cls(text, Document.from_text(text, path).node(), json=False)

    def has(self, *keys: str | int) -> bool:
        """Whether there is a value, null included."""
        return self.nodes.find(keys) is not None

    def is_mapping(self, *keys: str | int) -> bool:
        """Whether the value is a mapping in the text, not only in the long form."""
        return isinstance(self.nodes.find(keys), yaml.MappingNode)

    def length(self, *keys: str | int) -> int:
        """How many entries a list or a mapping has; 0 if it is neither."""
        node = self.nodes.find(keys)
        return len(node.value) if isinstance(node, yaml.CollectionNode) else 0

    def stands_on_lines(self, key: str) -> bool:
        """Whether there is such a key of the whole file, on lines of its own."""
        return self.has(key) and not self.nodes.in_flow((key,))

    def number(self, keys: Keys, value: float, decimals: int) -> list[Splice]:
        """Write another number in the place of one."""
        node = self.nodes.scalar(keys)
        digits = like(node.value, value, decimals)
        return [] if digits is None else [Splice(*self.nodes.span(node), digits)]

    def words(self, keys: Keys, value: str) -> list[Splice]:
        """Write another text in the place of one."""
        node = self.nodes.scalar(keys)
        quoted = self.json or node.style in ('"', "'")
        return [Splice(*self.nodes.span(node), flow(value) if quoted else word(value))]

    def fill(self, keys: Keys, value: Any) -> list[Splice]:
        """Write a value in the place of null, or of an empty list."""
        start, end = self.nodes.span(self.nodes.get(keys))
        key = self.nodes.key(keys)
        if self.json or key is None or self.nodes.in_flow(keys):
            return [Splice(start, end, self._in_flow(value, start))]
        at = self.nodes.line_end(end)
        lines = block(value, " " * (key.start_mark.column + 2))
        newline = self.nodes.newline
        begin = len(self.text[:start].rstrip(" "))
        return [Splice(begin, end, ""), Splice(at, at, newline + newline.join(lines))]

    def items(self, keys: Keys) -> list[yaml.ScalarNode]:
        """The words and numbers of a list; none where there is no list."""
        node = self.nodes.find(keys)
        items = node.value if isinstance(node, yaml.SequenceNode) else []
        return [item for item in items if isinstance(item, yaml.ScalarNode)]

    def rewrite(self, keys: Keys, value: Any) -> list[Splice]:
        """Write a whole list, or a single value, in the place of another."""
        node = self.nodes.get(keys)
        start, end = self.nodes.span(node)
        if self.json or not isinstance(node, yaml.CollectionNode) or node.flow_style:
            return [Splice(start, end, self._in_flow(value, start, (start, end)))]
        lines = block(value, " " * node.start_mark.column)
        return [Splice(start, end, self.nodes.newline.join(lines).lstrip(" "))]

    def exchange(self, keys: Keys, key: str, value: Any) -> list[Splice]:
        """Write another key with its value in the place of one, in YAML."""
        parent, index = self.nodes.collection(keys[:-1]), self.nodes.index(keys)
        start, end = self.nodes.entries(parent)[index]
        if parent.flow_style:
            return [Splice(start, end, yaml_flow({key: value})[1:-1])]
        lines = block({key: value}, " " * parent.start_mark.column)
        return [Splice(start, end, self.nodes.newline.join(lines).lstrip(" "))]

    def insert(self, keys: Keys, index: int, *items: Any) -> list[Splice]:
        """Insert items into a list, before the one that has the index now."""
        node = self.nodes.collection(keys)
        if not isinstance(node, yaml.SequenceNode) or not 0 <= index <= len(node.value):
            raise SourceError(f"{named(keys)} is no list of so many items; load the page again")
        if not node.value:
            return self.fill(keys, list(items))
        if node.flow_style:
            return self._insert_in_flow(node, index, items)
        return self._insert_lines(node, index, items)

    def add_key(self, keys: Keys, key: str, value: Any) -> list[Splice]:
        """Add a key behind the last one of a mapping."""
        node = self.nodes.collection(keys)
        if not isinstance(node, yaml.MappingNode):
            raise SourceError(f"{named(keys)} is no mapping in the file; edit it by hand")
        if node.flow_style:
            entry = flow({key: value})[1:-1] if self.json else yaml_flow({key: value})[1:-1]
            if not node.value:
                return [Splice(*self.nodes.span(node), "{" + entry + "}")]
            entries = self.nodes.entries(node)
            return [Splice(entries[-1][1], entries[-1][1], self._separator(node, entries) + entry)]
        at = self.nodes.line_end(self.nodes.end(node))
        lines = block({key: value}, " " * node.start_mark.column)
        newline = self.nodes.newline
        gap = newline if not keys else ""
        return [Splice(at, at, gap + newline + newline.join(lines))]

    def wrap(self, keys: Keys, key: str, others: Mapping[str, Any]) -> list[Splice]:
        """Make a mapping of a value: the value itself under `key`, and others beside it."""
        node = self.nodes.get(keys)
        start, end = self.nodes.span(node)
        if not isinstance(node, yaml.CollectionNode) or node.flow_style:
            more = "".join(f", {word(name)}: {yaml_flow(value)}" for name, value in others.items())
            return [Splice(start, start, f"{{{word(key)}: "), Splice(end, end, more + "}")]
        lines = [f"{word(name)}: {yaml_flow(value)}" for name, value in others.items()]
        break_ = self.nodes.newline + " " * node.start_mark.column
        return [Splice(start, start, "".join(line + break_ for line in [*lines, f"{word(key)}:"]))]

    def write_section(self, key: str, lines: str) -> list[Splice]:
        """Write whole lines in the place of a key that `stands_on_lines`, and its value."""
        parent, index = self.nodes.collection(()), self.nodes.index((key,))
        start, end = self.nodes.entries(parent)[index]
        text = lines.replace("\n", self.nodes.newline)
        return [Splice(self.nodes.line_start(start), self.nodes.next_line(end), text)]

    def remove(self, keys: Keys) -> list[Splice]:
        """Take an item out of a list, or a key with its value out of a mapping."""
        parent, index = self.nodes.collection(keys[:-1]), self.nodes.index(keys)
        entries = self.nodes.entries(parent)
        if parent.flow_style:
            return self._remove_in_flow(parent, entries, index)
        starts = [self._entry_start(parent, start) for start, _ in entries]
        if len(entries) == 1:
            return self._remove_last(keys[:-1], starts[0], entries[0][1])
        if not self.nodes.before(starts[index]).strip():
            return [self._whole_lines(starts[index], entries[index][1])]
        return [Splice(starts[index], starts[index + 1], "")]  # on its parent's line: the first

    # Within brackets and braces

    def _in_flow(self, item: Any, at: int, sibling: Span | None = None) -> str:
        """An item as text, in the style of a sibling or of the whole file."""
        if not self.json:
            return yaml_flow(item)
        lines = "\n" in (self.text if sibling is None else self.text[slice(*sibling)])
        before = self.nodes.before(at)
        indent = before[: len(before) - len(before.lstrip())]
        text = flow_lines(item, indent, self._unit) if lines else flow(item)
        return text.replace("\n", self.nodes.newline)

    def _separator(self, node: yaml.Node, entries: list[Span]) -> str:
        """What stands between two entries, or would; comments left out."""
        first = entries[0][0]
        if len(entries) > 1:
            between = self.text[entries[0][1] : entries[1][0]]
            first = entries[1][0]
        else:
            between = ", " + self.text[node.start_mark.index + 1 : first]
        if "\n" not in between:
            return between if len(entries) > 1 else ", "
        return "," + self.nodes.newline + self.nodes.before(first)

    def _insert_in_flow(
        self, node: yaml.SequenceNode, index: int, items: Iterable[Any]
    ) -> list[Splice]:
        entries = self.nodes.entries(node)
        separator = self._separator(node, entries)
        text = separator.join(self._in_flow(item, entries[0][0], entries[0]) for item in items)
        if index == 0:
            at = entries[0][0]
            return [Splice(at, at, text + separator)]
        at = entries[index - 1][1]
        rest = _REST.fullmatch(self.nodes.after(at))
        if "\n" not in separator or rest is None or not rest[2]:
            return [Splice(at, at, separator + text)]
        line = separator[1:] + text  # a comment stays with the item that it stands behind
        end = self.nodes.line_end(at)
        if rest[1]:
            return [Splice(end, end, line + ",")]
        return [Splice(at, at, ","), Splice(end, end, line)]

    def _remove_in_flow(
        self, node: yaml.CollectionNode, entries: list[Span], index: int
    ) -> list[Splice]:
        start, end = entries[index]
        if len(entries) == 1:
            return [Splice(node.start_mark.index + 1, node.end_mark.index - 1, "")]
        alone = not self.nodes.before(start).strip() and _REST.fullmatch(self.nodes.after(end))
        if alone and not self.json:
            return [self._whole_lines(start, end)]
        if index + 1 < len(entries):
            return [Splice(start, entries[index + 1][0], "")]
        return [Splice(entries[index - 1][1], end, "")]

    # In lines of their own

    def _insert_lines(
        self, node: yaml.SequenceNode, index: int, items: Iterable[Any]
    ) -> list[Splice]:
        entries = self.nodes.entries(node)
        indent = " " * node.start_mark.column
        newline = self.nodes.newline
        lines = newline.join(block(list(items), indent))
        if index == 0:
            at = node.start_mark.index
            return [Splice(at, at, lines.lstrip(" ") + newline + indent)]
        at = self.nodes.line_end(entries[index - 1][1])
        return [Splice(at, at, newline + lines)]

    def _entry_start(self, parent: yaml.CollectionNode, start: int) -> int:
        """The dash of a list's item, the key of a mapping."""
        if isinstance(parent, yaml.MappingNode):
            return start
        column = parent.start_mark.column
        at = self.nodes.line_start(start)
        while at > parent.start_mark.index and not self.text.startswith(" " * column + "-", at):
            at = self.nodes.line_start(at - 1)
        return max(at + column, int(parent.start_mark.index))

    def _remove_last(self, keys: Keys, start: int, end: int) -> list[Splice]:
        node = self.nodes.get(keys)
        if isinstance(node, yaml.MappingNode):
            raise SourceError(f"{named(keys)} would be empty; remove it as a whole")
        key = self.nodes.key(keys) if keys else None
        if key is None or self.nodes.before(start).strip():
            return [Splice(start, end, "[]")]
        colon = self.text.index(":", key.end_mark.index) + 1
        return [Splice(colon, colon, " []"), self._whole_lines(start, end)]

    def _whole_lines(self, start: int, end: int) -> Splice:
        first, behind = self.nodes.line_start(start), self.nodes.next_line(end)
        if behind == len(self.text) and not self.text.endswith("\n") and first:
            first -= len(self.nodes.newline)  # the last line of all has no line break
        return Splice(first, behind, "")
