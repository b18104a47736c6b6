"""Going where a robot should be, and hovering over it while data are exchanged: SEARCH, COMM."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.model.actions import PublishMap
from air_router.controller.model.events import RobotPath, RobotPose, RobotSought
from air_router.controller.model.mission_context import MissionContext, StateHandler
from air_router.controller.model.states import Signal, State
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import Progress
from air_router.controller.targets.exploration import Exploration
from air_router.controller.targets.search_points import RadioEvent, Search, SearchPoint
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted

FOLLOW_M: Final = 8.0
"""A robot that has moved so far from where we hover (or search) is followed."""

SEEK_AGAIN_S: Final = 10.0
"""Pause before the robots are gone through again when none of them could be sought."""


@dataclass(slots=True, eq=False)
class SearchState(StateHandler):
    """Chooses a robot, flies to where it should be, and follows what is heard of it.

    Args:
        context: Where it signals that the robot was found, or that no robot can be sought.
        gate: Flies there.
        search: Whom to seek, and where.
        exploration: What else there is to do; None: this vehicle only searches.
        name: This UAV's: of two that seek the same robot, the lower name keeps it.

    Attributes:
        robot: Who is sought or hovered over; None while no robot is.
    """

    _context: MissionContext
    _gate: CommandGate
    _search: Search
    _exploration: Exploration | None
    _name: str
    robot: str | None = None
    _wanted: str | None = None  # by a request, to be sought next
    _asked_for: str | None = None  # by a request, sought now

    def seek(self, robot: str) -> None:
        """The operator asks for this robot."""
        self._wanted = robot
        self._context.signal(Signal.SEEK)

    # The flight itself.

    def begin(self) -> None:
        """Seek the requested robot, or else the robot whose turn it is."""
        self._asked_for, self._wanted = self._wanted, None
        self._set_out(self._asked_for)

    def _set_out(self, first: str | None, *, goes_on: bool = False) -> None:
        """Seek this robot, if any, or the next one that there is a way to.

        One that is sought already, if it `goes_on`, is not tried once more by that.
        """
        for point in self._candidates(first):
            motion = self._gate.plan_to(point.goal)
            if self._gate.navigator.progress is not Progress.NO_ROUTE:
                self.robot = point.robot
                if not (goes_on and point.robot == first):
                    self._search.targets.sought(point.robot)
                self._context.say(f"SEARCH {point.robot}: {point.reason}")
                self._gate.advance(motion)
                return
            self._context.say(f"no way to {point.robot}: {self._gate.refusal}")
        self._no_target()

    def arrived(self) -> None:
        """Wait for it here."""
        if not self._context.timer_runs:
            self._context.start_timer()
            self._context.say(f"at the search position of {self.robot}")

    def no_route(self, refusal: str) -> None:
        """Give it up."""
        self._context.say(f"no way to {self.robot}: {refusal}")
        self._no_target()

    def retry(self) -> None:
        """To the same place, or choose again if no robot could be sought."""
        if self.robot is None:
            self.begin()
        else:
            self._gate.fly_again()

    def replan(self) -> None:
        """Seek the same robot, if there is a way to it now."""
        self._set_out(self.robot, goes_on=True)

    def _candidates(self, first: str | None) -> Iterator[SearchPoint]:
        """Where to seek that robot, then the others in their turn."""
        now_s = self._context.now_s
        if first is not None:
            yield self._search.search_point(first, now_s)
        yield from (point for point in self._search.search_points(now_s) if point.robot != first)

    def _no_target(self) -> None:
        self.robot = None
        self._gate.navigator.stop()
        if self._exploration is not None and self._exploration.remaining:
            self._context.signal(Signal.NO_TARGET)
        else:
            self._gate.hold("no robot can be sought from here")
            self._context.retry_in(SEEK_AGAIN_S)

    def follow(self, *, force: bool = False) -> None:
        """Hover over the robot's newest position once it has moved away, or search ahead of it."""
        if self.robot is None:
            return
        if self._context.state is State.SEARCH and self._search.foresees:
            over = self._search.ahead_of(self.robot, self._context.now_s)
        else:
            over = self._search.over(self.robot)
        if over is None:
            return
        (hover, beside_m), goal = over, self._gate.navigator.goal
        if not force and goal is not None and math.dist(goal.position, hover.position) < FOLLOW_M:
            return
        if beside_m > 0:
            self._context.say(f"no hovering over {self.robot}: waiting {beside_m:.0f} m beside it")
        self._gate.fly_to(hover)

    # What is heard of robots.

    def pose_heard(self, event: RobotPose) -> None:
        """A robot is, or was, there; its own pose from itself means that it was found."""
        news = self._search.targets.pose_heard(
            event.robot, event.position, event.stamp_s, self._context.now_s
        )
        if not news or event.robot != self.robot:
            return
        if self._context.state is State.SEARCH and event.peer == event.robot:
            self._context.signal(Signal.FOUND)
        elif self._context.spec.seeks:
            self.follow()

    def path_heard(self, event: RobotPath) -> None:
        """A robot will drive there."""
        news = self._search.targets.path_heard(
            event.robot, event.points, event.stamp_s, self._context.now_s
        )
        searching = self._context.state is State.SEARCH and event.robot == self.robot
        if news and searching and self._search.foresees:
            self.follow()

    def radio_heard(self, event: RadioEvent) -> None:
        """A robot's radio was heard."""
        self._search.heard(event, self._context.now_s)

    def sought_by_other(self, event: RobotSought) -> None:
        """Another UAV seeks a robot: one of the two goes on, if it is ours."""
        targets, now_s = self._search.targets, self._context.now_s
        news = targets.sought_by_other(event.by, event.robot, now_s)
        # A requested robot is not given up.
        free = self._context.state is State.SEARCH and self.robot != self._asked_for
        ours = free and self.robot is not None and self.robot == event.robot
        # A repeated message, or one that leaves no other robot, changes nothing.
        if ours and news and event.by < self._name and targets.free(now_s):
            self._context.say(f"{event.by} seeks {event.robot} as well, and keeps it")
            self._context.signal(Signal.YIELDED)


