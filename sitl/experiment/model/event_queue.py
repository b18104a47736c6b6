"""What is to happen when: the heart of a discrete-event simulation.

Simulated seconds only, no clock. Two things at the same time happen in the order in which they
were asked for, so a run is the same every time and everywhere.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable

_DIGITS = 6
"""Times are whole microseconds: what a logarithm of another machine's library may differ by is far
less, so that both round to the same time."""


class EventQueue:
    """Events in the order of time.

    Attributes:
        now_s: Simulated time, never running back.
    """

    def __init__(self) -> None:
        self.now_s = 0.0
        self._number = 0
        self._events: list[tuple[float, int, Callable[[], None]]] = []

    def at(self, time_s: float, event: Callable[[], None]) -> None:
        """Have something happen at a time; what is past happens now, after what is due already."""
        self._number += 1
        when_s = max(self.now_s, round(time_s, _DIGITS))
        heapq.heappush(self._events, (when_s, self._number, event))

    def after(self, delay_s: float, event: Callable[[], None]) -> None:
        """Have something happen after a while."""
        self.at(self.now_s + delay_s, event)

    def every(self, period_s: float, event: Callable[[], None]) -> None:
        """Have something happen now, and again and again; multiples of the period, without drift.

        Raises:
            ValueError: a period that time cannot pass in.
        """
        if not period_s > 0:
            raise ValueError(f"nothing happens every {period_s} s")
        began_s, count = self.now_s, 0

        def once() -> None:
            nonlocal count
            count += 1
            event()
            self.at(began_s + count * period_s, once)

        self.at(began_s, once)

    def run(self, until_s: float) -> None:
        """Let everything happen that is due before a time, then it is that time."""
        events = self._events
        while events and events[0][0] < until_s:
            self.now_s, _, event = heapq.heappop(events)
            event()
        self.now_s = until_s
