"""Routes from where the vehicle is to a waypoint or any other point, every leg checked.

The paper's planner, made exact: the start is joined to every waypoint that it sees, the goal
likewise, and between them the route stays on the waypoint graph. Where start or goal see no
waypoint the route is the shortest one around the corners of the zones.
Every leg is clear in the mission's planning airspace; what a first leg may do when the vehicle is
where it should not be, or moves, is said in `departure`.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from shapely import LineString
from shapely import Point as ShapelyPoint
from shapely.ops import nearest_points

from air_router.departure import Departure, names_of
from air_router.graph import WaypointGraph, polyline_length_m
from geo.airspace import FENCE
from geo.frame import Point
from geo.regions import Regions

_SAME_M = 0.01
"""A free point nearer than this to a waypoint is the waypoint."""

_RAYS = 48
_RAY_M = 2_000.0


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight leg to a point; `node` is its waypoint number (0: home), None if it is no node."""

    to: Point
    node: int | None = None


@dataclass(frozen=True, slots=True)
class Route:
    """Legs from the start to the goal, and their length.

    `warnings` says what is wrong with where the vehicle is now; the route leaves it at once.
    """

    legs: tuple[Leg, ...]
    length_m: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class NoRoute:
    """There is no route: why, and the names of the zones (or of the fence) in the way."""

    reason: str
    blockers: tuple[str, ...] = ()


class Router:
    """Finds routes over a mission's waypoint graph."""

    def __init__(self, graph: WaypointGraph) -> None:
        self._graph = graph
        self._mission = graph.mission
        self._airspace = graph.mission.planning_airspace
        self._departing = self._airspace.with_margin(graph.mission.planner.departure_margin_m)
        self._regions: Regions | None = None

    def route(
        self, start: Point, goal: Point | int, *, stopping: Point | None = None
    ) -> Route | NoRoute:
        """The shortest known route.

        Args:
            start: where the vehicle is.
            goal: a node of the graph, or any point.
            stopping: where the vehicle comes to rest if it brakes now; None if it stands.

        Returns:
            A Route whose legs are all clear by the rules above, or NoRoute with the reason: the
            goal is not clear, zones separate start and goal, no first leg is clear at this speed.
        """
        target = self._goal(goal)
        if not self._airspace.point_clear(target.to):
            return self._bad_goal(target)
        for rule in self._departures(start, stopping):
            points = self._points(target, rule)
            if points is not None:
                return _route(start, points, rule.warnings)
        for out in self._ways_out(start) if rule.cramped else []:
            if rule.allows(out):
                onward = self._points(target, Departure(self._airspace, out, None))
                if onward is not None:
                    return _route(start, [Leg(out), *onward], rule.warnings)
        return self._no_route(start, target, rule)

    def check_leg(self, start: Point, end: Point, stopping: Point | None = None) -> bool:
        """Whether the vehicle, now at `start`, may be sent straight to `end`."""
        return self._airspace.point_clear(end) and any(
            rule.allows(end) for rule in self._departures(start, stopping)
        )

    def _departures(self, start: Point, stopping: Point | None) -> Iterator[Departure]:
        """With the whole tracking margin, and where that is too much to ask, with half of it."""
        for airspace in (self._airspace, self._departing):
            yield Departure(airspace, start, stopping)

    def _goal(self, goal: Point | int) -> Leg:
        if isinstance(goal, int):
            return Leg(self._graph.position(goal), goal)
        for node, position in self._graph.positions.items():
            if math.dist(position, goal) <= _SAME_M:
                return Leg(position, node)
        return Leg(goal)

    def _points(self, target: Leg, rule: Departure) -> list[Leg] | None:
        """The legs from the rule's start to the target; None if there are none."""
        if rule.allows(target.to):
            return [target]
        nodes = self._graph.positions
        sees = rule.allowed(list(nodes.values()))
        firsts = {
            node: math.dist(rule.start, position)
            for (node, position), ok in zip(nodes.items(), sees, strict=True)
            if ok
        }
        if firsts:
            legs = self._on_graph(firsts, target)
            if legs is not None:
                return legs
        path = self._graph.paths.path(rule.start, target.to, first=rule.allows)
        return None if path is None else [*map(Leg, path[1:-1]), target]

    def _on_graph(self, firsts: dict[int, float], target: Leg) -> list[Leg] | None:
        """A* from the nodes that the start sees to those that the goal sees."""
        if target.node is not None:
            lasts = {target.node: 0.0}
        else:
            nodes = self._graph.positions
            seen = self._airspace.legs_clear(target.to, list(nodes.values()))
            lasts = {
                node: math.dist(target.to, position)
                for (node, position), ok in zip(nodes.items(), seen, strict=True)
                if ok
            }
        if not lasts:
            return None
        way = _shortest(self._graph, firsts, lasts, target.to)
        if way is None:
            return None
        legs = [Leg(self._graph.position(way[0]), way[0])]
        for before, node in pairwise(way):
            legs += map(Leg, self._graph.via(before, node))
            legs.append(Leg(self._graph.position(node), node))
        return legs if target.node is not None else [*legs, target]

    def _ways_out(self, start: Point) -> list[Point]:
        """Clear places around a start that is not clear, nearest first."""
        free = self._airspace.free
        if free.is_empty:
            return []
        nearest = self._airspace.nearest_clear(start)
        found = [nearest] if nearest is not None else []
        for step in range(_RAYS):
            angle = 2 * math.pi * step / _RAYS
            east_m = start.east_m + _RAY_M * math.cos(angle)
            north_m = start.north_m + _RAY_M * math.sin(angle)
            on_ray = LineString([start, (east_m, north_m)]).intersection(free)
            if not on_ray.is_empty:
                place = nearest_points(on_ray, ShapelyPoint(start))[0]
                found.append(Point(place.x, place.y))
        found += self._graph.paths.nearest_corners(start)[:_RAYS]
        return sorted(found, key=lambda place: math.dist(place, start))

    def _bad_goal(self, target: Leg) -> NoRoute:
        holders = self._airspace.holders(target.to)
        spare_m, name = self._airspace.spare_m(target.to)
        if FENCE in holders:
            return NoRoute("the goal lies outside of the fence", holders)
        if holders:
            return NoRoute(f"the goal lies inside {names_of(holders)}", holders)
        kept_m = self._airspace.kept_m(name)
        return NoRoute(
            f"the goal is {kept_m + spare_m:.1f} m from {names_of((name,))}, "
            f"routes keep {kept_m:g} m",
            (name,),
        )

    def _no_route(self, start: Point, target: Leg, rule: Departure) -> NoRoute:
        if self._regions is None:
            self._regions = Regions(self._airspace)
        walls = self._regions.separators(start, target.to)
        if walls:
            keep = f"{self._airspace.fence_distance_m:g} m"
            return NoRoute(
                f"{names_of(walls)} separate start and goal at {keep} of distance", walls
            )
        if rule.moving:
            return NoRoute(
                "no first leg is clear at this speed", self._airspace.blockers(start, rule.rest)
            )
        if rule.cramped:
            return NoRoute(
                "no clear way out of where the vehicle is", (self._airspace.nearest(start)[1],)
            )
        return NoRoute(
            "no clear way around what lies between", self._airspace.blockers(start, target.to)
        )


