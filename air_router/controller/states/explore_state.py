"""The states INIT and EXPL: flies the waypoints in the operator's order."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.model import (
    Goal,
    Hover,
    MissionContext,
    Planned,
    Progress,
    Signal,
    StateHandler,
    Wanted,
)
from air_router.controller.motion import Navigator
from air_router.controller.states.limits import PASSING_M
from air_router.controller.states.return_state import HomeReachability
from air_router.mission import Waypoint
from air_router.vehicle import FLY_OUT_OR_RELOAD
from geo.frame import Point

_NOWHERE: Final = Point(math.inf, math.inf)


@dataclass(slots=True)
class Exploration:
    """The waypoints in the operator's order. Each is visited once; exploration can be interrupted.

    Attributes:
        waypoints: All waypoints.
        left_out: Numbers of the waypoints that could not be visited.
        here: The vehicle's last known position; None before the flight.
        began_s: Time of the first known position.
        checked_from: Where the program last checked which waypoints are near.
        recheck_m: Within this distance of `checked_from` the same waypoints are near.
        explored_s: When the last waypoint was visited, on the vehicle's clock; infinite: not yet.
    """

    waypoints: Sequence[Waypoint]
    _skipped: frozenset[int] = frozenset()  # numbers of waypoints to skip
    left_out: list[int] = field(default_factory=list)
    here: Point | None = None
    began_s: float | None = None
    checked_from: Point = _NOWHERE
    recheck_m: float = 0.0
    explored_s: float = math.inf
    _next: int = 0  # index of the next waypoint
    # when each waypoint was last passed; infinite: it is near now
    _passed_s: dict[int, float] = field(default_factory=dict)

    def is_at(self, here: Point) -> None:
        """Update the vehicle's position."""
        self.here = here

    def explored(self, now_s: float) -> None:
        """Note when no waypoint is left, on the vehicle's clock; only the first time counts."""
        self.explored_s = min(self.explored_s, now_s)

    @property
    def remaining(self) -> int:
        """The number of waypoints still to be visited."""
        return sum(w.number not in self._skipped for w in self.waypoints[self._next :])

    @property
    def goal(self) -> Goal | None:
        """The next waypoint; None when none is left."""
        turn = self._turn
        if turn == len(self.waypoints):
            return None
        waypoint = self.waypoints[turn]
        return Goal(waypoint.position, waypoint.number)

    @property
    def _turn(self) -> int:
        """The index of the next waypoint; the number of waypoints when none is left."""
        turn = self._next
        while turn < len(self.waypoints) and self.waypoints[turn].number in self._skipped:
            turn += 1
        return turn

    def skip(self, numbers: Collection[int]) -> tuple[list[int], list[int]]:
        """Skip exactly these waypoints from now on; return the newly skipped and the restored ones.

        A restored waypoint is visited if its turn has not passed.
        """
        before, self._skipped = self._skipped, frozenset(numbers)
        return sorted(self._skipped - before), sorted(before - self._skipped)

    def visited(self) -> None:
        """Mark the next waypoint as visited."""
        self._next = self._turn + 1

    def leave_out(self) -> int:
        """Give up the next waypoint; return its number."""
        index = self._turn
        number = self.waypoints[index].number
        self.left_out.append(number)
        self._next = index + 1
        return number

    def restore(self, visited: int, left_out: Collection[int]) -> None:
        """Resume after another companion that visited this many and left these out."""
        self._next = visited
        self.left_out = list(left_out)

    def mark(self) -> tuple[int, int]:
        """The progress of exploration, for `back_to`."""
        return self._next, len(self.left_out)

    def back_to(self, mark: tuple[int, int]) -> None:
        """Restore the waypoints left out since a mark that was made after the last visit."""
        self._next, left_out = mark
        del self.left_out[left_out:]

    def note_nearby(self, here: Point, now_s: float) -> None:
        """Note which waypoints are near; this cannot change within `recheck_m` of here."""
        self.checked_from, self.recheck_m = here, math.inf
        if self.began_s is None:
            self.began_s = now_s
        for waypoint in self.waypoints:
            away_m = math.dist(here, waypoint.position)
            self.recheck_m = min(self.recheck_m, abs(away_m - PASSING_M))
            if away_m <= PASSING_M:
                self._passed_s[waypoint.number] = math.inf
            elif self._passed_s.get(waypoint.number) == math.inf:
                self._passed_s[waypoint.number] = now_s

    def longest_unseen(self) -> Goal:
        """Where to seek a robot that was never received: the waypoint passed longest ago.

        Of the waypoints never passed, the one farthest from all passed ones: amid the unknown.
        """
        passed = [w.position for w in self.waypoints if w.number in self._passed_s]

        def rank(waypoint: Waypoint) -> tuple[float, float]:
            away_m = min((math.dist(waypoint.position, p) for p in passed), default=0.0)
            return self._passed_s.get(waypoint.number, -math.inf), -away_m

        open_to_us = [w for w in self.waypoints if w.number not in self._skipped]
        waypoint = min(open_to_us or self.waypoints, key=rank)
        return Goal(waypoint.position, waypoint.number)


@dataclass(slots=True, eq=False)
class ExploreState(StateHandler):
    """Visits one waypoint after another, and skips those that cannot be reached from here.

    Args:
        context: Receives announcements of skipped waypoints, and the signal that none is left.
        navigator: Plans and flies routes.
        exploration: Knows the next waypoint.
        reachability: Whether a way home exists. Without one no waypoint is skipped.
    """

    _context: MissionContext
    _navigator: Navigator
    _exploration: Exploration
    _reachability: HomeReachability

    def begin(self) -> Wanted:
        """Fly to the next waypoint, or report that none is left."""
        navigator, exploration = self._navigator, self._exploration
        if self._reachability.walls is not None:
            # Waypoints that cannot be reached from home are skipped already.
            return Hover(
                "no waypoint can be reached from here: no clear way home", FLY_OUT_OR_RELOAD
            )
        refusals = []
        mark = exploration.mark()
        while (goal := exploration.goal) is not None:
            motion = navigator.plan_to(goal)
            if self._context.task.way.progress is Progress.FLYING:
                break
            if self._context.task.way.progress is Progress.NO_ROUTE:
                refusals.append(self._left_out(navigator.refusal))
            else:
                exploration.visited()
                mark = exploration.mark()
        if refusals and goal is None:
            # A mission flies only if every waypoint can be reached from home: the cause is this
            # position.
            exploration.back_to(mark)
            why = navigator.refusal
            return Hover(f"no waypoint can be reached from here: {why}", FLY_OUT_OR_RELOAD)
        for refusal in refusals:
            self._context.inform(refusal)
        if goal is not None:
            return Planned(motion)
        exploration.explored(self._context.now_s)
        return Signal.EXPLORED

    def arrived(self) -> Wanted:
        """Fly to the next waypoint."""
        self._exploration.visited()
        return self.begin()

    def no_route(self, refusal: str) -> Wanted:
        """Leave this waypoint out and fly to the next."""
        self._context.inform(self._left_out(refusal))
        return self.begin()

    def retry(self) -> Wanted:
        """Fly to the same waypoint, or to the first that can be reached."""
        if self._context.task.way.goal is None:
            return self.begin()
        return Planned(self._navigator.again())

    replan = begin

    def _left_out(self, refusal: str) -> str:
        return f"waypoint {self._exploration.leave_out()} left out: {refusal}"
