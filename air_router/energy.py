"""Whether the battery lasts for a mission: times along its routes, by what a full battery flies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from air_router.flight_plan import HOME_NODE
from air_router.preflight import Check, Verdict
from air_router.router import Route

if TYPE_CHECKING:
    from air_router.mission import Mission
    from air_router.router import Router

CLIMB_M_S: Final = 1.5
"""Of a PX4's take-off and of most of its descent."""

LAST_METRES_M: Final = 10.0
LAND_M_S: Final = 0.7

MARGIN: Final = 1.3
"""Headwind, turns and stops at the waypoints, on top of route length by cruise speed."""

SPARE: Final = 0.2
"""What there should be above the reserve where the vehicle's endurance is not known."""


def up_and_down_s(mission: Mission) -> float:
    """Take-off and landing."""
    altitude_m = mission.altitude_above_home_m
    last_m = min(altitude_m, LAST_METRES_M)
    return altitude_m / CLIMB_M_S + (altitude_m - last_m) / CLIMB_M_S + last_m / LAND_M_S


def farthest_s(mission: Mission, router: Router) -> float:
    """The longest way home along the routes, from any waypoint, in seconds."""
    longest_m = 0.0
    for waypoint in mission.waypoints:
        route = router.route(waypoint.position, HOME_NODE)
        if isinstance(route, Route):
            longest_m = max(longest_m, route.length_m)
    return longest_m / mission.speed_m_s * MARGIN


def battery(
    mission: Mission, router: Router, charge: float | None, voltage_v: float | None
) -> Check:
    """The charge against what the mission needs, the way home included."""
    if charge is None:
        return Check(
            "battery",
            Verdict.LOOK,
            "its charge is not known: the reserve cannot be kept",
            "set up the power module (BAT1_ parameters), and say --duration",
        )
    volts = "" if voltage_v is None else f" ({voltage_v:.1f} V)"
    found = f"{charge:.0%}{volts}, reserve {mission.battery_reserve:.0%}"
    usable = charge - mission.battery_reserve
    endurance_s = mission.endurance_s
    if endurance_s is None:
        if usable < SPARE:
            return Check("battery", Verdict.BAD, found, "charge it, or swap it")
        advice = "say in the mission how long a full battery flies (endurance_s) to have it checked"
        return Check("battery", Verdict.LOOK, found, advice)
    way_s = farthest_s(mission, router)
    least_s = up_and_down_s(mission) + 2 * way_s
    usable_s = usable * endurance_s
    found += f": {max(usable_s, 0.0) / 60:.1f} min in the air"
    if usable_s < least_s:
        advice = f"the farthest waypoint and back take {least_s / 60:.1f} min: charge or swap it"
        return Check("battery", Verdict.BAD, found, advice)
    if mission.duration_s is not None and usable_s < mission.duration_s + way_s:
        advice = f"it will come home before its {mission.duration_s / 60:.1f} min are over"
        return Check("battery", Verdict.LOOK, found, advice)
    return Check("battery", Verdict.GOOD, found)
