"""The two ways of planning between a start and a goal: on the waypoint graph, and the shortest.

Both are exact: the first leg satisfies the rule of departure, every other leg is clear.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
import numpy.typing as npt

from air_router.departure import Departure
from air_router.graph import WaypointGraph
from air_router.settings import PlannerKind
from geo.airspace import Airspace
from geo.frame import Point

_Floats = npt.NDArray[np.float64]

_ARRIVAL = -1
_FEW = 4
"""So many questions are asked one by one before they are asked in bulk."""


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight leg to a point; `node` is its waypoint number (0: home), None if it is no node."""

    to: Point
    node: int | None = None


class Planner(Protocol):
    """Finds legs from where a rule of departure is for to a clear target."""

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
        doors = [rule.rest] if rule.moving else []
        path = self._paths.path(
            rule.start, target.to, first=rule.allows if rule.special else None, doors=doors
        )
        return None if path is None else [*map(Leg, path[1:-1]), target]


class WaypointPlanner:
    """The paper's: onto the waypoint graph, along it, and off it at the goal.

    Where start and goal see each other the way is straight; where start or goal see no waypoint, or
    none that the graph joins, it is the shortest clear one.
    """

    def __init__(self, graph: WaypointGraph) -> None:
        self._graph = graph
        self._airspace = graph.mission.planning_airspace
        self._shortest = ShortestPlanner(graph)

    def legs(self, rule: Departure, target: Leg) -> list[Leg] | None:
        """As `Planner.legs`."""
        if rule.allows(target.to):
            return [target]
        way = self._way(rule, target)
        if way is None:
            return self._shortest.legs(rule, target)
        legs = [Leg(self._graph.position(way[0]), way[0])]
        for before, node in pairwise(way):
            legs += map(Leg, self._graph.via(before, node))
            legs.append(Leg(self._graph.position(node), node))
        return legs if target.node is not None else [*legs, target]

    def _way(self, rule: Departure, target: Leg) -> list[int] | None:
        """A* over the nodes; whether a node is seen is asked only when it matters."""
        graph = self._graph
        to_goal_m = np.hypot(*(graph.places - target.to).T)
        entering = _Entering(rule, graph, to_goal_m)
        leaving = _Leaving(self._airspace, graph, target.to)
        left_m: list[float] = to_goal_m.tolist()
        queue: list[tuple[float, float, int, int]] = []
        came_from: dict[int, int] = {}
        while not leaving.hopeless:
            while entering.estimate_m <= (queue[0][0] if queue else math.inf):
                for so_far_m, node in entering.take():
                    heapq.heappush(queue, (so_far_m + left_m[node], so_far_m, node, _ARRIVAL))
            if not queue:
                return None
            _, so_far_m, node, before = heapq.heappop(queue)
            if node in came_from:
                continue
            came_from[node] = before
            # A node that is the goal, or sees it: no other way is shorter.
            if node == target.node or (target.node is None and leaving.at(node)):
                return _trace(came_from, node)
            for other, length_m in graph.neighbours[node]:
                if other not in came_from:
                    reach_m = so_far_m + length_m
                    heapq.heappush(queue, (reach_m + left_m[other], reach_m, other, node))
        return None


class _Entering:
    """The nodes that the start sees, in the order of the way that they could allow."""

    def __init__(self, rule: Departure, graph: WaypointGraph, to_goal_m: _Floats) -> None:
        self._rule, self._graph = rule, graph
        away_m = np.hypot(*(graph.places - rule.start).T)
        estimates_m = away_m + to_goal_m
        order = np.argsort(estimates_m, kind="stable")
        rows = (order, away_m[order], estimates_m[order])
        self._waiting = list(zip(*(row.tolist() for row in rows), strict=True))[::-1]
        self._asked = _FEW

    @property
    def estimate_m(self) -> float:
        """The least way that a node allows which was not taken yet; nan if all were."""
        return self._waiting[-1][2] if self._waiting else math.nan

    def take(self) -> list[tuple[float, int]]:
        """The next nodes that are seen, and how far they are."""
        asked = [self._waiting.pop() for _ in range(min(self._asked, len(self._waiting)))]
        self._asked *= 2  # where few are seen it is quicker to ask for many at once
        answers = self._rule.allowed([self._graph.position(node) for node, _, _ in asked])
        return [(m, node) for (node, m, _), ok in zip(asked, answers, strict=True) if ok]


class _Leaving:
    """Which nodes see the goal; asked one by one at first, then all at once."""

    def __init__(self, airspace: Airspace, graph: WaypointGraph, goal: Point) -> None:
        self._airspace, self._graph, self._goal = airspace, graph, goal
        self._asked = 0
        self._seen: list[bool] | None = None

    @property
    def hopeless(self) -> bool:
        """Whether it is known that no node sees the goal."""
        return self._seen is not None and not any(self._seen)

    def at(self, node: int) -> bool:
        """Whether the goal is seen from a node."""
        self._asked += 1
        if self._seen is None and self._asked > _FEW:
            goals = np.broadcast_to(self._goal, self._graph.places.shape)
            self._seen = self._airspace.legs_clear_between(self._graph.places, goals).tolist()
        if self._seen is not None:
            return self._seen[node]
        return self._airspace.leg_clear(self._graph.position(node), self._goal)


def _trace(came_from: dict[int, int], node: int) -> list[int]:
    nodes = []
    while node != _ARRIVAL:
        nodes.append(node)
        node = came_from[node]
    return nodes[::-1]
