"""`sitl rehearse`: flights in which something goes wrong, faster than real time, and a judge."""

from __future__ import annotations

import difflib
import logging
import os
import shlex
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final

import click

from air_router.cli import print_json
from air_router.errors import ExitCode, UsageError
from air_router.flight import StatusLine
from air_router.mission import load_mission
from air_router.report import went_on_without
from air_router.words import progress_text
from mocha_link.cli import PATH, Options, command, option
from sitl.rehearsal import Fault, Scene, SimulatedFlight, scenes
from sitl.rehearsal.judge import End, Verdict, Violation, judge
from sitl.rehearsal.programs import OURS, SPEED, WIRE, RealFlight, WireScene, wire_scenes


def table(verdicts: Iterable[tuple[str, Verdict]], labels: Mapping[str, str]) -> str:
    """Markdown.

    Args:
        verdicts: Of every flight, with the name of the fault that it counts for.
        labels: A line for each fault, in the order of the table.
    """
    verdicts = list(verdicts)
    ends = [end for end in End if any(v.end is end for _, v in verdicts)]
    head = [
        "fault",
        "flights",
        *(end.value for end in ends),
        "closest to a zone or fence",
        "not as it should",
    ]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for fault, line in labels.items():
        mine = [verdict for name, verdict in verdicts if name == fault]
        if mine:
            lines.append(_row(line, mine, ends))
    lines.append(_row("**all**", [verdict for _, verdict in verdicts], ends))
    return "\n".join(lines)


def _row(name: str, verdicts: list[Verdict], ends: list[End]) -> str:
    counts = Counter(verdict.end for verdict in verdicts)
    closest_m = [v.closest_m for v in verdicts if v.closest_m is not None]
    closest = f"{min(closest_m):.1f} m" if closest_m else ""
    bad = sum(not verdict.good for verdict in verdicts)
    cells = [name, len(verdicts), *(counts[end] or "" for end in ends), closest, bad]
    return f"| {' | '.join(map(str, cells))} |"


MOST_VIOLATIONS: Final = 3
"""So many of a flight's are printed; all of them are in --json."""


@command(
    "Fly a mission many times with the real flight program and the simulated PX4 in one process, "
    "faster than real time, each time with a different fault. An independent judge evaluates each "
    "flight by the true track, the messages and the mission file. Prints a table.",
    "examples:\n"
    "  sitl rehearse missions/pennovation/mission.yaml\n"
    "  sitl rehearse missions/pennovation/mission.yaml --fault GUSTS --seed 3",
)
@click.argument("mission", type=PATH, help="mission file (.yaml)")
@option(
    "--share",
    type=float,
    metavar="X",
    default=1.0,
    help="fraction of the flights to fly, 0 to 1 (default 1: all)",
)
@option(
    "--fault",
    multiple=True,
    metavar="NAME",
    help="fly only flights with this fault; may be repeated",
)
@option("--seed", type=int, metavar="N", help="fly only the flight with this number for each fault")
@option(
    "--jobs",
    type=int,
    metavar="N",
    default=os.cpu_count() or 1,
    help="number of processes (default: number of CPUs)",
)
@option(
    "--mavlink",
    is_flag=True,
    help="run `air-router fly` over UDP against `sitl vehicle`, with other scenes",
)
@option("--px4", metavar="PATH", help="like --mavlink, against a real PX4 (see `sitl px4 --help`)")
@option(
    "--companion",
    metavar="COMMAND",
    help="with --mavlink or --px4: judge another air-router, started with this "
    'command ("env PYTHONPATH=OLD python -m air_router.cli"); use a low --speed, as the clock '
    "does not wait for it",
)
@option(
    "--speed",
    type=float,
    metavar="X",
    default=SPEED,
    help=f"speed with --mavlink and --px4, times real time (default {SPEED:g})",
)
@option("--json", is_flag=True, help="print one JSON object per flight instead of the table")
def run(arguments: Options) -> int:
    """Rehearse, and print the table of outcomes. Raises UsageError or DocumentError."""
    load_mission(arguments.mission)  # one error instead of one for each flight
    began_s, verdicts, status = time.monotonic(), [], StatusLine()
    programs = bool(arguments.mavlink or arguments.px4)
    count, flown = _flown_by_programs(arguments) if programs else _flown(arguments)
    if not count:
        raise _no_flight(arguments, [fault.name for fault in (WIRE if programs else Fault)])
    for scene, verdict in flown:
        verdicts.append((scene.fault.name, verdict))
        if arguments.json:
            print_json(_as_json(scene, verdict))
            sys.stdout.flush()
        for violation in verdict.violations[:MOST_VIOLATIONS]:
            status.print_line(f"{verdict.scene}: {verdict.end.value}: {violation}")
        if programs and verdict.good:  # one takes a minute
            status.print_line(f"{verdict.scene}: {verdict.end.value}: good")
        if lost := went_on_without(verdict.pace):
            status.print_line(f"{verdict.scene}: the clock {lost}")
        elapsed_s = time.monotonic() - began_s
        status.show(partial(progress_text, len(verdicts), count, "flights", elapsed_s))
    status.end()
    if not arguments.json:
        descriptions = {fault.name: fault.value.description for fault in Fault}
        sys.stdout.write(table(verdicts, descriptions) + "\n")
    status.print_line(f"{len(verdicts)} flights in {time.monotonic() - began_s:.0f} s")
    good = all(verdict.good for _, verdict in verdicts)
    return ExitCode.DONE if good else ExitCode.ENDED_OTHERWISE


