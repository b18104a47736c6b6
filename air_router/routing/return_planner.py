"""Ways home: length, time, required charge, and what PX4's own Return would do.

The vehicle comes home along the waypoint graph. All lengths come from one shortest-path tree from
home, and one from all rally points, so a mission with thousands of waypoints takes a fraction of a
second. A clear straight leg home is preferred, as in flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from heapq import heapify, heappop, heappush
from itertools import count

import numpy as np

from air_router.mission import HOME_NODE, Mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.limits import (
    ACCELERATION_M_S2,
    LANDING_M_S,
    RTL_RETURN_ALT_M,
    WAY_HOME_EVERY_S,
    WAY_HOME_MOVED_M,
)
from air_router.routing.router import Route, Router
from air_router.vehicle import Telemetry
from geo.airspace import Airspace
from geo.frame import Point


@dataclass(frozen=True, slots=True, order=True)
class Way:
    """The length and the number of legs of a clear way."""

    length_m: float
    legs: int = 1  # each takes time to brake and accelerate


@dataclass(frozen=True, slots=True)
class Pace:
    """Times of a vehicle on its ways.

    Attributes:
        speed_m_s: Cruise speed.
        landing_s: Time from the mission's altitude to the ground.
        endurance_s: Flight time of a full battery; None: unknown.
    """

    speed_m_s: float
    landing_s: float
    endurance_s: float | None

    @classmethod
    def of(cls, mission: Mission) -> Pace:
        """A mission's pace, with the landing from its highest altitude."""
        highest_m = mission.altitudes_m[1]
        return cls(mission.speed_m_s, highest_m / LANDING_M_S, mission.endurance_s)

    def time_s(self, way: Way) -> float:
        """Flight time of a way, with a stop at the end of every leg."""
        return way.length_m / self.speed_m_s + way.legs * self.speed_m_s / ACCELERATION_M_S2

    def home_s(self, way: Way) -> float:
        """Time of the way home including the landing."""
        return self.time_s(way) + self.landing_s

    def need(self, way: Way) -> float | None:
        """The share of a full battery needed to fly home and land; None: unknown."""
        return None if self.endurance_s is None else self.home_s(way) / self.endurance_s


class ReturnPlanner:
    """The ways from all nodes of a waypoint graph to home and to the nearest rally point."""

    def __init__(self, router: Router) -> None:
        self._graph = router.graph
        self._router = router
        self._mission = router.graph.mission
        self.pace = Pace.of(self._mission)  # times of this vehicle

    @cached_property
    def home(self) -> Mapping[int, Way]:
        """The way home from every node that has one."""
        ways = _tree(self._graph, {HOME_NODE: Way(0.0, 0)})
        return self._with_straight(ways, self._mission.home)

    @cached_property
    def rally(self) -> Mapping[int, Way]:
        """The way to the nearest rally point (by length) from every node that has one."""
        ways: dict[int, Way] = {}
        for place in self._mission.landings:
            known = self._with_straight({}, place) or self._by_route(place)
            for node, way in known.items():
                ways[node] = min(way, ways.get(node, way))
        return _tree(self._graph, ways) if ways else {}

    @property
    def worst_waypoint(self) -> tuple[int, Way] | None:
        """The waypoint with the longest way home; None: no waypoint has one."""
        ways = {
            w.number: self.home[w.number] for w in self._mission.waypoints if w.number in self.home
        }
        if not ways:
            return None
        number = max(ways, key=lambda n: self.pace.time_s(ways[n]))
        if self._mission.planner.kind != "shortest":
            return number, ways[number]
        return self._worst_of_shortest(ways)

    @property
    def worst_place(self) -> tuple[tuple[int, int], Way] | None:
        """The leg with the place farthest from home, and the way from there.

        On a leg of length L between a and b this is the place with equally long ways home by a and
        by b: (L + way of a + way of b) / 2. None if routes leave the graph.
        """
        if self._mission.planner.kind == "shortest":
            return None
        worst: tuple[tuple[int, int], Way] | None = None
        for a, around in enumerate(self._graph.neighbours):
            for b, apart_m in around:
                if a > b or a not in self.home or b not in self.home:
                    continue
                length_m = (apart_m + self.home[a].length_m + self.home[b].length_m) / 2
                legs = 1 + max(self.home[a].legs, self.home[b].legs)
                if worst is None or length_m > worst[1].length_m:
                    worst = ((a, b), Way(length_m, legs))
        return worst

    def _worst_of_shortest(self, ways: Mapping[int, Way]) -> tuple[int, Way]:
        """The worst waypoint if routes leave the graph: the graph's ways are upper bounds."""
        worst: tuple[float, int, Way] | None = None
        for number in sorted(ways, key=lambda n: -self.pace.time_s(ways[n])):
            way = ways[number]
            if worst is not None and self.pace.time_s(way) <= worst[0]:
                break
            route = self._router.route(self._graph.position(number), HOME_NODE)
            if isinstance(route, Route):
                way = min(way, Way(route.length_m, len(route.legs)))
            worst = max(worst or (0.0, number, way), (self.pace.time_s(way), number, way))
        assert worst is not None  # noqa: S101 - there are ways
        return worst[1], worst[2]

    def _with_straight(self, ways: Mapping[int, Way], place: Point) -> dict[int, Way]:
        """The ways, replaced by straight ones to a place if those are clear."""
        better = dict(ways)
        nodes = self._graph.positions
        clear = self._mission.planning_airspace.legs_clear(place, list(nodes.values()))
        for (node, position), ok in zip(nodes.items(), clear, strict=True):
            if ok:
                straight = Way(math.dist(position, place))
                better[node] = min(straight, better.get(node, straight))
        return better

    def _by_route(self, place: Point) -> dict[int, Way]:
        """The way to a place without a clear leg to any node, from its nearest node."""
        nodes = self._graph.positions
        nearest = min(nodes, key=lambda node: math.dist(nodes[node], place))
        route = self._router.route(nodes[nearest], place)
        if not isinstance(route, Route):
            return {}
        return {nearest: Way(route.length_m, len(route.legs))}


