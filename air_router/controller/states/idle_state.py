"""Waiting once everything is explored and every robot has been met: IDLE."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from air_router.controller.model import MissionContext, Signal, StateHandler
from air_router.controller.motion import CommandGate, Navigator
from air_router.controller.states.limits import FOLLOW_M
from air_router.controller.states.search_points import Search

ALL_EXPLORED: Final = "everything is explored, and the mission seeks no robot"
ALL_MET: Final = "everything is explored and every robot has been met"


@dataclass(slots=True, eq=False)
class IdleState(StateHandler):
    """Waits until a robot is due for another visit, or comes home, as the mission says.

    Robots within reach of the radio go on exchanging data meanwhile, which puts their next visit
    off: a vehicle that reaches all of them stays where it is.

    Args:
        context: The mission, which says what to do; where it signals that a robot is due.
        gate: Has it hover.
        navigator: Flies to the middle of the robots.
        search: When the next robot is due, and where their middle is.
    """

    _context: MissionContext
    _gate: CommandGate
    _navigator: Navigator
    _search: Search

    def begin(self) -> None:
        """Hover here or amid the robots, or come home."""
        context = self._context
        if context.mission.when_explored == "home" or not self._search.targets.names:
            context.come_home(ALL_MET if self._search.targets.names else ALL_EXPLORED)
            return
        if not self._fly_to_middle():
            context.say(f"waiting for the next visit to be due: {ALL_MET}")
            self._gate.stop()
            self._gate.hold(ALL_MET)
        else:
            context.say(f"hovering in the middle of the robots: {ALL_MET}")
        self._wait()

    def no_route(self, refusal: str) -> None:
        """Hover here."""
        self._gate.wait_for_way(refusal)

    def retry(self) -> None:
        """Visit the robot that is due, follow the middle of the robots, or wait on."""
        if self._hovers_amid:
            self._fly_to_middle()
        elif self._search.next_due_s <= self._context.now_s:
            self._context.signal(Signal.ROBOT_DUE)
            return
        else:
            self._gate.hold(ALL_MET)
        self._wait()

    replan = begin

    @property
    def _hovers_amid(self) -> bool:
        return self._context.mission.when_explored == "hover"

    def _fly_to_middle(self) -> bool:
        """Fly to the middle of the robots, if that is wanted and known; whether it is."""
        middle = self._search.middle if self._hovers_amid else None
        if middle is None:
            return False
        goal = self._context.task.way.goal
        moved = goal is None or math.dist(goal.position, middle.position) >= FOLLOW_M
        self._navigator.fly_to(middle if moved or goal is None else goal)
        return True

    def _wait(self) -> None:
        """Look again when the next robot is due, or when the robots may have driven away."""
        context = self._context
        due_s = max(0.0, self._search.next_due_s - context.now_s)
        context.retry_in(context.mission.timers.revisit_s if self._hovers_amid else due_s)
