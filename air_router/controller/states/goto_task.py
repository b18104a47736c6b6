"""Flying to requested points: whether that can be done, and how far it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from air_router.controller.model.actions import Refusal
from air_router.controller.motion.navigator import STANDING_M_S, Goal, stopping_point
from air_router.controller.targets.search_points import Search
from air_router.messages import FARTHEST_M
from air_router.mission.flight_plan import HOME_NODE
from air_router.mission.mission import Mission
from air_router.routing.return_planner import LANDING_MARGIN, Pace, Way
from air_router.routing.router import NoRoute, Route, Router
from air_router.vehicle.vehicle import Telemetry
from geo.airspace.airspace import FENCE
from geo.frame import Point


@dataclass(slots=True)
class GotoTask:
    """Points to fly to, in order.

    Attributes:
        stops: Where to hover for each, in metres east/north.
        hold_s: How long to hover at the last.
        by: Who asked.
        notes: What is else than asked for, and why.
        done: How many were reached, or left out.
    """

    stops: tuple[Point, ...]
    hold_s: float
    by: str
    notes: tuple[str, ...] = ()
    done: int = 0

    @property
    def goal(self) -> Goal:
        """The stop whose turn it is."""
        return Goal(self.stops[self.done])

    def next(self) -> bool:
        """The stop whose turn it was is done; whether there is another."""
        if self.done + 1 >= len(self.stops):
            return False
        self.done += 1
        return True


@dataclass(frozen=True, slots=True)
class Refused:
    """Why something is not done."""

    code: Refusal
    why: str


class GotoValidator:
    """Says whether the vehicle may be sent somewhere from where it is, and come home from there."""

    def __init__(self, mission: Mission, router: Router, search: Search) -> None:
        self._mission = mission
        self._router = router
        self._search = search
        self._pace = Pace.of(mission)

    def renew(self, mission: Mission, router: Router) -> None:
        """Zones and fences are others now."""
        self._mission = mission
        self._router = router
        self._pace = Pace.of(mission)

    def goto_task(
        self, telemetry: Telemetry, points: Sequence[Point], hold_s: float, by: str
    ) -> GotoTask | Refused:
        """Look at every point, the ways between them, and what the way home then takes."""
        stops: list[Point] = []
        notes: list[str] = []
        for number, point in enumerate(points, start=1):
            name = "the point" if len(points) == 1 else f"point {number}"
            if not math.hypot(*point) <= FARTHEST_M:
                away = f"{name} is more than {FARTHEST_M / 1000:.0f} km away"
                return Refused(Refusal.OUTSIDE_FENCE, away)
            if FENCE in self._mission.airspace.holders(point):
                return Refused(Refusal.OUTSIDE_FENCE, f"{name} lies outside of the fence")
            hover, why = self._search.hover(point)
            if why:
                beside_m = math.dist(point, hover)
                notes.append(f"{name}: {why}, so {max(beside_m, 0.1):.1f} m beside it")
            stops.append(hover)
        refused = self.way(telemetry, [Goal(stop) for stop in stops], hold_s)
        return refused or GotoTask(tuple(stops), hold_s, by, tuple(notes))

    def way(
        self, telemetry: Telemetry, goals: Sequence[Goal], hold_s: float = 0.0
    ) -> Refused | None:
        """Why these goals cannot be flown to, one after the other, and home from there."""
        here = telemetry.position
        length_m, legs = 0.0, 0
        for number, goal in enumerate(goals, start=1):
            name = "it" if len(goals) == 1 else f"point {number}"
            route = self._first(telemetry, goal) if number == 1 else self._route(here, goal)
            if isinstance(route, NoRoute):
                return Refused(Refusal.NO_WAY, f"no clear way to {name}: {route.reason}")
            here = goal.position
            length_m, legs = length_m + route.length_m, legs + len(route.legs)
            stay_s = hold_s if number == len(goals) else 0.0
            short = self._short(telemetry.battery, Way(length_m, legs), here, stay_s)
            if short is not None:
                return Refused(Refusal.RESERVE, f"{short} {name}")
        return None

    def _first(self, telemetry: Telemetry, goal: Goal) -> Route | NoRoute:
        """From where the vehicle is; or, where its speed allows no way, from where it stops."""
        stopping = stopping_point(telemetry)
        route = self._route(telemetry.position, goal, stopping)
        if isinstance(route, NoRoute) and math.hypot(*telemetry.velocity_m_s) >= STANDING_M_S:
            return self._route(stopping, goal)
        return route

    def _route(self, start: Point, goal: Goal, stopping: Point | None = None) -> Route | NoRoute:
        target = goal.position if goal.node is None else goal.node
        return self._router.route(start, target, stopping=stopping)

    def _short(self, charge: float | None, way: Way, place: Point, stay_s: float) -> str | None:
        """Why the battery does not last for a way, a stay there, and the way home.

        Nothing is known of that without the vehicle's endurance: then the way home is watched for
        in flight by `battery_reserve` alone.
        """
        pace = self._pace
        if pace.endurance_s is None or charge is None:
            return None
        home = self._router.route(place, HOME_NODE)
        if isinstance(home, NoRoute):
            return f"no clear way home ({home.reason}) from"
        need = pace.home_s(Way(home.length_m, len(home.legs))) / pace.endurance_s + LANDING_MARGIN
        need = max(need, self._mission.battery_reserve)
        left = charge - (pace.time_s(way) + stay_s) / pace.endurance_s
        if left > need:
            return None
        return f"the battery would be at {max(left, 0.0):.0%} and {need:.0%} are needed at"
