"""The command line: `sitl vehicle | team`. Each command is a module of its own."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence

from air_router.errors import ExitCode
from sitl import team_command, vehicle_command


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands; each command puts its function in as `run`."""
    parser = argparse.ArgumentParser(
        prog="sitl",
        description="The simulated world: a PX4 vehicle, ground robots, radios, a camera.",
        epilog="exit codes: 0 done, 1 ended otherwise, 2 wrong usage, 3 invalid file",
    )
    parser.add_argument(
        "--verbose", "-v", action="count", default=0, help="log more (-vv: everything) on stderr"
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in (vehicle_command, team_command):
        module.register(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    try:
        arguments = build_parser().parse_args(argv)
    except SystemExit as end:  # argparse has said why
        return end.code if isinstance(end.code, int) else ExitCode.USAGE
    logging.basicConfig(
        level=[logging.WARNING, logging.INFO, logging.DEBUG][min(arguments.verbose, 2)],
        format="%(levelname)s %(name)s: %(message)s",
        stream=sys.stderr,
    )
    return int(arguments.run(arguments))


if __name__ == "__main__":
    sys.exit(main())
