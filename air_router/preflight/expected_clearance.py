"""The least expected clearance of the true vehicle from zones and fences, by kind of leg.

Routes keep the clearance and the tracking margin. A leg from the vehicle's current position keeps
the clearance and the vehicle's possible deviation (`TrackingMargin`). The expected clearance is the
smallest remainder.
"""

from __future__ import annotations

from dataclasses import dataclass

from air_router.controller.states import landing_radius_m
from air_router.mission import Mission, tracking_error_m
from air_router.routing import names_of

LAND = "landing"
"""The kind of leg that starts farthest from its checked path: anywhere within the radius of
home."""


@dataclass(frozen=True, slots=True)
class ExpectedClearance:
    """The expected clearance of one kind of leg.

    Attributes:
        name: The kind, as text.
        kept_m: The least expected clearance.
        promised_m: The mission's required clearance there.
        to: The nearest zone or fence, as text.
        advice: The operator's action if it is too small.
    """

    name: str
    kept_m: float
    promised_m: float
    to: str = "zones and fence"
    advice: str = ""

    @property
    def short_m(self) -> float:
        """The missing distance; negative: none."""
        return self.promised_m - self.kept_m


def expected_clearances(mission: Mission) -> tuple[ExpectedClearance, ...]:
    """The expected clearances of every kind of leg, in the order of a flight."""
    margin, planner = mission.tracking, mission.planner
    clearance_m = planner.clearance_m
    planned_m = clearance_m + margin.planned_m - margin.error_m
    flown_m = clearance_m + margin.flown_m - margin.error_m
    hovers_m = tracking_error_m(0.0, planner.wind_m_s, planner.position_accuracy_m)
    kept_m = {
        "straight legs": planned_m,
        "turns": clearance_m + margin.turned_m - margin.turn_m,
        "first legs": flown_m,
        "go-tos": flown_m,
        "returns": planned_m,
    }
    return (
        _column(mission, "climb", hovers_m),
        *(ExpectedClearance(name, metres, clearance_m) for name, metres in kept_m.items()),
        _column(mission, LAND, hovers_m + landing_radius_m(mission)),
    )


def _column(mission: Mission, name: str, off_m: float) -> ExpectedClearance:
    """The column above home, with this possible distance from it."""
    spare_m, nearest = mission.climb_airspace.clearance_left_m(mission.home)
    promised_m = (
        mission.climb_airspace.required_m(nearest) if nearest else mission.planner.clearance_m
    )
    return ExpectedClearance(
        name,
        promised_m + spare_m - off_m,
        promised_m,
        names_of((nearest,)) if nearest else "zones and fence",
        f"move home {off_m - spare_m:.1f} m away from it",
    )
