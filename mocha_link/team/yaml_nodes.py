"""YAML text as nodes, each with its place; by the parser in C where there is one."""

from __future__ import annotations

import math
import re
from functools import lru_cache

import yaml

MAX_DEPTH = 60
LARGE = 50_000
"""Length in characters above which the error is that of the quick parser: the other one
takes a second for so many."""

_MOST_KEPT = 20_000
"""Number of scalars whose type (text, number or other) is kept in the cache."""

TAG = "tag:yaml.org,2002:"
"""Before the names of YAML's own types."""


class _DeepError(Exception):
    """Some value may be nested too deep."""


class _Limit:
    """A loader's count of how deep it is while it composes nodes: PyYAML's hooks around each."""

    most: float = MAX_DEPTH
    _depth = 0

    def descend_resolver(self, current_node: object, current_index: object) -> None:
        del current_node, current_index
        self._depth += 1
        if self._depth > self.most:
            raise _DeepError

    def ascend_resolver(self) -> None:
        self._depth -= 1


class Loader(_Limit, yaml.SafeLoader):
    """Composes nodes with marks; reads plain scalars by the YAML 1.2 core schema."""

    yaml_implicit_resolvers = {}  # noqa: RUF012 - PyYAML reads and fills this very attribute


for _name, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
    ("merge", r"<<", "<"),
):
    Loader.add_implicit_resolver(TAG + _name, re.compile(f"^(?:{_pattern})$"), list(_first))

if yaml.__with_libyaml__:

    class _QuickLoader(_Limit, yaml.CSafeLoader):
        """The same in C: ten times as quick, but it overflows the stack where nesting is deep."""

        yaml_implicit_resolvers = Loader.yaml_implicit_resolvers
        # Called for every value; in a text that is edited nearly all are the same as before.
        resolve = staticmethod(lru_cache(_MOST_KEPT)(Loader("").resolve))


def compose(text: str) -> yaml.Node | None:
    """The document as nodes. Raises YAMLError: it is none; TooDeepError."""
    if not yaml.__with_libyaml__:
        return _composed(text, Loader)
    try:
        return _composed(text, _QuickLoader)
    except yaml.YAMLError:
        if len(text) > LARGE:
            raise
    return _composed(text, Loader)  # its text does not depend on the installed packages


def _composed(text: str, loader: type[Loader | _QuickLoader]) -> yaml.Node | None:
    composer = loader(text)
    try:
        return composer.get_single_node()
    except _DeepError:
        _check_depth(text, loader)
    composer = loader(text)
    composer.most = math.inf  # scalars may lie in the deepest list
    return composer.get_single_node()


class TooDeepError(Exception):
    """Nested deeper than any file in use; both parsers take very long for it, or crash."""

    def __init__(self, line: int, column: int) -> None:
        super().__init__()
        self.place = (line + 1, column + 1)  # from 1


def _check_depth(text: str, loader: type[Loader | _QuickLoader]) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=loader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                mark = event.start_mark
                raise TooDeepError(*((mark.line, mark.column) if mark else (0, 0)))
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
