"""Where programs that follow YAML 1.1 read a file in another way than we do (YAML 1.2).

A name ``no`` is false there, ``010`` is eight, ``12:30`` is a number.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from typing import Any

import yaml

from mocha_link.team.document import Document, Problem
from mocha_link.team.error_text import Key


def other_readings(document: Document) -> Iterator[Problem]:
    """Where YAML 1.1, which the original nodes follow, means something else. Reads the file."""
    text = document.path.read_text(encoding="utf-8-sig")
    try:
        theirs = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        message = f"the original nodes cannot read this: {str(error).partition(chr(10))[0]}"
        yield Problem(document.path, line, column, message, "read-otherwise")
        return
    yield from _differences(document, (), document.data, theirs)


def _differences(
    document: Document, keys: tuple[Key, ...], ours: Any, theirs: Any
) -> Iterator[Problem]:
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for mine, other in zip_longest(ours, theirs):
            if type(mine) is not type(other) or mine != other:
                place = document.place_of_key(*keys, mine)
                message = f"the original nodes read '{other}' here; put the key in quotes"
                yield Problem(document.path, *place, message, "read-otherwise")
                return
            yield from _differences(document, (*keys, mine), ours[mine], theirs[mine])
    elif isinstance(ours, list) and isinstance(theirs, list):
        for index, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
            yield from _differences(document, (*keys, index), mine, other)
    elif type(ours) is not type(theirs) or ours != theirs:
        message = f"the original nodes read '{theirs}' here; put it in quotes"
        yield document.problem(keys, message, "read-otherwise")
