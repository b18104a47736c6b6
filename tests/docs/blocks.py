"""The snippets of README and docs: fenced blocks and indented ones, with where they stand."""

from __future__ import annotations

import re
import shlex
import textwrap
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "evidence").glob("*.md")),
]
PROGRAMS = ("air-router", "mocha-link", "sitl")
_LIST_ITEM = re.compile(r"\s*([*-]|\d+\.) ")


@dataclass(frozen=True)
class Block:
    """One snippet; `name` is unique and stays when text around it changes."""

    name: str
    page: Path
    line: int
    language: str  # of a fence; "" for an indented block
    text: str

    @property
    def commands(self) -> list[str]:
        """Its command lines, without comments; continuation lines are joined."""
        if self.language == "ini":  # of systemd
            return re.findall(r"^ExecStart=\S*/(.*)", self.text, re.MULTILINE)
        if self.language not in {"", "sh"}:
            return []
        lines = re.sub(r"\\\n\s*", "", self.text).splitlines()
        return [line for line in (re.sub(r"\s+#.*", "", line).strip() for line in lines) if line]


def _raw(text: str):
    """Of each block: line number, language ("" if indented) and text."""
    lines = text.splitlines()
    number, outer = 0, ""
    while number < len(lines):
        line = lines[number]
        if line.lstrip().startswith("```"):
            end = next(i for i in range(number + 1, len(lines)) if lines[i].strip() == "```")
            text = textwrap.dedent("\n".join(lines[number + 1 : end]) + "\n")
            yield number + 1, line.strip()[3:], text
            number = end + 1
        elif line.startswith("    ") and not lines[number - 1].strip() and not outer:
            end = number
            while end < len(lines) and (lines[end].startswith("    ") or not lines[end].strip()):
                end += 1
            yield number + 1, "", "\n".join(part[4:] for part in lines[number:end]).strip() + "\n"
            number = end
        else:
            if line.strip() and not line.startswith(" "):
                outer = "list" if _LIST_ITEM.match(line) else ""
            number += 1


def blocks() -> list[Block]:
    """All blocks of all pages: `editing.md python 1`, or `editing.md 3` for an indented one."""
    found = []
    for page in PAGES:
        count = Counter()
        for line, language, text in _raw(page.read_text(encoding="utf-8")):
            count[language] += 1
            name = " ".join(filter(None, (page.name, language, str(count[language]))))
            found.append(Block(name, page, line, language, text))
    return found


def simple_commands(line: str) -> list[list[str]]:
    """The commands of a shell line: what stands between `;`, `|`, `&&`, without redirections."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    commands, words = [[]], iter(lexer)
    for word in words:
        if set(word) <= set(";|&()"):
            commands.append([])
        elif set(word) <= set("<>"):
            next(words, None)
        else:
            commands[-1].append(word)
    return [command for command in commands if command]