def _no_flight(arguments: Options, known: Sequence[str]) -> UsageError:
    """Why no flight is chosen."""
    unknown = [name for name in arguments.fault if name not in known]
    if not unknown:
        return UsageError("no flight has this seed; leave --seed out")
    near = difflib.get_close_matches(unknown[0].upper(), known)
    return UsageError(
        f"there is no fault '{unknown[0]}' here; "
        + (f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(known)}")
    )


def _flown(arguments: Options) -> tuple[int, Iterator[tuple[Scene, Verdict]]]:
    """How many scenes there are, and each, flown in processes of ours."""
    chosen = [
        scene
        for scene in scenes(arguments.share, arguments.seed)
        if not arguments.fault or scene.fault.name in arguments.fault
    ]
    return len(chosen), _in_processes(partial(fly, arguments.mission), chosen, arguments.jobs)


def _in_processes(
    fly_one: Callable[[Scene], Verdict], chosen: Sequence[Scene], jobs: int
) -> Iterator[tuple[Scene, Verdict]]:
    if jobs <= 1:
        yield from zip(chosen, map(fly_one, chosen), strict=True)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from zip(chosen, pool.map(fly_one, chosen, chunksize=2), strict=True)


def fly(path: Path, scene: Scene) -> Verdict:
    """Fly one scene of a mission, and judge it."""
    logging.disable(logging.ERROR)  # faults on purpose are not reported a second time
    try:
        return judge(SimulatedFlight(scene, path).fly())
    except Exception as error:  # noqa: BLE001 - one flight must not lose the verdicts of the others
        return _not_flown(str(scene), frozenset(fault.name for fault in scene.faults), error)
    finally:
        logging.disable(logging.NOTSET)


def _flown_by_programs(arguments: Options) -> tuple[int, Iterator[tuple[WireScene, Verdict]]]:
    """How many scenes there are, and each, flown by the real programs in processes of its own."""
    chosen = [
        scene
        for scene in wire_scenes(arguments.share)
        if (not arguments.fault or scene.fault.name in arguments.fault)
        and arguments.seed in {None, scene.seed}
    ]
    path = arguments.mission.absolute()
    companion = shlex.split(arguments.companion) if arguments.companion else OURS

    def fly_one(scene: WireScene) -> Verdict:
        try:
            return judge(RealFlight(scene, path, arguments.speed, arguments.px4, companion).fly())
        except Exception as error:  # noqa: BLE001 - as in `fly`
            return _not_flown(str(scene), scene.judged, error)

    def flown() -> Iterator[tuple[WireScene, Verdict]]:
        # Threads only wait for the programs; of PX4s one flies at a time.
        with ThreadPoolExecutor(1 if arguments.px4 else arguments.jobs) as pool:
            yield from zip(chosen, pool.map(fly_one, chosen), strict=True)

    return len(chosen), flown()


def _not_flown(scene: str, faults: frozenset[str], error: Exception) -> Verdict:
    """The verdict where the rehearsal itself failed."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    text = f"{error!r} at {Path(where.filename).name}:{where.lineno}"
    return Verdict(scene, faults, End.NOT, (Violation(0.0, "evidence", text),))


def _as_json(scene: Scene, verdict: Verdict) -> dict[str, object]:
    closest_m = verdict.closest_m
    return {
        "scene": verdict.scene,
        "fault": scene.fault.name,
        "end": verdict.end.name,
        "good": verdict.good,
        "violations": [str(violation) for violation in verdict.violations],
        "closest_m": None if closest_m is None else round(closest_m, 2),
        "flown_s": round(verdict.flown_s, 1),
        "said": verdict.last_line,
        "pace": verdict.pace,
    }
