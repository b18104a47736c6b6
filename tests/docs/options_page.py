"""The page of all options, docs/options.md, as the parsers have them.

In the repository it names the options of each command, which `--help` explains. `make docs` runs
this file as a hook of mkdocs, and puts the page with all explanations into the site.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli

PAGE = Path(__file__).parents[2] / "docs" / "options.md"
HEAD = """\
# Every command and option

Purposes and exit codes: [commands.md](commands.md). All commands take `-h` (`--help`, with
examples) and, before or after the command, `-v` (log more; `-vv`: still more) and `--log-level`
(`debug`, `info`, `warning`, `error`). Each program has `completion {bash,zsh,fish}`, which prints a
script for the shell.
"""
HELP = """\
`COMMAND --help` explains the options; so does this page in the site that `make docs` builds.
"""
EVERYWHERE = {"--help", "--verbose", "--log-level"}
SHARED = """\
## Shared options

What several commands take; each command names those that it has.
"""


def page() -> str:
    """The page in the repository: each command with the names of its options."""
    parts = [HEAD, HELP]
    for program in _programs():
        parts += [f"## {program.prog}\n", f"{program.description}\n"]
        for command, rows in _commands(program):
            parts += [f"### {command.prog}\n", f"{_purpose(command, ': ')}\n"]
            if rows:
                parts.append(", ".join(name for name, _ in rows) + "\n")
    return "\n".join(parts)


def whole_page() -> str:
    """The page with explanations; what several commands take is explained once."""
    programs = _programs()
    count = Counter(row for program in programs for _, rows in _commands(program) for row in rows)
    means = {name: said for (name, said), times in reversed(count.most_common()) if times > 1}
    shared = sorted(means.items())
    parts = [HEAD, SHARED, "\n".join(f"* {name}: {said}" for name, said in shared) + "\n"]
    for program in programs:
        parts += [f"## {program.prog}\n", f"{program.description}\n"]
        for command, rows in _commands(program):
            parts += [f"### {command.prog}\n", f"{_purpose(command)}\n"]
            own = [f"* {name}: {said}" for name, said in rows if (name, said) not in shared]
            also = ", ".join(_short(name) for name, said in rows if (name, said) in shared)
            lines = [*own, *([f"* shared: {also}"] if also else [])]
            if lines:
                parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def on_page_markdown(markdown: str, /, *, page: Any, **_: object) -> str:
    """Put the explanations into the site: mkdocs calls this for every page."""
    return whole_page() if page.file.src_uri == PAGE.name else markdown


def _programs():
    modules = (air_router.cli.cli, mocha_link.cli.cli, sitl.cli.cli)
    return [module.PROGRAM.parser() for module in modules]


def _purpose(command, until=". "):
    """What a command is for: its first sentence, or the part before a colon."""
    sentence = " ".join((command.description or "").split()).partition(". ")[0]
    return sentence.partition(until)[0].rstrip(".") + "."


def _commands(parser):
    """Each command and its options: pairs of name and explanation."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                if name == "completion":
                    continue
                expand = command._get_formatter()._expand_help
                yield command, [_row(a, expand) for a in command._actions if _told(a)]
                yield from _commands(command)


def _told(action):
    return not (
        isinstance(action, argparse._SubParsersAction)
        or action.help is argparse.SUPPRESS
        or EVERYWHERE & {*action.option_strings}
    )


def _short(name):
    """`--speed X` as `--speed`: what it takes is said where it is explained."""
    return f"`{name.split('`')[1].split()[0]}`"


def _row(action, expand):
    if action.choices is not None:
        value = "{" + ",".join(map(str, action.choices)) + "}"
    else:
        value = action.metavar or action.dest.upper()
    value = " ".join(value) if isinstance(value, tuple) else value
    if action.nargs == 0:
        name = ", ".join(action.option_strings)
    elif action.option_strings:
        name = f"{', '.join(action.option_strings)} {value}"
        name += " ..." if action.nargs in {"+", "*"} else ""
        name = name.replace(f" {value}", f" [{value}]") if action.nargs == "?" else name
    else:
        name = {"?": f"[{value}]", "*": f"[{value} ...]", "+": f"{value} ..."}.get(
            action.nargs, value
        )
    needed = " (needed)" if action.option_strings and action.required else ""
    said = " ".join(expand(action).split()) if action.help else ""
    return f"`{name}`{needed}", said
