"""Whether the battery lasts for a mission, by what a full one flies and the ways home."""

from typing import Final

from air_router.mission.mission import Mission
from air_router.preflight.preflight import Check
from air_router.routing.return_planner import LANDING_MARGIN, ReturnPlanner
from air_router.routing.router import Router

CLIMB_M_S: Final = 1.5
"""Of a PX4's take-off."""

SPARE: Final = 0.2
"""What there should be above the reserve where the vehicle's endurance is not known."""


def battery(
    mission: Mission, router: Router, charge: float | None, voltage_v: float | None
) -> Check:
    """The charge against what the mission needs, the way home included."""
    if charge is None:
        return Check.look(
            "battery",
            "its charge is not known: the reserve cannot be kept",
            "set up the power module (BAT1_ parameters), and say --duration",
        )
    volts = "" if voltage_v is None else f" ({voltage_v:.1f} V)"
    found = f"{charge:.0%}{volts}, reserve {mission.battery_reserve:.0%}"
    usable = charge - mission.battery_reserve
    endurance_s = mission.endurance_s
    if endurance_s is None:
        if usable < SPARE:
            return Check.bad("battery", found, "charge it, or swap it")
        advice = "say in the mission how long a full battery flies (endurance_s) to have it checked"
        return Check.look("battery", found, advice)
    return_planner = ReturnPlanner(router)
    worst = return_planner.worst_waypoint
    out_s = mission.altitude_above_home_m / CLIMB_M_S
    turning = mission.battery_reserve  # the charge at which the vehicle would turn there
    if worst is not None:
        out_s += return_planner.pace.time_s(worst[1])
        turning = max(turning, return_planner.pace.home_s(worst[1]) / endurance_s + LANDING_MARGIN)
    usable_s = (charge - turning) * endurance_s
    found += f": {max(usable_s, 0.0) / 60:.1f} min before it must come home"
    if usable_s < out_s:
        advice = f"reaching the farthest waypoint takes {out_s / 60:.1f} min: charge it or swap it"
        return Check.bad("battery", found, advice)
    if mission.duration_s is not None and usable_s < mission.duration_s:
        advice = f"it will come home before its {mission.duration_s / 60:.1f} min are over"
        return Check.look("battery", found, advice)
    return Check.good("battery", found)
