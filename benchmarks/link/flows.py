"""`python -m benchmarks.link.flows`: what datagrams alone carry, on simulated links.

64 links of 0.25 to 50 Mbit/s, 10 to 600 ms and no to 20 % loss. In each a robot requests 2 MB
at its first contact, then at a later one with what the first has shown, then for 100 messages of
1 KB. Deterministic: two states of the code are compared by the JSON that each has written.

    python -m benchmarks.link.flows --json before.json
    python -m benchmarks.link.flows --against before.json
"""

import argparse
import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.link.flow_sim import MBIT, End, Way, World

RATES_MBIT_S = (0.25, 1.0, 8.0, 50.0)
RTTS_S = (0.01, 0.1, 0.3, 0.6)
LOSSES = (0.0, 0.05, 0.1, 0.2)
QUEUE_PACKETS = 20
QUEUE_LEAST_S = 0.05  # a shorter wait in a queue is of no use to anybody
PACKET_BYTES = 1_500
BULK_BYTES = 2_000_000
WINDOW_BYTES = 256 * 1024  # that datagrams carry of a later contact: sync/flows.py
SMALL = 100, 1_000  # messages, bytes of each
OPENING_BYTES = 1_100
LONGEST_S = 5.0
MEMORY_S = 1.0  # the length of the contact of which a later one knows the link
SMALL_LIMIT_S = 20.0

# What datagrams serve; the other figures are of what TCP carries.
GROUPS: Mapping[str, Callable[[str, "Link"], bool]] = {
    "contact of 1 s": lambda figure, _: figure.endswith(" 1 s"),
    "first 256 KB": lambda figure, _: figure.endswith("256 KB"),
    "100 x 1 KB": lambda figure, _: figure.endswith("small"),
    "loss >= 5 %": lambda figure, link: link.loss > 0.0 and figure.endswith(" 5 s"),
    "bulk, no loss": lambda figure, link: not link.loss and figure.endswith(" 5 s"),
    "of what left": lambda figure, _: figure.endswith("useful"),
    "short queues": lambda figure, _: figure.endswith("queue"),
}


@dataclass(frozen=True)
class Link:
    mbit_s: float
    rtt_s: float
    loss: float

    @property
    def name(self) -> str:
        return f"{self.mbit_s:g} Mbit/s, {self.rtt_s * 1e3:g} ms, {self.loss:.0%}"


LINKS = tuple(itertools.starmap(Link, itertools.product(RATES_MBIT_S, RTTS_S, LOSSES)))


class Contact:
    """A robot requests, and another one that serves it sends what it has."""

    def __init__(
        self, link: Link, frames: Iterator[int], known: Mapping[str, Any], seed: int
    ) -> None:
        self._left = list(frames)[::-1]
        self._requested: list[bytes] = []
        self.world = World()
        rate = link.mbit_s * MBIT
        queue = max(QUEUE_PACKETS * PACKET_BYTES, rate * link.rtt_s)
        ways = [
            Way(
                self.world,
                rate,
                link.rtt_s / 2,
                queue_bytes=queue,
                loss=link.loss,
                seed=2 * seed + k,
            )
            for k in (0, 1)
        ]
        self.way = ways[0]
        request = iter([bytes(OPENING_BYTES)])
        # A peer without an address token is unproven, as in `sync.flows`.
        self.server = End(
            self.world, ways[0], self._answer, self._requested, proven=bool(known), **known
        )
        self.client = End(self.world, ways[1], lambda _: next(request, None))
        self.client.join(self.server)
        self.client.flow.on_contact(0.0)
        self.client.go()

    def _answer(self, room: int) -> bytes | None:
        if not self._requested or not self._left:
            return None
        size = self._left.pop()
        if size > room:
            self._left.append(size - room)
            size = room
        return bytes(size)

    def run(self, until_s: float) -> "Contact":
        self.world.run(until_s)
        return self

    @property
    def memory(self) -> dict[str, Any]:
        flow = self.server.flow
        return {"rate_bytes_s": flow.rate_bytes_s, "rtt_s": flow.rtt_s}

    def bytes_s(self, by_s: float, size: int = BULK_BYTES) -> float:
        """The rate of the first `size` bytes: what was there in time, by the time that it took."""
        total, at_s = 0, by_s
        for frame, came_s in zip(self.client.got, self.client.got_s, strict=True):
            if came_s > by_s or total >= size:
                break
            total, at_s = total + len(frame), came_s
        return total / (at_s if total >= size else by_s)


