"""Events in simulated time: what is to happen when, and the log of what did.

Simulated seconds only, no clock. Two things at the same time happen in the order in which they were
scheduled, so a run is the same every time and everywhere.

The log has everything that was decided on, and everything that was decided, without the texts for
people: a reworded announcement is no other run. One JSON object per line, in the order in which
things happened:

    {"t": 12.5, "uav": "uav01", "event": {...}}     a controller received it (see docs/records.md)
    {"t": 12.5, "uav": "uav01", "action": {...}}    what it commanded then
        with "of": n, if it is a motion or what became of one: the n-th that was commanded
    {"t": 12.5, "sent": [...]}                      a transmission ended: exchange.Transmission
    {"t": 12.5, "goal": "g3", "robot": "ugv02"}     a robot reached a goal

Its digest is the run's: the same seed gives the same log, whatever machine writes it.
"""

from __future__ import annotations

import hashlib
import heapq
import json
from collections.abc import Callable
from typing import Any, Final

from air_router.controller.model import (
    Action,
    Announce,
    CommandConfirmed,
    CommandFailed,
    Event,
    MissionWaits,
    Motion,
)
from air_router.record import plain_of

_DIGITS = 6
"""Times are whole microseconds: what a logarithm of another machine's library may differ by is far
less, so that both round to the same time."""

_TEXTS: Final = frozenset({"why", "why_not", "reason"})
"""Fields of events and actions that are sentences."""


class EventQueue:
    """Events in the order of time.

    Attributes:
        now_s: Simulated time, never running back.
    """

    def __init__(self) -> None:
        self.now_s = 0.0
        self._number = 0  # of the newest: those of one time happen in their order
        self._events: list[tuple[float, int, Callable[[], None]]] = []  # heap

    def at(self, time_s: float, event: Callable[[], None]) -> None:
        """Have something happen at a time; what is past happens now, after what is due already."""
        self._number += 1
        when_s = max(self.now_s, round(time_s, _DIGITS))
        heapq.heappush(self._events, (when_s, self._number, event))

    def after(self, delay_s: float, event: Callable[[], None]) -> None:
        """Have something happen after a while."""
        self.at(self.now_s + delay_s, event)

    def every(self, period_s: float, event: Callable[[], None]) -> None:
        """Have something happen now, and again at all multiples of a period, without drift."""
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


class EventLog:
    """The log of a run: only its digest is kept, which is of all lines.

    Args:
        queue: The clock.

    Attributes:
        actions: How many there were, without announcements.
    """

    def __init__(self, queue: EventQueue) -> None:
        self.actions = 0
        self._queue = queue
        self._motions: list[Motion] = []  # all that were commanded: `of` is the place here
        self._digest = hashlib.sha256()

    @property
    def digest(self) -> str:
        """SHA-256 of all lines so far, in hex."""
        return self._digest.hexdigest()

    def event(self, uav: str, event: Event) -> None:
        """A controller receives an event."""
        if isinstance(event, CommandConfirmed | CommandFailed):
            self._write(uav=uav, event=_plain(event), of=self._number(event.action))
        else:
            self._write(uav=uav, event=_plain(event))

    def action(self, uav: str, action: Action) -> None:
        """A controller decides on an action; those that only inform people are left out."""
        if isinstance(action, Announce | MissionWaits):
            return
        self.actions += 1
        if isinstance(action, Motion):
            self._motions.append(action)
            self._write(uav=uav, action=_plain(action), of=self._number(action))
        else:
            self._write(uav=uav, action=_plain(action))

    def sent(self, row: tuple[Any, ...]) -> None:
        """A transmission ended."""
        self._write(sent=row)

    def goal(self, goal: str, robot: str) -> None:
        """A robot reached a goal."""
        self._write(goal=goal, robot=robot)

    def _number(self, motion: Motion) -> int:
        """Which one it is: there may be several alike."""
        for number in range(len(self._motions) - 1, -1, -1):
            if self._motions[number] is motion:
                return number
        raise AssertionError(f"{motion} was not commanded")

    def _write(self, **fields: Any) -> None:
        line = json.dumps({"t": self._queue.now_s, **fields}, separators=(",", ":"))
        self._digest.update(line.encode())
        self._digest.update(b"\n")


def _plain(value: object) -> dict[str, Any]:
    """An event or action without its sentences."""

    def kept(inner: Any) -> Any:
        if isinstance(inner, dict):
            return {key: kept(own) for key, own in inner.items() if key not in _TEXTS}
        return inner

    found: dict[str, Any] = kept(plain_of(value))
    return found
