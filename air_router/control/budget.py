"""How many requests are looked at: no program may take the flight's time with them."""

from collections.abc import Callable
from typing import Final

from air_router.control.command_request import CommandRequest
from air_router.vehicle.clock import loop_s

COSTLY: Final = frozenset({"seek", "goto", "reload"})
"""Requests that have ways planned, or a file read."""

COSTLY_PER_S, COSTLY_AT_ONCE = 5.0, 10.0
"""So many of them are looked at in a second, and so many after a pause."""

POINTS_AT_ONCE: Final = 10
"""So many points of a `goto` count as one request: ways to and from each are planned."""

TOO_MANY: Final = "too many requests; ask again in a second"


class Budget:
    """Fills up with time, and is spent."""

    def __init__(
        self, per_s: float, at_once: float, monotonic: Callable[[], float] = loop_s
    ) -> None:
        self._per_s = per_s
        self._at_once = self._left = at_once
        self._monotonic = monotonic
        self._at_s = monotonic()  # when it was filled up last, monotonic

    def spend(self, amount: float = 1.0) -> bool:
        """Whether there was enough for so much more."""
        now_s = self._monotonic()
        gained = max(0.0, now_s - self._at_s) * self._per_s
        self._at_s = now_s
        self._left = min(self._at_once, self._left + gained)
        if self._left < amount:
            return False
        self._left -= amount
        return True

    def affords(self, command: CommandRequest) -> bool:
        """Whether a request may be looked at; those that cost nothing always."""
        return command.request not in COSTLY or self.affords_ways(
            len(getattr(command, "points", ()))
        )

    def affords_ways(self, points: int) -> bool:
        """Whether ways to so many points may be planned."""
        return self.spend(max(1.0, points / POINTS_AT_ONCE))
