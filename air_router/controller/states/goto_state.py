"""The state GOTO: flies to requested points, after checking that they can be reached."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from air_router.controller.model import (
    Goal,
    MissionContext,
    Planned,
    Refusal,
    RequestRefusedError,
    Rest,
    Signal,
    StateHandler,
    Wanted,
)
from air_router.controller.motion import CommandGate, Navigator
from air_router.controller.states.limits import SETTLING_S
from air_router.messages import FARTHEST_M
from air_router.mission import HOME_NODE
from air_router.routing import LANDING_MARGIN, STANDING_M_S, Momentum, NoRoute, Route, Way
from air_router.vehicle import Telemetry
from geo.airspace import FENCE
from geo.frame import Point


@dataclass(slots=True)
class GotoTask:
    """Points to fly to, in order.

    Attributes:
        stops: Where to hover for each point, in meters east/north.
        hold_s: How long to hover at the last point.
        by: The requester.
        notes: Differences from the request, and why.
        done: Number of points reached or left out.
    """

    stops: tuple[Point, ...]
    hold_s: float
    by: str
    notes: tuple[str, ...] = ()
    done: int = 0

    @property
    def left(self) -> int:
        """Number of points not reached yet."""
        return len(self.stops) - self.done

    @property
    def number(self) -> int:
        """Number of the point flown to, from 1; once all are done, of the last."""
        return min(self.done + 1, len(self.stops))

    @property
    def goal(self) -> Goal:
        """Where the vehicle hovers for that point."""
        return Goal(self.stops[self.number - 1])

    def next(self) -> bool:
        """Mark the point as done; return whether there is another."""
        self.done = self.number
        return self.left > 0


class Accepted(NamedTuple):
    """The answer to an accepted request."""

    what: str  # what the vehicle does, as text
    points: tuple[Point, ...] = ()  # where a go-to flies


@dataclass(slots=True, eq=False)
class GotoValidator:
    """Checks that the vehicle can fly to requested points, and home from there.

    Args:
        context: Airspace, router, battery and pace.
        navigator: Finds where to hover for a point that is not clear.
        gate: Knows how far the vehicle coasts.
    """

    _context: MissionContext
    _navigator: Navigator
    _gate: CommandGate

    def goto_task(self, points: Sequence[Point], hold_s: float, by: str) -> GotoTask:
        """Check every point, the routes between them, and the charge for the way home.

        Raises:
            RequestRefusedError: A point, or home after it, cannot be reached.
        """
        stops: list[Point] = []
        notes: list[str] = []
        for number, point in enumerate(points, start=1):
            name = "the point" if len(points) == 1 else f"point {number}"
            if not math.hypot(*point) <= FARTHEST_M:
                away = f"{name} is more than {FARTHEST_M / 1000:.0f} km away"
                raise RequestRefusedError(Refusal.OUTSIDE_FENCE, away)
            if FENCE in self._context.airspace.mission.airspace.zones_at(point):
                outside = f"{name} lies outside the fence"
                raise RequestRefusedError(Refusal.OUTSIDE_FENCE, outside)
            hover, why = self._navigator.hover(point)
            if why:
                offset_m = math.dist(point, hover)
                notes.append(f"{name}: {why}, so {max(offset_m, 0.1):.1f} m beside it")
            stops.append(hover)
        self.check_way([*map(Goal, stops)], hold_s)
        return GotoTask(tuple(stops), hold_s, by, tuple(notes))

    def check_way(self, goals: Sequence[Goal], hold_s: float = 0.0) -> None:
        """Check that the vehicle can fly to these goals in order, and home from there.

        Raises:
            RequestRefusedError: It cannot.
        """
        telemetry = self._context.telemetry
        assert telemetry is not None  # noqa: S101 - a vehicle in the air has sent telemetry
        here = telemetry.position
        length_m, legs = 0.0, 0
        for number, goal in enumerate(goals, start=1):
            name = "it" if len(goals) == 1 else f"point {number}"
            route = self._first(telemetry, goal) if number == 1 else self._route(here, goal)
            if isinstance(route, NoRoute):
                no_way = f"no clear way to {name}: {route.reason}"
                raise RequestRefusedError(Refusal.NO_WAY, no_way)
            here = goal.position
            length_m, legs = length_m + route.length_m, legs + len(route.legs)
            stay_s = hold_s if number == len(goals) else 0.0
            short = self._short(telemetry.battery, Way(length_m, legs), here, stay_s)
            if short is not None:
                raise RequestRefusedError(Refusal.RESERVE, f"{short} {name}")

    def _first(self, telemetry: Telemetry, goal: Goal) -> Route | NoRoute:
        """The route from the vehicle's position; if its speed allows none, from where it stops."""
        momentum = self._gate.momentum(telemetry)
        route = self._route(telemetry.position, goal, momentum)
        if isinstance(route, NoRoute) and math.hypot(*telemetry.velocity_m_s) >= STANDING_M_S:
            return self._route(momentum.rest, goal)
        return route

    def _route(self, start: Point, goal: Goal, momentum: Momentum | None = None) -> Route | NoRoute:
        target = goal.position if goal.node is None else goal.node
        return self._context.airspace.router.route(start, target, momentum=momentum)

    def _short(self, charge: float | None, way: Way, place: Point, stay_s: float) -> str | None:
        """Why the charge does not suffice for a route, a stay at its end, and the way home.

        This cannot be computed without the vehicle's endurance. Then only `battery_reserve` brings
        it home in flight.

        Raises:
            RequestRefusedError: There is no clear way home from the place.
        """
        pace = self._context.pace
        if pace.endurance_s is None or charge is None:
            return None
        home = self._context.airspace.router.route(place, HOME_NODE)
        if isinstance(home, NoRoute):
            raise RequestRefusedError(
                Refusal.NO_WAY, f"no clear way home from there ({home.reason})"
            )
        need = pace.home_s(Way(home.length_m, len(home.legs))) / pace.endurance_s + LANDING_MARGIN
        need = max(need, self._context.airspace.mission.battery_reserve)
        left = charge - (pace.time_s(way) + stay_s) / pace.endurance_s
        if left > need:
            return None
        return f"the battery would be at {max(left, 0.0):.0%} and {need:.0%} are needed at"


