"""Tracks the clocks in messages: a wrap is no restart, and two clocks are two autopilots. Pure.

`time_boot_ms` has 32 bits: after 49.7 days it wraps to 0, even in flight.
"""

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise

from air_router.vehicle.px4.limits import (
    BOOT_CLOCK_WRAPS_WITHIN_MS,
    TWIN_CLEARED_MESSAGES,
    TWIN_CLOCKS_APART_S,
    TWIN_TURNS,
    TWIN_TURNS_WINDOW,
)
from air_router.vehicle.px4.mavlink_values import BOOT_CLOCK_MS


@dataclass(slots=True, eq=False)
class BootClock:
    """Extends `time_boot_ms` beyond its wrap."""

    _epoch: int = 0  # number of wraps
    _last_ms: int | None = None  # the newest, extended

    def whole_ms(self, time_boot_ms: int) -> int:
        """Milliseconds since the vehicle booted, in more than 32 bits."""
        counted_ms = time_boot_ms + self._epoch * BOOT_CLOCK_MS
        last_ms = self._last_ms
        if last_ms is not None:
            if 0 <= counted_ms + BOOT_CLOCK_MS - last_ms <= BOOT_CLOCK_WRAPS_WITHIN_MS:
                self._epoch += 1
                counted_ms += BOOT_CLOCK_MS
            elif self._epoch and counted_ms - last_ms >= BOOT_CLOCK_MS - BOOT_CLOCK_WRAPS_WITHIN_MS:
                return counted_ms - BOOT_CLOCK_MS  # late, from before the wrap
        self._last_ms = counted_ms
        return counted_ms


@dataclass(slots=True)
class _Track:
    """One clock: its newest time, and our time of reception, seconds."""

    boot_s: float
    arrived_s: float

    def advance(self, boot_s: float, arrived_s: float) -> None:
        """Update the clock."""
        self.boot_s, self.arrived_s = boot_s, arrived_s


@dataclass(slots=True, eq=False)
class TwinWatch:
    """Detects two clocks that stamp the same message in turns.

    Attributes:
        apart_s: Difference of two autopilots' clocks; None: there is one.
    """

    apart_s: float | None = None
    _tracks: list[_Track] = field(default_factory=list)  # the one received last is last
    _turns: deque[_Track] = field(default_factory=lambda: deque(maxlen=TWIN_TURNS_WINDOW))
    _alone: int = 0  # consecutive messages of one clock

    def take(self, boot_s: float, arrived_s: float, rate: float) -> bool:
        """Handle a position's time; return whether the number of autopilots has changed.

        Args:
            boot_s: Reported time since boot.
            arrived_s: Time of reception on our clock.
            rate: Rate of the vehicle's clock relative to ours.
        """
        before, latest = self.apart_s, self._turns[-1] if self._turns else None
        track = self._track_of(boot_s, arrived_s, rate)
        self._alone = self._alone + 1 if track is latest else 1
        self._turns.append(track)
        turns = list(self._turns)
        took = [b for a, b in pairwise(turns) if a is not b]
        if len(took) >= TWIN_TURNS and len({id(each) for each in took[-TWIN_TURNS:]}) == 2:
            one, other = took[-2:]
            passed_s = (one.arrived_s - other.arrived_s) * rate
            self.apart_s = abs(one.boot_s - other.boot_s - passed_s)
        elif self._alone >= TWIN_CLEARED_MESSAGES:
            self.apart_s = None
        return (self.apart_s is None) != (before is None)

    def _track_of(self, boot_s: float, arrived_s: float, rate: float) -> _Track:
        def off_s(track: _Track) -> float:
            return abs(boot_s - track.boot_s - (arrived_s - track.arrived_s) * rate)

        track = min(self._tracks, key=off_s, default=None)
        if track is None or off_s(track) > TWIN_CLOCKS_APART_S * max(rate, 1.0):
            track = _Track(boot_s, arrived_s)
            self._tracks = [*self._tracks[-1:], track]
        else:
            track.advance(boot_s, arrived_s)
        return track
