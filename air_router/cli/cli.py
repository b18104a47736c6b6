"""The command line: `air-router check`, `plan`, `convert` ...; each command is a module."""

import sys
from collections.abc import Mapping, Sequence

from air_router.errors import EXPECTED, exit_code
from mocha_link.cli import Program
from mocha_link.errors import error_text

_EXIT_CODES = """\
exit codes:
  0 done                      4 no vehicle
  1 ended abnormally          5 refused before take-off
  2 wrong usage               6 the pilot took over
  3 invalid file              7 a package is missing
                            130 interrupted
"""

COMMANDS = {
    "new": ("air_router.start.new", "create a first mission, with team, world and rover"),
    "check": ("air_router.cli.check", "check a mission file, and summarize the flight"),
    "plan": ("air_router.cli.plan", "plan a route between two waypoints or places"),
    "cover": (
        "air_router.cli.cover",
        "plan lawnmower waypoints over an area, clear of no-fly zones",
    ),
    "edit": ("air_router.cli.edit", "edit a mission on a map"),
    "tiles": ("air_router.web.fetch_command", "download map tiles for use offline"),
    "convert": (
        "air_router.cli.convert",
        "convert a mission, zones or a record to another format",
    ),
    "preflight": ("air_router.cli.preflight", "check whether a vehicle is ready to fly a mission"),
    "signing-key": (
        "air_router.cli.signing_key_command",
        "make a key for signed MAVLink, and transfer it to PX4",
    ),
    "fly": ("air_router.cli.fly", "fly a mission with a real vehicle"),
    "sim": ("air_router.sim.sim", "fly a mission in simulation"),
    "watch": ("air_router.cli.watch", "show several flights on one map page"),
    "ask": (
        "air_router.cli.ask",
        "send a request to a flight: hold, resume, seek, explore, home, goto ...",
    ),
    "ros2": ("air_router.ros2.command", "publish a flight on ROS 2, and accept its requests"),
    "replay": ("air_router.cli.replay", "replay a recorded flight and compare the decisions"),
    "report": ("air_router.cli.report", "write the report of a recorded flight as one HTML page"),
}


def program_of(
    name: str, description: str, epilog: str, commands: Mapping[str, tuple[str, str]]
) -> Program:
    """A program whose commands end with our exit codes."""
    return Program(name, description, epilog, commands, expected=EXPECTED, ended=_ended)


def _ended(error: Exception) -> tuple[int, str]:
    return exit_code(error), error_text(error)


PROGRAM = program_of(
    "air-router",
    "Fly PX4 missions around no-fly zones, and visit robots to exchange data.",
    _EXIT_CODES,
    COMMANDS,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    return PROGRAM.run(argv)


if __name__ == "__main__":
    sys.exit(main())
