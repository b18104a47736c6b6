"""`sitl px4`: a real PX4 SITL in one command."""

import time

import click

from air_router.errors import ExitCode
from mocha_link.cli import PATH, Options, Parsed, command, option
from sitl.cli.arguments import instance
from sitl.cli.vehicle_command import (
    parameters_of,
    place_of,
    place_options,
    ready_line,
    speed_and_parameters,
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
Uses the first PX4 with the built-in simulator (SIH) of: --px4, the environment variable
{ENVIRONMENT}, `px4` on the PATH, Docker or Podman with {IMAGE}. Prints one JSON line
on stdout when PX4 can arm: {{"ready": true, "mavlink": ..., "gcs": ..., "truth": ..., "px4": ...}}.
Runs until SIGINT or SIGTERM; PX4 always stops with it.

examples:
  sitl px4 missions/pennovation/mission.yaml --speed 5
  sitl px4 --home 40.4406,-79.9959,280 --px4 ~/PX4-Autopilot --param GF_ACTION=3
"""


@command("Run a PX4 SITL of this machine at a mission's home.", _EPILOG)
@place_options
@option(
    "--px4",
    metavar="PATH",
    help="build folder, source tree or executable of PX4; or docker, podman, docker:v1.17.0",
)
@option(
    "--instance",
    type=Parsed(instance),
    metavar="N",
    help="PX4 instance number, 0 to 250 (default: the first free one)",
)
@option(
    "--airframe",
    type=click.Choice(AIRFRAMES),
    default=AIRFRAMES[0],
    help=f"airframe to simulate (default {AIRFRAMES[0]}; hex needs PX4 1.17 or newer)",
)
@speed_and_parameters("speed, times real time, 0.1 to 100 (default 1)")
@option("--log-dir", type=PATH, metavar="DIR", help="keep PX4's files and output in this folder")
def run(arguments: Options) -> int:
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
                "px4": install.description,
                "process_id": process.process_id,
            }
            ready_line(links, number + 1, settings.speed, settings.place)
        while process.running and not stopped():
            time.sleep(0.2)
        ended = not stopped()
    return ExitCode.NO_VEHICLE if ended else ExitCode.DONE
