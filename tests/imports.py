"""What a module of ours imports, read from its lines: to parse every file takes seconds."""

import re
from collections.abc import Iterator

_IMPORT = re.compile(
    r"^( *)(?:from ([\w.]+) import (\([^)]*\)|[\w, ]+)|import ([\w., ]+))(?: *#.*)?$", re.MULTILINE
)
_NAME = re.compile(r"([\w.]+)(?: as \w+)?")


def imports_in(text: str, *, deep: bool) -> Iterator[tuple[str, str | None]]:
    """Each import: a module, and the name that is taken from it, None where it is all of it.

    Those within functions are `deep`. A line of prose that looks like an import counts as one.
    """
    for indent, module, names, modules in _IMPORT.findall(text):
        if deep or not indent:
            for name in _NAME.findall(names or modules):
                yield (module, name) if module else (name, None)
