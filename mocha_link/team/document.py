"""A YAML document whose every value knows its place, so that every error can name it.

Scalars follow the YAML 1.2 core schema: only ``true`` and ``false`` are booleans (a robot may be
called ``no``), ``1e3`` is a number, ``12:30`` and ``2026-01-01`` are text.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

import pydantic
import yaml
from pydantic_core import ErrorDetails

from mocha_link.team.error_text import UNKNOWN, Key, as_label, code_of, text_of_error
from mocha_link.team.problem import (
    DocumentError,
    Problem,
    ProblemList,
    bytes_of,
    line_column,
    text_in,
)
from mocha_link.team.yaml_mistakes import explained
from mocha_link.team.yaml_nodes import MAX_DEPTH, TAG, Loader, TooDeepError, compose

__all__ = ["Document", "DocumentError", "Problem", "as_yaml", "yaml_lines"]

MAX_BYTES = 4 * 1024 * 1024
MAX_VALUES = 200_000  # aliases may repeat a value; this bounds what they expand to

M = TypeVar("M", bound=pydantic.BaseModel)

_MAPPING, _SEQUENCE = TAG + "map", TAG + "seq"


class Document:
    """A loaded YAML file: plain values in ``data``, and the place of each of them.

    Made by `Document.load` (a file) or `Document.from_text`.
    """

    def __init__(self, path: Path, root: yaml.Node | None, data: Any) -> None:
        self.path = path
        self.data = data
        self._root = root

    @classmethod
    def load(cls, path: Path | str) -> Document:
        """Read and check a file.

        Raises:
            DocumentError: the file cannot be read, is larger than 4 MiB, is not UTF-8, is not
                YAML, repeats a key or uses a YAML feature that we do not read.
        """
        path = Path(path)
        raw = bytes_of(path, MAX_BYTES, "split the file or thin it out")
        return cls.from_text(text_in(raw, path), path)

    @classmethod
    def from_text(cls, text: str, path: Path) -> Document:
        """Read YAML from `text`; `path` only names it in messages. Raises DocumentError."""
        try:
            root = compose(text)
            plain = _Plain(path)
            data = None if root is None else plain.value(root)
        except yaml.MarkedYAMLError as error:
            message, place = explained(error, text)
            raise DocumentError.at(path, message, "not-yaml", *place) from None
        except yaml.reader.ReaderError as error:
            message = "control character in the text; remove it"
            place = line_column(text[: error.position].encode())
            raise DocumentError.at(path, message, "not-yaml", *place) from None
        except TooDeepError as error:
            message = f"nested more than {MAX_DEPTH} deep; flatten it"
            raise DocumentError.at(path, message, "too-deep", *error.place) from None
        if plain.problems:
            raise DocumentError(plain.problems)
        return cls(path, root, data)

    def place(self, *keys: Key) -> tuple[int, int]:
        """Line and column (1-based) of the value at a key path, or of its nearest parent."""
        value, _ = self._find(keys)
        return _mark(value)

    def place_of_key(self, *keys: Key) -> tuple[int, int]:
        """Line and column (1-based) of the last key itself, or of its nearest parent."""
        value, key = self._find(keys)
        return _mark(key or value)

    def node(self, *keys: Key) -> yaml.Node | None:
        """The YAML node of the value at a key path, or of its nearest parent."""
        return self._find(keys)[0]

    def problem(self, keys: Sequence[Key], message: str, code: str) -> Problem:
        """A problem with the value at a key path, for checks that a model cannot do."""
        return Problem(self.path, *self.place(*keys), message, code, tuple(keys))

    def parse(self, model: type[M], *, extra: Literal["forbid", "ignore"] = "forbid") -> M:
        """The document as a pydantic model, strictly: no text for a number, no `extra` key.

        Raises:
            DocumentError: with all problems at once. A missing key points to the mapping that
                lacks it, an unknown one to the key itself.
        """
        # Strictness as in JSON: arrays may fill tuples and text may fill enums, nothing else bends.
        text = json.dumps(self.data)
        try:
            return model.model_validate_json(text, strict=True, extra=extra)
        except pydantic.ValidationError as error:
            problems = ProblemList()
            for detail in error.errors(include_url=False):
                problems.add(self.path, code_of(detail), partial(self._problem, detail, model))
            raise DocumentError(problems) from None

    def _problem(self, detail: ErrorDetails, model: type[pydantic.BaseModel]) -> Problem:
        unknown = detail["type"] in UNKNOWN
        missing = detail["type"] == "missing"
        keys = detail["loc"][:-1] if missing else detail["loc"]
        at_key = unknown or keys[-1:] == ("[key]",)
        place = self.place_of_key(*keys) if at_key else self.place(*keys)
        text = text_of_error(detail, model, self._scalars(keys))
        return Problem(self.path, *place, text, code_of(detail), tuple(keys))

    def _scalars(self, keys: Sequence[Key]) -> list[str]:
        """The entries of a list of single values, as they are written; none of anything else."""
        node = self.node(*keys)
        entries = node.value if isinstance(node, yaml.SequenceNode) else []
        scalars = [entry.value for entry in entries if isinstance(entry, yaml.ScalarNode)]
        return scalars if len(scalars) == len(entries) else []

    def _find(self, keys: Sequence[Key]) -> tuple[yaml.Node | None, yaml.Node | None]:
        """The value node and its key node; steps that the document does not have are skipped."""
        value, key = self._root, None
        for step in keys:
            if isinstance(value, yaml.MappingNode):
                for key_node, value_node in value.value:
                    if as_label(_scalar(key_node)) == as_label(step):
                        value, key = value_node, key_node
                        break
            elif isinstance(value, yaml.SequenceNode) and step in range(len(value.value)):
                value, key = value.value[int(step)], None
        return value, key


class _Plain:
    """Converts nodes to plain values and collects their problems."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problems: list[Problem] = []  # in file order
        self._count = 0  # of values so far
        self._open: set[int] = set()  # ids of nodes from the root down

    def value(self, node: yaml.Node) -> Any:
        self._count += 1
        if isinstance(node, yaml.ScalarNode) and self._count <= MAX_VALUES:
            return self._scalar(node)
        if id(node) in self._open:
            message = "an alias inside its own anchor; remove it"
            raise DocumentError([self._problem(node, message, "yaml-feature")])
        if self._count > MAX_VALUES:
            message = f"more than {MAX_VALUES} values; split the file or thin it out"
            raise DocumentError([self._problem(node, message, "too-large")])
        self._open.add(id(node))
        try:
            if isinstance(node, yaml.CollectionNode) and node.tag not in (_MAPPING, _SEQUENCE):
                self._add(node, _strange(node), "yaml-feature")
                return None
            if isinstance(node, yaml.MappingNode):
                return self._mapping(node)
            if isinstance(node, yaml.SequenceNode):
                return [self.value(item) for item in node.value]
            return self._scalar(node)
        finally:
            self._open.discard(id(node))

    def _mapping(self, node: yaml.MappingNode) -> dict[Any, Any]:
        result: dict[Any, Any] = {}
        first_line: dict[str, int] = {}
        for key_node, value_node in node.value:
            if key_node.tag == TAG + "merge":
                message = "merge keys (<<) are not read; write the keys out"
                self._add(key_node, message, "yaml-feature")
                continue
            if not isinstance(key_node, yaml.ScalarNode):
                message = "a key must be a word, not a list or a mapping; rename it"
                self._add(key_node, message, "wrong-type")
                continue
            key = self._scalar(key_node)
            label = as_label(key)
            if label in first_line:
                message = f"key '{label}' is already on line {first_line[label]}; remove one"
                self._add(key_node, message, "repeated-key")
                continue
            first_line[label] = key_node.start_mark.line + 1
            result[key] = self.value(value_node)
        return result

    def _scalar(self, node: yaml.Node) -> Any:
        try:
            return _scalar(node)
        except ValueError as error:
            self._add(node, str(error), "wrong-value")
            return None

    def _add(self, node: yaml.Node, message: str, code: str) -> None:
        self.problems.append(self._problem(node, message, code))

    def _problem(self, node: yaml.Node, message: str, code: str) -> Problem:
        return Problem(self.path, *_mark(node), message, code)


