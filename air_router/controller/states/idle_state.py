"""The state IDLE: waits after everything is explored and every robot has been met."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from air_router.controller.model import (
    Goal,
    Hover,
    MissionContext,
    Rest,
    Signal,
    StateHandler,
    Wanted,
)
from air_router.controller.states.limits import FOLLOW_M
from air_router.controller.states.search_points import Search

ALL_EXPLORED: Final = "everything is explored, and the mission seeks no robot"
ALL_MET: Final = "everything is explored and every robot has been met"


@dataclass(slots=True, eq=False)
class IdleState(StateHandler):
    """Waits until a robot is due for another visit, or comes home, as the mission sets.

    Robots within radio range keep exchanging data, which postpones their next visit. A vehicle in
    range of all robots stays in place.

    Args:
        context: The mission; receives the signal that a robot is due.
        search: Knows when the next robot is due, and the center of all robots.
    """

    _context: MissionContext
    _search: Search

    def begin(self) -> Wanted:
        """Hover here or at the center of the robots, or come home."""
        context = self._context
        if context.airspace.mission.when_explored == "home" or not self._search.targets.names:
            context.come_home(ALL_MET if self._search.targets.names else ALL_EXPLORED)
            return Rest("it comes home")
        self._wait()
        goal = self._middle
        if goal is None:
            context.inform(f"waiting for the next visit to be due: {ALL_MET}")
            return Hover(ALL_MET)
        context.inform(f"hovering in the middle of the robots: {ALL_MET}")
        return goal

    def retry(self) -> Wanted:
        """Visit the robot that is due, follow the center of the robots, or keep waiting."""
        if not self._hovers_amid and self._search.next_due_s <= self._context.now_s:
            return Signal.ROBOT_DUE
        self._wait()
        return self._middle or Hover(ALL_MET)

    replan = begin

    @property
    def _hovers_amid(self) -> bool:
        return self._context.airspace.mission.when_explored == "hover"

    @property
    def _middle(self) -> Goal | None:
        """The center of the robots, if the mission wants it and it is known."""
        middle, goal = (
            self._search.middle if self._hovers_amid else None,
            self._context.task.way.goal,
        )
        if middle is None or goal is None:
            return middle
        return middle if math.dist(goal.position, middle.position) >= FOLLOW_M else goal

    def _wait(self) -> None:
        """Retry when the next robot is due, or when the robots may have moved."""
        context = self._context
        due_s = max(0.0, self._search.next_due_s - context.now_s)
        context.retry_in(context.airspace.mission.timers.revisit_s if self._hovers_amid else due_s)
