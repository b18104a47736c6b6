"""`air-router new`: a first mission with its team, world and rover, from options or answers."""

import itertools
import math
import re
import shlex
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any, Final

import click
import yaml

from air_router.cli import home, note_options, number, say
from air_router.errors import ExitCode, UsageError
from air_router.files import degrees_text
from air_router.files.missions import first_mission_text
from air_router.mission import load_mission
from geo.frame import Geodetic, LocalFrame, Point
from mocha_link.cli import PATH, Options, Parsed, command, option, together

_EPILOG: Final = """\
examples:
  air-router new                                      (prompts for all values)
  air-router new yard --home 47.3977,8.5456 --robots "husky=ros2, scout"
"""

ROVERS: Final = {"json": "rover_json.py", "ros1": "rover_ros1.py", "ros2": "rover_ros2.py"}
"""The message formats that robots may use, and the program of a rover that does."""

MOST_ROBOTS: Final = 20

_HERE = Path(__file__).parent
_PX4_RETURN_M = 30.0
_CORNERS = 4
_RADIUS_M = 100.0
_FENCE_M = 200.0
_PATROL_M = 8.0
_FIRST_DOMAIN = 7  # of DDS; robots do not receive each other's topics there
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")

_altitude = number("an altitude between 2 and 500 m above home", 2.0, 500.0)


def _name(text: str) -> str:
    """A robot's name."""
    if not _NAME.fullmatch(text) or yaml.safe_load(text) != text:  # YAML takes "on" for a switch
        raise ValueError(f"'{text}' is no name; use letters, digits, _ and -")
    return text


def _robots(text: str) -> dict[str, str]:
    """Names, and the message format of each: "rover=ros2, scout"."""
    found: dict[str, str] = {}
    for part in text.replace(",", " ").split():
        robot, _, kind = part.partition("=")
        kind = kind or "json"
        if kind not in ROVERS:
            known = ", ".join(ROVERS)
            raise ValueError(f"{part}: the message format of a robot is one of {known}")
        if robot in ROVERS and found:
            *_, last = found
            message = f"'{robot}' is a message format; write {last}={robot}"
            raise ValueError(message)
        if robot.lower() in map(str.lower, found):
            raise ValueError(f"'{robot}' is named twice (whatever its case)")
        found[_name(robot)] = kind
    if not 1 <= len(found) <= MOST_ROBOTS:
        raise ValueError(f"name 1 to {MOST_ROBOTS} robots")
    return found


@dataclass(frozen=True, slots=True)
class _Question:
    """A value that the command needs.

    Attributes:
        key: Its name among the arguments.
        metavar: Its name in the help.
        help: What it is, there.
        text: The prompt on a terminal.
        read: Parses the answer; raises ValueError.
        default: The value of an empty answer; None: an answer is required.
    """

    key: str
    metavar: str
    help: str
    text: str
    read: Callable[[str], Any]
    default: str | None = None

    def prompted(self, prompt: Callable[[str], str]) -> Any:
        """The answer on a terminal; repeated until it is valid."""
        shown = "" if self.default is None else f" [{self.default}]"
        while True:
            try:
                given = prompt(f"{self.text}{shown} ").strip() or self.default
            except EOFError:
                raise UsageError("no answer; nothing was made") from None
            try:
                if given is not None:
                    return self.read(given)
            except ValueError as error:
                sys.stderr.write(f"{error}\n")


_QUESTIONS = (
    _Question(
        "folder",
        "FOLDER",
        "folder to create (default mission)",
        "Folder to create",
        Path,
        "mission",
    ),
    _Question(
        "home",
        "LAT,LON",
        "take-off position, in degrees",
        "Where does the vehicle take off (latitude,longitude)?",
        home,
    ),
    _Question(
        "altitude",
        "M",
        "cruise altitude above home, in meters (default 30)",
        "Cruise altitude in metres above that?",
        _altitude,
        "30",
    ),
    _Question(
        "uav",
        "NAME",
        "name of the vehicle (default titan)",
        "Name of the vehicle in the team?",
        _name,
        "titan",
    ),
    _Question(
        "robots",
        "NAMES",
        "robots to seek, each with its message format json, ros1 or ros2 (default rover=json)",
        "Robots that it seeks, each with its message format (json, ros1, ros2)?",
        _robots,
        "rover=json",
    ),
)


_FOLDER, *_OPTIONS = _QUESTIONS


