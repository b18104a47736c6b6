"""The ports of a robot, one after the other, and where two robots would share some."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

LAST_PORT = 65535


@dataclass(frozen=True, slots=True)
class PortRange:
    """`count` ports at an address, from `first` on: one for each client of a robot."""

    address: str
    first: int
    count: int

    @property
    def last(self) -> int:
        """The last of them."""
        return self.first + self.count - 1

    def overlaps(self, other: PortRange) -> bool:
        """Whether both want some port of the same address."""
        return (
            self.address == other.address and self.first <= other.last and other.first <= self.last
        )

    def faults(self, others: Mapping[str, PortRange], key: str) -> Iterator[tuple[str, str]]:
        """Problem codes and messages, beside the ranges of others by the names of their robots.

        Args:
            others: who comes before it in the file, so that each pair is told once.
            key: how the file calls the first port.
        """
        if self.last > LAST_PORT:
            yield "port-too-high", f"the last port would be {self.last}; use a lower {key}"
        for name, other in others.items():
            if self.overlaps(other):
                message = (
                    f"ports {self.first} to {self.last} overlap those of {name} at the same "
                    f"address ({other.first} to {other.last}); use {other.last + 1} or more"
                )
                yield "ports-overlap", message
