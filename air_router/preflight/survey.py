"""Facts about a valid mission before the flight: lengths, times, tightest places."""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from air_router.mission import HOME_NODE, Mission
from air_router.routing import Leg, NoRoute, Pace, ReturnPlanner, Route, Router, Way, WaypointGraph
from geo.frame import Point


@dataclass(frozen=True, slots=True)
class SurveyedLeg:
    """The way from one node to another, as the mission would fly it."""

    start: int  # node
    end: int
    route: Route
    closest_m: float  # smallest distance to a zone or the fence
    closest_to: str  # its name
    straight_blockers: tuple[str, ...]  # zones on the straight line


class MissionSurvey:
    """A mission, surveyed.

    Attributes:
        mission: The mission.
        graph: Its waypoint graph.
        router: Its router.
        return_planner: The ways home.
        steps: From home through all waypoints in order, and home again.
    """

    def __init__(self, graph: WaypointGraph) -> None:
        self.mission = graph.mission
        self.graph = graph
        self.router = Router(graph)
        self.return_planner = ReturnPlanner(self.router)
        self.steps = tuple(self._steps())

    @cached_property
    def stranded(self) -> tuple[tuple[int, str], ...]:
        """Waypoints without a way home, with the reason."""
        found = []
        for waypoint in self.mission.waypoints:
            if waypoint.number not in self.return_planner.home:
                answer = self.router.route(waypoint.position, HOME_NODE)
                if isinstance(answer, NoRoute):
                    found.append((waypoint.number, answer.reason))
        return tuple(found)

    @property
    def length_m(self) -> float:
        """Total length of the steps."""
        return sum(step.route.length_m for step in self.steps)

    @property
    def flight_time_s(self) -> float:
        """Approximate time of the steps, with a stop at every corner, without climb and landing."""
        return sum(route_time_s(step.route, self.mission.speed_m_s) for step in self.steps)

    def tightest(self, count: int) -> list[SurveyedLeg]:
        """The steps closest to a zone or the fence, closest first."""
        near = [step for step in self.steps if step.closest_to]
        return sorted(near, key=lambda step: step.closest_m)[:count]

    @property
    def around(self) -> list[SurveyedLeg]:
        """The steps without a clear straight leg."""
        return [step for step in self.steps if step.straight_blockers]

    def _steps(self) -> list[SurveyedLeg]:
        order = [HOME_NODE, *(waypoint.number for waypoint in self.mission.waypoints), HOME_NODE]
        legs = list(pairwise(order))
        ends = np.array([[self.graph.position(node) for node in leg] for leg in legs], dtype=float)
        airspace = self.mission.planning_airspace
        clear = airspace.legs_clear_between(ends[:, 0], ends[:, 1]).tolist()
        steps = [self._step(*leg, clear=ok) for leg, ok in zip(legs, clear, strict=True)]
        return [step for step in steps if step is not None]

    def _step(self, start: int, end: int, *, clear: bool) -> SurveyedLeg | None:
        here, there = self.graph.position(start), self.graph.position(end)
        blockers: tuple[str, ...] = ()
        route: Route | NoRoute = Route((Leg(there, end),), math.dist(here, there))
        if not clear:
            route = self.router.route(here, end)
            blockers = self.mission.planning_airspace.blockers(here, there)
        if isinstance(route, NoRoute):
            return None
        closest_m, closest_to = closest_approach(self.mission, here, route)
        return SurveyedLeg(start, end, route, closest_m, closest_to, blockers)


def closest_approach(mission: Mission, start: Point, route: Route) -> tuple[float, str]:
    """The closest distance of a route to a zone or the fence, in meters, and its name."""
    return mission.airspace.track_distance_m([start, *(leg.to for leg in route.legs)])


def route_time_s(route: Route, speed_m_s: float) -> float:
    """Approximate time of a route, with a stop at the end of every leg."""
    return Pace(speed_m_s, 0.0, None).time_s(Way(route.length_m, len(route.legs)))
