"""Where the autopilot's own return would fly, and what it would cut.

PX4's Return climbs to RTL_RETURN_ALT, flies straight and lands; with RTL_TYPE 0, the default of
multicopters, at the nearest of home and the rally points, which are the mission's: they go on board
with it. No fence is tested on the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from air_router.mission.mission import Mission
from geo.airspace.airspace import Airspace
from geo.frame import Point

RETURN_ALTITUDE_M: Final = 60.0
"""PX4's default of RTL_RETURN_ALT, above home."""


@dataclass(frozen=True, slots=True)
class StraightReturn:
    """Where the autopilot's own return from a waypoint would go, and what it would cut.

    Attributes:
        waypoint: its number.
        to: `home`, or `rally point N`.
        cuts: names of zones, and the fence.
    """

    waypoint: int
    to: str
    cuts: tuple[str, ...]


def straight_returns(mission: Mission) -> tuple[StraightReturn, ...]:
    """From which waypoints the autopilot's own return would cut a zone or the fence."""
    if not mission.waypoints:
        return ()
    airspace = return_airspace(mission)
    here = np.array([w.position for w in mission.waypoints])
    ends = np.array([mission.home, *mission.rally_points])
    aims = np.argmin(np.hypot(*(here[:, None] - ends[None]).transpose(2, 0, 1)), axis=1)
    found = []
    for index in np.flatnonzero(~airspace.legs_clear_between(here, ends[aims])):
        waypoint, aim = mission.waypoints[index], int(aims[index])
        cuts = airspace.blockers(waypoint.position, Point(*ends[aim].tolist()))
        to = f"rally point {aim}" if aim else "home"
        found.append(StraightReturn(waypoint.number, to, cuts))
    return tuple(found)


def return_airspace(mission: Mission) -> Airspace:
    """What the autopilot's own return may cut: as drawn, at the altitudes where it flies."""
    every = Airspace(
        mission.fences, (*mission.zones, *mission.climb_corridors), mission.planner.clearance_m
    )
    active = every.during(mission.window.start, mission.window.end)
    highest_m = max(mission.cruise.upper_m, RETURN_ALTITUDE_M)
    return active.at(mission.cruise.lower_m, highest_m).as_drawn()
