"""Writes changed data into the text that they were read from: YAML with its comments, or JSON.

PyYAML locates each value. `rewritten` compares the data with the text: a value
is written over, an entry of a list or mapping comes and goes with its own lines. Comments stand
between entries or behind them, so none is touched, and neither is the layout of anything else.
JSON has no comments and one layout for all of a file, so that it is written anew in the file's own.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from air_router.errors import AirRouterError
from air_router.files.digits import Digits, like
from air_router.files.json_document import JsonDocument, json_text
from mocha_link.team import Document, yaml_lines

_REST = re.compile(r"[ \t]*(,?)[ \t]*(#.*)?")
"""What may stand behind an entry that has its lines for itself."""

_COMMENT_LINE = re.compile(r"\n[ \t]*#")

_SHORT_FOR = ("position", "polygon")
"""Keys of a mission file whose mapping may be written as the bare value of the key."""


class SourceError(AirRouterError):
    """A change that cannot be made in this text; the message has the reason, and a remedy."""


def rewritten(text: str, document: Document, data: Any) -> str:
    """The text of a document as it has to be for these data.

    Raises:
        SourceError: the text is written in a way that has no place for the change.
    """
    if isinstance(document, JsonDocument):
        return json_text(data, like=text)
    root = document.node()
    if root is None:
        return text
    change = _Change(text, root)
    change.value(_Value(root), document.data, data)
    return change.text()


def with_section(text: str, document: Document, key: str, lines: str) -> str | None:
    """A YAML text with whole lines in the place of a key and its value.

    None if the file has no such key on lines of its own.
    """
    root = document.node()
    if not isinstance(root, yaml.MappingNode) or root.flow_style:
        return None
    change = _Change(text, root)
    for entry in change.entries(_Value(root)):
        if entry.key is not None and entry.key.value == key:
            change.replace_lines(entry, lines)
            return change.text()
    return None


@dataclass(frozen=True, slots=True)
class _Value:
    """A value of the text."""

    node: yaml.Node
    name: str = ""  # for messages: no_fly_zones[2].name; '' is the whole file
    start: int = 0  # its entry's first character: of its dash or its key, where it has one
    key: yaml.Node | None = None  # None: an item of a list, or the whole
    in_flow: bool = False  # it stands in brackets of another value

    @property
    def first(self) -> int:
        """Its own first character."""
        return int(self.node.start_mark.index)

    @property
    def flow(self) -> bool:
        """Whether it stands in brackets, its own or another's."""
        return self.in_flow or bool(getattr(self.node, "flow_style", False))


