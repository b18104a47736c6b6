"""Where the values of a YAML or JSON text stand in it, and pieces of a text that are replaced."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum

import yaml

from air_router.files.json_document import JsonDocument
from mocha_link.team.document import Document

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


class Lines:
    """A text by its lines.

    Attributes:
        text: The whole.
        newline: Its line break.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.newline = "\r\n" if "\r\n" in text else "\n"

    def before(self, at: int) -> str:
        """What stands before a character on its line."""
        return self.text[self.line_start(at) : at]

    def line_start(self, at: int) -> int:
        """The first character of the line."""
        return self.text.rfind("\n", 0, at) + 1

    def line_end(self, at: int) -> int:
        """The end of the line, before its line break."""
        end = self.text.find("\n", at)
        if end < 0:
            return len(self.text)
        return end - 1 if self.text[max(end - 1, at) : end] == "\r" else end

    def next_line(self, at: int) -> int:
        """The first character of the line below."""
        return min(self.line_end(at) + len(self.newline), len(self.text))

    def after(self, at: int) -> str:
        """What stands behind a character on its line."""
        return self.text[at : self.line_end(at)]


def parts_of(text: str, document: Document) -> Part | None:
    """The places of a document's values in its text; None if it is empty."""
    if isinstance(document, JsonDocument):
        return json_part(document)
    node = document.node()
    return None if node is None else yaml_part(text, node)


def with_section(text: str, document: Document, key: str, lines: str) -> str | None:
    """A YAML text with whole lines in the place of a key and its value.

    None if the file has no such key on lines of its own.
    """
    root = parts_of(text, document)
    entries = [] if root is None or root.flow or not root.is_mapping else root.entries()
    entry = next((entry for entry in entries if entry.key == key), None)
    if entry is None:
        return None
    places = Lines(text)
    start, end = places.line_start(entry.start), places.next_line(entry.part.end)
    return spliced(text, [Splice(start, end, lines.replace("\n", places.newline))])


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
