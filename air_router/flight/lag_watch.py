"""Detects that this program stalls or lacks processor time, by the lag of its event loop.

A starved companion decides on old data, answers late, and takes inputs for missing that wait in its
own sockets. Only the program itself can detect and report this.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from air_router.controller import LAG_HOLD_S
from air_router.controller.model import CompanionLagged
from air_router.flight.limits import (
    LAG_CHECK_S,
    LAG_REPEATED_S,
    LAG_STARVED_S,
    LAG_STARVED_WITHIN_S,
    LAG_STOOD_S,
)
from air_router.vehicle import loop_s


@dataclass(slots=True, eq=False)
class LagWatch:
    """Adds up the lag of the event loop's turns. Pure; times are on the loop's clock."""

    _late: deque[tuple[float, float]] = field(default_factory=deque)  # when, how late
    _announced_s: float | None = None  # last announcement

    def take(self, late_s: float, now_s: float) -> CompanionLagged | None:
        """Add a turn's lag; return the event to report, if any."""
        if late_s > 0.0:
            self._late.append((now_s, late_s))
        while self._late and self._late[0][0] < now_s - LAG_STARVED_WITHIN_S:
            self._late.popleft()
        total_s = sum(late for _, late in self._late)
        announced = self._announced_s is not None and now_s < self._announced_s + LAG_REPEATED_S
        if late_s >= LAG_HOLD_S or (late_s >= LAG_STOOD_S and not announced):
            lagged = CompanionLagged(round(late_s, 2))
        elif total_s >= LAG_STARVED_S and not announced:
            lagged = CompanionLagged(round(total_s, 2), LAG_STARVED_WITHIN_S)
        else:
            return None
        self._announced_s = now_s
        self._late.clear()
        return lagged


async def watch_lag(deliver: Callable[[CompanionLagged], None]) -> None:
    """Measure the lag during the flight, and report it."""
    watch = LagWatch()
    while True:
        due_s = loop_s() + LAG_CHECK_S
        await asyncio.sleep(LAG_CHECK_S)
        now_s = loop_s()
        if (lagged := watch.take(now_s - due_s, now_s)) is not None:
            deliver(lagged)
