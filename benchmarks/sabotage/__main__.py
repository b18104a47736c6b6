"""`make sabotage`: mutation test of the flight code: whether the judge of rehearsals detects it.

Each sabotage breaks the code in one place and flies its scenes until the judge rejects a flight.
These scenes are also flown with the unchanged code, where the judge must accept them. The exit code
is 1 if it does not, or if a sabotage survives all of its scenes. Prints a table.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from benchmarks.patched import ROOT, check
from benchmarks.sabotage.table import SABOTAGES, Sabotage

MISSION = "missions/pennovation/mission.yaml"


def fly(scenes: Iterable[str]) -> Iterator[dict[str, Any]]:
    """Fly scenes, as `FAULT-seed`, with the code as it is imported; the judge's verdict on each."""
    from sitl.cli import fly as flown  # noqa: PLC0415 - changed code is imported late
    from sitl.rehearsal import Fault, Scene  # noqa: PLC0415

    for scene in scenes:
        fault, seed = scene.rsplit("-", 1)
        try:
            verdict = flown(ROOT / MISSION, Scene(Fault[fault], int(seed)))
            found = [str(violation) for violation in verdict.violations]
        except Exception as error:  # noqa: BLE001 - broken code may break in any way
            found = [f"the flight program failed: {type(error).__name__}: {error}"]
        yield {"scene": scene, "found": found}


def run(changes: Iterable[Any], scenes: Iterable[str]) -> Iterator[dict[str, Any]]:
    """Fly scenes in a process of their own with changed code, until one is bad."""
    command = [sys.executable, "-m", "benchmarks.patched", json.dumps(list(changes))]
    command += ["benchmarks.sabotage", "--fly", *scenes]
    process = subprocess.Popen(  # noqa: S603 - our own program
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdout is not None  # noqa: S101 - it is a pipe
        assert process.stderr is not None  # noqa: S101 - as well
        for line in process.stdout:
            yield json.loads(line)
        errors = process.stderr.read()
    if process.returncode:
        raise SystemExit(f"the scenes could not be flown:\n{errors}")


def caught(sabotage: Sabotage) -> tuple[str, str] | None:
    """The scene that shows it, and how; None: it survives."""
    for flight in run(sabotage.changes, ["--until-bad", *sabotage.scenes]):
        if flight["found"]:
            return flight["scene"], flight["found"][0]
    return None


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sabotage", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="run only these sabotages")
    parser.add_argument(
        "--share", type=float, default=1.0, help="fraction to run; 0.25: every fourth"
    )
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="number of parallel sabotages"
    )
    parser.add_argument("--fly", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--until-bad", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.fly:
        for flight in fly(arguments.names):
            print(json.dumps(flight), flush=True)
            if flight["found"] and arguments.until_bad:
                break
        return 0
    unknown = set(arguments.names) - {sabotage.name for sabotage in SABOTAGES}
    if unknown:
        parser.error(f"no sabotage is called {' or '.join(map(repr, sorted(unknown)))}")
    chosen = [s for s in SABOTAGES if not arguments.names or s.name in arguments.names]
    chosen = chosen[:: round(1 / arguments.share)]
    check([change for sabotage in chosen for change in sabotage.changes])
    print("| sabotage | caught by | how |\n|---|---|---|", flush=True)
    with ThreadPoolExecutor(arguments.jobs) as pool:
        survived, catching = 0, set[str]()
        for sabotage, how in zip(chosen, pool.map(caught, chosen), strict=True):
            scene, verdict = how or ("**nothing: it survived**", "")
            print(f"| {sabotage.name} | {scene} | {verdict} |", flush=True)
            survived += how is None
            catching |= set() if how is None else {scene}
        scenes = sorted(catching)
        shares = [s for n in range(arguments.jobs) if (s := scenes[n :: arguments.jobs])]
        flights = [each for flown in pool.map(lambda s: list(run([], s)), shares) for each in flown]
        bad = {flight["scene"]: flight["found"] for flight in flights if flight["found"]}
        for scene, found in bad.items():
            message = f"with the unchanged code {scene} is bad: {found[0]}"
            print(message, file=sys.stderr, flush=True)
    print(
        f"{len(chosen) - survived} of {len(chosen)} caught by {len(scenes)} scenes, "
        f"{len(bad)} of which the unchanged code fails",
        file=sys.stderr,
    )
    return 1 if survived or bad else 0


if __name__ == "__main__":
    sys.exit(main())
