"""Whether this program stands still, or is short of processor time: its event loop's own lag.

A starved companion decides on what was, answers late, and counts as missing what waits in its own
sockets. It measures that by itself, and says it: nothing else on the link does.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.model import CompanionLagged
from air_router.vehicle import loop_s

LOOK_S: Final = 0.1
"""How often it is looked."""

STOOD_S: Final = 0.5
"""A turn that comes so late is told. A search for garbage, a page and a map take 50 ms at most."""

STARVED_S, WITHIN_S = 3.0, 10.0
"""So much lag in that time is told as well, if no single turn is so late: 30 % of the processor."""

AGAIN_S: Final = 30.0
"""It is told again no sooner, but for one that has the vehicle hold (`lag_monitor.HOLD_S`)."""

_ALWAYS_S: Final = 2.0


@dataclass(slots=True, eq=False)
class LagWatch:
    """Adds up how late the turns of the event loop come. Pure; times on the loop's clock."""

    _late: deque[tuple[float, float]] = field(default_factory=deque)  # when, how late
    _told_s: float | None = None  # when it was told last

    def take(self, late_s: float, now_s: float) -> CompanionLagged | None:
        """Take a turn in that came so late; what to tell of it."""
        if late_s > 0.0:
            self._late.append((now_s, late_s))
        while self._late and self._late[0][0] < now_s - WITHIN_S:
            self._late.popleft()
        total_s = sum(late for _, late in self._late)
        told = self._told_s is not None and now_s < self._told_s + AGAIN_S
        if late_s >= _ALWAYS_S or (late_s >= STOOD_S and not told):
            lag_s = late_s
        elif total_s >= STARVED_S and not told:
            lag_s = total_s
        else:
            return None
        self._told_s = now_s
        self._late.clear()
        return CompanionLagged(round(lag_s, 2))


async def watch_lag(deliver: Callable[[CompanionLagged], None]) -> None:
    """Look for as long as the flight lasts, and tell the flight."""
    watch = LagWatch()
    while True:
        due_s = loop_s() + LOOK_S
        await asyncio.sleep(LOOK_S)
        now_s = loop_s()
        if (lagged := watch.take(now_s - due_s, now_s)) is not None:
            deliver(lagged)
