"""The nodes of a JSON text, with marks, in the form in which YAML's parser gives them."""

from __future__ import annotations

import json
import re

import yaml

_TAG = "tag:yaml.org,2002:"
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[-+0-9.eE]+|true|false|null|[][{},:]')
_KINDS = {"t": "bool", "f": "bool", "n": "null", '"': "str"}


def json_nodes(text: str) -> yaml.Node | None:
    """The root node of a text that is known to be JSON; None if there is nothing in it.

    All collections are flow; columns count from the line's first character.
    """
    lines = _Lines()
    stack: list[yaml.CollectionNode] = []
    pending: list[yaml.Node | None] = []  # per open mapping: the key that waits for its value
    root: yaml.Node | None = None
    for token in _TOKEN.finditer(text):
        symbol = token[0]
        if symbol in ",:":
            continue
        if symbol in "]}":
            closed = stack.pop()
            pending.pop()
            closed.end_mark = lines.mark(text, token.end())
            continue
        node = _node(symbol, lines.mark(text, token.start()), len(symbol))
        if not stack:
            root = node
        elif isinstance(stack[-1], yaml.SequenceNode):
            stack[-1].value.append(node)
        elif (key := pending[-1]) is None:
            pending[-1] = node
        else:
            stack[-1].value.append((key, node))
            pending[-1] = None
        if isinstance(node, yaml.CollectionNode):
            stack.append(node)
            pending.append(None)
    return root


class _Lines:
    """Finds columns; marks are asked for in the order of the text."""

    def __init__(self) -> None:
        self._line = 0
        self._start = 0
        self._seen = 0

    def mark(self, text: str, index: int) -> yaml.Mark:
        """The mark of a character."""
        self._line += text.count("\n", self._seen, index)
        self._start = max(self._start, text.rfind("\n", self._seen, index) + 1)
        self._seen = index
        return yaml.Mark("", index, self._line, index - self._start, None, 0)


def _node(symbol: str, start: yaml.Mark, length: int) -> yaml.Node:
    end = yaml.Mark("", start.index + length, start.line, start.column + length, None, 0)
    if symbol == "[":
        return yaml.SequenceNode(_TAG + "seq", [], start, end, flow_style=True)
    if symbol == "{":
        return yaml.MappingNode(_TAG + "map", [], start, end, flow_style=True)
    kind = _KINDS.get(symbol[0], "float")
    value = json.loads(symbol) if kind == "str" else symbol
    return yaml.ScalarNode(_TAG + kind, value, start, end, '"' if kind == "str" else None)
