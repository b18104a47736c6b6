"""Two times: the robot's Unix time (stamps, ages, triggers) and steady time (socket time-outs)."""

from __future__ import annotations

import time
from typing import NamedTuple, Protocol


class Clock(Protocol):
    """The robot's clock; a simulation brings its own, which may run faster or stand still."""

    def now_s(self) -> float:
        """Unix seconds."""


class SystemClock:
    """The clock of this machine."""

    def now_s(self) -> float:
        """Unix seconds."""
        return time.time()


class Instant(NamedTuple):
    """One moment on both clocks, which everything that decides is given.

    `may_step`: Unix time is this machine's, which may be set; otherwise it is all that passes.
    """

    unix_s: float
    steady_s: float
    may_step: bool = False

    @property
    def timer_s(self) -> float:
        """What intervals and silences are counted in."""
        return self.steady_s if self.may_step else self.unix_s
