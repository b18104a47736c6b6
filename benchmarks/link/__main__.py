"""`make bench-link`: share of a radio contact's capacity that several transports use.

Every transport (way) runs over the same emulated links, with real sockets of this kernel. The share
is the bytes of complete messages divided by rate x (contact time - one round trip), summed over the
contacts, in percent.
"""

import argparse
import contextlib
import json
import sys
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.link import links as known
from benchmarks.link import small, table
from benchmarks.link.cell import STARVED_NICE, Task
from benchmarks.link.load import Load, busy_loops
from benchmarks.link.namespaces import EmulationError, congestion_control
from benchmarks.link.runner import run
from benchmarks.link.score import Score
from benchmarks.link.ways import WAYS

SEED = 3


def main(argv: Sequence[str] | None = None) -> int:
    options = _options(argv)
    try:
        chosen = _links(options)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    ways = list(_ways(options))
    print(__doc__.strip().partition("\n")[2].strip())
    print(f"TCP congestion control: {congestion_control()}; gaps of {options.gap:g} s\n")
    for name in ways:
        print(f"{name:<12}{WAYS[name].what}")
    load = Load()
    tasks = _tasks(options, ways, chosen)
    try:
        with busy_loops() if options.starved else contextlib.nullcontext():
            scores = _measure(tasks, options.cores)
    except EmulationError as error:
        print(f"links cannot be emulated here: {error}", file=sys.stderr)
        return 1
    print("\n".join(_lines(scores, ways, chosen)))
    for line in table.conditions([score for _, score in scores], load):
        print(line)
    if options.json:
        rows = [{"equal": task.equal, **table.as_row(score)} for task, score in scores]
        options.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return 0 if len(scores) == len(tasks) else 1


def _tasks(
    options: argparse.Namespace, ways: Sequence[str], chosen: Sequence[known.Link]
) -> list[Task]:
    tasks = [
        Task(way, link, zlib.crc32(f"{options.seed + number} {link.name}".encode()))
        for number in range(options.repeat)
        for way in ways
        for link in chosen
    ]
    tasks = tasks if options.loss else tasks + small.tasks(ways)
    return [replace(task, nice=STARVED_NICE if options.starved else 0) for task in tasks]


def _lines(
    scores: Sequence[tuple[Task, Score]], ways: Sequence[str], chosen: Sequence[known.Link]
) -> Iterator[str]:
    by_link: dict[tuple[str, known.Link], list[Score]] = {}
    for task, score in scores:
        if not task.equal:
            by_link.setdefault((task.way, task.link), []).append(score)
    yield ""
    yield from table.shares(by_link, ways, chosen)
    yield ""
    hundred = [score for task, score in scores if task.equal]
    if hundred:
        yield from small.lines(hundred)
        yield ""


def _measure(tasks: Sequence[Task], cores: float | None) -> list[tuple[Task, Score]]:
    scores = []
    for done in run(tasks, cores=cores, failed=_complain):
        scores.append(done)
        if sys.stderr.isatty():
            print(f"\r{len(scores)} of {len(tasks)} ", end="", file=sys.stderr, flush=True)
    return scores


def _complain(task: Task, why: str) -> None:
    print(f"{task.way} on {task.link.name}: {why}", file=sys.stderr)


def _ways(options: argparse.Namespace) -> Iterator[str]:
    for name in options.only or [way.name for way in WAYS.values() if way.usual]:
        missing = WAYS[name].missing
        if missing:
            print(f"{name}: skipped, {missing} is not installed (extra 'bench')", file=sys.stderr)
        else:
            yield name


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.link",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--quick", action="store_true", help="only a few links, in less than two minutes")
    add(
        "--loss",
        action="store_true",
        help="links of 1 Mbit/s, 50 ms, 10 s with 1 to 20 %% packet loss",
    )
    add("--json", metavar="FILE", type=Path, help="also write all results to FILE")
    add(
        "--only",
        metavar="WAY",
        action="append",
        choices=tuple(WAYS),
        help="run only this way (repeatable)",
    )
    add(
        "--links",
        metavar="SUBSET",
        help="only these links: RTT ms/Mbit/s/contact s, * for any, e.g. 50/1/3,300/*/1",
    )
    add("--gap", metavar="S", type=float, default=known.GAP_S, help="seconds between contacts")
    add("--repeat", metavar="N", type=int, default=1, help="runs with different messages, pooled")
    add("--seed", type=int, default=SEED, help="seed of messages and packet loss")
    add("--starved", action="store_true", help="run peers at nice 19 beside three busy loops")
    add("--cores", metavar="N", type=float, help="cores that concurrent contacts may use")
    return parser.parse_args(argv)


def _links(options: argparse.Namespace) -> tuple[known.Link, ...]:
    links = known.LOSSY if options.loss else known.QUICK if options.quick else known.ALL
    if options.links:
        links = known.chosen(options.links, known.LOSSY if options.loss else known.ALL)
    return tuple(link.with_gap(options.gap) for link in links)


if __name__ == "__main__":
    sys.exit(main())