@dataclass(slots=True, eq=False)
class CommState(StateHandler):
    """Stays over the robot that was found until both have all that the other has.

    Only a sync that began after the robot was found counts: it alone carries all that both had by
    then.

    Args:
        context: Where it signals that both directions have synced.
        gate: Waits where no way leads on.
        search_state: Which robot was found; follows it.
    """

    _context: MissionContext
    _gate: CommandGate
    _search_state: SearchState
    _began: set[Direction] = field(default_factory=set)  # syncs seen from their start
    _synced: set[Direction] = field(default_factory=set)  # syncs ended well since then

    def begin(self) -> None:
        """Have the newest map ready, and go over the robot."""
        self._began.clear()
        self._synced.clear()
        self._context.do(PublishMap())
        self._context.say(f"COMM {self._search_state.robot}: found")
        self._search_state.follow(force=True)

    def no_route(self, refusal: str) -> None:
        """Wait where it is."""
        self._gate.wait_for_way(refusal)

    def retry(self) -> None:
        """Over the robot, wherever it is now."""
        self._search_state.follow(force=True)

    replan = retry

    def sync_started(self, event: SyncStarted) -> None:
        """Data begin to flow."""
        if event.peer == self._search_state.robot:
            self._began.add(event.direction)
        self._search_state.radio_heard(event)

    def sync_ended(self, event: SyncEnded) -> None:
        """One direction has everything."""
        if event.peer == self._search_state.robot and event.direction in self._began:
            self._began.discard(event.direction)
            self._synced.add(event.direction)
        self._search_state.radio_heard(event)
        if self._context.state is State.COMM and len(self._synced) == len(Direction):
            self._context.signal(Signal.SYNCED)