@dataclass(slots=True, eq=False)
class WayHome:
    """The way home from the vehicle's position, updated repeatedly in flight. Pure.

    Attributes:
        need_now: The last result.
    """

    need_now: float | None = None
    _router: Router | None = None
    _pace: Pace | None = None
    _from: Point | None = None  # start of the planned way
    _planned_s: float = -math.inf  # time of planning, vehicle's clock
    _way: Way | None = None

    def need(self, telemetry: Telemetry, router: Router) -> float | None:
        """The share of a full battery needed to fly home from here and land.

        None while endurance or way are unknown. If no way is found now (too fast, too near a zone),
        the last way plus the distance to its start is used.

        Args:
            telemetry: The vehicle's position.
            router: The router for the current zones; a different router discards earlier results.
        """
        if router is not self._router:
            self._router, self._pace = router, Pace.of(router.graph.mission)
            self._from, self._planned_s, self._way = None, -math.inf, None
        pace = self._pace
        if pace is None or pace.endurance_s is None:
            self.need_now = None
            return None
        moved_m = math.inf if self._from is None else math.dist(self._from, telemetry.position)
        if moved_m >= WAY_HOME_MOVED_M or telemetry.time_s >= self._planned_s + WAY_HOME_EVERY_S:
            self._planned_s = telemetry.time_s
            route = router.route(telemetry.position, HOME_NODE)
            if isinstance(route, Route):
                self._from, moved_m = telemetry.position, 0.0
                self._way = Way(route.length_m, len(route.legs))
        way = self._way
        self.need_now = (
            None if way is None else pace.need(Way(way.length_m + moved_m, way.legs + 1))
        )
        return self.need_now


def _tree(graph: WaypointGraph, ends: Mapping[int, Way]) -> dict[int, Way]:
    """The shortest ways over the graph to the nearest end node, each end with an onward way."""
    ways: dict[int, Way] = {}
    best_m = {node: way.length_m for node, way in ends.items()}
    number = count()  # of equally long ways the first one counts
    waiting = [(way.length_m, next(number), node, way.legs) for node, way in ends.items()]
    heapify(waiting)
    while waiting:
        length_m, _, node, legs = heappop(waiting)
        if node in ways:
            continue
        ways[node] = Way(length_m, legs)
        for other, apart_m in graph.neighbours[node]:
            reached_m = length_m + apart_m
            if reached_m < best_m.get(other, math.inf):
                best_m[other] = reached_m
                more = 1 + len(graph.via(other, node))
                heappush(waiting, (reached_m, next(number), other, legs + more))
    return ways


@dataclass(frozen=True, slots=True)
class StraightReturn:
    """PX4's own Return from a waypoint, and the zones it would cut.

    Attributes:
        waypoint: Number of the waypoint.
        to: `home`, or `rally point N`.
        cuts: Names of the zones, and the fence.
    """

    waypoint: int
    to: str
    cuts: tuple[str, ...]


def straight_returns(mission: Mission) -> tuple[StraightReturn, ...]:
    """The waypoints from which PX4's own Return would cut a zone or the fence.

    PX4's Return climbs to RTL_RETURN_ALT, flies straight and lands. With RTL_TYPE 0, the default of
    multicopters, it lands at the nearest of home and the rally points, which are uploaded with the
    mission. It does not check the fence on the way.
    """
    if not mission.waypoints:
        return ()
    airspace = return_airspace(mission)
    here = np.array([w.position for w in mission.waypoints])
    ends = np.array([mission.home, *mission.rally_points])
    aims = np.argmin(np.hypot(*(here[:, None] - ends[None]).transpose(2, 0, 1)), axis=1)
    found = []
    for index in np.flatnonzero(~airspace.legs_clear_between(here, ends[aims])):
        waypoint, aim = mission.waypoints[index], int(aims[index])
        cuts = airspace.blockers(waypoint.position, Point(*ends[aim].tolist()))
        to = f"rally point {aim}" if aim else "home"
        found.append(StraightReturn(waypoint.number, to, cuts))
    return tuple(found)


def return_airspace(mission: Mission) -> Airspace:
    """The airspace that PX4's own Return may cut: zones as drawn, at its altitudes."""
    every = Airspace(
        mission.fences, (*mission.zones, *mission.climb_corridors), mission.planner.clearance_m
    )
    active = every.during(mission.window.start, mission.window.end)
    highest_m = max(mission.cruise.upper_m, RTL_RETURN_ALT_M)
    return active.at(mission.cruise.lower_m, highest_m).as_drawn()
