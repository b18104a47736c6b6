"""`sitl team`: the ground robots, radios and camera of a simulation, as a process of its own."""

import json
from collections.abc import Sequence
from typing import Final

import click

from air_router.cli import print_json, rover_option
from air_router.errors import ExitCode, UsageError
from air_router.files import write_whole
from air_router.mission import Mission, load_mission
from air_router.vehicle import PaceClient
from mocha_link.cli import PATH, Options, Parsed, command, option
from mocha_link.team import DocumentError, Team
from sitl.cli.arguments import epoch, pace_source
from sitl.process import stop_signal
from sitl.team import TeamError, TeamRoles, check_rovers, default_team, roles_of
from sitl.world import WorldPlan, load_world

_DEFAULT_TRUTH: Final = "udp://127.0.0.1:19410"
_DEFAULT_CAMERA: Final = "tcp://127.0.0.1:24600"
_EPILOG = """\
Prints one JSON line on stdout when ready: {"ready": true, "team": ..., "camera": ...,
"truth": ..., "vehicle": ..., "robots": [...], "vehicles": {...}}. Runs until SIGINT or SIGTERM,
then writes the report. See docs/simulation.md.

example: sitl team missions/pennovation/mission.yaml --free-ports /tmp/world --report world.json
"""


@command(
    "Simulate the ground robots of a team, all radios and the vehicle's camera, driven by the true "
    "position and clock of a simulated vehicle.",
    _EPILOG,
)
@click.argument("mission", type=PATH, help="mission file (.yaml or .plan)")
@option("--team", type=PATH, metavar="FILE", help="team file (default: the mission's)")
@option("--world", type=PATH, metavar="FILE", help="world file (default: the mission's)")
@option(
    "--truth",
    multiple=True,
    metavar="[NAME=]URL",
    help=f"address that receives the vehicle's HIL_STATE_QUATERNION (default {_DEFAULT_TRUTH}, as "
    "PX4's SIH sends it); one for each UAV of the mission (default: the next ports)",
)
@option(
    "--camera",
    multiple=True,
    metavar="[NAME=]URL",
    help="endpoint at which the camera publishes its map patches (ZeroMQ PUB, default "
    f"{_DEFAULT_CAMERA}); one for each UAV of the mission (default: the next ports)",
)
@option(
    "--free-ports",
    type=PATH,
    metavar="DIR",
    help="write a team file with free loopback addresses and ports into DIR, and use it, so that "
    "several simulations can run at once; a mission without a team gets a built-in one",
)
@rover_option
@option(
    "--check",
    is_flag=True,
    help="only check mission, team, world file and --rover; problems go to stderr, and to stdout "
    "as one JSON object",
)
@option("--report", type=PATH, metavar="FILE", help="write a report to FILE at the end")
@option("--seed", type=int, metavar="N", default=1, help="random seed (default 1)")
@option(
    "--epoch",
    type=Parsed(epoch),
    metavar="UNIX_S",
    help="Unix time at the vehicle's time zero, in seconds; must equal the vehicle's --epoch "
    "(default: the arrival of its first packet is now)",
)
@option(
    "--pace-from",
    type=Parsed(pace_source),
    metavar="HOST:PORT",
    help="report progress to this vehicle's clock (`sitl vehicle --pace`), which then waits",
)
def run(arguments: Options) -> int:
    """Simulate until a signal comes; returns the exit code."""
    mission = load_mission(arguments.mission)
    team = _team(arguments, mission)
    roles = roles_of(mission, team)
    check_rovers([name for name, _ in arguments.rover], roles, team)
    try:
        plan = load_world(arguments.world or mission.world, mission, roles.ground, arguments.seed)
    except DocumentError as error:
        if arguments.check:
            print_json({"problems": [problem.as_json() for problem in error.problems]})
        raise
    if arguments.check:
        return ExitCode.DONE
    return _simulate(arguments, mission, team, roles, plan)


def _simulate(
    arguments: Options, mission: Mission, team: Team, roles: TeamRoles, plan: WorldPlan
) -> int:
    from sitl.team import Places, TeamSimulation, derive_team  # noqa: PLC0415 - no check needs it

    if arguments.free_ports is not None:
        team = derive_team(team, arguments.free_ports)
    rovers, epoch_s = dict(arguments.rover), arguments.epoch
    with stop_signal() as stopped:
        truths = _of_each("--truth", arguments.truth, roles.vehicles, _DEFAULT_TRUTH)
        cameras = _of_each("--camera", arguments.camera, roles.vehicles, _DEFAULT_CAMERA)
        places = {name: Places(truths[name], cameras[name]) for name in roles.vehicles}
        with (
            PaceClient(arguments.pace_from, "team") as pace,
            TeamSimulation(
                mission, team, plan, places, rovers=rovers, epoch_s=epoch_s
            ) as simulation,
        ):
            print_json(simulation.ready())
            simulation.run(stopped, pace.reached)
            content = simulation.report()
        if arguments.report is not None:
            arguments.report.parent.mkdir(parents=True, exist_ok=True)
            text = json.dumps(content, indent=1, allow_nan=False)
            write_whole(arguments.report, f"{text}\n", replace=True)
    return ExitCode.DONE


def _of_each(
    option: str, given: Sequence[str], vehicles: Sequence[str], default: str
) -> dict[str, str]:
    """The value of a repeated option for each vehicle: NAME=URL, or a bare one for the first.

    Raises:
        UsageError: it names no robot that flies.
    """
    start, _, port = default.rpartition(":")
    values = {name: f"{start}:{int(port) + number}" for number, name in enumerate(vehicles)}
    for text in given:
        name, equals, url = text.partition("=")
        if equals and name not in values:
            raise UsageError(f"{option} {text}: {' and '.join(vehicles)} fly this mission")
        values[name if equals else vehicles[0]] = url if equals else text
    return values


def _team(arguments: Options, mission: Mission) -> Team:
    path = arguments.team or mission.team
    if path is not None:
        return Team.load(path)
    if arguments.free_ports is not None or arguments.check:
        return default_team()
    raise TeamError(
        f"{mission.path} names no team; add 'team: team.yaml' to it, give --team FILE, or "
        "--free-ports DIR for a built-in team of three ground robots"
    )
