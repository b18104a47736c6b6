"""What a module of ours imports, read from its lines: to parse every file takes seconds."""

import re
from collections.abc import Iterator
from pathlib import Path

_IMPORT = re.compile(
    r"^( *)(?:from ([\w.]+) import (\([^)]*\)|[\w, ]+)|import ([\w., ]+))(?: *#.*)?$", re.MULTILINE
)
_REMARK = re.compile(r"#.*")
_NAME = re.compile(r"([\w.]+)(?: as \w+)?")


def imports_in(text: str, *, deep: bool) -> Iterator[tuple[str, str | None]]:
    """Each import: a module, and the name that is taken from it, None where it is all of it.

    Those within functions are `deep`. A line of prose that looks like an import counts as one.
    """
    for indent, module, names, modules in _IMPORT.findall(text):
        if deep or not indent:
            for name in _NAME.findall(_REMARK.sub("", names or modules)):
                yield (module, name) if module else (name, None)


_LATE = re.compile(r"^from (\S+) import (\w+) as", re.MULTILINE)


def late_homes(door: Path) -> dict[str, str]:
    """Of a door that loads late (its `__init__.py`), the module of each name; else nothing."""
    stub = door.with_suffix(".pyi")
    if not stub.exists():
        return {}
    return {name: module for module, name in _LATE.findall(stub.read_text("utf-8"))}
