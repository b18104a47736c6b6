"""The case files: every conversation, as data.

A file of `cases/` maps the name of each case to a list. First comes where the vehicle is when it
starts, with PX4's fact, in brackets where that was recorded, and settings of a `Conversation` if it
needs some; then its steps (see `interpreter`). A list within the list stands for its steps:
`definitions` holds what several cases share.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from typing import Any, Final

import yaml

from sitl.conformance.conversation import Conversation, Start
from sitl.conformance.interpreter import Step
from sitl.conformance.line import Link

_FILES: Final = (
    *("commands", "modes", "missions", "flown_missions"),
    *("fences", "offboard", "links", "failsafes"),
)


@cache
def conversations() -> tuple[Conversation, ...]:
    """All of them, in the order of their files."""
    folder = files("sitl.conformance") / "cases"
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # five times as fast, where it is built
    return tuple(
        _conversation(name, *case)
        for file in _FILES
        for name, case in yaml.load((folder / f"{file}.yaml").read_text("utf-8"), loader).items()  # noqa: S506 - safe
        if name != "definitions"
    )


def _conversation(name: str, start: dict[str, Any], *steps: Any) -> Conversation:
    (where, said), *settings = start.items()
    fact, _, recorded = said.removesuffix(")").rpartition(" (")
    terms: dict[str, Any] = dict(settings)
    terms["links"] = frozenset(map(Link, terms.get("links", [Link.API])))
    return Conversation(name, fact, recorded, tuple(_flat(steps)), Start(where), **terms)


def _flat(entries: Any) -> Iterator[Step]:
    for entry in entries:
        if isinstance(entry, list):
            yield from _flat(entry)
        else:
            yield {entry: None} if isinstance(entry, str) else entry
