"""Paths that lead to no file: the likely mistake, and its correction."""

from __future__ import annotations

import difflib
import re
from itertools import islice
from pathlib import Path
from typing import Final

from mocha_link.team.value_mistakes import plain

_MAX_COMPARED: Final = 1_000
"""Names of a folder that are compared with the one that is not there."""

_SIMILARITY: Final = (
    0.7  # of difflib: 'team.yml' and 'team.yaml', but not 'team.yaml' and 'world.yaml'
)


def path_advice(path: Path, otherwise: str = "correct the path") -> str:
    """What to do about a path that leads to no file."""
    text = str(path)
    if plain(path.name) != path.name:
        return f"it has quotes or blanks of a word processor; write '{plain(path.name)}'"
    if re.search(r"(^|/)[A-Za-z]:\\", text):
        return "drive letters are those of Windows; write the path from this file's folder"
    if "\\" in text:
        return f"write '/' between folders, not '\\': {path.name.replace(chr(92), '/')}"
    if re.search(r"[\t\n\r\a\b\f\v]", text):
        return "in double quotes a backslash begins a special character; write '/' between folders"
    if re.search(r"(^|/)(https?|ftp|file):/", text):
        return "pages of the Web are not read; download it, and write its path"
    return _in_folder(path, text) or otherwise


def _in_folder(path: Path, text: str) -> str:
    if re.search(r"(^|/)~", text):
        return "'~' is not read; write the whole path"
    if re.search(r"[*?]", text):
        return "patterns are not read; name each file"
    try:
        if path.is_dir():
            inside = path / "mission.yaml"
            return f"name the file in it{f': {inside}' * inside.is_file()}"
        names = [each.name for each in islice(path.parent.iterdir(), _MAX_COMPARED)]
    except OSError:
        return ""
    same = [name for name in names if name.lower() == path.name.lower()]
    near = same or difflib.get_close_matches(path.name, sorted(names), n=1, cutoff=_SIMILARITY)
    return f"did you mean '{near[0]}'?" if near else ""