@dataclass(slots=True, eq=False)
class GotoState(StateHandler):
    """Flies to one point after another, and hovers at the last.

    Args:
        context: Receives the signals that the vehicle sets out, and that no point can be reached.
        navigator: Plans and flies routes.

    Attributes:
        goto_task: The last requested points.
    """

    _context: MissionContext
    _navigator: Navigator
    goto_task: GotoTask | None = None
    _there_since_s: float | None = None  # since when the vehicle is at the next stop

    def set_out(self, goto_task: GotoTask, left_s: float | None = None) -> None:
        """Start a task, and hover for `left_s` at its end; None: for the task's own time."""
        self.goto_task = goto_task
        self._context.task.carry(goto_task.hold_s if left_s is None else left_s)
        self._context.signal(Signal.GOTO)

    def begin(self) -> Wanted:
        """Fly to the next point."""
        self._there_since_s = None
        return self._task.goal

    def arrived(self) -> Wanted:
        """Fly to the next point once the vehicle hovers here; start the timer at the last."""
        if self._context.task.ends_s is not None:
            return Rest("it hovers at the last point")
        if not self._settled:
            return Rest("it settles")
        if self._task.next():
            return self.begin()
        self._context.start_timer()
        self._context.inform("at the last point")
        return Rest("it hovers at the last point")

    def no_route(self, refusal: str) -> Wanted:
        """Leave this point out and fly to the next."""
        self._context.inform(f"point {self._task.number} left out: {refusal}")
        return self.begin() if self._task.next() else Signal.NO_WAY

    def retry(self) -> Wanted:
        """Fly to the same point."""
        return Planned(self._navigator.again())

    replan = begin

    @property
    def _task(self) -> GotoTask:
        """The requested points."""
        assert self.goto_task is not None  # noqa: S101 - `set_out` sets it before the state begins
        return self.goto_task

    @property
    def _settled(self) -> bool:
        """Whether the vehicle hovers at its point, or has been there for `SETTLING_S` in gusts."""
        telemetry, now_s = self._context.telemetry, self._context.now_s
        if self._there_since_s is None:
            self._there_since_s = now_s
        stands = telemetry is not None and math.hypot(*telemetry.velocity_m_s) < STANDING_M_S
        return stands or now_s - self._there_since_s >= SETTLING_S
