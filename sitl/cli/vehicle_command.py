"""`sitl vehicle`: a simulated PX4 multirotor, as a process of its own."""

import contextlib
import time
from typing import Any, Final

import click

from air_router.cli import (
    ANY_FINITE,
    MORE_THAN_0,
    number,
    print_json,
    px4_version_option,
    speed_factor,
    uav_option,
)
from air_router.errors import ExitCode, UsageError
from air_router.mission import load_mission
from air_router.vehicle.px4 import name_of
from mocha_link.cli import PATH, Decorator, Options, Parsed, command, option, together
from mocha_link.loopback import is_loopback
from sitl.cli.arguments import epoch, instance, pace_source
from sitl.mavlink import VehicleSettings
from sitl.process import (
    HERE,
    Address,
    FollowedPace,
    LinkAddresses,
    Pace,
    PaceServer,
    Ports,
    VehicleProcess,
    px4_ports,
    stop_signal,
)
from sitl.px4sim import BATTERY_MINUTES, BEHAVIOURS, USUAL, StartPosition, defaults
from sitl.px4sim.motion import WindSettings

PX4_HOME: Final = StartPosition(47.397742, 8.545594, 489.4)
"""Where PX4's own simulator starts by default."""

_MOST_WIND_M_S: Final = 25.0
_EPILOG = """\
Prints one JSON line on stdout when ready: {"ready": true, "mavlink": ..., "gcs": ...,
"truth": ..., "system_id": ..., "speed": ..., "home": ...}. Runs until SIGINT or SIGTERM, then
prints another: {"simulated_s": ..., "pace": {"requested": ..., "kept": ..., "processes": ...}}.
Ports are PX4's: instance N sends to 127.0.0.1, ports 14540+N (API), 14550 (ground station) and
19410+N (truth). On each link it answers only the first program that sends to it, unless --api-to or
--gcs-to is given.

examples:
  sitl vehicle missions/pennovation/mission.yaml --speed 10
  sitl vehicle --home 40.4406,-79.9959,280 --instance 1 --wind 6,270,2
"""


def parameters_of(arguments: Options) -> dict[str, float]:
    """The parameters that the command line sets; PX4's own battery stops draining at half."""
    drain_s = arguments.battery_minutes * 60.0
    return {"SIM_BAT_DRAIN": drain_s, "SIM_BAT_MIN_PCT": 0.0} | dict(arguments.param)


def place_of(arguments: Options) -> StartPosition:
    """The start position on the command line."""
    home: StartPosition | None = arguments.home
    if home is not None or arguments.mission is None:
        return home or PX4_HOME
    mission = load_mission(arguments.mission, uav=arguments.uav)
    latitude_deg, longitude_deg = mission.frame.to_geodetic(mission.home)
    return StartPosition(latitude_deg, longitude_deg, mission.home_altitude_amsl_m or 0.0)


def process_of(arguments: Options, **settings: Any) -> VehicleProcess:
    """The vehicle of the command line, on its ports.

    Args:
        arguments: Of the command line.
        settings: Of `VehicleSettings`, those that no option sets.

    Raises:
        UsageError: options contradict each other.
        AirRouterError: a port is taken, or the mission is none.
    """
    if arguments.no_gcs and arguments.gcs_to is not None:
        raise UsageError("--no-gcs and --gcs-to contradict each other; give one of them")
    if arguments.pace is not None and arguments.pace_from is not None:
        raise UsageError("--pace and --pace-from contradict each other; give one of them")
    version = arguments.px4_version or USUAL
    for name, _ in arguments.param:
        if name not in defaults(BEHAVIOURS[version]):
            raise UsageError(f"PX4 {name_of(version)} has no parameter {name}; see --px4-version")
    chosen = VehicleSettings(
        place_of(arguments),
        system_id=arguments.instance + 1,
        seed=arguments.seed,
        speed=arguments.speed,
        start_unix_s=time.time() if arguments.epoch is None else arguments.epoch,
        parameters=parameters_of(arguments),
        wind=arguments.wind,
        ground_link=not arguments.no_gcs,
        version=version,
        **settings,
    )
    return VehicleProcess(chosen, _ports(arguments), _pace(arguments))


