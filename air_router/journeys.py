"""Flying in each state of a mission: where next, what on arrival, and when no way is clear."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Final

from air_router.behaviour import EXPLORING, Signal, State
from air_router.exploration import Exploration
from air_router.flight_plan import HOME_NODE
from air_router.navigator import Goal, Navigator, Progress
from air_router.schedule import Schedule
from air_router.search import Search
from air_router.steering import Steering

if TYPE_CHECKING:
    from air_router.actions import Motion
    from air_router.mission import Mission
    from air_router.router import Router

FOLLOW_M: Final = 8.0
"""A robot that has moved so far from where we hover (or search) is followed."""

RETRY_S: Final = 3.0
"""Pause before something that could not be done is tried again."""

SEEK_AGAIN_S: Final = 10.0
"""Pause before the robots are gone through again when none of them could be sought."""


class Journeys(Steering, ABC):
    """The half of the controller that flies; which state comes next is said to `_signal`.

    Attributes:
        state: What the mission is doing.
        robot: Who is sought or hovered over.
        exploration: Which waypoint is next.
        search: Whom to seek, and where.
    """

    def __init__(self, mission: Mission, router: Router, seek: tuple[str, ...]) -> None:
        super().__init__(Navigator(mission, router))
        self._mission = mission
        self.state = State.READY
        self.robot: str | None = None
        self.exploration = Exploration(mission.waypoints)
        self.search = Search(mission, seek, self.exploration)
        self._schedule = Schedule(mission.timers)

    @abstractmethod
    def _signal(self, signal: Signal) -> None:
        """Something has happened to the mission."""

    def _advance(self, motion: Motion | None) -> None:
        """Command the next motion, and act on where the journey stands."""
        if motion is not None:
            self._command(motion)
        progress = self.navigator.progress
        if progress is Progress.ARRIVED:
            self._arrived()
        elif progress is Progress.STRANDED:
            self._stranded()

    def _arrived(self) -> None:
        goal = self.navigator.goal
        if self.state in EXPLORING:
            self.exploration.visited()
            self._explore()
        elif self.state is State.SEARCH and not self._schedule.running:
            self._schedule.start()
            self._say(f"at the search position of {self.robot}")
        elif self.state is State.HOME and goal is not None and goal.node == HOME_NODE:
            self._signal(Signal.ARRIVED)

    def _stranded(self) -> None:
        refusal = self._refusal()
        if self.state in EXPLORING:
            self._say(f"waypoint {self.exploration.leave_out()} left out: {refusal}")
            self._explore()
        elif self.state is State.SEARCH:
            self._say(f"no way to {self.robot}: {refusal}")
            self._no_target()
        elif not self._schedule.retrying:
            self._hold(refusal)
            self._schedule.retry_in(RETRY_S)

    def _explore(self) -> None:
        """Fly to the waypoint whose turn it is, or say that none is left."""
        exploration, refusals = self.exploration, []
        mark = exploration.mark()
        while exploration.remaining:
            motion = self._plan_to(exploration.goal)
            if self.navigator.progress is Progress.FLYING:
                break
            if self.navigator.progress is Progress.STRANDED:
                refusals.append(f"waypoint {exploration.leave_out()} left out: {self._refusal()}")
            else:
                exploration.visited()
                mark = exploration.mark()
        if refusals and not exploration.remaining:
            # All can be reached from home, or the mission would not fly: it is this place.
            exploration.back_to(mark)
            self.navigator.stop()
            self._hold(f"no waypoint can be reached from here: {self._refusal()}")
            self._schedule.retry_in(RETRY_S)
            return
        for refusal in refusals:
            self._say(refusal)
        if exploration.remaining:
            self._advance(motion)
        else:
            self._signal(Signal.EXPLORED)

    def _follow(self, *, force: bool = False) -> None:
        """Hover over (or search at) the robot's newest position once it has moved away."""
        over = None if self.robot is None else self.search.over(self.robot)
        if over is None:
            return
        (hover, beside_m), goal = over, self.navigator.goal
        if not force and goal is not None and math.dist(goal.position, hover.position) < FOLLOW_M:
            return
        if beside_m > 0:
            self._say(f"no hovering over {self.robot}: waiting {beside_m:.0f} m beside it")
        self._advance(self._plan_to(hover))

    def _go_home(self) -> None:
        self._advance(self._plan_to(Goal(self._mission.home, HOME_NODE)))

    def _no_target(self) -> None:
        self.robot = None
        self.navigator.stop()
        if self.exploration.remaining:
            self._signal(Signal.NO_TARGET)
        else:
            self._hold("no robot can be sought from here")
            self._schedule.retry_in(SEEK_AGAIN_S)
