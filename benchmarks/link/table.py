"""Results as tables for people and rows for programs."""

import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from benchmarks.link.links import Link
from benchmarks.link.load import Load
from benchmarks.link.score import Score

Scores = Mapping[tuple[str, Link], Sequence[Score]]  # several: repeated with other messages
_NONE = "-"


def shares(scores: Scores, ways: Sequence[str], links: Sequence[Link]) -> Iterator[str]:
    """A row for every link, the medians, and the long contacts that brought nothing."""
    yield _row("RTT, rate, contact", ways)
    for link in links:
        cells = [
            _percent(_share(scores[way, link])) if (way, link) in scores else _NONE for way in ways
        ]
        yield _row(link.name, cells)
    if len(links) > 1:
        yield _row("median", [_percent(median(scores, way, links)) for way in ways])
        yield _row(
            "least", [_percent(min(_shares(scores, way, links), default=None)) for way in ways]
        )
    yield _row("contacts >= 3 s with nothing", [_empty(scores, way, links) for way in ways])


def median(scores: Scores, way: str, links: Sequence[Link]) -> float | None:
    found = _shares(scores, way, links)
    return statistics.median(found) if found else None


def conditions(scores: Sequence[Score], load: Load) -> Iterator[str]:
    """How exact the emulators were, and how much the nodes had to wait for a core."""
    if scores:
        medians, highs, worsts = zip(*(score.late_ms for score in scores), strict=True)
        yield (
            f"packets moved late by {statistics.median(medians):.2f} ms in the median, 99 % by "
            f"less than {statistics.median(highs):.2f} ms (on the worst link {max(highs):.1f} ms), "
            f"the latest of all by {max(worsts):.0f} ms"
        )
    if load.waiting is not None:
        yield f"some program of this machine waited for a core {load.waiting:.0%} of the time"
    yield f"took {load.lasted_s:.0f} s"


def as_row(score: Score) -> dict[str, Any]:
    return {**asdict(score), "link": {"name": score.link.name, **asdict(score.link)}}


def _share(scores: Sequence[Score]) -> float:
    allowed = sum(score.allowed_bytes for score in scores)
    return sum(score.delivered_bytes for score in scores) / allowed if allowed else 0.0


def _shares(scores: Scores, way: str, links: Sequence[Link]) -> list[float]:
    return [_share(scores[way, link]) for link in links if (way, link) in scores]


def _empty(scores: Scores, way: str, links: Sequence[Link]) -> str:
    found = [score for link in links for score in scores.get((way, link), ())]
    return f"{sum(s.empty_contacts for s in found)} of {sum(s.contacts for s in found)}"


def _percent(share: float | None) -> str:
    return _NONE if share is None else f"{share * 100:.0f}"


def _row(first: str, cells: Sequence[str]) -> str:
    return f"{first:<30}" + "".join(f"{cell:>12}" for cell in cells)
