"""`air-router fly`: flies a mission with a vehicle that is already there."""

import argparse
import asyncio
import contextlib
import dataclasses
import gc
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

from air_router.cli.arguments import (
    MORE_THAN_0,
    add_uav,
    moment,
    note_options,
    number,
    print_json,
    say,
)
from air_router.control import CONTROL_NAME, endpoint_of
from air_router.errors import PictureError, RefusedError
from air_router.files import SEEK_POLICIES
from air_router.flight import Flight, FlightResult, StatusLine, as_begun
from air_router.gossip import Gossip, Mapper
from air_router.mission import ALONE, Mission, load_flown, sought, team_of
from air_router.preflight import PreflightSurvey
from air_router.record import (
    Recorder,
    add_recording,
    add_viewer,
    folder_of,
    viewing,
)
from air_router.report import table
from air_router.vehicle import PaceClient, PaceSource, VehicleClock
from air_router.vehicle.px4 import Px4Connection, Px4Vehicle
from air_router.web import ServeError, add_web, web_of
from mocha_link import ListenError, PortInUseError, RadioError
from mocha_link.errors import MissingExtraError, needs_extra
from mocha_link.team import KeyFileError, KeyMismatchError

DEFAULT_URL = "udpin://127.0.0.1:14540"
PART: Final = "--part"
_UNUSABLE = (  # the gossip node or the page cannot begin, so the flight does not
    PortInUseError,
    ListenError,
    RadioError,
    KeyFileError,
    KeyMismatchError,
    ServeError,
)


@contextlib.contextmanager
def refusing() -> Iterator[None]:
    """What the flight needs of this machine, and cannot have, refuses it."""
    try:
        yield
    except _UNUSABLE as error:
        raise RefusedError(str(error)) from None


