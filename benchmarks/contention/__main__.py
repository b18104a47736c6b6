"""Message waits of teams of the paper's table, by experiments and by real nodes.

    python -m benchmarks.contention                  # six teams, ten minutes each, all at once
    python -m benchmarks.contention --rows radius_m=10 ugvs=3,5 --seeds 3 --minutes 30
    python -m benchmarks.contention --timeout 5      # nodes give up a pull that waits so long
    python -m benchmarks.contention --json

An experiment determines when robots meet and what they publish; real nodes in processes, whose TCP
connections share one channel, do the same in real time (`benchmarks.contention.replay`). The ratio
is of geometric means over runs, with a 95 % interval. The machine should be idle: an event
that is more than a tenth of a second late is reported: latencies are of that order.
"""

from __future__ import annotations

import argparse
import asyncio
import csv
import io
import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from air_router.errors import AirRouterError
from benchmarks.contention.planned import Measures, Planned, planned, tasks_of
from benchmarks.contention.replay import Replayed, replay
from sitl.experiment.analysis import student_t

ROWS: Final = ("radius_m=20", "ugvs=3,5,10", "uavs=1,2")
MEASURES: Final = {
    "waits": "messages",
    "wait_mean_s": "wait, mean, s",
    "wait_sd_s": "wait, standard deviation, s",
    "delay_mean_s": "wait and transmission, mean, s",
    "exchanges_complete": "complete exchanges",
    "exchanges_complete_percent": "exchanges that are complete, %",
    "sent_MB": "megabytes",
    "channel_busy_percent": "channel in use, %",
}
LATE_S: Final = 0.1
LEAST: Final = 0.1


@dataclass(frozen=True, slots=True)
class Pair:
    """A run by both: the row's label, its seed, and the measures of each."""

    label: str
    seed: int
    experiment: Measures
    nodes: Measures
    late_s: float


@dataclass(frozen=True, slots=True)
class Ratio:
    """Real nodes over experiments: geometric means, and their ratio with its 95 % interval."""

    experiment: float
    nodes: float
    value: float
    low: float
    high: float


def ratio_of(key: str, pairs: Sequence[Pair]) -> Ratio:
    """How much a measure of real nodes is of that of experiments; runs without it are left out."""
    both = np.array([(pair.experiment[key] or 0.0, pair.nodes[key] or 0.0) for pair in pairs])
    logs = np.log(both[(both > 0).all(axis=1)])
    count = len(logs)
    if count < 2:
        return Ratio(*(math.nan,) * 5)
    apart = logs[:, 1] - logs[:, 0]
    mean, half = apart.mean(), student_t(0.975, count - 1) * apart.std(ddof=1) / math.sqrt(count)
    means = np.exp(logs.mean(axis=0)).tolist()
    return Ratio(*means, *(math.exp(each) for each in (mean, mean - half, mean + half)))


def table(pairs: Sequence[Pair]) -> str:
    """The table of all measures, as Markdown."""
    lines = [
        "| per run, geometric means | experiments | real nodes | ratio |",
        "|---|---:|---:|---:|",
    ]
    for key, name in MEASURES.items():
        found = ratio_of(key, pairs)
        interval = f"{found.value:.2f} ({found.low:.2f} to {found.high:.2f})"
        both = (
            f"{mean:,.0f}" if mean >= 100 else f"{mean:.3g}"
            for mean in (found.experiment, found.nodes)
        )
        lines.append(f"| {name} | {' | '.join(both)} | {interval} |")
    return "\n".join(lines)


def csv_text(pairs: Sequence[Pair]) -> str:
    """A line for each run, with every measure of both."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = [f"{key} {which}" for key in MEASURES for which in ("experiment", "nodes")]
    writer.writerow(["row", "seed", *heads])
    for pair in pairs:
        both = [one[key] or 0 for key in MEASURES for one in (pair.experiment, pair.nodes)]
        writer.writerow([pair.label, pair.seed, *(f"{value:.6g}" for value in both)])
    return text.getvalue()


async def _replay_all(plans: Sequence[Planned], timeout_s: float | None) -> list[Replayed]:
    start = asyncio.Barrier(len(plans))
    async with asyncio.TaskGroup() as group:
        tasks = [
            group.create_task(replay(plan, start=start, timeout_s=timeout_s)) for plan in plans
        ]
        progress = asyncio.create_task(_show_progress())
        await asyncio.gather(*tasks)
        progress.cancel()
    return [task.result() for task in tasks]


async def _show_progress() -> None:
    began_s = time.monotonic()
    while True:
        await asyncio.sleep(60)
        sys.stderr.write(f"{(time.monotonic() - began_s) / 60:.0f} minutes\n")


def _count(text: str) -> int:
    """A whole number from 1 on."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no whole number from 1 on")
    return int(text)


def _duration(text: str) -> float:
    """Minutes or seconds, a tenth of one at least."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not LEAST <= value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is no number from {LEAST} on")
    return value


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.contention",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--rows", nargs="+", default=ROWS, help=f"of table1 ({' '.join(ROWS)})")
    parser.add_argument("--first-seed", type=_count, default=1, help="number of the first seed (1)")
    parser.add_argument("--seeds", type=_count, default=1, help="runs of each row (1)")
    parser.add_argument("--minutes", type=_duration, default=10.0, help="of each run (10)")
    parser.add_argument(
        "--timeout", type=_duration, help="of nodes' pulls, s (none while in contact)"
    )
    parser.add_argument("--csv", type=Path, help="also write the runs into this file")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    numbers = range(options.first_seed, options.first_seed + options.seeds)
    try:
        tasks = tasks_of("table1", options.rows, numbers)
    except AirRouterError as error:
        parser.error(str(error))
    sys.stderr.write(f"{len(tasks)} runs of {options.minutes:g} minutes\n")
    plans = [planned(task, 60 * options.minutes) for task in tasks]
    found = asyncio.run(_replay_all(plans, options.timeout))
    pairs = [
        Pair(plan.label, plan.seed, plan.measures, real.measures, real.late_s)
        for plan, real in zip(plans, found, strict=True)
    ]
    for pair in pairs:
        if pair.late_s > LATE_S:
            sys.stderr.write(f"{pair.label}, seed {pair.seed}: up to {pair.late_s:.2f} s late\n")
    if options.csv is not None:
        options.csv.write_text(csv_text(pairs), encoding="utf-8")
    if options.json:
        ratios: Mapping[str, Ratio] = {key: ratio_of(key, pairs) for key in MEASURES}
        plain = {key: asdict(ratio) for key, ratio in ratios.items()}
        print(json.dumps({"ratios": plain, "runs": [asdict(pair) for pair in pairs]}))
    else:
        print(table(pairs))
    return 0


if __name__ == "__main__":
    sys.exit(main())
