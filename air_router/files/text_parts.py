"""Where the values of a YAML or JSON text stand in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import yaml

from air_router.files.json_document import JsonDocument

Span = tuple[int, int]
"""From a character up to, not including, another."""


class Kind(Enum):
    """What a value is in the text."""

    WORD = "word"  # or a number, or null
    LIST = "list"
    MAPPING = "mapping"


@dataclass(frozen=True, slots=True)
class Part:
    """A value in a text.

    Attributes:
        kind: What it is.
        start: Its first character.
        end: Behind its last one; blanks and comments behind it are not part of it.
        column: Of its first character, from 0.
        entries: Those of a list or mapping; none of a word.
        flow: It stands in brackets or braces of its own.
        quoted: It is a word in quotes.
        shared: The text uses it more than once, through YAML's aliases.
    """

    kind: Kind
    start: int
    end: int
    column: int
    entries: Callable[[], list[Entry]]
    flow: bool = False
    quoted: bool = False
    shared: bool = False

    @property
    def span(self) -> Span:
        """From its first character to behind its last one."""
        return self.start, self.end

    @property
    def is_mapping(self) -> bool:
        """Whether it has keys."""
        return self.kind is Kind.MAPPING

    @property
    def is_word(self) -> bool:
        """Whether it is a single value."""
        return self.kind is Kind.WORD


@dataclass(frozen=True, slots=True)
class Entry:
    """An item of a list, or a key of a mapping with its value; `key` of an item is None."""

    part: Part  # the item, or the value
    start: int  # of the item, or of the key
    key: str | None = None
    key_end: int = 0  # behind the key


def json_part(document: JsonDocument, start: int | None = None) -> Part:
    """The value at a character of a JSON text; None: the whole."""
    at = document.start if start is None else start
    letter, end = document.text[at], document.end_of(at)
    kind = {"[": Kind.LIST, "{": Kind.MAPPING}.get(letter, Kind.WORD)

    def entries() -> list[Entry]:
        return [
            Entry(json_part(document, child), key_at, key if kind is Kind.MAPPING else None)
            for key, (key_at, child) in document.children_of(at).items()
        ]

    flow = kind is not Kind.WORD
    return Part(kind, at, end, 0, entries if flow else list, flow=flow, quoted=letter == '"')


def yaml_part(text: str, root: yaml.Node) -> Part:
    """The root value of a YAML text."""
    return _Nodes(text, root).part(root)


class _Nodes:
    """Makes parts of a text's nodes."""

    def __init__(self, text: str, root: yaml.Node) -> None:
        self._text = text
        counts: Counter[int] = Counter()
        rest = [root]
        while rest:
            node = rest.pop()
            counts[id(node)] += 1
            if counts[id(node)] == 1 and isinstance(node, yaml.CollectionNode):
                for entry in node.value:
                    rest += entry if isinstance(entry, tuple) else [entry]
        self._shared = {node for node, count in counts.items() if count > 1}

    def part(self, node: yaml.Node) -> Part:
        kind, flow = Kind.WORD, False
        if isinstance(node, yaml.CollectionNode):
            kind = Kind.MAPPING if isinstance(node, yaml.MappingNode) else Kind.LIST
            flow = bool(node.flow_style)
        return Part(
            kind,
            int(node.start_mark.index),
            self._end(node),
            int(node.start_mark.column),
            lambda: self._entries(node),
            flow,
            quoted=isinstance(node, yaml.ScalarNode) and node.style in ('"', "'"),
            shared=id(node) in self._shared,
        )

    def _entries(self, node: yaml.Node) -> list[Entry]:
        if isinstance(node, yaml.MappingNode):
            return [
                Entry(
                    self.part(value),
                    int(key.start_mark.index),
                    str(key.value),
                    int(key.end_mark.index),
                )
                for key, value in node.value
            ]
        items = node.value if isinstance(node, yaml.SequenceNode) else []
        return [Entry(self.part(item), int(item.start_mark.index)) for item in items]

    def _end(self, node: yaml.Node) -> int:
        """Where a node ends; a list or mapping without brackets ends with its last value."""
        start, end = int(node.start_mark.index), int(node.end_mark.index)
        if isinstance(node, yaml.ScalarNode) and node.style in ("|", ">"):
            return start + len(self._text[start:end].rstrip())
        if not isinstance(node, yaml.CollectionNode) or node.flow_style or not node.value:
            return end
        last = node.value[-1]
        last = last[1] if isinstance(last, tuple) else last
        if id(last) not in self._shared:
            return self._end(last)
        lines = self._text[start:end].splitlines(keepends=True)
        while lines and (not lines[-1].strip() or lines[-1].lstrip().startswith("#")):
            lines.pop()
        return start + len("".join(lines).rstrip())