def measure(link: Link, seed: int) -> dict[str, float]:
    """Figures of one link; the larger the better."""
    first = Contact(link, iter([BULK_BYTES]), {}, seed).run(MEMORY_S)
    known = first.memory
    figures = {}
    for name, contact in (
        ("first", first),
        ("later", Contact(link, iter([BULK_BYTES]), known, seed)),
    ):
        contact.run(LONGEST_S)
        for by_s in (1.0, LONGEST_S):
            figures[f"{name}, {by_s:g} s"] = contact.bytes_s(by_s)
        figures[f"{name}, 256 KB"] = contact.bytes_s(LONGEST_S, WINDOW_BYTES)
        figures[f"{name}, queue"] = 1 / (QUEUE_LEAST_S + contact.way.queued_s)
        figures[f"{name}, useful"] = contact.client.bytes / max(contact.server.flow.bytes_out, 1)
    for name, memory in (("first", {}), ("later", known)):
        small = Contact(link, iter([SMALL[1]] * SMALL[0]), memory, seed)
        size = SMALL[0] * SMALL[1]
        figures[f"{name}, small"] = small.run(SMALL_LIMIT_S).bytes_s(SMALL_LIMIT_S, size)
    return figures


def _one(task: tuple[Link, int]) -> dict[str, float]:
    return measure(*task)


def all_figures(seeds: int, jobs: int) -> dict[str, dict[str, float]]:
    """By link: the mean of the seeds; without loss one is as good as many."""
    tasks = [(link, seed) for link in LINKS for seed in range(seeds if link.loss else 1)]
    with ProcessPoolExecutor(jobs) as pool:
        found = list(pool.map(_one, tasks, chunksize=2))
    figures: dict[str, dict[str, float]] = {}
    for link in LINKS:
        rows = [row for (of, _), row in zip(tasks, found, strict=True) if of == link]
        figures[link.name] = {name: sum(row[name] for row in rows) / len(rows) for name in rows[0]}
    return figures


def compared(
    now: Mapping[str, Mapping[str, float]], before: Mapping[str, Mapping[str, float]]
) -> Iterator[str]:
    """Per group: the mean change, and the cell that lost most."""
    for group, belongs in GROUPS.items():
        ratios = {
            (link.name, figure): value / before[link.name][figure]
            for link in LINKS
            for figure, value in now[link.name].items()
            if belongs(figure, link) and before[link.name][figure] > 0
        }
        if not ratios:
            continue
        mean = math.exp(sum(math.log(max(r, 1e-3)) for r in ratios.values()) / len(ratios))
        worst = sorted(ratios, key=ratios.__getitem__)[:3]
        cells = "; ".join(f"{ratios[cell] - 1:+.0%} {cell[0]}, {cell[1]}" for cell in worst)
        yield f"{group:<16}{mean - 1:+7.2%}   {len(ratios)} cells, least: {cells}"


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures there")
    parser.add_argument("--against", type=Path, metavar="FILE", help="compare with these")
    parser.add_argument("--seeds", type=int, default=6, help="of losses, each cell")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    figures = all_figures(options.seeds, options.jobs)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1), encoding="utf-8")
    if options.against:
        before = json.loads(options.against.read_text(encoding="utf-8"))
        print("\n".join(compared(figures, before)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