@command(
    "Create a folder with a mission, its team, a simulated world and a rover's program. Prompts "
    "for values that no option gives. Never overwrites a file.",
    _EPILOG,
)
@click.argument(
    _FOLDER.key,
    type=PATH,
    required=False,
    metavar=f"[{_FOLDER.metavar}]",
    help=_FOLDER.help,
)
@together(
    *(
        option(f"--{each.key}", type=Parsed(each.read), metavar=each.metavar, help=each.help)
        for each in _OPTIONS
    )
)
def run(arguments: Options) -> int:
    """Prompt, write, and print how to go on."""
    answers = _answered(arguments, input if sys.stdin.isatty() else None)
    folder, uav, kinds = answers["folder"], answers["uav"], answers["robots"]
    if uav.lower() in map(str.lower, kinds):
        raise UsageError(f"'{uav}' is the vehicle's name; give the robot another one")
    note_options(Options(**answers), {"altitude": "altitude_m"})
    texts = texts_of(answers["home"], answers["altitude"], uav, kinds)
    there = [str(folder / file) for file in texts if (folder / file).exists()]
    if there:
        raise UsageError(f"{', '.join(there)}: there already; choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in texts.items():
        with (folder / file).open("x", encoding="utf-8") as made:
            made.write(text)
        print(folder / file)
    for note in load_mission(folder / "mission.yaml").notes:
        say(f"note: {note}")
    _print_next(folder, answers["home"], kinds)
    return ExitCode.DONE


def _answered(arguments: Options, prompt: Callable[[str], str] | None) -> dict[str, Any]:
    """Every answer: as an option, else from the terminal if there is one, else its default.

    Raises:
        UsageError: one is missing that has no default.
    """
    answers = {}
    for question in _QUESTIONS:
        value = getattr(arguments, question.key)
        if value is None and prompt is not None:
            value = question.prompted(prompt)
        elif value is None and question.default is None:
            raise UsageError(f"pass --{question.key}, or answer on a terminal: {question.text}")
        elif value is None:
            value = question.read(str(question.default))
        answers[question.key] = value
    return answers


def _print_next(folder: Path, at: Geodetic, kinds: dict[str, str]) -> None:
    mission, frame = shlex.quote(str(folder / "mission.yaml")), LocalFrame(at)
    places = first_places(len(kinds))
    endpoints = {robot: f"ipc:///tmp/{robot}" for robot in kinds}
    rovers = " ".join(f"--rover {robot}={endpoint}" for robot, endpoint in endpoints.items())
    lines = [
        "next:",
        f"  air-router check {mission}",
        f"  air-router sim {mission}",
        "with programs of yours as robots, each in a terminal of its own (docs/robot.md):",
        f"  air-router sim {mission} {rovers}",
    ]
    domains = itertools.count(_FIRST_DOMAIN)
    for (robot, kind), place in zip(kinds.items(), places, strict=False):
        to, where = endpoints[robot], ",".join(map(degrees_text, frame.to_geodetic(place)))
        if kind == "ros2":
            domain = str(next(domains))
            lines.append(f"  mocha-link bridge ros2 --node {to} --domain {domain}")
            to, where = domain, f"{place.east_m:.0f},{place.north_m:.0f}"
        lines.append(f"  python {shlex.quote(str(folder / ROVERS[kind]))} {to} {where}")
    sys.stderr.write("\n".join(lines) + "\n")


# The files of a first mission, as texts: small, commented, and ready to be flown and changed.


def first_places(count: int) -> list[Point]:
    """Where robots are at first, in metres from home: near waypoints, apart from each other."""
    corners = max(count, _CORNERS)
    angles = [math.tau * number / corners for number in range(corners)]
    return [Point(_RADIUS_M * math.sin(a), _RADIUS_M * math.cos(a)) for a in angles]


def texts_of(
    home: Geodetic, altitude_m: float, uav: str, robots: Mapping[str, str]
) -> dict[str, str]:
    """The files by name.

    Args:
        home: Where the vehicle takes off.
        altitude_m: Where it cruises, above home.
        uav: Its name.
        robots: The message format of each robot, by name: a key of `ROVERS`.
    """
    places = first_places(len(robots))
    kinds = dict.fromkeys(robots.values())
    patrols = [
        f"  {name}: {{patrol: {_patrol(place)}}}"
        for name, place in zip(robots, places, strict=False)
    ]
    begin = first_mission_text(
        "air-router new", home, places, altitude_m=altitude_m, fence_radius_m=_FENCE_M
    )
    accepts = _filled("accepts") if altitude_m > _PX4_RETURN_M else ""
    programs = {ROVERS[kind]: (_HERE / ROVERS[kind]).read_text(encoding="utf-8") for kind in kinds}
    return {
        "mission.yaml": begin + _filled("mission", uav=uav, robots=", ".join(robots)) + accepts,
        "team.yaml": _filled(
            "team",
            robots=_team(", ".join(map(degrees_text, home)), uav, robots),
            occupancy="" if set(kinds) == {"json"} else _filled("occupancy"),
            kinds="".join(_filled(f"kind_{kind}") for kind in kinds).rstrip("\n"),
        ),
        "world.yaml": _filled("world", robots="\n".join(patrols)),
        **{name: program.replace("titan", uav) for name, program in programs.items()},
    }


def _filled(template: str, **values: object) -> str:
    text = (_HERE / "templates" / f"{template}.yaml").read_text(encoding="utf-8")
    return Template(text).substitute(values)


def _team(home: str, uav: str, robots: Mapping[str, str]) -> str:
    """The section of a team file; `home` is where local frames have their origins."""
    names = [uav, *robots]
    text = ""
    for index, name in enumerate(names, start=1):
        text += _filled(
            "robot",
            name=name,
            kind=f"{robots[name]}_rover" if name in robots else "aerial_robot",
            number=index,
            base_port=24_000 + 100 * index,
            clients=", ".join(other for other in names if other != name),
            radio_port=24_090 + 100 * index,
        )
        if "ros2" in (robots.get(name), *(robots.values() if name == uav else ())):
            text += f"    datum: [{home}]  # where the origin of its local frame lies\n"
        if robots.get(name) == "ros2":
            text += "    ros: 2\n"
    return text.rstrip("\n")


def _patrol(place: Point) -> str:
    half_m = _PATROL_M / 2
    corners = [(-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m)]
    points = [f"[{place.east_m + e:.0f}, {place.north_m + n:.0f}]" for e, n in corners]
    return f"[{', '.join(points)}]"
