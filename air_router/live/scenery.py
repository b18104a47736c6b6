"""What does not move on the live page: fences, zones and what is kept from them, graph, places."""

from __future__ import annotations

from typing import Any, Final

from air_router.mission.flight_plan import HOME_NODE
from air_router.mission.mission import Mission
from air_router.routing.router import Router
from air_router.web.outlines import buffer, degrees
from geo.airspace.zone import Shape

_MOST_EDGES: Final = 20_000


def scenery(mission: Mission, router: Router) -> dict[str, Any]:
    """Everything of a mission that the page draws, in degrees."""
    frame = mission.frame
    idle = {entry.zone.name: entry.reason for entry in mission.idle_zones}
    planner = mission.planner
    areas = [
        _area(mission, "fence", fence, is_fence=True, clearance_m=planner.clearance_m, notes=[])
        for fence in mission.fences
    ]
    for zone in (*mission.zones, *mission.columns):
        own_m = zone.clearance_m
        notes = [] if own_m is None else [f"clearance {own_m:g} m"]
        notes += [idle[zone.name]] if zone.name in idle else []
        clearance_m = planner.clearance_m if own_m is None else own_m
        areas.append(
            _area(
                mission, zone.name, zone.shape, is_fence=False, clearance_m=clearance_m, notes=notes
            )
        )
    graph = router.graph
    positions = {node: degrees(frame, place) for node, place in graph.positions.items()}
    places: list[dict[str, Any]] = [
        {"kind": "home" if node == HOME_NODE else "waypoint", "node": node, "at": at}
        for node, at in sorted(positions.items())
    ]
    places += [
        {"kind": "rally", "node": None, "at": degrees(frame, place)}
        for place in mission.rally_points
    ]
    edges = [
        [
            degrees(frame, point)
            for point in (graph.position(a), *graph.via(a, b), graph.position(b))
        ]
        for a, b in list(graph.graph.edges)[:_MOST_EDGES]
    ]
    return {
        "name": mission.name,
        "file": mission.path.name,
        "areas": areas,
        "places": places,
        "edges": edges,
    }


def _area(  # noqa: PLR0913 - what an area is made of
    mission: Mission,
    name: str,
    shape: Shape,
    *,
    is_fence: bool,
    clearance_m: float,
    notes: list[str],
) -> dict[str, Any]:
    sign = -1 if is_fence else 1
    kept_m = (clearance_m, clearance_m + mission.planner.tracking_margin_m)
    return {
        "keys": None,
        "name": name,
        "fence": is_fence,
        "outline": buffer(mission.frame, shape, 0.0),
        "rings": [],
        "circle": None,
        "wrong": False,
        "notes": notes,
        "buffers": [buffer(mission.frame, shape, sign * distance_m) for distance_m in kept_m],
    }
