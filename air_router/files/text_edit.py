"""Writes changed data into the text that they were read from: YAML or JSON, comments and all.

An edit changes the plain data of a file. `rewritten` looks where these differ from what the text
says, and replaces such pieces only; whatever they do not touch stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from air_router.errors import AirRouterError
from air_router.files.json_document import JsonDocument
from air_router.files.mission_document import Keys
from air_router.files.text_parts import (
    Entry,
    Lines,
    Part,
    Span,
    Splice,
    parts_of,
    spliced,
)
from air_router.files.text_values import (
    Digits,
    block,
    json_flow,
    like,
    quoted,
    word,
    yaml_flow,
)
from mocha_link.team.document import Document

_REST = re.compile(r"[ \t]*(,?)[ \t]*(#.*)?")
"""What may stand behind an item that has its line for itself."""

_SHORT_FOR = ("position", "polygon")
"""Keys of a mission file whose mapping may be written as the bare value of the key."""


class SourceError(AirRouterError):
    """A change that cannot be made in this text; the message says why, and what to do instead."""


def rewritten(text: str, document: Document, data: Any) -> str:
    """The text of a document as it has to be for these data.

    Raises:
        SourceError: the text is written in a way that has no place for the change.
    """
    change = _Change(text, json=isinstance(document, JsonDocument))
    root = parts_of(text, document)
    if root is not None:
        change.value(_Place(root), document.data, data)
    return spliced(text, change.splices)


@dataclass(frozen=True, slots=True)
class _Place:
    """A value on the way down: its part, its path, the entry that it is, and what it stands in."""

    part: Part
    keys: Keys = ()
    entry: Entry | None = None
    in_flow: bool = False  # within brackets or braces of a parent

    def inner(self, entry: Entry, key: str | int) -> _Place:
        return _Place(entry.part, (*self.keys, key), entry, self.in_flow or self.part.flow)

    @property
    def named(self) -> str:
        """The path in words: 'no_fly_zones[2].name'."""
        path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in self.keys)
        return f"'{path.removeprefix('.')}'"


class _Change(Lines):
    """Compares data with what a text says, and collects the pieces that are to be replaced.

    Attributes:
        splices: The pieces so far.
    """

    def __init__(self, text: str, *, json: bool) -> None:
        super().__init__(text)
        self._json = json
        unit = re.search(r"\n([ \t]+)\S", text)
        self._unit = unit[1] if unit else "    "  # one step of indent
        self.splices: list[Splice] = []

    def value(self, place: _Place, old: Any, new: Any) -> None:
        """Make the text say `new` where it says `old`."""
        if old == new and isinstance(old, bool) is isinstance(new, bool):
            return
        part = place.part
        if part.shared:
            raise SourceError(
                f"{place.named} is used in several places of the file (a YAML alias); "
                "write it out, or edit it by hand"
            )
        if isinstance(old, dict) and isinstance(new, dict):
            self._mapping(place, old, new)
        elif isinstance(old, list) and isinstance(new, list) and old:
            self._list(place, old, new)
        elif isinstance(new, Mapping) and (key := _wrapping_key(old, new)) is not None:
            self._wrap(place, key, {name: item for name, item in new.items() if name != key})
        elif isinstance(new, Mapping | list) and old in (None, [], {}):
            self._fill(place, new)
        else:
            self._replace(part, new)

    def _mapping(self, place: _Place, old: dict[Any, Any], new: dict[Any, Any]) -> None:
        part = place.part
        gone, added = [key for key in old if key not in new], [key for key in new if key not in old]
        entries = {entry.key: entry for entry in part.entries()}
        if len(gone) == len(added) == 1:
            entry = entries[str(gone[0])]
            self._add(entry.start, entry.part.end, self._entry_text(part, added[0], new[added[0]]))
        elif gone and (len(gone) > 1 or added):
            self._replace(part, new)
            return
        else:
            for key in gone:
                self._remove(place, list(entries).index(str(key)))
            if not old:
                self._fill(place, new)
            elif added:
                self._add_keys(place, {key: new[key] for key in added})
        for key, value in old.items():
            if key in new:
                self.value(place.inner(entries[str(key)], key), value, new[key])

    def _list(self, place: _Place, old: list[Any], new: list[Any]) -> None:
        same = min(len(old), len(new))
        first = next((i for i in range(same) if old[i] != new[i]), same)
        behind = next((i for i in range(same - first) if old[-1 - i] != new[-1 - i]), same - first)
        fewer, more = old[first : len(old) - behind], new[first : len(new) - behind]
        if len(fewer) == len(more):
            entries = place.part.entries()
            for index, (before, after) in enumerate(zip(fewer, more, strict=True), start=first):
                self.value(place.inner(entries[index], index), before, after)
        elif not fewer:
            self._insert(place.part, first, more)
        elif not more and len(fewer) == 1:
            self._remove(place, first)
        else:
            self._replace(place.part, new)

    # A whole value

    def _replace(self, part: Part, new: Any) -> None:
        """Write a value in the place of another."""
        start, end = part.span
        if isinstance(new, Digits) and part.is_word:
            self._add(start, end, like(self.text[start:end], new))
        elif part.is_word and not isinstance(new, list | dict):
            gap = " " if self.text[start - 1 : start] == ":" else ""
            in_quotes = isinstance(new, str) and (self._json or part.quoted)
            self._add(start, end, gap + (quoted(new) if in_quotes else yaml_flow(new)))
        elif self._json or part.is_word or part.flow:
            self._add(start, end, self._in_flow(new, start, (start, end)))
        else:
            lines = block(new, " " * part.column)
            self._add(start, end, self.newline.join(lines).lstrip(" "))

    def _fill(self, place: _Place, new: Any) -> None:
        """Write a value in the place of null, or of an empty list or mapping."""
        (start, end), entry = place.part.span, place.entry
        if self._json or entry is None or entry.key is None or place.in_flow:
            self._add(start, end, self._in_flow(new, start))
            return
        at = self.line_end(end)
        lines = block(new, " " * (entry.start - self.line_start(entry.start) + 2))
        self._add(len(self.text[:start].rstrip(" ")), end, "")
        self._add(at, at, self.newline + self.newline.join(lines))

    def _wrap(self, place: _Place, key: str, others: Mapping[str, Any]) -> None:
        """Make a mapping of a value: the value itself under `key`, and others beside it."""
        start, end = place.part.span
        if place.part.is_word or place.part.flow:
            more = "".join(f", {word(name)}: {yaml_flow(value)}" for name, value in others.items())
            self._add(start, start, f"{{{word(key)}: ")
            self._add(end, end, more + "}")
        else:
            lines = [f"{word(name)}: {yaml_flow(value)}" for name, value in others.items()]
            separator = self.newline + " " * place.part.column
            self._add(start, start, "".join(f"{line}{separator}" for line in [*lines, f"{key}:"]))

    # Entries

    def _entry_text(self, part: Part, key: str, value: Any) -> str:
        """A key and its value, as an entry of this mapping."""
        if part.flow:
            return (json_flow if self._json else yaml_flow)({key: value})[1:-1]
        lines = block({key: value}, " " * part.column)
        return self.newline.join(lines).lstrip(" ")

    def _add_keys(self, place: _Place, more: Mapping[str, Any]) -> None:
        """Add keys behind the last one of a mapping that has some."""
        part = place.part
        spans = self._spans(part)
        if part.flow:
            separator = self._separator(part, spans)
            text = "".join(separator + self._entry_text(part, *item) for item in more.items())
            self._add(spans[-1][1], spans[-1][1], text)
        else:
            at = self.line_end(part.end)
            gap = self.newline if not place.keys else ""
            lines = block(more, " " * part.column)
            self._add(at, at, gap + self.newline + self.newline.join(lines))

    def _insert(self, part: Part, index: int, items: Sequence[Any]) -> None:
        """Insert items into a list, before the one that has the index now."""
        spans = self._spans(part)
        if part.flow:
            self._insert_in_flow(part, spans, index, items)
            return
        indent = " " * part.column
        lines = self.newline.join(block(list(items), indent))
        if index == 0:
            self._add(part.start, part.start, lines.lstrip(" ") + self.newline + indent)
        else:
            at = self.line_end(spans[index - 1][1])
            self._add(at, at, self.newline + lines)

    def _insert_in_flow(
        self, part: Part, spans: list[Span], index: int, items: Iterable[Any]
    ) -> None:
        separator = self._separator(part, spans)
        text = separator.join(self._in_flow(item, spans[0][0], spans[0]) for item in items)
        if index == 0:
            self._add(spans[0][0], spans[0][0], text + separator)
            return
        at = spans[index - 1][1]
        rest = _REST.fullmatch(self.after(at))
        if "\n" not in separator or rest is None or not rest[2]:
            self._add(at, at, separator + text)
            return
        line = separator[1:] + text  # a comment stays with the item that it stands behind
        end = self.line_end(at)
        if rest[1]:
            self._add(end, end, line + ",")
        else:
            self._add(at, at, ",")
            self._add(end, end, line)

    def _remove(self, place: _Place, index: int) -> None:
        """Take an item out of a list, or a key with its value out of a mapping."""
        part, spans = place.part, self._spans(place.part)
        if part.flow:
            self._remove_in_flow(part, spans, index)
            return
        starts = [self._entry_start(part, start) for start, _ in spans]
        if len(spans) == 1:
            self._remove_last(place, starts[0], spans[0][1])
        elif not self.before(starts[index]).strip():
            self._remove_lines(starts[index], spans[index][1])
        else:  # on its parent's line: the first
            self._add(starts[index], starts[index + 1], "")

    def _remove_in_flow(self, part: Part, spans: list[Span], index: int) -> None:
        start, end = spans[index]
        alone = not self.before(start).strip() and _REST.fullmatch(self.after(end))
        if len(spans) == 1:
            self._add(part.start + 1, part.end - 1, "")
        elif alone and not self._json:
            self._remove_lines(start, end)
        elif index + 1 < len(spans):
            self._add(start, spans[index + 1][0], "")
        else:
            self._add(spans[index - 1][1], end, "")

    def _remove_last(self, place: _Place, start: int, end: int) -> None:
        if place.part.is_mapping:
            raise SourceError(f"{place.named} would be empty; remove it as a whole")
        key = place.entry
        if key is None or key.key is None or self.before(start).strip():
            self._add(start, end, "[]")
            return
        colon = self.text.index(":", key.key_end) + 1
        self._add(colon, colon, " []")
        self._remove_lines(start, end)

    def _remove_lines(self, start: int, end: int) -> None:
        first, behind = self.line_start(start), self.next_line(end)
        if behind == len(self.text) and not self.text.endswith("\n") and first:
            first -= len(self.newline)  # the last line of all has no line break
        self._add(first, behind, "")

    def _spans(self, part: Part) -> list[Span]:
        """The places of a list's items, or of a mapping's keys with their values."""
        entries = part.entries()
        if any(entry.part.shared for entry in entries):
            raise SourceError(
                "the list has entries that stand elsewhere (YAML aliases); "
                "write them out, or edit it by hand"
            )
        return [(entry.start, entry.part.end) for entry in entries]

    def _entry_start(self, part: Part, start: int) -> int:
        """The dash of a list's item, the key of a mapping."""
        if part.is_mapping:
            return start
        at = self.line_start(start)
        while at > part.start and not self.text.startswith(" " * part.column + "-", at):
            at = self.line_start(at - 1)
        return max(at + part.column, part.start)

    # The text around

    def _add(self, start: int, end: int, text: str) -> None:
        self.splices.append(Splice(start, end, text))

    def _in_flow(self, item: Any, at: int, sibling: Span | None = None) -> str:
        """An item as text, in the style of a sibling or of the whole file."""
        if not self._json:
            return yaml_flow(item)
        lines = "\n" in (self.text if sibling is None else self.text[slice(*sibling)])
        before = self.before(at)
        indent = before[: len(before) - len(before.lstrip())]
        text = json_flow(item, self._unit if lines else None)
        return text.replace("\n", self.newline + indent)

    def _separator(self, part: Part, spans: list[Span]) -> str:
        """What stands between two entries, or would; comments left out."""
        first = spans[0][0]
        if len(spans) > 1:
            between = self.text[spans[0][1] : spans[1][0]]
            first = spans[1][0]
        else:
            between = ", " + self.text[part.start + 1 : first]
        if "\n" not in between:
            return between if len(spans) > 1 else ", "
        return "," + self.newline + self.before(first)


def _wrapping_key(old: Any, new: Mapping[str, Any]) -> str | None:
    """The key of the long form, if a value became one that holds it as it was."""
    keys = ("policy",) if isinstance(old, str) else _SHORT_FOR if isinstance(old, list) else ()
    return next((key for key in keys if new.get(key) == old), None)
