"""Repeated lines, reported once with a count: "again 12 times". Pure.

For output to people only: the record has each repetition. An alarm and the reply to a request are
never repeats, and after one of them every line is printed in full once more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

PAUSE_S: Final = 15.0
"""A line that comes again after a longer pause is printed in full."""

REPORT_S: Final = 30.0
"""Interval in which a terminal reports the count: a line once printed cannot be updated there."""

_MANY: Final = 100  # lines; more are kept only while they may still come again

Line = TypeVar("Line")


@dataclass(slots=True)
class _Repeated:
    last_s: float  # when it came last
    reported_s: float  # when it was printed or its count reported last
    count: int = 0  # how often it came again
    unreported: int = 0  # of those, how many were not reported


class Repeats(Generic[Line]):
    """Counts lines that come again without a pause, in any order among each other."""

    def __init__(self) -> None:
        self._lines: dict[Line, _Repeated] = {}

    def again(self, line: Line, now_s: float) -> int:
        """How often a line that comes now came before without a pause; 0: print it in full."""
        repeated = self._lines.get(line)
        if repeated is None or not 0.0 <= now_s - repeated.last_s <= PAUSE_S:
            self._forget(now_s)
            self._lines[line] = _Repeated(now_s, now_s)
            return 0
        repeated.last_s = now_s
        repeated.count += 1
        repeated.unreported += 1
        return repeated.count

    def due(self, now_s: float) -> Iterator[tuple[Line, int]]:
        """Lines that came again, and how often: each once in a while, and when no more come.

        Each then counts as reported, and is counted from here. At the end, at infinity, all are
        due.
        """
        for line, repeated in self._lines.items():
            ended = not 0.0 <= now_s - repeated.last_s <= PAUSE_S
            if repeated.unreported and (ended or now_s - repeated.reported_s >= REPORT_S):
                count = repeated.unreported
                repeated.unreported, repeated.reported_s = 0, now_s
                yield line, count

    def clear(self) -> None:
        """An alarm or a reply was printed: all that follows is printed in full."""
        self._lines.clear()

    def _forget(self, now_s: float) -> None:
        """Lines that would be printed in full."""
        if len(self._lines) > _MANY:
            self._lines = {
                line: repeated
                for line, repeated in self._lines.items()
                if repeated.unreported or now_s - repeated.last_s <= PAUSE_S
            }


def times(count: int) -> str:
    """How often, as text: "again", "again 12 times"."""
    return "again" if count == 1 else f"again {count} times"
