"""Lines that come again and again, told as one with a count: "again 12 times". Pure.

For people only: what is recorded is recorded each time. An alarm and the answer to a request are
never repeats, and what comes after one is told in full: it may be new what was told before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

PAUSE_S: Final = 15.0
"""A line that comes again after a longer pause is told in full."""

TELL_S: Final = 30.0
"""How often a terminal tells how many there were: there, what was printed stays as it is."""

_MANY: Final = 100  # lines; more are kept only while they may still come again

Line = TypeVar("Line")


@dataclass(slots=True)
class _Said:
    last_s: float  # when it came last
    told_s: float  # when it was told last
    count: int = 0  # how often it came again
    untold: int = 0  # of those, how many were not told


class Repeats(Generic[Line]):
    """Counts lines that come again without a pause, in any order among each other."""

    def __init__(self) -> None:
        self._said: dict[Line, _Said] = {}

    def again(self, line: Line, now_s: float) -> int:
        """How often a line that comes now came before without a pause; 0: it is told in full."""
        said = self._said.get(line)
        if said is None or not 0.0 <= now_s - said.last_s <= PAUSE_S:
            self._forget(now_s)
            said = self._said[line] = _Said(now_s, now_s)
            return 0
        said.last_s = now_s
        said.count += 1
        said.untold += 1
        return said.count

    def due(self, now_s: float) -> Iterator[tuple[Line, int]]:
        """Lines that came again, and how often: each once in a while, and when no more come.

        Each is told by this, and counted from here. At the end, at infinity, all are due.
        """
        for line, said in self._said.items():
            ended = not 0.0 <= now_s - said.last_s <= PAUSE_S
            if said.untold and (ended or now_s - said.told_s >= TELL_S):
                count, said.untold, said.told_s = said.untold, 0, now_s
                yield line, count

    def clear(self) -> None:
        """Something came that stands for itself: all that follows is told in full."""
        self._said.clear()

    def _forget(self, now_s: float) -> None:
        """Lines that would be told in full."""
        if len(self._said) > _MANY:
            self._said = {
                line: said
                for line, said in self._said.items()
                if said.untold or now_s - said.last_s <= PAUSE_S
            }


def times(count: int) -> str:
    """How often, in words: "again", "again 12 times"."""
    return "again" if count == 1 else f"again {count} times"
