"""The page of all options, docs/options.md, as the parsers have them."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli

PAGE = Path(__file__).parents[2] / "docs" / "options.md"
HEAD = """\
# Every command and option

Written from the programs themselves (`DOCS_WRITE=1 pytest tests/docs`). What the commands are for,
and exit codes: [commands.md](commands.md). All take `-h` (`--help`, with examples) and, before or
after the command, `-v` (log more; `-vv`: still more) and `--log-level` (`debug`, `info`, `warning`,
`error`). Each program has `completion {bash,zsh,fish}`, which prints a script for the shell.
"""
EVERYWHERE = {"--help", "--verbose", "--log-level"}
SHARED = """\
## Shared options

What several commands take; each command names those that it has.
"""


def page() -> str:
    """The whole page; what several commands take is explained once."""
    modules = (air_router.cli.cli, mocha_link.cli.cli, sitl.cli.cli)
    programs = [module.PROGRAM.parser() for module in modules]
    count = Counter(row for program in programs for _, rows in _commands(program) for row in rows)
    means = {name: said for (name, said), times in reversed(count.most_common()) if times > 1}
    shared = sorted(means.items())
    parts = [HEAD, SHARED, "\n".join(f"* {name}: {said}" for name, said in shared) + "\n"]
    for program in programs:
        parts += [f"## {program.prog}\n", f"{program.description}\n"]
        for command, rows in _commands(program):
            purpose = " ".join((command.description or "").split()).partition(". ")[0].rstrip(".")
            parts += [f"### {command.prog}\n", f"{purpose}.\n"]
            own = [f"* {name}: {said}" for name, said in rows if (name, said) not in shared]
            also = ", ".join(_short(name) for name, said in rows if (name, said) in shared)
            lines = [*own, *([f"* shared: {also}"] if also else [])]
            if lines:
                parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


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
