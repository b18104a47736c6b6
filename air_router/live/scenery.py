"""What does not move on the live page: fences, zones and what is kept from them, graph, places."""

from collections.abc import Sequence
from typing import Any, Final

from air_router.mission.flight_plan import HOME_NODE
from air_router.mission.mission import Mission
from air_router.routing.router import Router
from air_router.web.outlines import area_beside, buffer, degrees
from geo.airspace.zone import Shape

_MOST_EDGES: Final = 20_000


def scenery(mission: Mission, router: Router) -> dict[str, Any]:
    """Everything of a mission that the page draws, in degrees."""
    frame = mission.frame
    idle = {entry.zone.name: entry.reason for entry in mission.idle_zones}
    planner = mission.planner

    def area(
        name: str, shape: Shape, clearance_m: float, notes: Sequence[str] = (), sign: int = 1
    ) -> dict[str, Any]:
        kept_m = (clearance_m, clearance_m + planner.tracking_margin_m)
        buffers = [buffer(frame, shape, sign * distance_m) for distance_m in kept_m]
        outline = buffer(frame, shape, 0.0)
        return area_beside(name, outline, buffers, [*notes], is_fence=sign < 0)

    areas = [area("fence", fence, planner.clearance_m, sign=-1) for fence in mission.fences]
    for zone in (*mission.zones, *mission.climb_corridors):
        own_m = zone.clearance_m
        notes = [] if own_m is None else [f"clearance {own_m:g} m"]
        notes += [idle[zone.name]] if zone.name in idle else []
        clearance_m = planner.clearance_m if own_m is None else own_m
        areas.append(area(zone.name, zone.shape, clearance_m, notes))
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
