"""Routes from where the vehicle is to a waypoint or any other point, every leg checked.

The mission chooses between two planners (`planner.kind`): on the waypoint graph, as the paper does,
or the shortest there is; see `planners`. Every leg is clear in the mission's planning airspace;
what a first leg may do when the vehicle is where it should not be, or moves, is in `departure`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

from air_router.routing.departure import Departure, Momentum, PendingSetpoint, names_of
from air_router.routing.graph import WaypointGraph
from air_router.routing.planners import Leg, Planner, planner_of
from geo.airspace.airspace import FENCE, Airspace
from geo.frame import Point
from geo.paths.separators import separators

__all__ = ["Leg", "NoRoute", "Route", "Router"]

_SAME_M = 0.01
"""A free point nearer than this to a waypoint is the waypoint."""


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

    reason: str  # in words
    blockers: tuple[str, ...] = ()  # names of zones, or of the fence


class Router:
    """Finds routes, in the way that the mission asks for.

    Args:
        graph: the mission's waypoint graph.
        planner: how to plan between start and goal; None: as the mission says.
    """

    def __init__(self, graph: WaypointGraph, planner: Planner | None = None) -> None:
        self.graph = graph
        self._mission = graph.mission
        self._airspace = graph.mission.planning_airspace  # with the tracking margin
        # A first leg keeps the whole tracking margin; where that is too much to ask, half of it.
        self._half = self._airspace.with_margin(graph.mission.planner.departure_margin_m)
        self._paths = graph.paths
        self._positions = graph.positions  # of nodes
        self._planner = planner or planner_of(graph.mission.planner.kind, graph)

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
            start: where the vehicle is.
            goal: a node of the graph, or any point.
            momentum: what the vehicle flies on by itself; None if it stands.
            pending: where it was sent before, and goes on to until it follows a new command.

        Returns:
            A Route whose legs are all clear by the rules above, or NoRoute with the reason: the
            goal is not clear, zones separate start and goal, no first leg is clear at this speed.
        """
        target = self._goal(goal)
        whole = Departure(self._airspace, self._paths, start, momentum, pending)
        if whole.clear(target.to):
            return _route(start, [target])
        if not self._airspace.point_clear(target.to):
            return self._bad_goal(target)
        half = Departure(self._half, self._paths, start, momentum, pending)
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
        """Whether the vehicle, now at `start`, may be sent straight to `end`."""
        whole = Departure(self._airspace, self._paths, start, momentum, pending)
        if whole.clear(end):
            return True
        half = Departure(self._half, self._paths, start, momentum, pending)
        if self._airspace.point_clear(end) and (whole.allows(end) or half.allows(end)):
            return True
        return half.leads_out(end)

    def off_cruise(self, altitude_m: float, swept: Sequence[Point]) -> NoRoute | None:
        """Why a leg is not clear that begins off the cruise altitudes; None if it is.

        The vehicle climbs or sinks on its way: which part of it is low, or high, is not known, so
        all of it counts.

        Args:
            altitude_m: how high above home the vehicle is.
            swept: what it may sweep, from where it is to the end of the leg.
        """
        mission = self._mission
        low = altitude_m < mission.cruise.lower_m
        airspace = mission.climb_airspace if low else mission.airspace_at(altitude_m)
        if len(airspace.zones) == len(mission.airspace.zones):
            return None
        airspace = _with_margin(airspace, mission.planner.departure_margin_m)
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
        """Straight there where that is clear, else as the mission's planner finds."""
        return [target] if rule.allows(target.to) else self._planner.legs(rule, target)

    def _ways_out(self, rule: Departure) -> Iterator[tuple[Point, ...]]:
        """To clear places around a start that is not clear: straight ones, nearest first."""
        for place in self._paths.exits(rule.start):
            if rule.allows(place):
                yield (place,)
        if rule.way_out is not None:
            yield rule.way_out[1:]

    def _goal(self, goal: Point | int) -> Leg:
        if isinstance(goal, int):
            return Leg(self._positions[goal], goal)
        for node, place in self._positions.items():
            if math.dist(goal, place) <= _SAME_M:
                return Leg(place, node)
        return Leg(goal)

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
        walls = separators(self._airspace, start, target.to)
        if walls:
            kept_m = sorted({self._airspace.kept_m(name) for name in walls})
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
def _with_margin(airspace: Airspace, margin_m: float) -> Airspace:
    """Kept for the next leg that begins off the cruise altitudes."""
    return airspace.with_margin(margin_m)
