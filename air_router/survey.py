"""What can be said of a checked mission before it flies: lengths, times, the tightest places."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import networkx as nx

from air_router.flight_plan import HOME_NODE
from air_router.graph import WaypointGraph
from air_router.mission import Mission
from air_router.router import NoRoute, Route, Router
from geo.frame import Point

_ACCELERATION_M_S2 = 2.0
"""What a flight time counts for speeding up and braking at the ends of a leg."""


@dataclass(frozen=True, slots=True)
class Step:
    """The way from one node to another, as the mission would fly it."""

    start: int
    end: int
    route: Route
    closest_m: float
    closest_to: str
    straight_blockers: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Survey:
    """A mission, surveyed.

    Attributes:
        edges: Connections of the waypoint graph.
        detours: Those of them that lead around corners.
        connected: Whether the graph is in one piece.
        stranded: Nodes from which no way home was found, with the reason.
        steps: From home through all waypoints in order, and home again.
    """

    edges: int
    detours: int
    connected: bool
    stranded: tuple[tuple[int, str], ...]
    steps: tuple[Step, ...]

    @property
    def length_m(self) -> float:
        """Length of the steps."""
        return sum(step.route.length_m for step in self.steps)

    @property
    def tightest(self) -> Step | None:
        """The step that comes closest to a zone or to the fence."""
        return min(self.steps, key=lambda step: step.closest_m, default=None)

    def flight_time_s(self, speed_m_s: float) -> float:
        """About how long the steps take, with a stop at every corner; no climb, no landing."""
        return sum(route_time_s(step.route, speed_m_s) for step in self.steps)


def survey(graph: WaypointGraph) -> Survey:
    """Look at everything that the mission may fly."""
    router = Router(graph)
    mission = graph.mission
    stranded = []
    for waypoint in mission.waypoints:
        answer = router.route(waypoint.position, HOME_NODE)
        if isinstance(answer, NoRoute):
            stranded.append((waypoint.number, answer.reason))
    order = [HOME_NODE, *(waypoint.number for waypoint in mission.waypoints), HOME_NODE]
    steps = [_step(graph, router, start, end) for start, end in pairwise(order)]
    return Survey(
        edges=graph.graph.number_of_edges(),
        detours=len(list(graph.detours)),
        connected=nx.is_connected(graph.graph),
        stranded=tuple(stranded),
        steps=tuple(step for step in steps if step is not None),
    )


def closest_approach(mission: Mission, start: Point, route: Route) -> tuple[float, str]:
    """How close a route comes to any zone or to the fence, in metres, and to which."""
    return mission.airspace.track_distance_m([start, *(leg.to for leg in route.legs)])


def route_time_s(route: Route, speed_m_s: float) -> float:
    """About how long a route takes, with a stop at the end of every leg."""
    return route.length_m / speed_m_s + len(route.legs) * speed_m_s / _ACCELERATION_M_S2


def _step(graph: WaypointGraph, router: Router, start: int, end: int) -> Step | None:
    here, there = graph.position(start), graph.position(end)
    route = router.route(here, end)
    if isinstance(route, NoRoute):
        return None
    closest_m, closest_to = closest_approach(graph.mission, here, route)
    blockers = graph.mission.planning_airspace.blockers(here, there)
    return Step(start, end, route, closest_m, closest_to, blockers)
