"""Whether a position goes on from the one before, so that no single message moves the vehicle.

A datagram that did not come from the vehicle, or a bit that fell over, may say anything: a clock of
another boot, a place far away. What does not follow from what was heard before is believed when
several messages in a row agree with each other and what they contradict is not heard any more.
"""

import math
from dataclasses import dataclass
from typing import Final

from geo.frame import Point

BACK_S: Final = 1.0
"""So far back messages may overtake each other, on the vehicle's clock."""

AHEAD_S: Final = 4.0
"""So far the vehicle's clock may step on between two messages; more in a fast simulation.

Less than a step back that counts as a restart (`flight.RESTART_S`).
"""

JUMP_M: Final = 5.0
SPEED_M_S: Final = 50.0
"""How far it may be from one message to the next: what an estimate may jump, and what it flies."""

MESSAGES: Final = 5
QUIET_S: Final = 0.7
"""So many messages that agree are believed, when for so long nothing else was heard."""


@dataclass(frozen=True, slots=True)
class ReportedPosition:
    """What a position message says.

    Attributes:
        boot_s: The vehicle's clock, seconds since it booted.
        position: Metres east and north in the mission's frame.
    """

    boot_s: float
    position: Point


class Continuity:
    """Says of each position in turn whether it is believed. Has no clock of its own."""

    def __init__(self) -> None:
        self._last: ReportedPosition | None = None  # the newest believed
        self._last_s = -math.inf  # when it came
        self._doubted: ReportedPosition | None = None  # the newest that was not
        self._count = 0  # of these that agree

    def believes(self, heard: ReportedPosition, now_s: float, rate: float) -> bool:
        """Whether a message is believed that came at `now_s` of our monotonic clock.

        `rate` is how many seconds of the vehicle a second of ours is: 1 outside of simulations.
        """
        rate = max(rate, 1.0)
        if self._last is None or _follows(self._last, heard, rate):
            self._doubted, self._count = None, 0
        else:
            agrees = self._doubted is not None and _follows(self._doubted, heard, rate)
            self._doubted, self._count = heard, self._count + 1 if agrees else 1
            if self._count < MESSAGES or now_s - self._last_s < QUIET_S / rate:
                return False
            self._doubted, self._count = None, 0
        self._last, self._last_s = heard, now_s
        return True


def _follows(before: ReportedPosition, after: ReportedPosition, rate: float) -> bool:
    passed_s = after.boot_s - before.boot_s
    if not -BACK_S <= passed_s <= AHEAD_S * rate:
        return False
    way_m = math.dist(tuple(before.position), tuple(after.position))
    return way_m <= JUMP_M + SPEED_M_S * max(passed_s, 0.0)
