"""One cell, in a process of its own: one way on one map. Prints a JSON object.

Times are processor time: what the clock shows on an idle machine, and nearly so on a busy one.
"""

import gc
import json
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.route.maps import Map, made, walled
from benchmarks.route.ways import WAYS, Query, Shortest, bare

_PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6


def main(arguments: list[str]) -> None:
    name, waypoints, zones, repeats = arguments[0], *map(int, arguments[1:])
    map_ = made(waypoints, zones)
    cell = walled_in(map_) if name == "walled" else measured(name, map_, repeats)
    print(json.dumps(cell), flush=True)


def measured(name: str, map_: Map, repeats: int) -> dict[str, Any]:
    gc.collect()
    before_mb = _resident_mb()
    way = WAYS[name](map_)
    first_ms, query = _least_ms(way.build, 1)
    cold_ms, lengths_m = _queried(query, map_)
    after_mb = _resident_mb()
    warm_ms, _ = _queried(query, map_)
    build_ms = min(first_ms, _least_ms(way.build, repeats - 1)[0]) if repeats > 1 else first_ms
    return {
        "build_ms": build_ms,
        "bare_ms": _least_ms(lambda: bare(map_), repeats)[0],
        "cold_median_ms": statistics.median(cold_ms),
        "cold_worst_ms": max(cold_ms),
        "warm_median_ms": statistics.median(warm_ms),
        "warm_worst_ms": max(warm_ms),
        "memory_mb": after_mb - before_mb,
        "lengths_m": lengths_m,
    }


def walled_in(map_: Map) -> dict[str, Any]:
    """The planner `shortest` where its goals are open, behind a tight gate, and walled in."""
    cell: dict[str, Any] = {}
    within, gated = (walled(map_, gate=gate) for gate in (False, True))
    for name, queried, found in (
        ("found", replace(within, pairs=map_.pairs), True),
        ("gate", gated, True),
        ("refused", within, False),
    ):
        gc.collect()
        cell["build_ms"], query = _least_ms(Shortest(queried).build, 1)
        answers = zip(*_queried(query, queried), strict=True)
        times_ms = [took_ms for took_ms, m in answers if (m is not None) == found]
        cell[f"{name}_median_ms"] = statistics.median(times_ms)
        cell[f"{name}_worst_ms"] = max(times_ms)
        cell[f"{name}_answers"] = len(times_ms)
    return cell


def _queried(query: Query, map_: Map) -> tuple[list[float], list[float | None]]:
    times_ms, lengths_m = [], []
    for start, goal in map_.pairs:
        began_s = time.process_time()
        lengths_m.append(query(start, goal))
        times_ms.append((time.process_time() - began_s) * 1e3)
    return times_ms, lengths_m


def _least_ms(function: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    times_ms = []
    for _ in range(repeats):
        began_s = time.process_time()
        result = function()
        times_ms.append((time.process_time() - began_s) * 1e3)
    return min(times_ms), result


def _resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE_MB


if __name__ == "__main__":
    main(sys.argv[1:])
