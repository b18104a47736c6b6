"""The command line: `air-router check`, `plan`, `convert` ...; each command is a module."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from air_router import (
    check,
    command_line,
    convert,
    cover,
    edit_command,
    fly,
    plan,
    preflight_command,
    sim,
)

_EXIT_CODES = """\
exit codes:
  0 done                      4 no vehicle
  1 ended otherwise           5 refused before take-off
  2 wrong usage               6 the pilot took over
  3 invalid file            130 interrupted
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    parser = command_line.build_parser(
        "air-router",
        "Fly PX4 missions around no-fly zones, and seek robots to exchange data with.",
        _EXIT_CODES,
        (check, plan, cover, edit_command, convert, preflight_command, fly, sim),
    )
    return command_line.run(parser, argv)


if __name__ == "__main__":
    sys.exit(main())
