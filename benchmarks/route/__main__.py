"""`make bench-route`: time, length and memory of routes, compared with other programs.

Every planner (way) runs on every map in its own process. Times are CPU times in ms: build is the
minimum of several, queries are median and maximum over 40 pairs, for the first query (cold) and a
repetition. Length is relative to the shortest paths around finely sampled arcs: median and maximum.
Memory is the growth of the process in MB. `x bare` is build divided by its bare shapely calls.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarks.route.ways import PEERS

WAYPOINTS, ZONES = (20, 100, 500, 2000), (3, 20, 100, 500)
TARGETS = (
    *(("shortest", 20, z, "build_ms", most) for z, most in ((20, 8), (100, 60), (500, 550))),
    *(("shortest", 20, z, "cold_median_ms", m) for z, m in ((20, 0.2), (100, 0.8), (500, 3.5))),
    *(("shortest", 20, z, "cold_worst_ms", most) for z, most in ((20, 2), (100, 10), (500, 60))),
    *(
        ("walled", 20, z, f"{name}_worst_ms", 15)
        for z in (20, 100, 500, 1000)
        for name in ("found", "gate", "refused")
    ),
    ("waypoints", 2000, 100, "build_ms", 60),
    ("waypoints", 2000, 500, "build_ms", 1000),
    ("shortest", 20, 500, "memory_mb", 30),
    ("shortest", 20, 500, "ratio_median", 1.0005),
    ("shortest", 20, 500, "ratio_worst", 1.05),
)
CLIFFS = ("found", "gate", "refused")
HEAD = (
    f"{'map':<12}{'way':<21}{'build':>8}{'x bare':>8}{'cold':>8}{'worst':>8}{'warm':>8}"
    f"{'worst':>8}{'length':>9}{'worst':>8}{'none':>6}{'MB':>6}"
)


def main() -> int:
    options = _options()
    print(__doc__.strip().partition("\n")[2].strip())
    print(f"\nload {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors\n\n{HEAD}", flush=True)
    rows = []
    for waypoints, zones in _cells(options):
        reference = _run("arcs", waypoints, zones, options)
        names = ("shortest", "waypoints", *(PEERS if waypoints == WAYPOINTS[0] else ()))
        for name in names:
            row = {"map": f"W{waypoints}_Z{zones}", "way": name}
            row |= _run(name, waypoints, zones, options)
            _compare(row, reference)
            rows.append(row)
            print(_line(row), flush=True)
    rows += _cliffs(options)
    missed = _judge(rows)
    if options.json:
        Path(options.json).write_text(json.dumps(rows, indent=1))
    return 1 if missed and options.strict else 0


def _cliffs(options: argparse.Namespace) -> list[dict[str, Any]]:
    """The worst of 40 first questions: goals that are open, behind a tight gate, walled in."""
    head = f"{'zones':>6}{'build':>9}" + "".join(
        f"{f'{n}: median':>17}{'worst':>8}" for n in CLIFFS
    )
    print(f"\n{head}", flush=True)
    rows = []
    for zones in (20, 100, 500, 1000):
        row = {"map": f"W20_Z{zones}", "way": "walled"} | _run("walled", 20, zones, options)
        rows.append(row)
        times = (f"{row[f'{n}_median_ms']:>17.2f}{row[f'{n}_worst_ms']:>8.1f}" for n in CLIFFS)
        result = row.get("failed") or f"{row['build_ms']:>9.0f}" + "".join(times)
        print(f"{zones + 4:>6}{result}", flush=True)
    return rows


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.route", description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="only four maps, and 5 s for each other program"
    )
    parser.add_argument("--json", metavar="FILE", help="also write the rows to FILE")
    parser.add_argument(
        "--limit", type=float, metavar="S", help="time limit for one way on one map"
    )
    parser.add_argument("--strict", action="store_true", help="exit with 1 if a target is missed")
    return parser.parse_args()


def _cells(options: argparse.Namespace) -> list[tuple[int, int]]:
    if options.quick:
        return [(20, 20), (20, 100), (20, 500), (2000, 100)]
    return [(waypoints, zones) for zones in ZONES for waypoints in WAYPOINTS]


def _run(name: str, waypoints: int, zones: int, options: argparse.Namespace) -> dict[str, Any]:
    limit_s = options.limit or (5 if options.quick and name in PEERS else 60)
    print(f"  {name} on W{waypoints}_Z{zones} ...", end="\r", file=sys.stderr, flush=True)
    command = [sys.executable, "-W", "ignore", "-m", "benchmarks.route.measure", name]
    repeats = 1 if name in {*PEERS, "arcs"} else 5
    command += map(str, (waypoints, zones, repeats))
    try:
        done = subprocess.run(  # noqa: S603 - ourselves
            command, capture_output=True, text=True, timeout=limit_s, check=False
        )
    except subprocess.TimeoutExpired:
        return {"failed": f"not within {limit_s:g} s"}
    finally:
        print(" " * 60, end="\r", file=sys.stderr, flush=True)
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or ["no reason given"]
        return {"failed": last[0][:90]}
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def _compare(row: dict[str, Any], reference: dict[str, Any]) -> None:
    """Lengths by the reference's, and how many paths were not found that it found."""
    lengths_m, best_m = row.pop("lengths_m", None), reference.get("lengths_m")
    if lengths_m is None or best_m is None:
        return
    both = [(own, best) for own, best in zip(lengths_m, best_m, strict=True) if best is not None]
    ratios = [own / best for own, best in both if own is not None and best > 0]
    row["ratio_median"], row["ratio_worst"] = statistics.median(ratios), max(ratios)
    row["not_found"] = sum(own is None for own, _ in both)


def _line(row: dict[str, Any]) -> str:
    if "failed" in row:
        return f"{row['map']:<12}{row['way']:<21}{row['failed']}"
    return (
        f"{row['map']:<12}{row['way']:<21}{row['build_ms']:>8.1f}"
        f"{row['build_ms'] / row['bare_ms']:>8.1f}{row['cold_median_ms']:>8.2f}"
        f"{row['cold_worst_ms']:>8.1f}{row['warm_median_ms']:>8.2f}{row['warm_worst_ms']:>8.1f}"
        f"{row.get('ratio_median', 0):>9.5f}{row.get('ratio_worst', 0):>8.4f}"
        f"{row.get('not_found', 0):>6}{row['memory_mb']:>6.1f}"
    )


def _judge(rows: list[dict[str, Any]]) -> int:
    """Print which targets are met; returns how many are not."""
    found = {(row["way"], row["map"]): row for row in rows}
    missed = sum(row.get("not_found", 0) > 0 for row in rows if row["way"] not in PEERS)
    print(f"\nload {os.getloadavg()[0]:.1f}; targets are for two idle processors")
    for way, waypoints, zones, what, most in TARGETS:
        value = found.get((way, f"W{waypoints}_Z{zones}"), {}).get(what)
        if value is not None:
            missed += value > most
            result = "met" if value <= most else "MISSED"
            print(
                f"{way:<10} W{waypoints}_Z{zones:<5} {what:<17}{value:>10.4g} of {most:<8g}{result}"
            )
    return missed


if __name__ == "__main__":
    sys.exit(main())
