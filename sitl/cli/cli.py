"""The command line: `sitl vehicle | team | px4 | ... | experiment | leaderboard | town`."""

import sys
from collections.abc import Sequence

from air_router.cli import program_of

COMMANDS = {
    "vehicle": (
        "sitl.cli.vehicle_command",
        "simulate a vehicle that behaves as PX4 does, over MAVLink",
    ),
    "team": (
        "sitl.cli.team_command",
        "simulate the ground robots, radios and the camera beside a vehicle",
    ),
    "px4": ("sitl.cli.px4_command", "start a real PX4 simulator"),
    "conform": (
        "sitl.cli.conform_command",
        "compare a vehicle with recorded MAVLink conversations of PX4",
    ),
    "rehearse": (
        "sitl.cli.rehearse_command",
        "fly a mission hundreds of times, each time with a different fault",
    ),
    "experiment": ("sitl.cli.experiment_command", "run many simulated teams and compare them"),
    "leaderboard": (
        "sitl.cli.leaderboard_command",
        "compare seek policies on a test set that does not change",
    ),
    "town": ("sitl.cli.town_command", "check, draw or make a town for experiments"),
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
