"""Routes: the first query to a map, and how long a map takes to build."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.fleet.processes import HERE
from benchmarks.goals.figure import Conditions, Figure, UnmeasuredError

WAYPOINTS, REPEATS = 20, 3
MEDIANS_MS = {20: 0.1, 100: 0.3, 500: 1.0}
WORST_ZONES, WORST_MS = (20, 100, 500, 1000), 15  # and the four walls around a goal
CLIFFS = {"found": "there is a way", "gate": "through a gate", "refused": "walled in"}
BUILT_ZONES, BUILT_S = 5000, 4
LIMIT_S = 300


def measure(conditions: Conditions) -> Iterator[Figure]:
    """Processor times, so that they hold on a busy machine as well."""
    against = conditions.against
    bare_ms: dict[int, float] = {}
    for zones, goal_ms in list(MEDIANS_MS.items())[: 1 if conditions.quick else None]:
        cell = _cell("shortest", zones)
        bare_ms[zones] = cell["bare_ms"]
        anchors = {"shapely's part of a build": cell["bare_ms"]}
        if against:
            anchors[against.name] = _cell("shortest", zones, against)["cold_median_ms"]
        what = f"{zones} zones: first question, median"
        yield Figure(what, cell["cold_median_ms"], "ms", goal_ms, anchors=anchors)
    for zones in WORST_ZONES[: 1 if conditions.quick else None]:
        cell = _cell("walled", zones)
        other = _cell("walled", zones, against) if against else {}
        for name, case in CLIFFS.items():
            anchors = {"the build": cell["build_ms"]}
            if against:
                anchors[against.name] = other[f"{name}_worst_ms"]
            what = f"{zones + 4} zones: {case}, worst"
            yield Figure(what, cell[f"{name}_worst_ms"], "ms", WORST_MS, anchors=anchors)
    if not conditions.quick:
        cell = _cell("shortest", BUILT_ZONES, repeats=1)
        anchors = {"shapely's part of it": cell["bare_ms"] / 1e3}
        yield Figure(
            f"{BUILT_ZONES} zones built", cell["build_ms"] / 1e3, "s", BUILT_S, anchors=anchors
        )


def _cell(name: str, zones: int, checkout: Path = HERE, repeats: int = REPEATS) -> dict[str, Any]:
    """What benchmarks.route measures of one map, with the code of a checkout."""
    command = [sys.executable, "-W", "ignore", "-m", "benchmarks.route.measure", name]
    done = subprocess.run(  # noqa: S603 - ourselves
        [*command, str(WAYPOINTS), str(zones), str(repeats)],
        capture_output=True,
        text=True,
        cwd=checkout,
        env=os.environ | {"PYTHONPATH": str(checkout)},
        timeout=LIMIT_S,
        check=False,
    )
    if done.returncode:
        raise UnmeasuredError(done.stderr.strip()[-200:])
    result: dict[str, Any] = json.loads(done.stdout)
    return result
