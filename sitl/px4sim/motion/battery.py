"""The battery of PX4's simulator: it drains evenly while armed and is full again when disarmed."""

from enum import IntEnum
from typing import Final

_EMPTY_V: Final = 14.4
_FULL_V: Final = 16.2


class BatteryWarning(IntEnum):
    """battery_status.warning; one more is BATTERY_STATUS.charge_state."""

    NONE = 0
    LOW = 1
    CRITICAL = 2
    EMERGENCY = 3


class Battery:
    """State of charge from 1 (full) to 0.

    Attributes:
        remaining: Fraction of the charge.
        warning: The worst level since arming: in flight PX4 never takes a warning back.
    """

    def __init__(self) -> None:
        self.remaining = 1.0
        self.warning = BatteryWarning.NONE

    def step(
        self,
        step_s: float,
        *,
        armed: bool,
        drain_s: float,
        least: float,
        thresholds: tuple[float, float, float],
    ) -> None:
        """Drain for `step_s`.

        Args:
            step_s: Seconds.
            armed: Whether the motors draw.
            drain_s: Seconds from full to empty (SIM_BAT_DRAIN).
            least: Fraction at which the simulated battery stops draining (SIM_BAT_MIN_PCT).
            thresholds: Fractions of the low, critical and emergency warning.
        """
        if not armed:
            self.remaining, self.warning = 1.0, BatteryWarning.NONE
            return
        drained = self.remaining - step_s / max(drain_s, 1.0)
        self.remaining = max(drained, min(max(least, 0.0), self.remaining))
        level = BatteryWarning(sum(self.remaining < threshold for threshold in thresholds))
        self.warning = max(self.warning, level)

    @property
    def voltage_v(self) -> float:
        """Of four cells, falling evenly."""
        return _EMPTY_V + (_FULL_V - _EMPTY_V) * self.remaining
