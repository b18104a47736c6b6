"""How long a hundred small messages take at 100 ms: where every round trip shows."""

from collections.abc import Iterator, Sequence

from benchmarks.link.cell import Task
from benchmarks.link.links import Link
from benchmarks.link.score import Score

HUNDRED = (100, 1_000)  # messages, and bytes of each
WAYS = ("original", "old-peer", "new", "tcp", "zenoh")
_SLOW_S, _FAST_S = 60.0, 8.0  # the original way needs 41 s
_SEED = 1


def link_for(way: str) -> Link:
    return Link(0.1, 10e6, _SLOW_S if way == "original" else _FAST_S, contacts=1)


def tasks(ways: Sequence[str]) -> list[Task]:
    return [Task(way, link_for(way), _SEED, equal=HUNDRED) for way in ways if way in WAYS]


def lines(scores: Sequence[Score]) -> Iterator[str]:
    yield "100 messages of 1 KB, 100 ms, 10 Mbit/s: from the begin of the contact"
    for score in sorted(scores, key=lambda score: WAYS.index(score.way)):
        all_here = "nothing" if score.last_s is None else f"{score.last_s:.2f} s"
        text = f"  {score.way:<12}{score.messages} messages in {all_here}"
        yield text + (f", pull ended at {score.ended_s:.2f} s" if score.ended_s else "")
