"""What our commands have in common: their parser, logging, and how expected errors end them."""

from __future__ import annotations

import argparse
import json
import logging
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from air_router.errors import EXPECTED, ExitCode, exit_code, told
from mocha_link.cli.command_help import (
    Command,
    add_commands,
    add_completion,
    add_verbose,
    add_version,
    log_level,
)
from mocha_link.cli.interrupt import leave_when_interrupted, raise_when_interrupted

_SOUTHERN = re.compile(r"-[\d.]+,")
"""How a place, or bounds, with a negative latitude begin."""


class _Help(argparse.HelpFormatter):
    """Fills paragraphs, but leaves alone those with indented lines: examples, tables."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n\n".join(
            paragraph
            if re.search(r"^( |examples?:)", paragraph, re.MULTILINE)
            else super(_Help, self)._fill_text(paragraph, width, indent)
            for paragraph in text.split("\n\n")
        )


@dataclass(frozen=True, slots=True)
class Program:
    """A program of several commands."""

    name: str
    description: str
    epilog: str
    commands: tuple[Command, ...]

    def parser(self, *, whole: bool = True) -> argparse.ArgumentParser:
        """What its command line can say; if not `whole`, of each command when it is asked for."""
        parser = argparse.ArgumentParser(
            prog=self.name,
            description=self.description,
            epilog=self.epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        add_verbose(parser)
        add_version(parser)
        commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
        add_commands(commands, self.name, self.commands, _adjust, whole=whole)
        add_completion(commands, self.name, self.parser)
        return parser

    def run(self, argv: Sequence[str] | None) -> int:
        """Run one command; returns its exit code. Results go to stdout, all else to stderr."""
        leave_when_interrupted()  # a command is imported when it is asked for
        parser = self.parser(whole=False)
        try:
            arguments = parser.parse_args(_with_places(sys.argv[1:] if argv is None else argv))
        except SystemExit as end:  # argparse has said why
            raise_when_interrupted()
            return end.code if isinstance(end.code, int) else ExitCode.USAGE
        logging.basicConfig(
            level=log_level(arguments, logging.WARNING),
            format="%(levelname)s %(name)s: %(message)s",
            stream=sys.stderr,
        )
        try:
            raise_when_interrupted()
            return int(arguments.run(arguments))
        except EXPECTED as error:
            print(told(error), file=sys.stderr)
            return exit_code(error)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return ExitCode.INTERRUPTED


def print_json(facts: Any) -> None:
    """What `--json` prints: one object on a line of its own, at once."""
    json.dump(facts, sys.stdout)
    sys.stdout.write("\n")
    sys.stdout.flush()


def _adjust(command: argparse.ArgumentParser) -> None:
    add_verbose(command, default=argparse.SUPPRESS)
    if command.formatter_class is argparse.HelpFormatter:
        command.formatter_class = _Help


def _with_places(argv: Sequence[str]) -> list[str]:
    """The arguments with places in the southern hemisphere joined to their options.

    `--home -33.9,151.2` is taken for two options by argparse, `--home=-33.9,151.2` is not; and a
    place by itself for one, but for a blank before it.
    """
    joined: list[str] = []
    for word in argv:
        option = joined[-1] if joined else ""
        if option.startswith("--") and "=" not in option and _SOUTHERN.match(word):
            joined[-1] += f"={word}"
        elif _SOUTHERN.match(word):
            joined.append(f" {word}")
        else:
            joined.append(word)
    return joined
