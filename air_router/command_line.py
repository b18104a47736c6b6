"""What our commands have in common: their parser, logging, and how expected errors end them."""

from __future__ import annotations

import argparse
import logging
import re
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Protocol

from air_router.errors import EXPECTED, ExitCode, exit_code, told

_SOUTHERN = re.compile(r"-[\d.]+,")
"""How a place, or bounds, with a negative latitude begin."""


class CommandModule(Protocol):
    """A module that adds one command; its parser's default `run` takes the parsed arguments."""

    def register(self, commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
        """Add the command."""


def build_parser(
    prog: str, description: str, epilog: str, modules: Sequence[CommandModule]
) -> argparse.ArgumentParser:
    """The parser of a program's commands."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--verbose", "-v", action="count", default=0, help="log more (-vv: everything) on stderr"
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in modules:
        module.register(commands)
    return parser


def add_start(parser: argparse.ArgumentParser) -> None:
    """Add `--at`: when the mission is to start, for zones that do not apply at all times."""
    parser.add_argument(
        "--at",
        type=_moment,
        metavar="TIME",
        help="the mission starts then, e.g. 2026-11-20T08:00:00Z (default: now)",
    )


def _moment(text: str) -> datetime:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        moment = None
    if moment is None or moment.tzinfo is None:
        raise argparse.ArgumentTypeError(
            f"{text} is not a time with its time zone; write it like 2026-11-20T08:00:00Z"
        )
    return moment.astimezone(UTC)


def _with_places(argv: Sequence[str]) -> list[str]:
    """The arguments with places in the southern hemisphere joined to their options.

    `--home -33.9,151.2` is taken for two options by argparse, `--home=-33.9,151.2` is not.
    """
    joined: list[str] = []
    for word in argv:
        option = joined[-1] if joined else ""
        if option.startswith("--") and "=" not in option and _SOUTHERN.match(word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def run(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> int:
    """Run one command; returns its exit code. Results go to stdout, all else to stderr."""
    try:
        arguments = parser.parse_args(_with_places(sys.argv[1:] if argv is None else argv))
    except SystemExit as end:  # argparse has said why
        return end.code if isinstance(end.code, int) else ExitCode.USAGE
    logging.basicConfig(
        level=[logging.WARNING, logging.INFO, logging.DEBUG][min(arguments.verbose, 2)],
        format="%(levelname)s %(name)s: %(message)s",
        stream=sys.stderr,
    )
    try:
        return int(arguments.run(arguments))
    except EXPECTED as error:
        print(told(error), file=sys.stderr)  # noqa: T201 - printing is what a command does
        return exit_code(error)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)  # noqa: T201
        return ExitCode.INTERRUPTED
