"""Over emulated radio links: how much of what they allow, and how soon after they return.

When the machine is to be busy, the peers are at `nice 19` beside the loops.
"""

import statistics
import sys
import zlib
from collections.abc import Iterator
from dataclasses import replace

from benchmarks.goals.figure import Conditions, Figure, UnmeasuredError
from benchmarks.link import links, small
from benchmarks.link.cell import STARVED_NICE, Task
from benchmarks.link.links import Link
from benchmarks.link.namespaces import EmulationError
from benchmarks.link.runner import run
from benchmarks.link.score import Score

WAYS = ("new", "tcp")
SEED = 3
LOSS = 0.2
FAR_S, LONG_S = 0.3, 10.0
PACKET_BYTES, HEADER_BYTES = 1500, 28  # of a full packet, and of IPv4 and UDP in it
# So short that no contact brings all hundred messages: each has a first one.
RETURNS = (Link(0.1, 1e6, 0.4, contacts=4), Link(0.3, 1e6, 0.9, contacts=3))


def measure(conditions: Conditions) -> Iterator[Figure]:
    """The table of 27 links in four figures, packet loss, small messages, first messages."""
    tables = links.QUICK if conditions.quick else links.ALL
    lossy = tuple(link for link in links.LOSSY if link.loss == LOSS)
    returns = RETURNS[:1] if conditions.quick else RETURNS
    tasks = [
        Task(
            way,
            link,
            zlib.crc32(f"{SEED} {link.name}".encode()),
            equal=small.HUNDRED if link in returns else None,
        )
        for way in WAYS
        for link in (*tables, *lossy, *returns)
    ]
    tasks += small.tasks(WAYS if conditions.quick else ("original", *WAYS))
    nice = STARVED_NICE if conditions.busy else 0
    scores: dict[tuple[str, Link], Score] = {}
    try:
        for task, score in run([replace(each, nice=nice) for each in tasks], failed=_complain):
            scores[task.way, task.link] = score
    except EmulationError as error:
        raise UnmeasuredError(f"links cannot be emulated here: {error}") from error

    def percent(way: str, chosen: tuple[Link, ...]) -> list[float]:
        return [100 * scores[way, link].share for link in chosen if (way, link) in scores]

    def figure(what: str, goal: float, values: dict[str, float]) -> Figure:
        anchors = {"a bare TCP stream": values["tcp"]}
        if "most" in values:
            anchors["whole messages in packets without a header of ours"] = values["most"]
        return Figure(what, values["new"], "%", goal, at_least=True, anchors=anchors)

    medians = {way: statistics.median(percent(way, tables)) for way in WAYS}
    medians["most"] = statistics.median(
        _most_percent(task) for task in tasks if task.way == "new" and task.link in tables
    )
    yield figure(f"{len(tables)} links: median share", 92, medians)
    far = tuple(link for link in tables if link.rtt_s == FAR_S)
    medians = {way: statistics.median(percent(way, far)) for way in WAYS}
    yield figure("round trip of 300 ms: median share", 85, medians)
    yield figure("worst link", 35, {way: min(percent(way, tables)) for way in WAYS})
    yield figure("20 % of packets lost", 70, {way: percent(way, lossy)[0] for way in WAYS})
    yield from _firsts(scores, returns)
    last_s = {
        way: scores[way, small.link_for(way)].last_s
        for way in ("original", *WAYS)
        if (way, small.link_for(way)) in scores
    }
    found_s = {way: value for way, value in last_s.items() if value is not None}
    if "new" in found_s:
        names = {"original": "an original pair", "tcp": "a bare TCP stream"}
        anchors = {names[way]: value for way, value in found_s.items() if way in names}
        yield Figure("100 x 1 KB at 100 ms", found_s["new"], "s", anchors=anchors)


def _most_percent(task: Task) -> float:
    """What could come at most: the messages one after the other, in full packets, none lost."""
    link = task.link
    open_s = (link.window_s - link.rtt_s) * link.contacts
    allowed = link.rate_bytes_s * open_s
    room = allowed * (1 - HEADER_BYTES / PACKET_BYTES)
    whole = 0
    for size in task.offer.sizes:
        if whole + size > room:
            break
        whole += size
    return 100 * whole / allowed


def _firsts(scores: dict[tuple[str, Link], Score], returns: tuple[Link, ...]) -> Iterator[Figure]:
    for link in returns:
        latest_ms = {
            way: 1e3 * max(first or float("inf") for first in scores[way, link].firsts_s)
            for way in WAYS
            if (way, link) in scores
        }
        what = f"first message after a link of {link.rtt_s * 1e3:g} ms returns"
        goal_ms = 2 * link.rtt_s * 1e3 + 50
        anchors = {"a bare TCP stream": latest_ms["tcp"]}
        yield Figure(what, latest_ms["new"], "ms", goal_ms, anchors=anchors)


def _complain(task: Task, why: str) -> None:
    print(f"{task.way} on {task.link.name}: {why}", file=sys.stderr)
