"""The page of all options, docs/options.md, as the programs have them.

In the repository it names the options of each command, which `--help` explains. `make docs` runs
this file as a hook of mkdocs, and puts the page with all explanations into the site.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import click

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli
from tests.command_lines import commands_of

PAGE = Path(__file__).parents[2] / "docs" / "options.md"
HEAD = """\
# Every command and option

[commands.md](commands.md) describes purposes and exit codes. Every command takes `-h` (`--help`,
with examples) and, before or after its name, `-v` (log more; `-vv`: even more) and `--log-level`
(`debug`, `info`, `warning`, `error`). `completion {bash,zsh,fish}` of each program prints a script
for the shell.
"""
HELP = """\
`COMMAND --help` and the site built by `make docs` explain each option.
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
        parts += [f"## {program.name}\n", f"{program.help}\n"]
        for command, path, rows in _commands(program):
            parts += [f"### {path}\n", f"{_purpose(command, ': ')}\n"]
            if rows:
                parts.append(", ".join(name for name, _ in rows) + "\n")
    return "\n".join(parts)


def whole_page() -> str:
    """The page with explanations; what several commands take is explained once."""
    programs = _programs()
    count = Counter(row for program in programs for *_, rows in _commands(program) for row in rows)
    means = {name: said for (name, said), times in reversed(count.most_common()) if times > 1}
    shared = sorted(means.items())
    parts = [HEAD, SHARED, "\n".join(f"* {name}: {said}" for name, said in shared) + "\n"]
    for program in programs:
        parts += [f"## {program.name}\n", f"{program.help}\n"]
        for command, path, rows in _commands(program):
            parts += [f"### {path}\n", f"{_purpose(command)}\n"]
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
    return [module.PROGRAM for module in modules]


def _purpose(command, until=". "):
    """What a command is for: its first sentence, or the part before a colon."""
    sentence = " ".join((command.help or "").split()).partition(". ")[0]
    return sentence.partition(until)[0].rstrip(".") + "."


def _commands(program):
    """Each command, its path, and its options: pairs of name and explanation."""
    for ctx in commands_of(program):
        if ctx.info_name != "completion":
            params = [each for each in ctx.command.params if _told(each)]
            yield ctx.command, _path(ctx), [_row(each, ctx) for each in params]


def _path(ctx):
    """Its words, without what stands between them."""
    return " ".join(filter(None, [ctx.parent and _path(ctx.parent), ctx.info_name]))


def _told(param):
    return not (getattr(param, "hidden", False) or EVERYWHERE & {*param.opts})


def _short(name):
    """`--speed X` as `--speed`: what it takes is said where it is explained."""
    return f"`{name.split('`')[1].split()[0]}`"


def _row(param, ctx):
    value = param.make_metavar(ctx)
    if isinstance(param, click.Argument):
        name, needed = value, ""
    else:
        flag = param.is_flag and not param.count
        name = ", ".join(param.opts) if flag else f"{', '.join(param.opts)} {value}"
        needed = " (needed)" if param.required else ""
    return f"`{name}`{needed}", " ".join((param.help or "").split())
