"""The page of all options, docs/options.md, as the parsers have them."""

from __future__ import annotations

import argparse
from pathlib import Path

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli

PAGE = Path(__file__).parents[2] / "docs" / "options.md"
HEAD = """\
# Every command and option

Written from the programs themselves (`DOCS_WRITE=1 pytest tests/docs`). What the commands are for,
and exit codes: [commands.md](commands.md). All take `-h` (`--help`, with examples), `-v` (log more;
`-vv`: still more) and `--log-level` (`debug`, `info`, `warning`, `error`).
"""
EVERYWHERE = {"--help", "--verbose", "--log-level"}


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    for module in (air_router.cli.cli, mocha_link.cli.cli, sitl.cli.cli):
        program = module.parser()
        parts += [f"## {program.prog}\n", f"{program.description}\n", *_commands(program)]
    return "\n".join(parts)


def _commands(parser):
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield f"### {command.prog}\n"
                yield f"{' '.join((command.description or '').split())}\n"
                expand = command._get_formatter()._expand_help
                rows = [_row(a, expand) for a in command._actions if _told(a)]
                if rows:
                    yield "\n".join(rows) + "\n"
                yield from _commands(command)


def _told(action):
    return not (
        isinstance(action, argparse._SubParsersAction)
        or action.help is argparse.SUPPRESS
        or EVERYWHERE & {*action.option_strings}
    )


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
    return f"* `{name}`{needed}: {said}"