def _whole(text: str) -> int:
    number = int(text, 0) if text.startswith(("0o", "0x")) else int(text)
    float(number)  # one that no setting can be: OverflowError
    return number


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError
    return number


_READERS: dict[str, Callable[[str], Any]] = {
    "str": str,
    "null": lambda _: None,
    "bool": lambda text: {"true": True, "false": False}[text.lower()],
    "int": _whole,
    "float": _finite,
}


def _scalar(node: yaml.Node) -> Any:
    """The plain value of a scalar node. Raises ValueError with a text for the user."""
    kind = node.tag.removeprefix(TAG)
    if kind not in _READERS:
        raise ValueError(_strange(node))
    if any("\ud800" <= letter <= "\udfff" for letter in node.value):
        raise ValueError("half a character (a lone surrogate) in text; remove it")
    try:
        return _READERS[kind](node.value)
    except (KeyError, ValueError, OverflowError):
        text = f"{node.value[:40]!r} is not a finite {kind} value; correct it"
        raise ValueError(text) from None


def _strange(node: yaml.Node) -> str:
    return f"YAML tag {node.tag} is not read; remove it"


def _mark(node: yaml.Node | None) -> tuple[int, int]:
    return (node.start_mark.line + 1, node.start_mark.column + 1) if node else (1, 1)


class _Dumper(yaml.SafeDumper):
    """Quotes only texts that `Loader` would not read as text; writes no aliases."""

    yaml_implicit_resolvers = Loader.yaml_implicit_resolvers

    def ignore_aliases(self, data: object) -> bool:
        del data
        return True


class _LineDumper(_Dumper):
    """Begins no line within a text; a float of a type of its own is written as its `str`."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        del indentless  # a list is indented more than its key
        super().increase_indent(flow=flow, indentless=False)

    def text(self, text: str) -> yaml.ScalarNode:
        """A text with line breaks or invisible letters is written in double quotes."""
        return self.represent_scalar(TAG + "str", text, style=None if text.isprintable() else '"')

    def number(self, number: float) -> yaml.ScalarNode:
        """A number with the digits of its shortest form."""
        digits = str(number)
        return self.represent_scalar(TAG + ("float" if "." in digits else "int"), digits)


_LineDumper.add_representer(str, _LineDumper.text)
_LineDumper.add_multi_representer(float, _LineDumper.number)


def as_yaml(data: Any, *, short_in_line: bool = False) -> str:
    """Plain values as YAML text that `Document.from_text` reads back as they are.

    With `short_in_line`, lists and mappings that hold no others are written on one line.
    """
    return yaml.dump(
        data,
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=None if short_in_line else False,
        width=100,
    )


def yaml_lines(data: Any, *, quotes: str | None = None, in_line: bool = False) -> list[str]:
    """Plain values as lines to be put into a YAML text, long ones not wrapped.

    Args:
        data: What is written. Lists and mappings that hold no others get one line.
        quotes: The kind that all texts get; None: none where none are needed.
        in_line: All of it gets one line, which may stand in brackets.
    """
    text: str = yaml.dump(
        [data] if in_line else data,
        Dumper=_LineDumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=True if in_line else None,
        default_style=quotes,
        width=math.inf,
    )
    return [text[1:-2]] if in_line else text.splitlines()
