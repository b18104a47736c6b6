"""How far a vehicle may be off what was planned, and what routes keep for that.

`docs/routes.md` has the measurements that the numbers come from, and their sources. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from air_router.files import PlannerSettings

ESTIMATE: Final = 0.63
"""Metres that the estimated position is off, for each metre of accuracy that the receiver reports
(GPS_RAW_INT.h_acc): PX4 1.17's own simulator reports 0.9 m, and is off by up to 0.59 m."""

HOVER_M: Final = 0.35
SPEED_S2_M: Final = 0.0145
"""Metres that PX4's controller leaves what was checked for a leg by, at no speed, and for each
(m/s)2: what it swings by while it brakes and speeds up grows with these."""

TURN_M: Final = 0.3
"""Metres that a leg takes more which begins at speed: PX4 turns late."""

BREEZE_M_S: Final = 5.0
WIND_S: Final = 0.2
"""Metres that gusts push it aside by, for each m/s of a mean wind that is more than a breeze: in a
weaker one the simulated autopilot is no farther off than PX4 is in still air."""

PLAN_M: Final = 0.04
"""So much farther away legs are planned than they have to be when they are flown: a vehicle at the
end of one reports a place that is some centimetres off."""

SLACK_M: Final = 0.15
"""So much worse than planned for nothing is done about it: a receiver's report wanders."""


def tracking_error_m(
    speed_m_s: float, wind_m_s: float, accuracy_m: float, *, turns: bool = False
) -> float:
    """How far the true vehicle may be outside of what was checked for its leg.

    Args:
        speed_m_s: It flies, over ground.
        wind_m_s: Mean wind, with the gusts that come with it.
        accuracy_m: Horizontally, as the satellite receiver reports it.
        turns: The leg begins at speed.
    """
    gusts_m = WIND_S * max(wind_m_s - BREEZE_M_S, 0.0)
    turn_m = TURN_M if turns else 0.0
    return ESTIMATE * accuracy_m + HOVER_M + SPEED_S2_M * speed_m_s**2 + turn_m + gusts_m


@dataclass(frozen=True, slots=True)
class TrackingMargin:
    """What a mission keeps on top of its clearances.

    Attributes:
        error_m: What its vehicle may be off a straight leg at its speed, in the wind and with the
            accuracy that the mission is planned for.
        turn_m: The same of a leg that begins at speed.
        planned_m: Of routes. The mission file's value, but not less than `turn_m` and a bit.
        flown_m: Of a leg that begins where the vehicle hovers: half of the file's value, but not
            less than `error_m`.
        turned_m: The same of a leg that begins at speed: not less than `turn_m`.
    """

    error_m: float
    turn_m: float
    planned_m: float
    flown_m: float
    turned_m: float

    @classmethod
    def of(cls, planner: PlannerSettings, speed_m_s: float) -> TrackingMargin:
        """That of a mission with these settings, at this cruise speed."""
        conditions = speed_m_s, planner.wind_m_s, planner.position_accuracy_m
        error_m = round(tracking_error_m(*conditions), 2)
        turn_m = round(tracking_error_m(*conditions, turns=True), 2)
        floor_m = planner.tracking_margin_m
        return cls(
            error_m,
            turn_m,
            planned_m=max(floor_m, round(turn_m + PLAN_M, 2)),
            flown_m=max(floor_m / 2, error_m),
            turned_m=max(floor_m / 2, turn_m),
        )
