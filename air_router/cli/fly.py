"""`air-router fly`: flies a mission with a vehicle that is already there."""

import asyncio
import contextlib
import dataclasses
import gc
import logging
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

import click
from click.shell_completion import CompletionItem
from pydantic_core import PydanticCustomError

from air_router.cli.arguments import (
    MORE_THAN_0,
    moment,
    note_options,
    number,
    print_json,
    say,
    uav_option,
)
from air_router.control import CONTROL_NAME, endpoint_of
from air_router.errors import PictureError, RefusedError
from air_router.files import known_policy, policy_names
from air_router.flight import Flight, FlightResult, StatusLine, as_begun
from air_router.gossip import Gossip, Mapper
from air_router.mission import ALONE, Mission, load_flown, sought, team_of
from air_router.preflight import PreflightSurvey
from air_router.record import (
    Recorder,
    folder_of,
    recording_options,
    viewer_option,
    viewing,
)
from air_router.report import table
from air_router.vehicle import PaceClient, PaceSource, VehicleClock
from air_router.vehicle.px4 import Px4Connection, Px4Vehicle
from air_router.web import ServeError, web_of, web_options
from mocha_link import ListenError, PortInUseError, RadioError
from mocha_link.cli import PATH, Decorator, Options, Parsed, command, option, optional, together
from mocha_link.errors import MissingExtraError, needs_extra
from mocha_link.team import KeyFileError, KeyMismatchError, keys

_log = logging.getLogger(__name__)

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


def _seek_policy(text: str) -> str:
    """The name of a seek policy that is installed. Raises ValueError."""
    try:
        return known_policy(text)
    except PydanticCustomError as error:
        raise ValueError(f"'{text}' is no seek policy: {error.message()}") from None


def _seek_policies(
    _context: click.Context, _parameter: click.Parameter, begun: str
) -> list[CompletionItem]:
    return [CompletionItem(name) for name in policy_names() if name.startswith(begun)]


@contextlib.contextmanager
def refusing() -> Iterator[None]:
    """What the flight needs of this machine, and cannot have, refuses it."""
    try:
        yield
    except _UNUSABLE as error:
        raise RefusedError(str(error)) from None


@refusing()
def fly_mission(mission: Mission, arguments: Options, stem: str) -> FlightResult:
    """Fly a mission to its end; the exceptions have the reason why one did not start.

    Args:
        mission: The mission.
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
            status.print_line(hours)
    mapper = Mapper(mission)
    exposure = keys.exposure(team, [team.robot(uav)])
    if exposure:
        _log.warning("%s", exposure)
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
            status.print_line(f"Foxglove: open a connection to {viewer.address}")
        recorder.file(mission.path)
        if team.path != ALONE:
            recorder.file(team.path)
        vehicle = vehicle_of(mission, clock, arguments)
        vehicle.telemetry.subscribe(pace.received)
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
            page = LivePage(
                flight.status,
                lambda: flight.controller.router,
                flight.commands,
                mapper=mapper,
                web=web,
            )
        gc.freeze()  # the objects of now stay: a search of them for garbage blocks the loop
        result = asyncio.run(flight.run(page))
    if recorder.path is not None:
        result.report["record"] = str(recorder.path)
    return result


def vehicle_of(mission: Mission, clock: VehicleClock, arguments: Options) -> Px4Vehicle:
    """The vehicle that the arguments of `vehicle_options` name.

    Raises:
        SigningKeyError: the file of the signing key has none, or others can read it.
    """
    connection = partial(Px4Connection, key=arguments.signing_key)
    return Px4Vehicle(
        mission, arguments.connect, clock, system_id=arguments.sysid, connection=connection
    )


def _system_id(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 250:
        raise ValueError(f"{text} is not a system id of a vehicle, 1 to 250")
    return int(text)


def link_options(connect: str | None = DEFAULT_URL) -> Decorator:
    """Add the options that name the vehicle and its link."""
    return together(
        option(
            "--connect",
            metavar="URL",
            default=connect,
            help="MAVLink connection to the vehicle"
            + (f" (default {connect})" if connect else "")
            + "; for a serial port e.g. serial:///dev/ttyACM0:57600",
        ),
        option(
            "--sysid",
            type=Parsed(_system_id),
            metavar="N",
            default=1,
            help="MAVLink system id of the vehicle, 1 to 250 (default 1)",
        ),
    )


vehicle_options = together(
    link_options(),
    option(
        "--signing-key",
        type=PATH,
        metavar="FILE",
        help="sign MAVLink with the key in FILE, and accept only messages signed with it "
        "(`air-router signing-key`, docs/security.md)",
    ),
    option("--team", type=PATH, metavar="FILE", help="team file (default: the mission's)"),
)
"""Options common to `fly` and `preflight`."""


flight_options = together(
    click.argument("mission", type=PATH, help="mission file (.yaml or .plan)"),
    option(
        "--duration",
        type=Parsed(number("a positive number of seconds, at most 1e9", MORE_THAN_0, 1e9)),
        metavar="S",
        help="come home after this flight time, in seconds of the vehicle's clock "
        "(default: the mission's)",
    ),
    recording_options,
    viewer_option,
    option(
        "--png",
        type=PATH,
        metavar="F",
        help="draw the flown track into file F (default: track.png)",
    ),
    option(
        "--metrics",
        metavar="ENDPOINT",
        help="serve link metrics to other programs at this endpoint, e.g. tcp://127.0.0.1:24500 "
        "(`mocha-link metrics ENDPOINT --follow`)",
    ),
    option(
        "--control",
        type=Parsed(endpoint_of),
        **optional(CONTROL_NAME),
        metavar="[ENDPOINT]",
        help="accept requests from other programs on this machine (`air-router ask`, "
        "docs/control.md), at the default endpoint, or at a name, ipc://PATH, a port or "
        "tcp://127.0.0.1:PORT",
    ),
    web_options(),
    option("--json", is_flag=True, help="print one JSON object on stdout"),
    option(
        "--seek",
        type=Parsed(_seek_policy),
        shell_complete=_seek_policies,
        metavar="POLICY",
        help="policy that chooses the next robot: round_robin, freshest, rendezvous, tour, the "
        "name of an installed policy, or package.module:Class (default: the mission's)",
    ),
)
"""Options common to `fly` and `sim`."""


@command(
    "Fly a mission with a PX4 vehicle or a running SITL. Waits until the pilot arms and chooses "
    "Mission mode, unless --arm is confirmed.",
    "example:\n  air-router fly missions/pennovation/mission.yaml "
    "--connect udpin://127.0.0.1:14540",
)
@vehicle_options
@uav_option
@option(
    "--camera",
    metavar="URL",
    help="ZeroMQ endpoint that publishes map patches, e.g. tcp://127.0.0.1:24600",
)
@option("--arm", is_flag=True, help="arm and take off once the operator has confirmed")
@option(
    "--resume",
    is_flag=True,
    help="continue a flight of this mission that is already in the air",
    not_with=["arm"],
)
@option("--yes", is_flag=True, help="arm without asking for confirmation")
@option(
    "--keys",
    type=PATH,
    metavar="DIR",
    help="folder with the UAV's secret key, NAME.key, if the team file has a key for it",
)
@flight_options
@option(PART, is_flag=True, hidden=True)
@option("--at", type=Parsed(moment), hidden=True)
@option("--pace-from", type=Parsed(PaceSource.of), hidden=True)
def run(arguments: Options) -> int:
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


def finish(mission: Mission, result: FlightResult, arguments: Options) -> int:
    """Print a flight's result as requested, draw its track, and give its exit code."""
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
