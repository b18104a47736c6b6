"""Writes changed data into the text that they were read from: YAML with its comments, or JSON.

An edit changes the plain data of a file. `rewritten` looks where these differ from what a YAML text
says, and replaces such pieces only; whatever they do not touch stays as it is. JSON has no comments
and one layout for all of a file, so that it is written anew in the file's own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import yaml

from air_router.errors import AirRouterError
from air_router.files.json_document import JsonDocument, json_text
from air_router.files.yaml_text import (
    Digits,
    YamlText,
    YamlValue,
    block,
    like,
    quoted,
    word,
    yaml_flow,
)
from mocha_link.team import Document

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
    if isinstance(document, JsonDocument):
        return json_text(data, like=text)
    root = document.node()
    if root is None:
        return text
    change = _Change(text, root)
    change.value(change.root, document.data, data)
    return change.text()


def with_section(text: str, document: Document, key: str, lines: str) -> str | None:
    """A YAML text with whole lines in the place of a key and its value.

    None if the file has no such key on lines of its own.
    """
    root = document.node()
    if not isinstance(root, yaml.MappingNode) or root.flow_style:
        return None
    places = YamlText(text, root)
    for entry in places.root.entries():
        if entry.keys == (key,):
            places.replace_lines(entry, lines)
            return places.text()
    return None


class _Change(YamlText):
    """Compares data with what a text says, and replaces the pieces where they differ."""

    def value(self, place: YamlValue, old: Any, new: Any) -> None:
        """Make the text say `new` where it says `old`."""
        if old == new and isinstance(old, bool) is isinstance(new, bool):
            return
        if self.is_shared(place.node):
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
            self._replace(place, new)

    def _mapping(self, place: YamlValue, old: dict[Any, Any], new: dict[Any, Any]) -> None:
        gone, added = [key for key in old if key not in new], [key for key in new if key not in old]
        entries = {str(entry.keys[-1]): entry for entry in place.entries()}
        if len(gone) == len(added) == 1:
            entry = entries[str(gone[0])]
            text = self._entry_text(place, added[0], new[added[0]])
            self.put(entry.begin, self.end(entry.node), text)
        elif gone and (len(gone) > 1 or added):
            self._replace(place, new)
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
                self.value(entries[str(key)], value, new[key])

    def _list(self, place: YamlValue, old: list[Any], new: list[Any]) -> None:
        same = min(len(old), len(new))
        first = next((i for i in range(same) if old[i] != new[i]), same)
        behind = next((i for i in range(same - first) if old[-1 - i] != new[-1 - i]), same - first)
        fewer, more = old[first : len(old) - behind], new[first : len(new) - behind]
        if len(fewer) == len(more):
            entries = list(place.entries())[first:]
            for entry, before, after in zip(entries, fewer, more, strict=False):
                self.value(entry, before, after)
        elif not fewer:
            self._insert(place, first, more)
        elif not more and len(fewer) == 1:
            self._remove(place, first)
        else:
            self._replace(place, new)

    # A whole value

    def _replace(self, place: YamlValue, new: Any) -> None:
        """Write a value in the place of another."""
        start, end = place.start, self.end(place.node)
        if isinstance(new, Digits) and place.is_word:
            self.put(start, end, like(self.source[start:end], new))
        elif place.is_word and not isinstance(new, list | dict):
            gap = " " if self.source[start - 1 : start] == ":" else ""
            in_quotes = isinstance(new, str) and self.source[start : start + 1] in ('"', "'")
            text = gap + (quoted(new) if in_quotes else yaml_flow(new))
            self.put(start, end, text + self._remark_of_block(place))
        elif place.is_word or place.flow:
            self.put(start, end, yaml_flow(new))
        else:
            self.put(start, end, self.lines(block(new, place.indent)).lstrip(" "))

    def _remark_of_block(self, place: YamlValue) -> str:
        """The remark behind the mark of a text in lines of its own, which goes with these lines."""
        if not isinstance(place.node, yaml.ScalarNode) or place.node.style not in ("|", ">"):
            return ""
        remark = self.after(place.start).partition(" ")[2].strip()
        return f"  {remark}" if remark else ""

    def _fill(self, place: YamlValue, new: Any) -> None:
        """Write a value in the place of null, or of an empty list or mapping."""
        start, end = place.start, self.end(place.node)
        if place.flow and "#" in self.source[start:end]:  # remarks between the brackets stay there
            self.put(start + 1, start + 1, yaml_flow(new)[1:-1])
            return
        if place.key_end is None or place.in_flow:
            self.put(start, end, yaml_flow(new))
            return
        at, indent = self.line_end(end), " " * (len(self.before(place.begin)) + 2)
        self.put(len(self.source[:start].rstrip(" ")), end, "")
        self.put(at, at, self.newline + self.lines(block(new, indent)))

    def _wrap(self, place: YamlValue, key: str, others: Mapping[str, Any]) -> None:
        """Make a mapping of a value: the value itself under `key`, and others beside it."""
        start, end = place.start, self.end(place.node)
        lines = [f"{word(name)}: {yaml_flow(value)}" for name, value in others.items()]
        if place.is_word or place.flow:
            self.put(start, start, f"{{{word(key)}: ")
            self.put(end, end, "".join(f", {line}" for line in lines) + "}")
        else:
            separator = self.newline + place.indent
            self.put(start, start, "".join(f"{line}{separator}" for line in [*lines, f"{key}:"]))

    # Entries

    def _entry_text(self, place: YamlValue, key: str, value: Any) -> str:
        """A key and its value, as an entry of this mapping."""
        if place.flow:
            return yaml_flow({key: value})[1:-1]
        return self.lines(block({key: value}, place.indent)).lstrip(" ")

    def _add_keys(self, place: YamlValue, more: Mapping[str, Any]) -> None:
        """Add keys behind the last one of a mapping that has some."""
        if place.flow:
            spans = self._spans(place)
            texts = [self._entry_text(place, *item) for item in more.items()]
            self._insert_in_flow(place, spans, len(spans), texts)
        else:
            at = self.line_end(self.end(place.node))
            gap = self.newline if not place.keys else ""
            self.put(at, at, gap + self.newline + self.lines(block(more, place.indent)))

    def _insert(self, place: YamlValue, index: int, items: Sequence[Any]) -> None:
        """Insert items into a list, before the one that has the index now."""
        spans = self._spans(place)
        if place.flow:
            self._insert_in_flow(place, spans, index, map(yaml_flow, items))
            return
        lines = self.lines(block(list(items), place.indent))
        if index == 0:
            text = lines.lstrip(" ") + self.newline + place.indent
            self.put(place.start, place.start, text)
        else:
            at = self.line_end(spans[index - 1][1])
            self.put(at, at, self.newline + lines)

    def _insert_in_flow(
        self, place: YamlValue, spans: list[tuple[int, int]], index: int, texts: Iterable[str]
    ) -> None:
        separator = self._separator(place, spans)
        text = separator.join(texts)
        if index == 0:
            self.put(spans[0][0], spans[0][0], text + separator)
            return
        at = spans[index - 1][1]
        rest = _REST.fullmatch(self.after(at))
        if "\n" not in separator or rest is None or not rest[2]:
            self.put(at, at, separator + text)
            return
        line = separator[1:] + text  # a comment stays with the item that it stands behind
        end = self.line_end(at)
        if rest[1]:
            self.put(end, end, line + ",")
        else:
            self.put(at, at, ",")
            self.put(end, end, line)

    def _remove(self, place: YamlValue, index: int) -> None:
        """Take an item out of a list, or a key with its value out of a mapping."""
        spans = self._spans(place)
        starts = [self._entry_start(place, start) for start, _ in spans]
        start, end = starts[index], spans[index][1]
        alone = not self.before(start).strip()
        if len(spans) == 1:
            self._remove_last(place, start, end)
        elif alone and (not place.flow or _REST.fullmatch(self.after(end))):
            self.remove_lines(start, end)
        elif index + 1 < len(spans):
            self.put(start, starts[index + 1], "")
        else:
            self.put(spans[index - 1][1], end, "")

    def _remove_last(self, place: YamlValue, start: int, end: int) -> None:
        if place.flow:
            self.put(place.start + 1, self.end(place.node) - 1, "")
            return
        if isinstance(place.node, yaml.MappingNode):
            raise SourceError(f"{place.named} would be empty; remove it as a whole")
        if place.key_end is None or self.before(start).strip():
            self.put(start, end, "[]")
            return
        colon = self.source.index(":", place.key_end) + 1
        self.put(colon, colon, " []")
        self.remove_lines(start, end)

    # Where things stand

    def _spans(self, place: YamlValue) -> list[tuple[int, int]]:
        """The places of a list's items, or of a mapping's keys with their values."""
        entries = list(place.entries())
        if any(self.is_shared(entry.node) for entry in entries):
            raise SourceError(
                "the list has entries that stand elsewhere (YAML aliases); "
                "write them out, or edit it by hand"
            )
        return [(entry.begin, self.end(entry.node)) for entry in entries]

    def _entry_start(self, place: YamlValue, start: int) -> int:
        """The dash of a list's item, the key of a mapping, all of an item in brackets."""
        if place.flow or isinstance(place.node, yaml.MappingNode):
            return start
        at = self.line_start(start)
        while at > place.start and not self.source.startswith(place.indent + "-", at):
            at = self.line_start(at - 1)
        return max(at + len(place.indent), place.start)

    def _separator(self, place: YamlValue, spans: list[tuple[int, int]]) -> str:
        """What stands between two entries, or would; comments left out."""
        first = spans[0][0]
        if len(spans) > 1:
            between = self.source[spans[0][1] : spans[1][0]]
            first = spans[1][0]
        else:
            between = ", " + self.source[place.start + 1 : first]
        if "\n" not in between:
            return between if len(spans) > 1 else ", "
        return "," + self.newline + self.before(first)


def _wrapping_key(old: Any, new: Mapping[str, Any]) -> str | None:
    """The key of the long form, if a value became one that holds it as it was."""
    keys = ("policy",) if isinstance(old, str) else _SHORT_FOR if isinstance(old, list) else ()
    return next((key for key in keys if new.get(key) == old), None)
