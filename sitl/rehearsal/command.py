"""`sitl rehearse`: flights in which something goes wrong, faster than real time, and a judge."""

from __future__ import annotations

import argparse
import functools
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from air_router.errors import ExitCode
from air_router.graph import WaypointGraph
from air_router.mission import load_mission
from air_router.router import Router
from sitl.rehearsal.faults import Scene, scenes
from sitl.rehearsal.judge_flight import judge
from sitl.rehearsal.programs.flight import SPEED, RealFlight
from sitl.rehearsal.programs.scenes import WireScene, wire_scenes
from sitl.rehearsal.report import table
from sitl.rehearsal.stage import Stage, hurried

if TYPE_CHECKING:
    from air_router.mission import Mission
    from sitl.rehearsal import judge_flight
    from sitl.rehearsal.judge import Verdict


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `rehearse` to the command line."""
    parser = commands.add_parser(
        "rehearse",
        help="fly a mission hundreds of times while something goes wrong",
        description="Fly a mission with the real controller and the simulated PX4 in one process, "
        "faster than real time; each flight has its own misfortune. A judge that knows only "
        "where the vehicle was and where the zones are says how each went. Prints a table.",
        epilog="examples:\n"
        "  sitl rehearse missions/pennovation/mission.yaml\n"
        "  sitl rehearse missions/pennovation/mission.yaml --fault GUSTS --seed 3",
    )
    parser.add_argument("mission", type=Path, metavar="MISSION", help="mission YAML or .plan")
    parser.add_argument(
        "--share", type=float, default=1.0, metavar="X", help="of the flights (default 1: all)"
    )
    parser.add_argument("--fault", metavar="NAME", action="append", help="only these")
    parser.add_argument("--seed", type=int, metavar="N", help="only this one of each fault")
    parser.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes (default: CPUs)",
    )
    parser.add_argument(
        "--mavlink",
        action="store_true",
        help="fly `air-router fly` over UDP against `sitl vehicle` instead: other scenes",
    )
    parser.add_argument(
        "--px4", metavar="PATH", help="the same against a real PX4 (see `sitl px4 --help`)"
    )
    parser.add_argument(
        "--speed",
        type=float,
        default=SPEED,
        metavar="X",
        help=f"with --mavlink and --px4: times real time (default {SPEED:g})",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object per flight instead")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Rehearse, and print what became of it."""
    if arguments.mavlink or arguments.px4:
        return _run_programs(arguments)
    chosen = [
        scene
        for scene in scenes(arguments.share)
        if (not arguments.fault or scene.fault.name in arguments.fault)
        and arguments.seed in {None, scene.seed}
    ]
    began_s = time.monotonic()
    verdicts = []
    for verdict in rehearse(arguments.mission, chosen, arguments.jobs):
        verdicts.append(verdict)
        if arguments.json:
            sys.stdout.write(json.dumps(_as_json(verdict)) + "\n")
        if not verdict.good:
            sys.stderr.write(f"{verdict.scene}: {verdict.end.value}, {_depth(verdict)}\n")
    if not arguments.json:
        sys.stdout.write(table(verdicts) + "\n")
    sys.stderr.write(f"{len(verdicts)} flights in {time.monotonic() - began_s:.0f} s\n")
    return ExitCode.DONE if all(v.good for v in verdicts) else ExitCode.ENDED_OTHERWISE


def rehearse(path: Path, chosen: Sequence[Scene], jobs: int) -> Iterator[Verdict]:
    """Fly scenes of a mission, in processes of their own where there are several jobs."""
    if jobs <= 1:
        yield from (_fly(path, scene) for scene in chosen)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(functools.partial(_fly, path), chosen, chunksize=4)


def _run_programs(arguments: argparse.Namespace) -> int:
    chosen = [
        scene
        for scene in wire_scenes(arguments.share)
        if (not arguments.fault or scene.fault in arguments.fault)
        and arguments.seed in {None, scene.seed}
    ]
    began_s, bad = time.monotonic(), 0

    def fly(scene: WireScene) -> judge_flight.Verdict:
        path = arguments.mission.absolute()
        return judge(RealFlight(scene, path, arguments.speed, arguments.px4).fly())

    # Threads only wait for the programs; of PX4s one flies at a time.
    with ThreadPoolExecutor(1 if arguments.px4 else arguments.jobs) as pool:
        for verdict in pool.map(fly, chosen):
            bad += not verdict.good
            words = "good" if verdict.good else "; ".join(map(str, verdict.violations))
            sys.stdout.write(f"{verdict.scene}: {verdict.end.value}: {words}\n")
            sys.stdout.flush()
    spent_s = time.monotonic() - began_s
    sys.stderr.write(f"{len(chosen)} flights in {spent_s:.0f} s, {bad} not as they should be\n")
    return ExitCode.ENDED_OTHERWISE if bad else ExitCode.DONE


@functools.cache
def _prepared(path: Path) -> tuple[Mission, Router]:
    mission = hurried(load_mission(path))
    return mission, Router(WaypointGraph(mission))


def _fly(path: Path, scene: Scene) -> Verdict:
    mission, router = _prepared(path)
    return Stage(scene, mission, router).fly()


def _depth(verdict: Verdict) -> str:
    depth_m = verdict.deepest_m
    return f"{abs(depth_m):.1f} m {'inside' if depth_m >= 0 else 'from'} a zone"


def _as_json(verdict: Verdict) -> dict[str, object]:
    return {
        "scene": verdict.scene,
        "fault": verdict.fault,
        "end": verdict.end.name,
        "good": verdict.good,
        "closest_m": None if verdict.flown_s == 0 else round(-verdict.deepest_m, 2),
        "flown_s": round(verdict.flown_s, 1),
        "said": verdict.why,
    }
