"""`python -m benchmarks.link.first`: how long first contacts take, with datagrams and without.

Two nodes that have never met; the time from the begin of the contact to the last message, in turns
with the default and with `datagrams=False`. The link carries 80 Mbit/s.
"""

import argparse
import contextlib
import statistics
import sys
from collections.abc import Iterator, Sequence

from benchmarks.link.budget import Budget
from benchmarks.link.cell import PROCESSES, STARVED_NICE, Task, measure
from benchmarks.link.links import Link
from benchmarks.link.load import busy_loops
from benchmarks.link.namespaces import EmulationError, congestion_control
from benchmarks.link.score import Score

CELLS = (  # messages and bytes of each; round trips in s; how long to wait for them, and starved
    ((100, 1_000), (0.05, 0.1, 0.3), 4.0, 20.0),
    ((10, 1_000_000), (0.01, 0.05, 0.2), 12.0, 60.0),
)
RATE_BIT_S = 80e6
WAYS = ("new", "new-tcp")


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.link.first",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--repeat", metavar="N", type=int, default=3, help="contacts of each way in each cell")
    add("--starved", action="store_true", help="run peers at nice 19 beside three busy loops")
    options = parser.parse_args(argv)
    print(f"TCP congestion control: {congestion_control()}; medians of {options.repeat}\n")
    try:
        with busy_loops() if options.starved else contextlib.nullcontext():
            for line in _lines(options.repeat, starved=options.starved):
                print(line, flush=True)
    except EmulationError as error:
        print(f"links cannot be emulated here: {error}", file=sys.stderr)
        return 1
    return 0


def _lines(repeat: int, *, starved: bool) -> Iterator[str]:
    yield f"{'messages, round trip':<30}{'default':>10}{'TCP only':>10}{'times':>8}{'CPU':>8}"
    budget = Budget(PROCESSES)
    for equal, round_trips_s, idle_s, starved_s in CELLS:
        lasts_s = starved_s if starved else idle_s
        for rtt_s in round_trips_s:
            scores: dict[str, list[Score]] = {way: [] for way in WAYS}
            for number in range(repeat):
                link = Link(rtt_s, RATE_BIT_S, lasts_s, contacts=1)
                nice = STARVED_NICE if starved else 0
                for way in WAYS[:: 1 if number % 2 else -1]:
                    task = Task(way, link, number, equal=equal, nice=nice)
                    scores[way].append(measure(task, budget))
            yield _row(equal, rtt_s, [scores[way] for way in WAYS])


def _row(equal: tuple[int, int], rtt_s: float, scores: Sequence[Sequence[Score]]) -> str:
    count, size = equal
    name = f"{count} x {size / 1000:,.0f} KB, {rtt_s * 1e3:g} ms"
    taken = [statistics.median(_taken_s(score, count) for score in each) for each in scores]
    cpu = [statistics.median(score.cores for score in each) for each in scores]
    times = "".join(f"{each:>8.2f} s" for each in taken)
    return f"{name:<30}{times}{taken[0] / taken[1]:>8.2f}{cpu[0] / cpu[1]:>8.2f}"


def _taken_s(score: Score, count: int) -> float:
    """Until the last message; endless if not all arrived."""
    return score.last_s if score.last_s and score.messages == count else float("inf")


if __name__ == "__main__":
    sys.exit(main())
