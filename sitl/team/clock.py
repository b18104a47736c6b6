"""The simulation's clock: it moves when the vehicle says so, and nodes read it from any thread."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

_log = logging.getLogger(__name__)

_RESTART_S = 1.0  # a step back of more than this is a vehicle that was started anew


class SimClock:
    """Unix seconds of the simulated world; never runs backwards.

    `now_s` may be called from any thread: it reads one attribute, which `advance`, called from one
    thread only, replaces.

    Args:
        epoch_s: Unix time at simulated time zero; None: such that the first `advance` happens at
            the present wall time.
        wall_s: The wall clock, in Unix seconds.

    Attributes:
        epoch_s: Unix time at simulated time zero; None while it is unknown.
        elapsed_s: Simulated seconds since time zero, through all starts of the vehicle.
    """

    def __init__(self, epoch_s: float | None, wall_s: Callable[[], float] = time.time) -> None:
        self.epoch_s = epoch_s
        self._wall_s = wall_s
        self.elapsed_s = 0.0
        self._offset_s = 0.0  # what came before the vehicle's last start
        self._now_s = wall_s() if epoch_s is None else epoch_s  # Unix

    def now_s(self) -> float:
        """Unix seconds now."""
        return self._now_s

    def advance(self, vehicle_time_s: float) -> None:
        """Follow the vehicle's simulated time.

        A vehicle that is started again begins at zero; the world then goes on from where it was.
        """
        if self.epoch_s is None:
            self.epoch_s = self._wall_s() - vehicle_time_s
        elapsed_s = vehicle_time_s + self._offset_s
        if elapsed_s < self.elapsed_s - _RESTART_S:
            _log.warning("the vehicle's time stepped back: taken as a restart of the vehicle")
            self._offset_s = self.elapsed_s - vehicle_time_s
            elapsed_s = self.elapsed_s
        self.elapsed_s = max(self.elapsed_s, elapsed_s)
        self._now_s = max(self._now_s, self.epoch_s + self.elapsed_s)
