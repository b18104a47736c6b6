"""Where words stand on a picture: beside what they name, on no other words and marks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class _Box(NamedTuple):
    """What is covered, and by which words; "" is a mark."""

    west: float
    east: float
    south: float
    north: float
    words: str

    def shared(self, other: _Box) -> float:
        """The area that both cover."""
        width = min(self.east, other.east) - max(self.west, other.west)
        height = min(self.north, other.north) - max(self.south, other.south)
        return max(width, 0.0) * max(height, 0.0)


class Labels:
    """Words and marks of a picture, in any unit, as long as it is one.

    Attributes:
        _taken: What is covered.
    """

    def __init__(self) -> None:
        self._taken: list[_Box] = []

    def mark(self, x: float, y: float, radius: float) -> None:
        """Words that are placed later go out of this mark's way."""
        self._taken.append(_Box(x - radius, x + radius, y - radius, y + radius, ""))

    def place(
        self,
        words: str,
        at: tuple[float, float],
        size: tuple[float, float],
        offs: Sequence[tuple[float, float]],
    ) -> tuple[float, float] | None:
        """Take the first of some places that is free, else the one that covers least.

        Args:
            words: What is written.
            at: What they name.
            size: Their width and height.
            offs: How far from there their middle may be, the best first.

        Returns:
            One of `offs`; None where the same words stand already, and name this, too.
        """
        boxes = []
        for dx, dy in offs:
            (x, y), (width, height) = (at[0] + dx, at[1] + dy), size
            boxes.append(_Box(x - width / 2, x + width / 2, y - height / 2, y + height / 2, words))
        if any(boxes[0].shared(other) for other in self._taken if other.words == words):
            return None
        covered = [sum(map(box.shared, self._taken)) for box in boxes]
        best = covered.index(min(covered))
        self._taken.append(boxes[best])
        return offs[best]