def _address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(f"'{text}' is not HOST:PORT; write 127.0.0.1:14540")
    return host, int(port)


def _wind(text: str) -> WindSettings:
    try:
        speed_m_s, from_deg, *rest = (float(part) for part in text.split(","))
        wind = WindSettings(speed_m_s, from_deg, *rest)
    except (ValueError, TypeError):
        raise ValueError(f"'{text}' is not SPEED,FROM[,GUSTS]; write for example 5,270,2") from None
    gusts = wind.gusts_m_s or 0.0
    if not (0 <= speed_m_s <= _MOST_WIND_M_S and 0 <= gusts <= _MOST_WIND_M_S):
        raise ValueError(f"'{text}': winds go from 0 to {_MOST_WIND_M_S:g} m/s")
    return wind


def _place(text: str) -> StartPosition:
    try:
        latitude_deg, longitude_deg, altitude_m = (float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(
            f"'{text}' is not LAT,LON,ALT; write for example 47.397742,8.545594,489.4"
        ) from None
    place = StartPosition(latitude_deg, longitude_deg, altitude_m)
    if not (abs(latitude_deg) < 90 and abs(longitude_deg) <= 180 and abs(altitude_m) < 10000):
        raise ValueError(f"'{text}' is not a place on Earth")
    return place


def parameter(text: str) -> tuple[str, float]:
    """NAME=VALUE of a command line; the name must be one of PX4's."""
    name, _, value = text.partition("=")
    set_to = number("the value of NAME=VALUE; write GF_ACTION=3", -ANY_FINITE, ANY_FINITE)(value)
    if not any(name in defaults(behaviour) for behaviour in BEHAVIOURS.values()):
        raise ValueError(f"'{name}' is not a parameter of PX4's SITL")
    return name, set_to


place_options = together(
    click.argument(
        "mission",
        type=PATH,
        required=False,
        help="mission file (.yaml or .plan); the vehicle starts at its home (default: PX4's "
        "home, near Zurich)",
    ),
    option(
        "--home",
        type=Parsed(_place),
        metavar="LAT,LON,ALT",
        help="start at this position: degrees, and meters AMSL",
        not_with=["mission"],
    ),
    uav_option,
)
"""Add MISSION, --home and --uav; `place_of` reads them."""


def speed_and_parameters(speed_help: str) -> Decorator:
    """Add --speed, --battery-minutes and --param; `parameters_of` reads the last two."""
    return together(
        option("--speed", type=Parsed(speed_factor), metavar="X", default=1.0, help=speed_help),
        option(
            "--battery-minutes",
            type=Parsed(number("a number above zero", MORE_THAN_0, ANY_FINITE)),
            metavar="M",
            default=BATTERY_MINUTES,
            help=f"endurance of a full battery, in minutes (default {BATTERY_MINUTES:g})",
        ),
        option(
            "--param",
            multiple=True,
            type=Parsed(parameter),
            metavar="NAME=VALUE",
            help="set a PX4 parameter; may be repeated",
        ),
    )


@command("Simulate a multirotor with an autopilot that behaves like PX4.", _EPILOG)
@place_options
@option(
    "--instance",
    type=Parsed(instance),
    metavar="N",
    default=0,
    help="instance number, 0 to 250: ports +N, system id N+1 (default 0)",
)
@speed_and_parameters("speed limit, times real time, 0.1 to 100 (default 1)")
@option(
    "--pace",
    type=Parsed(_address),
    metavar="HOST:PORT",
    help="serve the simulation clock here, and run no faster than the processes that report to it",
)
@option(
    "--pace-for",
    type=int,
    metavar="N",
    default=1,
    help="number of processes that will report (default 1); the clock runs slowly until all have",
)
@option(
    "--pace-from",
    type=Parsed(pace_source),
    metavar="HOST:PORT",
    help="follow the clock of another vehicle, which serves it here (--pace)",
)
@option("--seed", type=int, metavar="N", default=1, help="seed of the position noise (default 1)")
@option(
    "--epoch",
    type=Parsed(epoch),
    metavar="UNIX_S",
    help="Unix time at simulated time zero, in seconds (default: now)",
)
@option(
    "--wind",
    type=Parsed(_wind),
    metavar="SPEED,FROM[,GUSTS]",
    default=WindSettings(),
    help="mean wind in m/s, direction it comes from in degrees, and standard deviation of the "
    "gusts in m/s (default 0.3 of the speed); no wind by default",
)
@option(
    "--api-to",
    type=Parsed(_address),
    metavar="HOST:PORT",
    help="send the API link to this address, from a free port (default 127.0.0.1:14540+N)",
)
@option(
    "--gcs-to",
    type=Parsed(_address),
    metavar="HOST:PORT",
    help="send the ground station link to this address (default 127.0.0.1:14550)",
)
@option(
    "--listen",
    metavar="ADDRESS",
    help="address to receive on (default: this machine only; with 0.0.0.0 other machines can "
    "command the vehicle)",
)
@px4_version_option("the vehicle behaves like")
@option("--no-gcs", is_flag=True, help="do not open a link to a ground station")
@option(
    "--truth-to",
    type=Parsed(_address),
    metavar="HOST:PORT",
    help="send the true position to this address (default 127.0.0.1:19410+N)",
)
def run(arguments: Options) -> int:
    """Simulate until a signal comes; returns the exit code."""
    with process_of(arguments) as process, stop_signal() as stopped:
        settings, ports = process.settings, process.ports
        host, port = ports.truth.partner
        links = {
            "mavlink": f"udpin://127.0.0.1:{ports.onboard.partner[1]}",
            "gcs": ports.ground and f"udpin://127.0.0.1:{ports.ground.partner[1]}",
            "truth": f"udp://{host}:{port}",
        }
        ready_line(links, settings.system_id, settings.speed, settings.place)
        process.run(stopped)
        simulated_s = round(process.vehicle.autopilot.time_s, 1)
        ended = {"simulated_s": simulated_s, "pace": process.pace()}
    with contextlib.suppress(BrokenPipeError):  # the program that started it has ended
        print_json(ended)
    return ExitCode.DONE


def _pace(arguments: Options) -> Pace:
    """Which processes the clock waits for."""
    if arguments.pace is not None:
        return PaceServer(arguments.pace, arguments.pace_for)
    if arguments.pace_from is not None:
        return FollowedPace(arguments.pace_from, f"vehicle {arguments.instance + 1}")
    return Pace()


def _ports(arguments: Options) -> Ports:
    """PX4's, except where the command line names a partner: those links take a free port."""
    named = {"onboard": arguments.api_to, "ground": arguments.gcs_to, "truth": arguments.truth_to}
    ends = {
        link: LinkAddresses((_listens(arguments.listen, partner[0]), 0), partner)
        for link, partner in named.items()
        if partner is not None
    }
    ports = px4_ports(arguments.instance, arguments.listen or HERE)._replace(**ends)
    return ports._replace(ground=None) if arguments.no_gcs else ports


def _listens(wanted: str | None, partner: str) -> str:
    """Where a link to a partner receives: the replies of another machine come from outside."""
    if wanted is not None:
        return wanted
    return HERE if is_loopback(partner) else ""


def ready_line(links: dict[str, Any], system_id: int, speed: float, place: StartPosition) -> None:
    """Print the line that announces a running vehicle and its ports."""
    home = {
        "latitude_deg": place.latitude_deg,
        "longitude_deg": place.longitude_deg,
        "altitude_amsl_m": place.altitude_m,
    }
    print_json({"ready": True, **links, "system_id": system_id, "speed": speed, "home": home})