class _Change:
    """Compares data with a text, and collects the pieces that are to be replaced."""

    def __init__(self, text: str, root: yaml.Node) -> None:
        self._source = text
        self._newline = "\r\n" if "\r\n" in text else "\n"
        self._shared = _shared(root) if "&" in text else set()  # ids of nodes with aliases
        self._pieces: list[tuple[int, int, str]] = []  # from, up to, the new text

    def text(self) -> str:
        """The text with all pieces replaced at once."""
        parts: list[str] = []
        done = 0
        for start, end, new in sorted(self._pieces, key=lambda piece: piece[:2]):
            if start < done:
                raise SourceError("two changes meet in one line; edit it by hand")
            parts += (self._source[done:start], new)
            done = end
        return "".join([*parts, self._source[done:]])

    def value(self, value: _Value, old: Any, new: Any) -> None:
        """Change the text from `old` to `new`."""
        if old == new and isinstance(old, bool) is isinstance(new, bool):
            return
        if id(value.node) in self._shared:
            raise SourceError(
                f"'{value.name}' is used in several places of the file (a YAML alias); "
                "write it out, or edit it by hand"
            )
        if old and new and isinstance(old, dict) and isinstance(new, dict):
            self._mapping(value, old, new)
        elif old and new and isinstance(old, list) and isinstance(new, list):
            self._list(value, old, new)
        elif isinstance(new, Mapping) and (key := _wrapping_key(old, new)) is not None:
            self._wrap(value, key, {name: item for name, item in new.items() if name != key})
        elif old and new in ([], {}):
            self._remove(value, range(len(old)))
        else:
            self._replace(value, new)

    def _mapping(self, value: _Value, old: dict[Any, Any], new: dict[Any, Any]) -> None:
        entries = self.entries(value)
        removed = [index for index, key in enumerate(old) if key not in new]
        added = [(key, item) for key, item in new.items() if key not in old]
        if len(removed) == len(added) == 1:  # under another name, where it is
            entry = entries[removed[0]]
            self._cut(entry.start, self._end(entry.node), self._entry(value, *added[0]))
        elif removed:
            self._remove(value, removed)
            added = [] if len(removed) == len(old) else added  # then `_remove` left no lines
        if added and len(removed) != 1:
            self._insert(value, len(entries), added)
        for entry, (key, item) in zip(entries, old.items(), strict=True):
            if key in new:
                self.value(entry, item, new[key])

    def _list(self, value: _Value, old: list[Any], new: list[Any]) -> None:
        same = min(len(old), len(new))
        first = next((i for i in range(same) if old[i] != new[i]), same)
        behind = next((i for i in range(same - first) if old[-1 - i] != new[-1 - i]), same - first)
        fewer, more = old[first : len(old) - behind], new[first : len(new) - behind]
        both = min(len(fewer), len(more))
        entries = self.entries(value)
        for index, item in enumerate(more[:both], start=first):
            entry = entries[index]
            text = self._text_of(entries, old, item)
            if text is not None and self._is_one_line(entry.node) and not self._anchored(entry):
                self._cut(entry.first, self._end(entry.node), text)  # it moves unchanged
            else:
                self.value(entry, old[index], item)
        if more[both:]:
            self._insert(value, first + both, [(None, item) for item in more[both:]])
        elif fewer[both:]:
            self._remove(value, range(first + both, first + len(fewer)))

    def _text_of(self, entries: list[_Value], old: list[Any], item: Any) -> str | None:
        """How an item stands in the text now, if it is there in one line."""
        at = next((i for i, other in enumerate(old) if other is item), None)
        node = None if at is None or not isinstance(item, list | dict) else entries[at].node
        if node is None or id(node) in self._shared or not self._is_one_line(node):
            return None
        return self._source[int(node.start_mark.index) : self._end(node)]

    # A value as a whole

    def _replace(self, value: _Value, new: Any) -> None:
        """Write a value in the place of another."""
        node, start, end = value.node, value.first, self._end(value.node)
        short = _is_short(new)
        if not isinstance(node, yaml.ScalarNode) and not value.flow:
            indent = "\n" + " " * node.start_mark.column
            self._cut(start, end, self._broken(indent.join(_lines(new))))
        elif not short and value.flow and "#" in self._source[start:end]:
            self._put(start + 1, start + 1, _in_line(new)[1:-1])  # comments between the brackets
        elif not short and value.key is not None and not value.in_flow:
            at, indent = self._line_end(end), "\n" + " " * (value.key.start_mark.column + 2)
            self._cut(len(self._source[:start].rstrip(" ")), end, "")
            self._put(at, at, self._broken("".join(indent + line for line in _lines(new))))
        elif isinstance(node, yaml.ScalarNode) and node.style in ("|", ">"):
            _, mark, comment = self._after(start).partition("#")  # behind the mark of the block
            self._put(start, end, _in_line(new) + (f"  {mark}{comment}" if mark else ""))
        elif isinstance(new, Digits) and isinstance(node, yaml.ScalarNode):
            self._cut(start, end, self._gap(start) + like(self._source[start:end], new))
        else:
            style = getattr(node, "style", None)
            quotes = style if isinstance(new, str) and style in ("'", '"') else None
            self._cut(start, end, self._gap(start) + _in_line(new, quotes))

    def _gap(self, start: int) -> str:
        """A blank behind a key that has no value."""
        return " " if self._source[start - 1 : start] == ":" else ""

    def _wrap(self, value: _Value, key: str, others: Mapping[str, Any]) -> None:
        """Make a mapping of a value: the value itself under `key`, and others beside it."""
        start, end = value.first, self._end(value.node)
        if isinstance(value.node, yaml.ScalarNode) or value.flow:
            more = "".join(f", {name}: {_in_line(item)}" for name, item in others.items())
            self._put(start, start, f"{{{key}: ")
            self._put(end, end, f"{more}}}")
        else:
            indent = "\n" + " " * value.node.start_mark.column
            lines = [f"{name}: {_in_line(item)}" for name, item in others.items()]
            self._put(
                start, start, self._broken("".join(f"{x}{indent}" for x in [*lines, f"{key}:"]))
            )

    # Entries

    def entries(self, value: _Value) -> list[_Value]:
        """The items of a list, or the values of a mapping with their keys; none of a scalar."""
        node = value.node
        if isinstance(node, yaml.MappingNode):
            return [
                _Value(
                    item,
                    f"{value.name}.{key.value}".removeprefix("."),
                    key.start_mark.index,
                    key,
                    value.flow,
                )
                for key, item in node.value
            ]
        items = node.value if isinstance(node, yaml.SequenceNode) else []
        return [
            _Value(item, f"{value.name}[{i}]", self._dash(value, item), None, value.flow)
            for i, item in enumerate(items)
        ]

    def _dash(self, value: _Value, item: yaml.Node) -> int:
        """The first character of a list's item: its dash, or itself where it is in brackets."""
        at, column = int(item.start_mark.index), int(value.node.start_mark.column)
        if value.flow:
            return at
        at = self._line_start(at)
        while at > value.first and self._source[at : at + column + 1].strip(" ") != "-":
            at = self._line_start(at - 1)
        return max(at + column, value.first)

    def _entry(self, value: _Value, key: Any, item: Any) -> str:
        """An entry's text, for this list or mapping."""
        if value.flow:
            return _in_line(item) if key is None else _in_line({key: item})[1:-1]
        if key is None:
            lines = [("  " if i else "- ") + line for i, line in enumerate(_lines(item))]
        elif _is_short(item):
            lines = [f"{_in_line(key)}: {_in_line(item)}"]
        else:
            lines = [f"{_in_line(key)}:", *("  " + line for line in _lines(item))]
        return self._broken(("\n" + " " * value.node.start_mark.column).join(lines))

    def _insert(self, value: _Value, index: int, items: Sequence[tuple[Any, Any]]) -> None:
        """Insert keys, or None, with their values before the entry that has the index now."""
        entries, texts = self._own(value), [self._entry(value, *item) for item in items]
        alone = all(self._is_alone(entry) for entry in entries)
        indent = self._newline + self._before(entries[0].start) if alone else ""
        separator = indent
        if value.flow:
            separator = f",{indent}" if indent else ", "
        elif not alone:  # the first one stands behind another's dash
            separator = self._newline + " " * value.node.start_mark.column
        if index == 0:
            at = entries[0].start
            self._put(at, at, separator.join([*texts, ""]))
            return
        at = self._end(entries[index - 1].node)
        if value.flow and alone:  # a comment stays with the entry that it stands behind
            rest = _REST.match(self._after(at))
            self._put(at, at, "" if rest and rest[1] else ",")
            texts[-1] += "," if index < len(entries) or (rest and rest[1]) else ""
            separator = separator.removeprefix(",")
            texts[:-1] = [text + "," for text in texts[:-1]]
        if not value.flow or alone:
            at = self._line_end(at)
        if not value.flow and not value.name:
            self._put(at, at, self._newline)
        self._put(at, at, "".join(separator + text for text in texts))

    def _remove(self, value: _Value, indexes: Iterable[int]) -> None:
        """Take items out of a list, or keys with their values out of a mapping."""
        entries, removed = self._own(value), set(indexes)
        if len(removed) == len(entries):
            self._empty(value, entries)
            return
        for index in sorted(removed):
            entry = entries[index]
            if self._is_alone(entry):
                self._remove_lines(entry)
            elif any(i not in removed for i in range(index + 1, len(entries))):
                self._cut(entry.start, entries[index + 1].start, "")
            else:
                self._cut(self._end(entries[index - 1].node), self._end(entry.node), "")

    def _empty(self, value: _Value, entries: list[_Value]) -> None:
        empty = "[]" if isinstance(value.node, yaml.SequenceNode) else "{}"
        if value.flow or value.key is None or not all(map(self._is_alone, entries)):
            self._cut(value.first, self._end(value.node), empty)
            return
        colon = self._source.index(":", value.key.end_mark.index) + 1
        self._put(colon, colon, f" {empty}")
        for entry in entries:
            self._remove_lines(entry)

    def _own(self, value: _Value) -> list[_Value]:
        """The entries of a list or mapping that stand where they are, and nowhere else."""
        entries = self.entries(value)
        if self._anchored(value) or any(id(entry.node) in self._shared for entry in entries):
            raise SourceError(
                f"'{value.name}' has an anchor, or entries that stand elsewhere (YAML aliases); "
                "write them out, or edit it by hand"
            )
        return entries

    def _anchored(self, value: _Value) -> bool:
        return self._source[value.first : value.first + 1] in ("&", "!")

    def _is_alone(self, entry: _Value) -> bool:
        """Whether nothing else stands on an entry's lines but comments."""
        if self._before(entry.start).strip(" "):
            return False
        return not entry.in_flow or bool(_REST.fullmatch(self._after(self._end(entry.node))))

    # Lines

    def replace_lines(self, entry: _Value, lines: str) -> None:
        """Put whole lines in the place of an entry."""
        start, end = self._line_start(entry.start), self._next_line(self._end(entry.node))
        self._put(start, end, self._broken(lines))

    def _remove_lines(self, entry: _Value) -> None:
        first, behind = self._line_start(entry.start), self._next_line(self._end(entry.node))
        if behind == len(self._source) and not self._source.endswith("\n") and first:
            first -= len(self._newline)  # the last line of all has no line break
        self._put(first, behind, "")

    def _put(self, start: int, end: int, text: str) -> None:
        """Have another text from a character up to, not including, another."""
        self._pieces.append((start, end, text))

    def _cut(self, start: int, end: int, text: str) -> None:
        """The same where lines of comments may stand, which must not get lost."""
        if _COMMENT_LINE.search(self._source, start, end):
            line = self._source.count("\n", 0, start) + 1
            raise SourceError(f"comments stand in what changes on line {line}; edit it by hand")
        self._put(start, end, text)

    def _broken(self, text: str) -> str:
        """A text with the line breaks of this one."""
        return text.replace("\n", self._newline)

    def _before(self, at: int) -> str:
        return self._source[self._line_start(at) : at]

    def _after(self, at: int) -> str:
        return self._source[at : self._line_end(at)]

    def _line_start(self, at: int) -> int:
        return self._source.rfind("\n", 0, at) + 1

    def _line_end(self, at: int) -> int:
        """The end of the line, before its line break."""
        end = self._source.find("\n", at)
        end = len(self._source) if end < 0 else end
        return end - 1 if end > at and self._source[end - 1] == "\r" else end

    def _next_line(self, at: int) -> int:
        """The first character of the line below; line breaks of a file may differ."""
        end = self._source.find("\n", at)
        return len(self._source) if end < 0 else end + 1

    def _is_one_line(self, node: yaml.Node) -> bool:
        return "\n" not in self._source[int(node.start_mark.index) : self._end(node)]

    def _end(self, node: yaml.Node) -> int:
        """Behind a node; a list or mapping without brackets ends with its last value."""
        start, end = int(node.start_mark.index), int(node.end_mark.index)
        if isinstance(node, yaml.ScalarNode) and node.style in ("|", ">"):
            return start + len(self._source[start:end].rstrip())
        if not isinstance(node, yaml.CollectionNode) or node.flow_style or not node.value:
            return end
        last = node.value[-1][-1] if isinstance(node, yaml.MappingNode) else node.value[-1]
        if id(last) in self._shared:
            raise SourceError("a YAML alias stands last; write it out, or edit it by hand")
        return self._end(last)


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


def _is_short(value: Any) -> bool:
    """Whether a value gets one line: it holds no lists and no mappings."""
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return not any(isinstance(item, list | dict) for item in items)


def _in_line(value: Any, quotes: str | None = None) -> str:
    return yaml_lines(value, quotes=quotes, in_line=True)[0]


def _lines(value: Any) -> list[str]:
    return yaml_lines(value, in_line=_is_short(value))


def _wrapping_key(old: Any, new: Mapping[str, Any]) -> str | None:
    """The key of the long form, if a value became one that holds it as it was."""
    keys = ("policy",) if isinstance(old, str) else _SHORT_FOR if isinstance(old, list) else ()
    return next((key for key in keys if new.get(key) == old), None)
