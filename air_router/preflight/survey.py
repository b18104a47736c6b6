"""Facts about a checked mission before it flies: lengths, times, the tightest places."""

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
    closest_m: float  # least distance to a zone or the fence
    closest_to: str  # its name
    straight_blockers: tuple[str, ...]  # zones in the straight way


class MissionSurvey:
    """A mission, surveyed.

    Attributes:
        mission: What was surveyed.
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
        """Waypoints from which no way home was found, with the reason."""
        found = []
        for waypoint in self.mission.waypoints:
            if waypoint.number not in self.return_planner.home:
                answer = self.router.route(waypoint.position, HOME_NODE)
                if isinstance(answer, NoRoute):
                    found.append((waypoint.number, answer.reason))
        return tuple(found)

    @property
    def length_m(self) -> float:
        """Length of the steps."""
        return sum(step.route.length_m for step in self.steps)

    @property
    def flight_time_s(self) -> float:
        """About how long the steps take, with a stop at every corner; no climb, no landing."""
        return sum(route_time_s(step.route, self.mission.speed_m_s) for step in self.steps)

    def tightest(self, count: int) -> list[SurveyedLeg]:
        """The steps that come closest to a zone or to the fence, closest first."""
        near = [step for step in self.steps if step.closest_to]
        return sorted(near, key=lambda step: step.closest_m)[:count]

    @property
    def around(self) -> list[SurveyedLeg]:
        """The steps whose straight leg is not clear."""
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
    """How close a route comes to any zone or to the fence, in metres, and to which."""
    return mission.airspace.track_distance_m([start, *(leg.to for leg in route.legs)])


def route_time_s(route: Route, speed_m_s: float) -> float:
    """About how long a route takes, with a stop at the end of every leg."""
    return Pace(speed_m_s, 0.0, None).time_s(Way(route.length_m, len(route.legs)))
