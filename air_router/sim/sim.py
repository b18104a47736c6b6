"""`air-router sim`: starts the simulated world and flies in it, as it would fly outside.

One vehicle is flown by this process; of several each is flown by an `air-router fly` of its own.
"""

import contextlib
import dataclasses
import importlib.util
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from air_router.cli import (
    PART,
    finish,
    flight_options,
    fly_mission,
    note_options,
    print_json,
    px4_version_option,
    refusing,
    rover_option,
    say,
    speed_factor,
    start_option,
)
from air_router.errors import UsageError
from air_router.mission import Mission, load_mission
from air_router.preflight import check_world, world_notes
from air_router.record import ViewerAddress, no_folder
from air_router.report import several
from air_router.sim.demo import demo_or
from air_router.sim.flights import Flights
from air_router.sim.sim_world import SimOptions, SimVehicle, SimWorld
from air_router.vehicle.px4 import NEWEST
from air_router.web import PageAddress, shown_beside, web_of
from mocha_link.cli import Options, Parsed, command, option, optional
from mocha_link.errors import MissingExtraError, needs_extra
from mocha_link.path_safety import made_folder


@command(
    "Start a simulated PX4, ground robots and radios, and fly a mission with them.",
    "examples:\n  air-router sim demo --speed 10      (the built-in mission)\n"
    "  air-router sim missions/pennovation/mission.yaml --speed 10",
)
@flight_options
@start_option
@rover_option
@option(
    "--speed",
    type=Parsed(speed_factor),
    metavar="X",
    default=1.0,
    help="speed limit, times real time, 0.1 to 100 (default 1); the simulation waits for the "
    "slowest process",
)
@option("--seed", type=int, metavar="N", default=1, help="random seed (default 1)")
@option(
    "--px4",
    **optional(""),
    metavar="[PATH]",
    help="fly a real PX4 SITL at PATH, or where `sitl px4` finds one, not the simulated PX4",
)
@px4_version_option("the simulated PX4 behaves like")
def run(arguments: Options) -> int:
    """Fly in a world of its own, and report on stdout."""
    for package in ("mavsdk", "pymavlink"):  # the flight and the world are other processes
        if importlib.util.find_spec(package) is None:
            raise MissingExtraError("the simulated world", package, "sim", "air-router")
    arguments.mission = demo_or(arguments.mission)
    mission = load_mission(arguments.mission, start=arguments.at, duration_s=arguments.duration)
    check_world(arguments.mission, arguments.rover)
    note_options(arguments, {"duration": "duration_s"})
    for note in world_notes(mission.world):
        say(f"note: {note}")
    if arguments.px4 is not None and arguments.px4_version is not None:
        raise UsageError("--px4 and --px4-version contradict each other; give one of them")
    options = SimOptions(
        *(arguments.speed, arguments.seed, arguments.px4, tuple(arguments.rover)),
        px4_version=arguments.px4_version or NEWEST,
    )
    if len(mission.layers) > 1:
        return _fly_several(mission, options, arguments)
    # The simulated vehicle's clock is today's, whenever the flight is meant to be.
    mission = dataclasses.replace(
        mission,
        window=dataclasses.replace(mission.window, latest_start=None),
        seek_policy=arguments.seek or mission.seek_policy,
    )
    with (
        _folder(arguments.log_dir) as folder,
        SimWorld(arguments.mission, options, folder) as world,
    ):
        (seat,) = world.seats
        flown = {
            "connect": seat.url,
            "sysid": seat.system_id,
            "team": world.team,
            "camera": seat.camera,
            "keys": None,
            "signing_key": None,
            "pace_from": world.pace,
            "arm": True,
            "resume": False,
        }
        result = fly_mission(mission, Options(**{**vars(arguments), **flown}), "sim")
        result.report["world"] = world.stop()
    return finish(mission, result, arguments)


@refusing()
def _fly_several(mission: Mission, options: SimOptions, arguments: Options) -> int:
    """Each UAV in a process of its own; one report, and the worst exit code."""
    web = web_of(arguments)
    page = None
    if web is not None:
        with needs_extra("the page", "web", "air-router"):
            from air_router.live import JointPage  # noqa: PLC0415 - an extra
        page = JointPage((layer.uav for layer in mission.layers), web)

    def take_line(uav: str, line: str) -> bool:
        """Their own pages are for the joint page only."""
        address = None if page is None else PageAddress.in_line(line)
        if page is None or address is None:
            return False
        page.found(uav, address)
        return True

    with (
        _folder(arguments.log_dir) as folder,
        contextlib.nullcontext() if page is None else shown_beside(page, say),
        SimWorld(arguments.mission, options, folder, mission.layers) as world,
    ):
        commands = {
            seat.uav: command_of(seat, index, world, arguments)
            for index, seat in enumerate(world.seats)
        }
        flights = Flights(commands, take_line=take_line)
        code = flights.run()
        report: dict[str, Any] = {
            "uavs": {flight.uav: flight.report for flight in flights.flights},
            "world": world.stop(),
        }
    sys.stderr.write(several(report, {f.uav: f.exit_code for f in flights.flights}))
    if arguments.json:
        print_json(report)
    return code


def command_of(seat: SimVehicle, index: int, world: SimWorld, arguments: Options) -> Sequence[str]:
    """What flies one of several UAVs; each has ports of its own, behind those of the one before."""
    command = ["fly", str(arguments.mission), "--uav", seat.uav, "--arm", "--yes", "--json", PART]
    command += ["--connect", seat.url, "--sysid", str(seat.system_id)]
    command += ["--team", str(world.team), "--camera", seat.camera]
    picture = arguments.png
    if picture is not None:
        picture = picture.with_stem(f"{picture.stem}-{seat.uav}")
    for name, value in (
        ("--pace-from", world.pace),
        ("--duration", arguments.duration),
        ("--seek", arguments.seek),
        ("--png", picture),
        ("--log-dir", None if arguments.log_dir is None else arguments.log_dir / seat.uav),
        ("--metrics", _nth(arguments.metrics, index)),
        ("--control", _nth(arguments.control, index)),
        ("--web", _port(arguments.web, index + 1)),  # behind the joint page, on this machine only
        ("--foxglove", _viewer(arguments.foxglove, index)),
        ("--at", None if arguments.at is None else arguments.at.isoformat()),
    ):
        command += [] if value is None else [name, str(value)]
    return [*command, "--no-record"] if arguments.no_record else command


def _nth(endpoint: str | None, index: int) -> str | None:
    """An endpoint for the n-th UAV: a port higher by n, another path; any free port stays so."""
    if endpoint is None or index == 0:
        return endpoint
    place, _, port = endpoint.rpartition(":")
    if endpoint.startswith("tcp://"):
        return f"{place}:{_port(int(port), index)}" if port.isdecimal() else endpoint
    return f"{endpoint}-{index + 1}"


def _viewer(address: ViewerAddress | None, index: int) -> ViewerAddress | None:
    return address and address._replace(port=_port(address.port, index) or 0)


def _port(port: int | None, index: int) -> int | None:
    return port + index if port else port


@contextlib.contextmanager
def _folder(log_dir: Path | None) -> Iterator[Path]:
    if log_dir is not None:
        try:
            made_folder(log_dir)
        except OSError as error:
            raise no_folder(error) from None
        yield log_dir
        return
    with tempfile.TemporaryDirectory(prefix="air-router-") as folder:
        yield Path(folder)
