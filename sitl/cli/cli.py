"""The command line: `sitl vehicle | team | px4 | ... | experiment | leaderboard | town`."""

import sys
from collections.abc import Sequence

from air_router.cli import program_of

COMMANDS = {
    "vehicle": (
        "sitl.cli.vehicle_command",
        "simulate a PX4 multirotor with MAVLink",
    ),
    "team": (
        "sitl.cli.team_command",
        "simulate ground robots, radios and the vehicle's camera",
    ),
    "px4": ("sitl.cli.px4_command", "run a real PX4 SITL"),
    "conform": (
        "sitl.cli.conform_command",
        "compare a vehicle's answers with PX4's in scripted MAVLink conversations",
    ),
    "rehearse": (
        "sitl.cli.rehearse_command",
        "fly a mission hundreds of times, each time with a different fault",
    ),
    "experiment": ("sitl.cli.experiment_command", "run many simulated teams and compare them"),
    "leaderboard": (
        "sitl.cli.leaderboard_command",
        "compare seek policies on a fixed test set",
    ),
    "town": ("sitl.cli.town_command", "check, draw or generate a town for experiments"),
}

PROGRAM = program_of(
    "sitl",
    "The simulated world: a PX4 vehicle, ground robots, radios, a camera.",
    "exit codes: 0 done, 1 ended abnormally, 2 wrong usage, 3 invalid file, 4 no reply,\n"
    "5 refused, 7 a package is missing, 130 interrupted (Ctrl-C)",
    COMMANDS,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    return PROGRAM.run(argv)


if __name__ == "__main__":
    sys.exit(main())
