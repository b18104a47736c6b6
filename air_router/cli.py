"""The command line: `air-router check | plan | fly | sim`. Each command is a module of its own."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence

from air_router import check, fly, plan, sim
from air_router.errors import EXPECTED, ExitCode, exit_code, told

_EXIT_CODES = """\
exit codes:
  0 done                      4 no vehicle
  1 ended otherwise           5 refused before take-off
  2 wrong usage               6 the pilot took over
  3 invalid file            130 interrupted
"""


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands; each command puts its function in as `run`."""
    parser = argparse.ArgumentParser(
        prog="air-router",
        description="Fly PX4 missions around no-fly zones, and seek robots to exchange data with.",
        epilog=_EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--verbose", "-v", action="count", default=0, help="log more (-vv: everything) on stderr"
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in (check, plan, fly, sim):
        module.register(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code. Results go to stdout, all else to stderr."""
    try:
        arguments = build_parser().parse_args(argv)
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
        print(told(error), file=sys.stderr)
        return exit_code(error)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return ExitCode.INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