@refusing()
def fly_mission(mission: Mission, arguments: argparse.Namespace, stem: str) -> FlightResult:
    """Fly a mission to its end; the exceptions say why one did not start.

    Args:
        mission: What is flown.
        arguments: Those of `fly`.
        stem: How the name of a record begins.
    """
    if arguments.duration is not None:
        mission = dataclasses.replace(mission, duration_s=arguments.duration)
    team, uav = team_of(mission, arguments.team)
    mission = dataclasses.replace(mission, uav=uav)
    folder, source = folder_of(arguments), arguments.pace_from
    clock = VehicleClock(ceiling=None if source is None else source.speed)
    status = StatusLine()
    if arguments.resume:
        now = datetime.fromtimestamp(clock.now_s(), UTC)
        mission, hours = as_begun(mission, folder, now)
        if hours:
            status.say(hours)
    mapper = Mapper(mission)
    gossip = Gossip(
        mission.frame,
        team,
        uav,
        clock,
        mapper,
        metrics=arguments.metrics,
        keys=arguments.keys,
        goals_from=mission.goals_from,
    )
    with (
        PaceClient(source, uav) as pace,
        viewing(arguments.foxglove, uav) as viewer,
        Recorder(
            folder,
            str(mission.path),
            unix_s=clock.now_s,
            stem=stem,
            name=uav,
            must=arguments.log_dir is not None and not arguments.resume,
            viewer=viewer,
        ) as recorder,
    ):
        if viewer is not None:
            status.say(f"Foxglove: open a connection to {viewer.address}")
        recorder.file(mission.path)
        if team.path != ALONE:
            recorder.file(team.path)
        vehicle = vehicle_of(mission, clock, arguments)
        vehicle.telemetry.subscribe(pace.heard)
        flight = Flight(
            mission,
            vehicle,
            clock=clock,
            gossip=gossip,
            mapper=mapper,
            seek=sought(team, uav, mission.seek, mission.goals_from),
            recorder=recorder,
            status=status,
            camera=arguments.camera,
            control=arguments.control,
            arm=arguments.arm,
            resume=arguments.resume,
            survey=lambda router: PreflightSurvey(
                mission,
                router,
                team=team,
                uav=uav,
                log_dir=folder,
                clock=clock,
                simulated=arguments.pace_from is not None,
            ),
        )
        web, page = web_of(arguments), None
        if web is not None:
            with needs_extra("the page", "web", "air-router"):
                from air_router.live import LivePage  # noqa: PLC0415 - an extra
            told = flight.controller, flight.commands, gossip.links
            page = LivePage(*told, mapper=mapper, web=web)
        gc.freeze()  # what is there by now stays: a search of it for garbage blocks the loop
        result = asyncio.run(flight.run(page))
    if recorder.path is not None:
        result.report["record"] = str(recorder.path)
    return result


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.description = (
        "Fly a mission with a PX4 that is already there. Waits for the pilot to arm "
        "and to choose Mission mode, unless --arm is confirmed."
    )
    parser.epilog = (
        "example: air-router fly missions/pennovation/mission.yaml "
        "--connect udpin://127.0.0.1:14540"
    )
    add_vehicle_arguments(parser)
    add_uav(parser)
    parser.add_argument(
        "--camera", metavar="URL", help="ZeroMQ endpoint that publishes map patches, tcp://..."
    )
    begin = parser.add_mutually_exclusive_group()
    begin.add_argument("--arm", action="store_true", help="arm and take off, once confirmed")
    begin.add_argument(
        "--resume",
        action="store_true",
        help="go on with a flight of this mission that is in the air",
    )
    parser.add_argument("--yes", action="store_true", help="confirm --arm without being asked")
    parser.add_argument(
        "--keys",
        type=Path,
        metavar="DIR",
        help="the folder with the UAV's secret key, NAME.key, if the team has a key for it",
    )
    add_flight_arguments(parser)
    # For `sim` with several UAVs: one of them, at a time that is pretended.
    parser.add_argument(PART, action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--at", type=moment, help=argparse.SUPPRESS)
    parser.add_argument("--pace-from", type=PaceSource.of, help=argparse.SUPPRESS)


def vehicle_of(mission: Mission, clock: VehicleClock, arguments: argparse.Namespace) -> Px4Vehicle:
    """The vehicle that the arguments of `add_vehicle_arguments` name.

    Raises:
        SigningKeyError: the file of the signing key has none, or others can read it.
    """
    connection = partial(Px4Connection, key=arguments.signing_key)
    return Px4Vehicle(
        mission, arguments.connect, clock, system_id=arguments.sysid, connection=connection
    )


def add_vehicle_arguments(parser: argparse.ArgumentParser) -> None:
    """What `fly` and `preflight` have in common."""
    add_link_arguments(parser)
    parser.add_argument(
        "--signing-key",
        type=Path,
        metavar="FILE",
        help="sign MAVLink with this key, and take only what is signed with it (`air-router "
        "signing-key`, docs/security.md)",
    )
    parser.add_argument("--team", type=Path, metavar="FILE", help="team file (the mission's)")


def add_link_arguments(parser: argparse.ArgumentParser) -> None:
    """Which vehicle is meant, and where it is."""
    parser.add_argument(
        "--connect",
        metavar="URL",
        default=DEFAULT_URL,
        help="the vehicle's link (default %(default)s); also serial:///dev/ttyACM0:57600",
    )
    parser.add_argument(
        "--sysid", type=_system_id, default=1, metavar="N", help="its MAVLink system id (default 1)"
    )


def add_flight_arguments(parser: argparse.ArgumentParser) -> None:
    """What `fly` and `sim` have in common."""
    parser.add_argument("mission", type=Path, metavar="MISSION", help="mission YAML or .plan")
    parser.add_argument(
        "--duration",
        type=number("a positive number of seconds, at most 1e9", MORE_THAN_0, 1e9),
        metavar="S",
        help="come home after so many seconds in the air, on the vehicle's clock",
    )
    add_recording(parser)
    add_viewer(parser)
    parser.add_argument(
        "--png", type=Path, metavar="F", help="draw the flown track into F (track.png)"
    )
    parser.add_argument(
        "--metrics",
        metavar="ENDPOINT",
        help="let your other programs watch the links there, e.g. tcp://127.0.0.1:24500 "
        "(`mocha-link metrics ENDPOINT --follow`)",
    )
    parser.add_argument(
        "--control",
        type=endpoint_of,
        nargs="?",
        const=CONTROL_NAME,
        metavar="ENDPOINT",
        help="let your other programs on this machine ask for something (`air-router ask`, "
        "docs/control.md); at another place than the usual: a name, ipc://PATH, a port or "
        "tcp://127.0.0.1:PORT",
    )
    add_web(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument(
        "--seek", choices=SEEK_POLICIES, help="how the next robot is chosen (as the mission says)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Fly, and report on stdout."""
    note_options(arguments, {"duration": "duration_s"})
    mission = load_flown(
        arguments.mission,
        arguments.uav,
        start=arguments.at,
        duration_s=arguments.duration,
        in_flight=arguments.resume,
    )
    mission = dataclasses.replace(mission, seek_policy=arguments.seek or mission.seek_policy)
    if arguments.part:
        # The simulated vehicle's clock is today's, whenever the flight is meant to be.
        window = dataclasses.replace(mission.window, latest_start=None)
        mission = dataclasses.replace(mission, window=window)
    if arguments.arm and not arguments.yes and not _confirmed(mission):
        raise RefusedError("not confirmed: the vehicle stays disarmed")
    result = fly_mission(mission, arguments, "sim" if arguments.part else "flight")
    return finish(mission, result, arguments)


def finish(mission: Mission, result: FlightResult, arguments: argparse.Namespace) -> int:
    """Print a flight's result as asked, draw its track, and give its exit code."""
    part = getattr(arguments, "part", False)
    picture = arguments.png or (arguments.log_dir or Path()) / "track.png"
    if part and arguments.png is None and arguments.log_dir is None:
        picture = None
    if arguments.json:
        print_json(result.report)
    if not part:
        sys.stderr.write(table(result.report))
        if "record" in result.report:
            record = result.report["record"]
            say(f"the record of the flight: {record} (air-router report, air-router replay)")
    if picture is None or not result.track:
        return result.exit_code
    try:
        from air_router.report import draw_mission  # noqa: PLC0415 - an extra

        draw_mission(mission, picture, track=result.track, meetings=result.meetings)
    except (PictureError, MissingExtraError) as error:
        say(f"no picture of the track: {error}")
    else:
        say(f"the track over the mission: {picture}")
    return result.exit_code


def _confirmed(mission: Mission) -> bool:
    sys.stderr.write(
        f"The vehicle will arm, take off and fly {mission.name} by itself. Propellers clear?\n"
    )
    try:
        sys.stderr.write("type 'fly' to go: ")
        return input().strip().lower() == "fly"
    except EOFError:
        return False


def _system_id(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 250:
        raise argparse.ArgumentTypeError(f"{text} is not a system id of a vehicle, 1 to 250")
    return int(text)
