"""`air-router new`: a first mission with its team, world and rover."""

import argparse
import sys
from pathlib import Path

from air_router.cli.arguments import home
from air_router.errors import ExitCode, UsageError
from air_router.files.text_values import degrees_text
from air_router.mission.loading import load_mission
from air_router.start.answers import altitude, answered, name, robots
from air_router.start.texts import ROVERS, first_places, texts_of
from geo.frame import Geodetic, LocalFrame

_EPILOG = """\
examples:
  air-router new                                      (asks on the terminal)
  air-router new yard --home 47.3977,8.5456 --robots "husky=ros2, scout"
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.description = (
        "Make a folder with a mission, its team, a world to simulate and a rover's program. What "
        "no option answers is asked for on a terminal. Nothing is overwritten."
    )
    parser.epilog = _EPILOG
    parser.add_argument(
        "folder", type=Path, nargs="?", metavar="FOLDER", help="where (default mission)"
    )
    parser.add_argument("--home", type=home, metavar="LAT,LON", help="where the vehicle takes off")
    parser.add_argument(
        "--altitude", type=altitude, metavar="M", help="cruise altitude above home (default 30)"
    )
    parser.add_argument("--uav", type=name, metavar="NAME", help="its name (default titan)")
    parser.add_argument(
        "--robots",
        type=robots,
        metavar="NAMES",
        help="whom it seeks, each with what it speaks, json, ros1 or ros2 (default rover=json)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Ask, write, and say how to go on."""
    answers = answered(arguments, input if sys.stdin.isatty() else None)
    folder, uav, kinds = answers["folder"], answers["uav"], answers["robots"]
    if uav in kinds:
        raise UsageError(f"'{uav}' is the vehicle's name; give the robot another one")
    texts = texts_of(answers["home"], answers["altitude"], uav, kinds)
    there = [str(folder / file) for file in texts if (folder / file).exists()]
    if there:
        raise UsageError(f"{', '.join(there)}: there already; choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in texts.items():
        with (folder / file).open("x", encoding="utf-8") as made:
            made.write(text)
        print(folder / file)
    load_mission(folder / "mission.yaml")
    _say_next(folder, answers["home"], kinds)
    return ExitCode.DONE


def _say_next(folder: Path, at: Geodetic, kinds: dict[str, str]) -> None:
    robot, kind = next(iter(kinds.items()))
    endpoint, place = f"ipc:///tmp/{robot}", first_places(len(kinds))[0]
    where = f"{place.east_m:.0f},{place.north_m:.0f}"
    if kind != "ros2":
        where = ",".join(map(degrees_text, LocalFrame(at).to_geodetic(place)))
    mission, program = folder / "mission.yaml", folder / ROVERS[kind]
    lines = [
        "next:",
        f"  air-router check {mission}",
        f"  air-router sim {mission}",
        f"with a program of yours as {robot} (docs/robot.md):",
        f"  air-router sim {mission} --rover {robot}={endpoint}",
    ]
    if kind == "ros2":
        lines.append(f"  mocha-link bridge ros2 --node {endpoint} --domain 7")
        endpoint = "7"
    lines.append(f"  python {program} {endpoint} {where}")
    sys.stderr.write("\n".join(lines) + "\n")
