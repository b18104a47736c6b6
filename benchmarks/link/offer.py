"""What the first node holds and the second one wants: many messages, from 100 B to 100 KB."""

import math
import random
from dataclasses import dataclass, field

from benchmarks.link.links import Link

SMALLEST_BYTES, LARGEST_BYTES = 100, 100_000
LEAST_MESSAGES = 100
SPARE = 1.25  # so much more than the contacts can carry is offered, so that no way runs out
TOPICS_PER_ROBOT = 250  # a team has at most 256 topics; the rest are messages of other robots


@dataclass(frozen=True, slots=True)
class Offer:
    """Incompressible messages of log-uniform sizes, the same for the same seed.

    100 of them (1.5 MB) on a slow link, more of the same sizes where the contacts carry more.
    """

    count: int
    seed: int
    sizes: tuple[int, ...] = field(repr=False)

    @classmethod
    def of(cls, count: int, seed: int, *, size: int | None = None) -> "Offer":
        chance = random.Random(f"{seed} sizes")
        span = math.log(LARGEST_BYTES / SMALLEST_BYTES)
        sizes = tuple(
            size or round(SMALLEST_BYTES * math.exp(chance.random() * span)) for _ in range(count)
        )
        return cls(count, seed, sizes)

    @classmethod
    def for_link(cls, link: Link, seed: int) -> "Offer":
        count = LEAST_MESSAGES
        while sum(cls.of(count, seed).sizes) < SPARE * link.capacity_bytes:
            count = round(count * 1.1)
        return cls.of(count, seed)

    @property
    def total_bytes(self) -> int:
        return sum(self.sizes)

    def data(self, key: int) -> bytes:
        return random.Random(f"{self.seed} {key}").randbytes(self.sizes[key])


def place(key: int) -> tuple[int, int]:
    """Which robot's message it is (0: the first node's own), and which of its topics."""
    return divmod(key, TOPICS_PER_ROBOT)
