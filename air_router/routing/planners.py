"""The two ways of planning between a start and a goal: on the waypoint graph, and the shortest.

Both are exact: the first leg satisfies the rule of departure, every other leg is clear.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
import numpy.typing as npt

from air_router.files.settings import PlannerKind
from air_router.routing.departure import Departure
from air_router.routing.graph import WaypointGraph
from geo.frame import Point

_START = -1


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight leg to a point; `node` is its waypoint number (0: home), None if it is no node."""

    to: Point
    node: int | None = None


class Planner(Protocol):
    """Finds legs from where a rule of departure is for to a clear target, not straight there."""

    def legs(self, rule: Departure, target: Leg) -> list[Leg] | None:
        """The legs in order, the target last; None if there are none."""


def planner_of(kind: PlannerKind, graph: WaypointGraph) -> Planner:
    """The planner that a mission chose."""
    return ShortestPlanner(graph) if kind == "shortest" else WaypointPlanner(graph)


class ShortestPlanner:
    """The shortest clear way, wherever the waypoints are."""

    def __init__(self, graph: WaypointGraph) -> None:
        self._paths = graph.paths

    def legs(self, rule: Departure, target: Leg) -> list[Leg] | None:
        """As `Planner.legs`."""
        doors = [rule.rest, *(on.place for on in rule.pending)] if rule.moving else []
        path = self._paths.path(
            rule.start, target.to, first=rule.allows if rule.special else None, doors=doors
        )
        return None if path is None else [*map(Leg, path[1:-1]), target]


class WaypointPlanner:
    """The paper's: onto the waypoint graph, along it, and off it at the goal.

    Legs onto the graph and off it are as long as its edges at most, unless no node is seen so near.
    Where start or goal see no waypoint, or none that the graph joins, it is the shortest clear one.
    """

    def __init__(self, graph: WaypointGraph) -> None:
        self._graph = graph
        self._airspace = graph.mission.planning_airspace  # with the tracking margin
        self._max_edge_m = graph.mission.planner.max_edge_m  # farther nodes are not joined
        self._shortest = ShortestPlanner(graph)

    def legs(self, rule: Departure, target: Leg) -> list[Leg] | None:
        """As `Planner.legs`."""
        way = self._way(rule, target)
        if way is None:
            return self._shortest.legs(rule, target)
        first = self._graph.position(way[0])
        there = first == rule.start and not rule.special  # nothing to fly, no leg
        legs = [] if there else [Leg(first, way[0])]
        for before, node in pairwise(way):
            legs += map(Leg, self._graph.via(before, node))
            legs.append(Leg(self._graph.position(node), node))
        return legs if target.node is not None else [*legs, target]

    def _way(self, rule: Departure, target: Leg) -> list[int] | None:
        """The nodes of the shortest way from those that the start sees to those that the goal sees.

        A* with the straight distance to the goal.
        """
        graph = self._graph
        to_goal_m: list[float] = self._distances_m(target.to).tolist()
        if target.node is not None:
            leaving = {target.node}
        else:
            leaving = self._seen(target.to, lambda ends: self._airspace.legs_clear(target.to, ends))
        if not leaving:
            return None
        entering = self._seen(rule.start, rule.allowed)
        queue = []
        for node in entering:
            away_m = math.dist(rule.start, graph.position(node))
            queue.append((away_m + to_goal_m[node], away_m, node, _START))
        heapq.heapify(queue)
        came_from: dict[int, int] = {}
        while queue:
            _, so_far_m, node, before = heapq.heappop(queue)
            if node in came_from:
                continue
            came_from[node] = before
            if node in leaving:  # what it is estimated by is the way from there: none is shorter
                return _trace(came_from, node)
            for other, length_m in graph.neighbours[node]:
                if other not in came_from:
                    reach_m = so_far_m + length_m
                    heapq.heappush(queue, (reach_m + to_goal_m[other], reach_m, other, node))
        return None

    def _seen(self, place: Point, ask: Callable[[list[Point]], list[bool]]) -> set[int]:
        """The nodes seen from a place, no farther than edges are long; else any that are seen."""
        near = self._distances_m(place) <= self._max_edge_m
        for nodes in (np.flatnonzero(near).tolist(), np.flatnonzero(~near).tolist()):
            answers = ask([self._graph.position(node) for node in nodes])
            seen = {node for node, ok in zip(nodes, answers, strict=True) if ok}
            if seen:
                return seen
        return set()

    def _distances_m(self, place: Point) -> npt.NDArray[np.float64]:
        return np.asarray(np.hypot(*(self._graph.places - place).T))


def _trace(came_from: dict[int, int], node: int) -> list[int]:
    nodes = []
    while node != _START:
        nodes.append(node)
        node = came_from[node]
    return nodes[::-1]
