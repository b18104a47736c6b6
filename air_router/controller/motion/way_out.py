"""Where a vehicle leaves the zones that it is in, by what applies at the height where it is.

At the cruise altitudes that is the nearest clear place from which a way leads home. Below or above
them other zones count: what applies from the vehicle's height to the cruise altitudes, so that it
can climb, or descend, where it has left.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from air_router.controller.motion.limits import REACH_M
from air_router.mission import Mission
from air_router.routing import Router, WaypointGraph
from air_router.vehicle import Telemetry
from geo.frame import Point
from geo.paths import ShortestPaths


class WayOut(NamedTuple):
    """Where a zone is left, and by which router; None: that of the cruise altitudes."""

    place: Point
    router: Router | None = None


def off_cruise(mission: Mission, telemetry: Telemetry) -> bool:
    """Whether the vehicle is below, or above, where the mission flies."""
    return not mission.cruise.lower_m <= telemetry.altitude_m <= mission.cruise.upper_m


def nearest_way_out(router: Router, mission: Mission, telemetry: Telemetry) -> WayOut | None:
    """The nearest place where the vehicle is out of all that it is in; None if there is none.

    One from which a way leads home at the cruise altitudes, if there is any.

    Args:
        router: That of the cruise altitudes.
        mission: With the zones of now.
        telemetry: Where the vehicle is, and how high.
    """
    paths, here, home = router.graph.paths, telemetry.position, mission.home
    if not off_cruise(mission, telemetry):
        place = paths.nearest(here, reachable_from=home) or paths.nearest(here)
        return None if place is None else WayOut(place)
    local = _router_around(mission, telemetry)
    rest = [*_places(local.graph.paths, here)]
    homeward = (place for place in rest if paths.connected(home, place))
    found = next(homeward, None) or next(iter(rest), None)
    return None if found is None else WayOut(found, local)


def _places(paths: ShortestPaths, here: Point) -> Iterator[Point]:
    """Clear places around, the nearest first."""
    nearest = paths.nearest(here)
    if nearest is not None:
        yield nearest
    yield from paths.exits(here)


def _router_around(mission: Mission, telemetry: Telemetry) -> Router:
    """Plans among what applies from the vehicle's height to the cruise altitudes, near to it."""
    planner = replace(mission.planner, kind="shortest")
    airspace = mission.airspace_off_cruise(telemetry.altitude_m)
    around = airspace.around(telemetry.position, REACH_M).with_margin(mission.tracking.planned_m)
    return Router(
        WaypointGraph(replace(mission, waypoints=(), planner=planner, planning_airspace=around))
    )
