"""How far a vehicle may deviate from its legs, and the margin that routes keep for it.

Sources and measurements of the numbers are in docs/evidence/clearance.md. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from air_router.files import PlannerSettings

ESTIMATE: Final = 0.63
"""Error of the estimated position, per metre of accuracy that the receiver reports
(GPS_RAW_INT.h_acc): PX4 1.17's own simulator reports 0.9 m, with errors up to 0.59 m."""

HOVER_M: Final = 0.35
SPEED_S2_M: Final = 0.0145
"""How far PX4's controller leaves the area checked for a leg: at standstill, and per (m/s)2. Its
overshoot on braking and accelerating grows with the square of the speed."""

TURN_M: Final = 0.3
"""Additional deviation of a leg that begins at speed, because PX4 turns late."""

BREEZE_M_S: Final = 5.0
WIND_S: Final = 0.2
"""Deviation by gusts, per m/s of mean wind above a breeze. In weaker wind the simulated autopilot
deviates no more than PX4 in still air."""

PLAN_M: Final = 0.04
"""Margin of planned legs beyond that of flown legs: at the end of a leg a vehicle reports a
position that is some centimetres off."""

SLACK_M: Final = 0.15
"""Excess over the planned deviation that is tolerated, because a receiver's report fluctuates."""


def tracking_error_m(
    speed_m_s: float, wind_m_s: float, accuracy_m: float, *, turns: bool = False
) -> float:
    """How far the true position may be outside the area checked for a leg.

    Args:
        speed_m_s: Speed over ground.
        wind_m_s: Mean wind, with its usual gusts.
        accuracy_m: Horizontal accuracy that the GNSS receiver reports.
        turns: Whether the leg begins at speed.
    """
    gusts_m = WIND_S * max(wind_m_s - BREEZE_M_S, 0.0)
    turn_m = TURN_M if turns else 0.0
    return ESTIMATE * accuracy_m + HOVER_M + SPEED_S2_M * speed_m_s**2 + turn_m + gusts_m


@dataclass(frozen=True, slots=True)
class TrackingMargin:
    """The margins that a mission adds to its clearances.

    Attributes:
        error_m: Deviation from a leg begun from hover, for the planned speed, wind and accuracy.
        turn_m: Deviation from a leg begun at speed.
        planned_m: Margin of routes: the mission file's value, at least `turn_m` + `PLAN_M`.
        flown_m: Margin of a leg begun from hover: half of the file's value, at least `error_m`.
        turned_m: Margin of a leg begun at speed: the same, at least `turn_m`.
    """

    error_m: float
    turn_m: float
    planned_m: float
    flown_m: float
    turned_m: float

    @classmethod
    def of(cls, planner: PlannerSettings, speed_m_s: float) -> TrackingMargin:
        """The margins for these settings and this cruise speed."""
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
