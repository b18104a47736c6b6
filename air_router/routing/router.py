"""Plans routes from the vehicle's position to a waypoint or any point; every leg is checked.

The mission chooses the planner (`planner.kind`): on the waypoint graph, as in the paper, or the
shortest path. Both are exact: every leg is clear in the mission's planning airspace, and the first
leg follows the rules in `departure`.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from air_router.routing.departure import Departure, Momentum, PendingSetpoint, names_of
from air_router.routing.graph import WaypointGraph
from air_router.routing.limits import SAME_WAYPOINT_M, STANDING_M_S
from geo.airspace import FENCE, Airspace
from geo.frame import Point
from geo.paths import barriers

_START = -1
"""Stands for the vehicle's position among the nodes of a path."""


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight leg to a point; `node`: its waypoint number (0: home), None: no node."""

    to: Point
    node: int | None = None


@dataclass(frozen=True, slots=True)
class Route:
    """Legs from the start to the goal, and their length.

    `warnings` concern the start, which the route leaves first. `air-router plan` prints them; in
    flight the controller itself monitors the clearance and warns.
    """

    legs: tuple[Leg, ...]
    length_m: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class NoRoute:
    """The reason why there is no route, and the zones (or the fence) in the way."""

    reason: str  # as text
    blockers: tuple[str, ...] = ()  # names of zones, or of the fence


class Router:
    """Plans routes with the mission's planner.

    Args:
        graph: The mission's waypoint graph.
    """

    def __init__(self, graph: WaypointGraph) -> None:
        self.graph = graph
        self._mission = graph.mission
        self._airspace = graph.mission.planning_airspace  # with the tracking margin
        # A first leg keeps the whole tracking margin if possible, else that required in flight.
        tracking, most_m = graph.mission.tracking, self._airspace.margin_m
        self._flown = self._airspace.with_margin(min(tracking.flown_m, most_m))  # from hovering
        self._turned = self._airspace.with_margin(min(tracking.turned_m, most_m))  # at speed
        self._paths = graph.paths
        self._positions = graph.positions  # of nodes
        shortest = graph.mission.planner.kind == "shortest"
        self._planner = None if shortest else WaypointPlanner(graph)

    def route(
        self,
        start: Point,
        goal: Point | int,
        *,
        momentum: Momentum | None = None,
        pending: Sequence[PendingSetpoint] = (),
    ) -> Route | NoRoute:
        """The shortest known route.

        Args:
            start: The vehicle's position.
            goal: A node of the graph, or any point.
            momentum: How far the vehicle coasts; None: it hovers.
            pending: Ends of earlier legs that it may fly to before it follows a new command.

        Returns:
            A Route with clear legs, or NoRoute with the reason: the goal is not clear, zones
            separate start and goal, or no first leg is clear at this speed.
        """
        target = self._goal(goal)
        whole = Departure(self._airspace, self._paths, start, momentum, pending)
        if whole.clear(target.to):
            return _route(start, [target])
        if not self._airspace.point_clear(target.to):
            return self._bad_goal(target)
        half = Departure(self._needed(momentum, pending), self._paths, start, momentum, pending)
        for rule in (whole, half):
            legs = self._legs(rule, target)
            if legs is not None:
                return _route(start, legs, rule.warnings)
        if half.in_margin:
            for out in self._ways_out(half):
                if not self.check_leg(start, out[0], momentum, pending):
                    continue
                onward = self._legs(Departure(self._airspace, self._paths, out[-1], None), target)
                if onward is not None:
                    return _route(start, [*map(Leg, out), *onward], half.warnings)
        return self._no_route(start, target, half)

    def check_leg(
        self,
        start: Point,
        end: Point,
        momentum: Momentum | None = None,
        pending: Sequence[PendingSetpoint] = (),
    ) -> bool:
        """Whether the vehicle at `start` may fly straight to `end`."""
        whole = Departure(self._airspace, self._paths, start, momentum, pending)
        if whole.clear(end):
            return True
        half = Departure(self._needed(momentum, pending), self._paths, start, momentum, pending)
        if self._airspace.point_clear(end) and (whole.allows(end) or half.allows(end)):
            return True
        return half.leads_out(end)

    def _needed(self, momentum: Momentum | None, pending: Sequence[PendingSetpoint]) -> Airspace:
        """The airspace with the margin of a first leg: larger for a moving vehicle."""
        speed_m_s = 0.0 if momentum is None else math.hypot(*momentum.velocity_m_s)
        return self._turned if pending or speed_m_s >= STANDING_M_S else self._flown

    def off_cruise(self, altitude_m: float, swept: Sequence[Point]) -> NoRoute | None:
        """Why a leg that starts off the cruise altitudes is not clear; None if it is.

        The vehicle climbs or descends to the cruise altitudes somewhere on this leg. So all zones
        between its altitude and the cruise altitudes apply along the whole leg, except zones that
        it is already in and leaves.

        Args:
            altitude_m: The vehicle's altitude above home.
            swept: Corners of the area that the vehicle may sweep up to the end of the leg.
        """
        mission = self._mission
        low = altitude_m < mission.cruise.lower_m
        airspace = mission.airspace_off_cruise(altitude_m)
        if len(airspace.zones) == len(mission.airspace.zones):
            return None
        inside = frozenset(airspace.zones_at(swept[0]))
        airspace = _with_margin(airspace, mission.tracking.flown_m, inside)
        if airspace.swept_clear(swept):
            return None
        names = airspace.blockers(swept[0], swept[-1])
        where, way_out = ("lower", "climb") if low else ("higher", "descend")
        return NoRoute(
            f"the vehicle is {altitude_m:.0f} m above home, {where} than the mission "
            f"flies, where {' and '.join(names) or 'a zone'} is in the way; {way_out} first",
            names,
        )

    def _legs(self, rule: Departure, target: Leg) -> Sequence[Leg] | None:
        """The straight leg if it is clear, else a path on the graph if the mission uses it.

        Otherwise, or without a path on the graph, the shortest clear path.
        """
        if rule.allows(target.to):
            return [target]
        legs = None if self._planner is None else self._planner.legs(rule, target)
        if legs is not None:
            return legs
        doors = [rule.rest, *(on.place for on in rule.pending)] if rule.moving else []
        first = rule.allows if rule.special else None
        path = self._paths.path(rule.start, target.to, first=first, doors=doors)
        return None if path is None else [*map(Leg, path[1:-1]), target]

    def _ways_out(self, rule: Departure) -> Iterator[tuple[Point, ...]]:
        """Ways from a start that is not clear to clear places, nearest first."""
        for place in self._paths.exits(rule.start):
            if rule.allows(place):
                yield (place,)
        if rule.way_out is not None:
            yield rule.way_out[1:]

    def _goal(self, goal: Point | int) -> Leg:
        if isinstance(goal, int):
            return Leg(self._positions[goal], goal)
        for node, place in self._positions.items():
            if math.dist(goal, place) <= SAME_WAYPOINT_M:
                return Leg(place, node)
        return Leg(goal)

    def _bad_goal(self, target: Leg) -> NoRoute:
        zones = self._airspace.zones_at(target.to)
        spare_m, name = self._airspace.clearance_left_m(target.to)
        if FENCE in zones:
            return NoRoute("the goal lies outside the fence", zones)
        if zones:
            return NoRoute(f"the goal lies inside {names_of(zones)}", zones)
        kept_m = self._airspace.required_m(name)
        return NoRoute(
            f"the goal is {kept_m + spare_m:.1f} m from {names_of((name,))}, "
            f"routes keep {kept_m:g} m",
            (name,),
        )

    def _no_route(self, start: Point, target: Leg, rule: Departure) -> NoRoute:
        walls = barriers(self._airspace, start, target.to)
        if walls:
            kept_m = sorted({self._airspace.required_m(name) for name in walls})
            keep = " and ".join(f"{metres:g} m" for metres in kept_m)
            verb = "separates" if len(walls) == 1 else "separate"
            return NoRoute(f"{names_of(walls)} {verb} start and goal at {keep} of distance", walls)
        if rule.moving:
            return NoRoute(
                "no first leg is clear at this speed", self._airspace.blockers(start, rule.rest)
            )
        if rule.in_margin:
            return NoRoute(
                "no clear way out of where the vehicle is", (self._airspace.nearest(start)[1],)
            )
        return NoRoute(
            "no clear way around what lies between", self._airspace.blockers(start, target.to)
        )


def _route(start: Point, legs: Sequence[Leg], warnings: tuple[str, ...] = ()) -> Route:
    length_m, here = 0.0, start
    for leg in legs:
        length_m += math.dist(here, leg.to)
        here = leg.to
    return Route(tuple(legs), length_m, warnings)


@lru_cache(maxsize=8)
def _with_margin(airspace: Airspace, margin_m: float, without: frozenset[str]) -> Airspace:
    """The airspace with another margin; cached for the next leg off the cruise altitudes."""
    zones = [zone for zone in airspace.zones if zone.name not in without]
    kept = Airspace(airspace.fences, zones, airspace.clearance_m) if without else airspace
    return kept.with_margin(margin_m)


class WaypointPlanner:
    """The paper's planner: to the waypoint graph, along it, and from it to the goal.

    The first and the last leg are at most as long as edges of the graph, unless no node is visible
    within that distance.
    """

    def __init__(self, graph: WaypointGraph) -> None:
        self._graph = graph
        self._airspace = graph.mission.planning_airspace  # with the tracking margin
        self._max_edge_m = graph.mission.planner.max_edge_m  # longest edge

    def legs(self, rule: Departure, target: Leg) -> list[Leg] | None:
        """The legs in order, the target last.

        None if start or goal has no visible waypoint, or the graph does not connect them.
        """
        way = self._way(rule, target)
        if way is None:
            return None
        first = self._graph.position(way[0])
        there = first == rule.start and not rule.special  # already there
        legs = [] if there else [Leg(first, way[0])]
        for before, node in pairwise(way):
            legs += map(Leg, self._graph.via(before, node))
            legs.append(Leg(self._graph.position(node), node))
        return legs if target.node is not None else [*legs, target]

    def _way(self, rule: Departure, target: Leg) -> list[int] | None:
        """The nodes of the shortest path from the start's visible nodes to the goal's.

        A* with the straight distance to the goal as heuristic.
        """
        graph = self._graph
        to_goal_m: list[float] = self._distances_m(target.to).tolist()
        if target.node is not None:
            leaving = {target.node}
        else:
            leaving = self._visible(
                target.to, lambda ends: self._airspace.legs_clear(target.to, ends)
            )
        if not leaving:
            return None
        entering = self._visible(rule.start, rule.allowed)
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
            if node in leaving:  # the heuristic is exact here
                return _trace(came_from, node)
            for other, length_m in graph.neighbours[node]:
                if other not in came_from:
                    reach_m = so_far_m + length_m
                    heapq.heappush(queue, (reach_m + to_goal_m[other], reach_m, other, node))
        return None

    def _visible(self, place: Point, check: Callable[[list[Point]], list[bool]]) -> set[int]:
        """The visible nodes within edge length of a place; without any, all visible nodes."""
        near = self._distances_m(place) <= self._max_edge_m
        for nodes in (np.flatnonzero(near).tolist(), np.flatnonzero(~near).tolist()):
            are_clear = check([self._graph.position(node) for node in nodes])
            visible = {node for node, ok in zip(nodes, are_clear, strict=True) if ok}
            if visible:
                return visible
        return set()

    def _distances_m(self, place: Point) -> npt.NDArray[np.float64]:
        return np.asarray(np.hypot(*(self._graph.places - place).T))


def _trace(came_from: dict[int, int], node: int) -> list[int]:
    nodes = []
    while node != _START:
        nodes.append(node)
        node = came_from[node]
    return nodes[::-1]
