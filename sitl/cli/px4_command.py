"""`sitl px4`: a real PX4 SITL in one command."""

import argparse
import time
from pathlib import Path

from air_router.errors import ExitCode
from sitl.cli.arguments import instance
from sitl.cli.vehicle_command import (
    add_place,
    add_speed_and_parameters,
    parameters_of,
    place_of,
    ready_line,
)
from sitl.process import (
    AIRFRAMES,
    ENVIRONMENT,
    IMAGE,
    Px4Process,
    Px4Settings,
    find_px4,
    stop_signal,
)

_EPILOG = f"""\
Looks for a PX4 with its built-in simulator (SIH): --px4, the environment variable {ENVIRONMENT},
`px4` on the PATH, then Docker or Podman with {IMAGE}. Prints one JSON line
on stdout when it can arm: {{"ready": true, "mavlink": ..., "gcs": ..., "truth": ..., "px4": ...}}.
Runs until SIGINT or SIGTERM; PX4 is stopped with it, whatever happens.

examples:
  sitl px4 missions/pennovation/mission.yaml --speed 5
  sitl px4 --home 40.4406,-79.9959,280 --px4 ~/PX4-Autopilot --param GF_ACTION=3
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.description = "Find a PX4 SITL on this machine and run it at a mission's home."
    parser.epilog = _EPILOG
    add_place(parser)
    parser.add_argument(
        "--px4",
        metavar="PATH",
        help="a build folder, source tree or px4 executable; or docker, podman, docker:v1.17.0",
    )
    parser.add_argument(
        "--instance", type=instance, metavar="N", help="PX4's (default: the first that is free)"
    )
    parser.add_argument(
        "--airframe",
        choices=AIRFRAMES,
        default=AIRFRAMES[0],
        help="what is simulated (default %(default)s; hex from PX4 1.17 on)",
    )
    add_speed_and_parameters(parser, "times real time (default 1)")
    parser.add_argument(
        "--log-dir", type=Path, metavar="DIR", help="keep PX4's files and what it says there"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run PX4 until a signal comes; returns the exit code."""
    install = find_px4(arguments.px4)
    settings = Px4Settings(
        place_of(arguments),
        speed=arguments.speed,
        parameters=parameters_of(arguments),
        instance=arguments.instance,
        folder=arguments.log_dir,
        airframe=arguments.airframe,
    )
    with stop_signal() as stopped, Px4Process(install, settings) as process:
        if process.wait_until_armable(stopped):
            number = process.instance
            links = {
                "mavlink": f"udpin://0.0.0.0:{14540 + number if number <= 9 else 14549}",
                "gcs": "udpin://127.0.0.1:14550",
                "truth": f"udp://127.0.0.1:{19410 + number}",
                "px4": install.words,
                "process_id": process.process_id,
            }
            ready_line(links, number + 1, settings.speed, settings.place)
        while process.running and not stopped():
            time.sleep(0.2)
        ended = not stopped()
    return ExitCode.NO_VEHICLE if ended else ExitCode.DONE
