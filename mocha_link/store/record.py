"""What a database holds: one message as it is stored, and what is known of a peer's database."""

from __future__ import annotations

from dataclasses import dataclass

from mocha_link.store.header import Header


@dataclass(frozen=True, slots=True)
class Record:
    """A message as it is stored and passed on: `body` is what the wire carries, untouched.

    `stamp_ms` is when the robot published it, Unix milliseconds below 2**47 that agree with the
    header modulo 65536 s; `received_s` is when we got or made it. `extrapolated`: the stamp
    was guessed from the header by our clock, as that of an original node has to be: if the clock
    was wrong, it is wrong by a multiple of 65536 s, and comparisons bear with that. `body` is a
    read-only view if it came in a buffer of its own.
    """

    header: Header
    priority: int
    body: bytes | memoryview
    stamp_ms: int
    received_s: float
    extrapolated: bool = False

    @property
    def stamp_s(self) -> float:
        """Unix seconds of publication."""
        return self.stamp_ms / 1000


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What we know of a peer's database.

    Everything that it held up to its number `sequence` of its `epoch` has been offered to us. Our
    own last number was `own_sequence` then. Each is a u64; ValueError otherwise.
    """

    epoch: int
    sequence: int
    own_sequence: int

    def __post_init__(self) -> None:
        for value in (self.epoch, self.sequence, self.own_sequence):
            if not 0 <= value < 1 << 64:
                raise ValueError(f"{value} is not within 0 to 2**64 - 1")
