"""What is measured: our two planners, what a shortest path is at least, and other programs."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
import shapely
from shapely import Polygon

from air_router.files import PlannerSettings
from air_router.mission import TrackingMargin
from air_router.routing import Route, Router, WaypointGraph
from benchmarks.route.maps import Map
from geo.frame import Point
from geo.paths import HAIR_M, FreeSpace, Mesh, Source, path_length_m, shortest_path, shortest_paths

Query = Callable[[Point, Point], float | None]
"""Length of the path between two places; None if there is none."""


class Way(Protocol):
    """Prepares for a map (not timed), then builds what it needs for queries."""

    def __init__(self, map_: Map) -> None: ...

    def build(self) -> Query: ...


class Shortest:
    """Our planner `shortest`: build is free space, mesh and location index; query is the router."""

    def __init__(self, map_: Map) -> None:
        self._map = map_

    def build(self) -> Query:
        shortest_paths.cache_clear()
        return routed(Router(WaypointGraph(mission(self._map, "shortest", nodes=1))))


class Waypoints:
    """Our planner `waypoints`: build is the waypoint graph on a ready mesh; query is the router."""

    def __init__(self, map_: Map) -> None:
        self._mission = mission(map_, "waypoints")
        WaypointGraph(self._mission)

    def build(self) -> Query:
        return routed(Router(WaypointGraph(self._mission)))


class Arcs:
    """The reference for lengths: the same search where zones are grown with fine arcs."""

    def __init__(self, map_: Map) -> None:
        self._map = map_

    def build(self) -> Query:
        mesh = Mesh(FreeSpace(self._map.airspace).tight())

        def query(start: Point, goal: Point) -> float | None:
            path = shortest_path(mesh, [Source(0.0, start)], goal)
            return None if path is None else path_length_m(path)

        return query


class ExtremityPathfinder:
    """extremitypathfinder: a visibility graph of extremities, on our polygons."""

    def __init__(self, map_: Map) -> None:
        self._area = largest_part(map_)

    def build(self) -> Query:
        from extremitypathfinder import PolygonEnvironment  # noqa: PLC0415 - only where installed

        environment = PolygonEnvironment()
        outside = shapely.geometry.polygon.orient(self._area)
        holes = [shapely.get_coordinates(hole)[:-1] for hole in outside.interiors]
        environment.store(shapely.get_coordinates(outside.exterior)[:-1], holes, validate=False)

        def query(start: Point, goal: Point) -> float | None:
            _, length_m = environment.find_shortest_path(start, goal, verify=False)
            return None if length_m is None else float(length_m)

        return query


class PyVisGraph:
    """pyvisgraph: a whole visibility graph, on our polygons."""

    def __init__(self, map_: Map) -> None:
        self._area = largest_part(map_)

    def build(self) -> Query:
        import pyvisgraph as vg  # noqa: PLC0415 - only where installed

        rings = [self._area.exterior, *self._area.interiors]
        graph = vg.VisGraph()
        corners = [shapely.get_coordinates(ring)[:-1].tolist() for ring in rings]
        graph.build([[vg.Point(*place) for place in ring] for ring in corners], status=False)

        def query(start: Point, goal: Point) -> float | None:
            path = graph.shortest_path(vg.Point(*start), vg.Point(*goal))
            return path_length_m([Point(place.x, place.y) for place in path])

        return query


WAYS: dict[str, type[Way]] = {
    "shortest": Shortest,
    "waypoints": Waypoints,
    "arcs": Arcs,
    "extremitypathfinder": ExtremityPathfinder,
    "pyvisgraph": PyVisGraph,
}
PEERS = ("extremitypathfinder", "pyvisgraph")


def mission(map_: Map, kind: Any, nodes: int | None = None) -> Any:
    """What the planners read from a mission."""
    places = map_.waypoints[:nodes]
    return SimpleNamespace(
        airspace=map_.airspace,
        planning_airspace=map_.airspace,
        home=places[0],
        waypoints=[SimpleNamespace(position=place) for place in places[1:]],
        planner=PlannerSettings(max_edge_m=map_.max_edge_m, kind=kind),
        tracking=TrackingMargin(0.0, 0.0, 0.0, 0.0, 0.0),
    )


def routed(router: Router) -> Query:
    def query(start: Point, goal: Point) -> float | None:
        route = router.route(start, goal)
        return route.length_m if isinstance(route, Route) else None

    return query


def largest_part(map_: Map) -> Polygon:
    return max(FreeSpace(map_.airspace).lean, key=lambda part: part.area)


def bare(map_: Map) -> None:
    """The shapely calls that free space and mesh are made of, and nothing else."""
    reach_m = map_.airspace.clearance_m + HAIR_M
    style = {"join_style": "mitre", "mitre_limit": 1.03}
    zones = np.array([zone.polygon for zone in map_.airspace.zones], dtype=object)
    (fence,) = map_.airspace.fences
    inside = shapely.buffer(fence.polygon, -reach_m, **style)
    free = shapely.difference(inside, shapely.union_all(shapely.buffer(zones, reach_m, **style)))
    shapely.constrained_delaunay_triangles(free)
