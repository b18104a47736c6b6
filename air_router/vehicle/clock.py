"""The companion's own clock, and the vehicle's clock, extrapolated between two messages.

Every timer of a mission runs on the vehicle's clock, so a simulation at ten times real time (or one
that pauses) behaves like a real flight.
"""

import asyncio
import math
import threading
import time
from collections.abc import Callable

from air_router.vehicle.limits import (
    CLOCK_EXTRAPOLATED_S,
    CLOCK_RATE_MOST,
    CLOCK_RATE_SAMPLE_S,
    CLOCK_RATE_SAMPLES,
    CLOCK_RATE_TOLERANCE,
    CLOCK_RATE_WINDOW_S,
    PACE_ALLOWANCE_S,
    REBOOT_S,
    UNIX_TIME_SET_S,
    UNIX_TIME_STEADY_S,
)


def loop_s() -> float:
    """Seconds on the running event loop's clock, `time.monotonic` on an ordinary one.

    A rehearsal flies on a loop whose clock is simulated time. Without a running loop (on another
    thread, or before the flight) it is `time.monotonic`.
    """
    try:
        return asyncio.get_running_loop().time()
    except RuntimeError:
        return time.monotonic()


class VehicleClock:
    """Seconds since the vehicle booted, and Unix seconds; any thread may read it.

    Args:
        monotonic: The companion's own clock; tests inject another.
        unix: Unix time until the vehicle reports its own (it does with GPS).
        ceiling: Highest rate of a simulation that waits for this program
            (`air_router.vehicle.pace`).
    """

    def __init__(
        self,
        monotonic: Callable[[], float] = time.monotonic,
        unix: Callable[[], float] = time.time,
        *,
        ceiling: float | None = None,
    ) -> None:
        self._monotonic = monotonic
        self._unix = unix
        self._ceiling = ceiling
        self._lock = threading.Lock()
        self._boot_s: float | None = None  # newest received time
        self._alive_s = 0.0  # the last reception of any message, monotonic
        self._extrapolated_s = 0.0  # duration of messages without a newer time
        self._rate: float | None = None  # vehicle's seconds per second of ours; None: not measured
        self._window_rate = 0.0  # rate of the last window alone
        self._mark: tuple[float, float] | None = None  # both clocks at the start of the window
        self._epoch_s: float | None = None  # Unix time at boot
        self._last_unix = (
            0.0,
            math.inf,
        )  # time since boot, and Unix time at boot, as reported last
        self._synchronised = False  # the vehicle reported Unix time
        self._last_s = 0.0  # the last returned time: never decreases

    def received(self, boot_s: float) -> None:
        """Handle a message with the vehicle's time since boot."""
        with self._lock:
            wall_s = self._monotonic()
            if self._boot_s is not None and boot_s < self._boot_s - REBOOT_S:
                self._mark = None  # it rebooted: start over
                self._last_s = 0.0
                self._synchronised = False
            elif self._boot_s is not None and boot_s <= self._boot_s:
                self._extrapolate(wall_s)  # late, or the clock stands still
                return
            self._boot_s, self._alive_s, self._extrapolated_s = boot_s, wall_s, 0.0
            if self._mark is None:
                self._mark = (boot_s, wall_s)
            elif wall_s - self._mark[1] >= CLOCK_RATE_WINDOW_S:
                rate = (boot_s - self._mark[0]) / (wall_s - self._mark[1])
                self._measured(min(max(rate, 0.0), CLOCK_RATE_MOST))
                self._mark = (boot_s, wall_s)

    def _measured(self, rate: float) -> None:
        """Note a measured rate. Windows differ on a link that stalls and then delivers at once."""
        consistent = abs(rate - self._window_rate) <= CLOCK_RATE_TOLERANCE * max(
            rate, self._window_rate
        )
        if self._rate is None or consistent:
            self._rate = rate
        self._window_rate = rate

    def alive(self) -> None:
        """Handle a message without a time: extrapolate the clock."""
        with self._lock:
            self._extrapolate(self._monotonic())

    def _extrapolate(self, wall_s: float) -> None:
        self._extrapolated_s += min(wall_s - self._alive_s, CLOCK_EXTRAPOLATED_S)
        self._alive_s = wall_s

    def received_unix(self, unix_s: float, boot_s: float) -> None:
        """Handle a message with the Unix time of the vehicle's GPS.

        The first one counts: from then on both clocks run together, whatever a simulated GPS
        reports (PX4's reports wall time, even at ten times real time). A later clock that was set
        ahead, as happens once GPS knows the time, and that runs with the vehicle's, replaces it.
        """
        epoch_s = unix_s - boot_s
        with self._lock:
            before_s, before_epoch_s = self._last_unix
            steady = boot_s > before_s and abs(epoch_s - before_epoch_s) <= UNIX_TIME_STEADY_S
            behind = self._epoch_s is None or epoch_s > self._epoch_s + UNIX_TIME_SET_S
            if not self._synchronised or (steady and behind):
                self._synchronised = True
                self._epoch_s = epoch_s
            self._last_unix = (boot_s, epoch_s)

    def boot_s(self) -> float:
        """Seconds since the vehicle booted; never decreases; 0 before the first message."""
        with self._lock:
            if self._boot_s is None:
                return 0.0
            since_s = self._extrapolated_s + min(
                self._monotonic() - self._alive_s, CLOCK_EXTRAPOLATED_S
            )
            rate = 1.0 if self._rate is None else self._rate
            ahead_s = min(since_s, CLOCK_EXTRAPOLATED_S) * rate
            if self._ceiling is not None:
                ahead_s = min(ahead_s, PACE_ALLOWANCE_S)  # the simulation waits for us beyond that
            # A long extrapolation runs at our own rate at most, so it cannot get far ahead.
            ahead_s += max(0.0, since_s - CLOCK_EXTRAPOLATED_S) * min(rate, 1.0)
            self._last_s = max(self._last_s, self._boot_s + ahead_s)
            return self._last_s

    @property
    def reported_s(self) -> float:
        """The newest time since boot that the vehicle reported, not extrapolated; 0: none yet."""
        with self._lock:
            return self._boot_s or 0.0

    @property
    def rate(self) -> float:
        """The vehicle's seconds per second of ours: 1 in reality, more in a fast simulation.

        If the simulation waits for this program the rate varies: then its maximum. 1 until it is
        measured.
        """
        with self._lock:
            measured = self._rate if self._ceiling is None else self._ceiling
            return 1.0 if measured is None else measured

    async def measured_rate(self) -> float:
        """Wait until the rate is measured, unless the vehicle sends no time."""
        for _ in range(CLOCK_RATE_SAMPLES):
            if self._rate is not None or self._ceiling is not None:
                break
            await asyncio.sleep(CLOCK_RATE_SAMPLE_S)
        return self.rate

    @property
    def most_ahead_s(self) -> float:
        """How far the vehicle's time advances at most while none of its messages is handled."""
        return math.inf if self._ceiling is None else PACE_ALLOWANCE_S

    def now_s(self) -> float:
        """Unix seconds: the vehicle's, or the companion's until the vehicle reports its time."""
        boot_s = self.boot_s()
        with self._lock:
            if self._epoch_s is None:
                if self._boot_s is None:
                    return self._unix()
                self._epoch_s = self._unix() - boot_s
            return self._epoch_s + boot_s
