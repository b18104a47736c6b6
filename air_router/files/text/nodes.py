"""Where the values of a mission file stand in its text."""

from collections import Counter
from collections.abc import Sequence
from functools import cached_property

import yaml

from air_router.errors import AirRouterError
from air_router.files.mission_document import Keys

Span = tuple[int, int]
"""From a character up to, not including, another."""

_OMITTED = ("position", "polygon")
"""Keys of the long form that the short form leaves out."""


class SourceError(AirRouterError):
    """A change that cannot be made in this text; the message says why, and what to do instead."""


class Nodes:
    """A text and the nodes of its values, found by their key paths.

    A path may name the long form of a mission file ("waypoints", 3, "position") where the text
    has the short one.
    """

    def __init__(self, text: str, root: yaml.Node | None) -> None:
        self.text = text
        self.newline = "\r\n" if "\r\n" in text else "\n"  # as the text has it
        self._root = root

    def find(self, keys: Sequence[str | int]) -> yaml.Node | None:
        """The node at a key path; None if there is none.

        Raises:
            SourceError: the text has it in several places at once.
        """
        node = self._root
        for count, key in enumerate(keys, start=1):
            if isinstance(node, yaml.SequenceNode) and key in _OMITTED:
                continue
            index = _index(node, key)
            if index is None or not isinstance(node, yaml.CollectionNode):
                return None
            entry = node.value[index]
            node = entry[1] if isinstance(entry, tuple) else entry
            if id(node) in self._shared:
                raise SourceError(
                    f"{named(keys[:count])} is used in several places of the file (a YAML alias); "
                    "write it out, or edit it by hand"
                )
        return node

    def get(self, keys: Keys) -> yaml.Node:
        """The node at a key path. Raises SourceError if there is none."""
        node = self.find(keys)
        if node is None:
            raise SourceError(f"the file has no {named(keys)} any more; load the page again")
        return node

    def scalar(self, keys: Keys) -> yaml.ScalarNode:
        """The single value at a key path. Raises SourceError if there is none."""
        node = self.get(keys)
        if not isinstance(node, yaml.ScalarNode):
            raise SourceError(f"{named(keys)} is not a single value; edit it by hand")
        return node

    def collection(self, keys: Keys) -> yaml.CollectionNode:
        """The list or mapping at a key path. Raises SourceError if there is none."""
        node = self.get(keys)
        if not isinstance(node, yaml.CollectionNode):
            raise SourceError(f"{named(keys)} is neither a list nor a mapping; edit it by hand")
        return node

    def index(self, keys: Keys) -> int:
        """Which entry of its parent the value at a key path is."""
        index = _index(self.get(keys[:-1]), keys[-1])
        if index is None:
            raise SourceError(f"the file has no {named(keys)} any more; load the page again")
        return index

    def key(self, keys: Keys) -> yaml.Node | None:
        """The node of the key itself; None for an entry of a list."""
        parent = self.get(keys[:-1])
        if not isinstance(parent, yaml.MappingNode):
            return None
        key: yaml.Node = parent.value[self.index(keys)][0]
        return key

    def in_flow(self, keys: Keys) -> bool:
        """Whether the value stands within brackets or braces."""
        parents = (self.find(keys[:count]) for count in range(len(keys)))
        return any(isinstance(p, yaml.CollectionNode) and bool(p.flow_style) for p in parents)

    def span(self, node: yaml.Node) -> Span:
        """A node's place in the text, without blanks and comments behind it."""
        return node.start_mark.index, self.end(node)

    def end(self, node: yaml.Node) -> int:
        """Where a node ends; a list or mapping without brackets ends with its last value."""
        start, end = node.start_mark.index, node.end_mark.index
        if isinstance(node, yaml.CollectionNode):
            if node.flow_style or not node.value:
                return int(end)
            last = node.value[-1]
            last = last[1] if isinstance(last, tuple) else last
            if id(last) not in self._shared:
                return self.end(last)
            lines = self.text[start:end].splitlines(keepends=True)
            while lines and (not lines[-1].strip() or lines[-1].lstrip().startswith("#")):
                lines.pop()
            return start + len("".join(lines).rstrip())
        if isinstance(node, yaml.ScalarNode) and node.style in ("|", ">"):
            return start + len(self.text[start:end].rstrip())
        return int(end)

    def entries(self, node: yaml.CollectionNode) -> list[Span]:
        """The places of a list's items, or of a mapping's keys with their values."""
        spans = []
        for entry in node.value:
            first, last = entry if isinstance(entry, tuple) else (entry, entry)
            if id(first) in self._shared or id(last) in self._shared:
                raise SourceError(
                    "the list has entries that stand elsewhere (YAML aliases); "
                    "write them out, or edit it by hand"
                )
            spans.append((int(first.start_mark.index), self.end(last)))
        return spans

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

    def before(self, at: int) -> str:
        """What stands before a character on its line."""
        return self.text[self.line_start(at) : at]

    def after(self, at: int) -> str:
        """What stands behind, on the line."""
        return self.text[at : self.line_end(at)]

    @cached_property
    def _shared(self) -> set[int]:
        """Nodes that the text uses more than once, through YAML's aliases."""
        counts: Counter[int] = Counter()
        rest = [] if self._root is None else [self._root]
        while rest:
            node = rest.pop()
            counts[id(node)] += 1
            if counts[id(node)] > 1 or not isinstance(node, yaml.CollectionNode):
                continue
            for entry in node.value:
                rest += entry if isinstance(entry, tuple) else [entry]
        return {node for node, count in counts.items() if count > 1}


def named(keys: Sequence[str | int]) -> str:
    """A key path in words: 'no_fly_zones[2].name'."""
    path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return f"'{path.removeprefix('.')}'"


def _index(node: yaml.Node | None, key: str | int) -> int | None:
    if isinstance(node, yaml.SequenceNode):
        return key if isinstance(key, int) and 0 <= key < len(node.value) else None
    if isinstance(node, yaml.MappingNode):
        for index, (key_node, _) in enumerate(node.value):
            if key_node.value == key:
                return index
    return None
