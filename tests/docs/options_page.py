"""The options in docs/commands.md, as the programs have them, and the Python API of the site.

In the repository the page names the options of each command, which `--help` explains. `make docs`
runs this file as a hook of mkdocs: the site explains each option, and has a page of docstrings.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import click

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli
from tests.command_lines import commands_of

PAGE = Path(__file__).parents[2] / "docs" / "commands.md"
PRINTED = re.compile(r"(?<=<!-- printed: options -->\n).*?(?=\n<!-- /printed -->)", re.DOTALL)
EVERYWHERE = {"--help", "--verbose", "--log-level"}
API = (
    "mocha_link.node.node",
    "mocha_link.team.team",
    "mocha_link.store.message",
    "mocha_link.links.metrics",
    "mocha_link.node.broadcast",
    "mocha_link.links.reading",
    "mocha_link.radios.radio",
    "mocha_link.service.service_client",
    "mocha_link.ros.typed",
    "mocha_link.ros.ros",
    "mocha_link.bridges.dds",
    "mocha_link.errors",
    "air_router.control.control",
    "air_router.controller.targets.seeking",
    "air_router.controller.targets.target_list",
    "air_router.seek_policies.testing",
    "air_router.mission.loading",
    "air_router.routing.router",
    "geo.airspace.airspace",
    "geo.airspace.zone",
    "geo.paths.shortest",
    "geo.frame",
    "sitl.world.explorers.policies",
    "sitl.robot_policies.testing",
    "sitl.experiment.learning.environment",
)
"""Modules whose docstrings the site shows: the public ones."""
SHARED = """\
## Shared options

What several commands take; each command names those that it has.
"""


def names() -> str:
    """For the repository: each command with the names of its options."""
    parts = [""]
    for program in _programs():
        parts += [f"## {program.name}\n", f"{program.help}\n"]
        for command, path, rows in _commands(program):
            parts += [f"### {path}\n", f"{_purpose(command, ': ')}\n"]
            if rows:
                parts.append(", ".join(name for name, _ in rows) + "\n")
    return "\n".join(parts)


def explanations() -> str:
    """For the site: each option explained; what several commands take is explained once."""
    programs = _programs()
    count = Counter(row for program in programs for *_, rows in _commands(program) for row in rows)
    means = {name: text for (name, text), times in reversed(count.most_common()) if times > 1}
    shared = sorted(means.items())
    parts = [SHARED, "\n".join(f"* {name}: {text}" for name, text in shared) + "\n"]
    for program in programs:
        parts += [f"## {program.name}\n", f"{program.help}\n"]
        for command, path, rows in _commands(program):
            parts += [f"### {path}\n", f"{_purpose(command)}\n"]
            own = [f"* {name}: {text}" for name, text in rows if (name, text) not in shared]
            also = ", ".join(_short(name) for name, text in rows if (name, text) in shared)
            lines = [*own, *([f"* shared: {also}"] if also else [])]
            if lines:
                parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def on_page_markdown(markdown: str, /, *, page: Any, **_: object) -> str:
    """Put the explanations into the site: mkdocs calls this for every page."""
    if page.file.src_uri != PAGE.name:
        return markdown
    return PRINTED.sub(lambda _: explanations(), markdown)


def on_files(files: Any, /, *, config: Any) -> None:
    """Add the page of docstrings, which only the site has: mkdocs calls this once."""
    from mkdocs.structure.files import File  # noqa: PLC0415 - only `make docs` has mkdocs

    text = "# Python API\n\n" + "".join(f"::: {name}\n" for name in API)
    files.append(File.generated(config, "api.md", content=text))


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
            params = [each for each in ctx.command.params if _listed(each)]
            yield ctx.command, _path(ctx), [_row(each, ctx) for each in params]


def _path(ctx):
    """Its parts, without what stands between them."""
    return " ".join(filter(None, [ctx.parent and _path(ctx.parent), ctx.info_name]))


def _listed(param):
    return not (getattr(param, "hidden", False) or EVERYWHERE & {*param.opts})


def _short(name):
    """`--speed X` as `--speed`: its value is described where it is explained."""
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
