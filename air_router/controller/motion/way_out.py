"""Where a vehicle leaves the zones that it is in, by the zones at its altitude.

At the cruise altitudes this is the nearest clear place with a way home. Below or above them other
zones count: those between the vehicle's altitude and the cruise altitudes, so that the vehicle can
climb or descend where it has left the zone.
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
    """Where a zone is left, and the router for it; None: the cruise altitudes' router."""

    place: Point
    router: Router | None = None


def off_cruise(mission: Mission, telemetry: Telemetry) -> bool:
    """Whether the vehicle is below or above the cruise altitudes."""
    return not mission.cruises_at(telemetry.altitude_m)


def nearest_way_out(router: Router, mission: Mission, telemetry: Telemetry) -> WayOut | None:
    """The nearest place outside every zone that the vehicle is in; None if there is none.

    A place with a way home at the cruise altitudes is preferred.

    Args:
        router: The cruise altitudes' router.
        mission: The mission with the current zones.
        telemetry: The vehicle's position and altitude.
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
    """Clear places around the vehicle, the nearest first."""
    nearest = paths.nearest(here)
    if nearest is not None:
        yield nearest
    yield from paths.exits(here)


def _router_around(mission: Mission, telemetry: Telemetry) -> Router:
    """A router near the vehicle, for the zones between its altitude and the cruise altitudes."""
    planner = replace(mission.planner, kind="shortest")
    airspace = mission.airspace_off_cruise(telemetry.altitude_m)
    around = airspace.around(telemetry.position, REACH_M).with_margin(mission.tracking.planned_m)
    return Router(
        WaypointGraph(replace(mission, waypoints=(), planner=planner, planning_airspace=around))
    )