def _route(start: Point, legs: Sequence[Leg], warnings: tuple[str, ...]) -> Route:
    length_m = polyline_length_m((start, *(leg.to for leg in legs)))
    return Route(tuple(legs), length_m, warnings)


def _shortest(
    graph: WaypointGraph, firsts: dict[int, float], lasts: dict[int, float], goal: Point
) -> list[int] | None:
    """The nodes of the shortest way: in at one of `firsts`, out at one of `lasts`."""
    queue = [(m + math.dist(graph.position(n), goal), m, n, -1) for n, m in firsts.items()]
    heapq.heapify(queue)
    came_from: dict[int, int] = {}
    arrival = -2
    while queue:
        _, so_far_m, node, before = heapq.heappop(queue)
        if node in came_from:
            continue
        if node == arrival:
            return _trace(came_from, before)
        came_from[node] = before
        for other, edge in graph.graph.adj[node].items():
            if other not in came_from:
                reach_m = so_far_m + edge["length_m"]
                estimate_m = reach_m + math.dist(graph.position(other), goal)
                heapq.heappush(queue, (estimate_m, reach_m, other, node))
        if node in lasts:
            heapq.heappush(queue, (so_far_m + lasts[node], so_far_m + lasts[node], arrival, node))
    return None


def _trace(came_from: dict[int, int], node: int) -> list[int]:
    nodes = []
    while node >= 0:
        nodes.append(node)
        node = came_from[node]
    return nodes[::-1]
