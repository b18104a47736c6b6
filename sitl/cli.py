"""The command line: `sitl vehicle | team | px4 | conform | rehearse`, each in its module."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from air_router import command_line
from sitl import conform_command, px4_command, team_command, vehicle_command
from sitl.rehearsal import command as rehearse_command


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    parser = command_line.build_parser(
        "sitl",
        "The simulated world: a PX4 vehicle, ground robots, radios, a camera.",
        "exit codes: 0 done, 1 ended otherwise, 2 wrong usage, 3 invalid file, 130 interrupted",
        (vehicle_command, team_command, px4_command, conform_command, rehearse_command),
    )
    return command_line.run(parser, argv)


if __name__ == "__main__":
    sys.exit(main())
