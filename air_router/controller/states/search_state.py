"""Going where a robot should be, and hovering over it while data are exchanged: SEARCH, COMM.

Where that is for each robot: the best guess, where hovering keeps the clearance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.model.actions import Announce, PublishMap
from air_router.controller.model.events import RobotPath, RobotPose, RobotSought
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.mission_context import (
    Goal,
    MissionContext,
    Progress,
    StateHandler,
)
from air_router.controller.model.states import Signal, State
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import Navigator
from air_router.controller.states.explore_state import Exploration
from air_router.controller.targets.seeking import POLICIES, Policy, SeekContext
from air_router.controller.targets.target_list import SearchPlace, Sighting, TargetList
from air_router.routing.return_planner import Way
from air_router.routing.router import NoRoute
from geo.frame import Point
from mocha_link.links.metrics import (
    ContactBegan,
    ContactEnded,
    Direction,
    SyncEnded,
    SyncStarted,
)

RadioEvent = ContactBegan | ContactEnded | SyncStarted | SyncEnded
"""What tells that a robot's radio is heard where the vehicle is."""

FOLLOW_M: Final = 8.0
"""A robot that has moved so far from where we hover (or search) is followed."""

SEEK_AGAIN_S: Final = 10.0
"""Pause before the robots are gone through again when none of them could be sought."""


@dataclass(frozen=True, slots=True)
class SearchPoint:
    """A robot that could be sought now, where, and why there.

    Attributes:
        robot: Its name.
        goal: Where to hover.
        reason: What is known there of the robot, and what keeps the vehicle beside it.
        beside_m: How far from the robot's place the vehicle will hover.
    """

    robot: str
    goal: Goal
    reason: str
    beside_m: float = 0.0


class Search:
    """Knows the robots, and the places from which to look for them.

    Args:
        context: The airspace, and how long the vehicle would fly.
        navigator: Where to hover for a place.
        setup: Whom to seek, in order, and whether the vehicle explores between two searches.
        exploration: Where the vehicle is, and where a robot may be that was never heard.

    Attributes:
        targets: The robots, and what is known of each.
        name: This UAV's: of two that seek the same robot, the lower name keeps it.
        exploration: Where the vehicle is, and was.
        to_explore: The same, as what else there is to do; None: this vehicle only searches.
        policy: Whom to seek, and where; the mission's.
        foresees: A robot is sought where it will be, so that news of its path matters too.
    """

    def __init__(
        self,
        context: MissionContext,
        navigator: Navigator,
        setup: FlightSetup,
        exploration: Exploration,
    ) -> None:
        self.name = setup.name
        self.targets = TargetList(setup.seek)
        self.policy: Policy = POLICIES[context.mission.seek_policy]
        self.foresees = self.policy.foresees
        self._context, self._navigator = context, navigator
        self.exploration = exploration
        self.to_explore = exploration if setup.explore else None
        timers = context.mission.timers
        # a search, a talk, and exploring between them
        self._round_s = timers.search_s + timers.communicate_s + setup.explore * timers.explore_s

    def search_points(self, now_s: float) -> Iterator[SearchPoint]:
        """The robots in the order in which they are to be tried."""
        for place in self.policy.order(self.targets, self._seek_context(now_s)):
            yield self._beside(place)

    def search_point(self, robot: str, now_s: float) -> SearchPoint:
        """Where one of the robots would be sought now."""
        return self._beside(self.policy.place(robot, self.targets, self._seek_context(now_s)))

    def _seek_context(self, now_s: float) -> SeekContext:
        exploration = self.exploration
        began_s = now_s if exploration.began_s is None else exploration.began_s
        return SeekContext(
            now_s,
            began_s,
            self._flight_s,
            unseen=exploration.longest_unseen().position,
            round_s=self._round_s,
        )

    def _flight_s(self, place: Point) -> float:
        here = self.exploration.here
        if here is None:
            return 0.0
        route = self._context.router.route(here, self._navigator.hover_point(place))
        if isinstance(route, NoRoute):
            return math.inf
        return self._context.pace.time_s(Way(route.length_m, len(route.legs)))

    def _beside(self, place: SearchPlace) -> SearchPoint:
        robot = place.robot
        if place.position is None:
            return SearchPoint(robot, self.exploration.longest_unseen(), place.reason)
        hover, why = self._navigator.hover(place.position)
        beside_m = math.dist(place.position, hover)
        reason = place.reason + (f"; {why}, so {max(beside_m, 0.1):.1f} m beside it" if why else "")
        return SearchPoint(robot, Goal(hover), reason, beside_m)


@dataclass(slots=True, eq=False)
class SearchState(StateHandler):
    """Chooses a robot, flies to where it should be, and follows what is heard of it.

    Args:
        context: Where it signals that the robot was found, or that no robot can be sought.
        gate: Has it hold.
        navigator: Flies there.
        search: The robots, and where to seek them.
    """

    _context: MissionContext
    _gate: CommandGate
    _navigator: Navigator
    search: Search
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
            motion = self._navigator.plan_to(point.goal)
            if self._context.way.progress is not Progress.NO_ROUTE:
                self._context.robot = point.robot
                if not (goes_on and point.robot == first):
                    self.search.targets.sought(point.robot)
                self._context.say(f"SEARCH {point.robot}: {point.reason}")
                self._navigator.advance(motion)
                return
            self._context.say(f"no way to {point.robot}: {self._navigator.refusal}")
        self._no_target()

    def arrived(self) -> None:
        """Wait for it here."""
        if self._context.ends_s is None:
            self._context.start_timer()
            self._context.say(f"at the search position of {self._context.robot}")

    def no_route(self, refusal: str) -> None:
        """Give it up."""
        self._context.say(f"no way to {self._context.robot}: {refusal}")
        self._no_target()

    def retry(self) -> None:
        """To the same place, or choose again if no robot could be sought."""
        if self._context.robot is None:
            self.begin()
        else:
            self._navigator.fly_again()

    def replan(self) -> None:
        """Seek the same robot, if there is a way to it now."""
        self._set_out(self._context.robot, goes_on=True)

    def _candidates(self, first: str | None) -> Iterator[SearchPoint]:
        """Where to seek that robot, then the others in their turn."""
        now_s = self._context.now_s
        if first is not None:
            yield self.search.search_point(first, now_s)
        yield from (point for point in self.search.search_points(now_s) if point.robot != first)

    def _no_target(self) -> None:
        self._context.robot = None
        self._gate.stop()
        to_explore = self.search.to_explore
        if to_explore is not None and to_explore.remaining:
            self._context.signal(Signal.NO_TARGET)
        else:
            self._gate.hold("no robot can be sought from here")
            self._context.retry_in(SEEK_AGAIN_S)

    def follow(self, *, force: bool = False) -> None:
        """Hover over the robot's newest position once it has moved away, or search ahead of it."""
        context, robot = self._context, self._context.robot
        track = None if robot is None else self.search.targets.tracks.get(robot)
        if robot is None or track is None or track.pose is None:
            return
        if context.state is State.SEARCH and self.search.foresees:
            point = self.search.search_point(robot, context.now_s)
            hover, beside_m = point.goal, point.beside_m
        else:
            place = self._navigator.hover_point(track.pose.position)
            hover, beside_m = Goal(place), math.dist(track.pose.position, place)
        goal = context.way.goal
        if not force and goal is not None and math.dist(goal.position, hover.position) < FOLLOW_M:
            return
        if beside_m > 0:
            context.say(f"no hovering over {robot}: waiting {beside_m:.0f} m beside it")
        self._navigator.fly_to(hover)

    # What is heard of robots.

    def pose_heard(self, event: RobotPose) -> None:
        """A robot is, or was, there; its own pose from itself means that it was found."""
        context, track = self._context, self.search.targets.tracks.get(event.robot)
        if track is None or not track.pose_heard(event.position, event.stamp_s, context.now_s):
            return
        if event.robot != context.robot:
            return
        if context.state is State.SEARCH and event.peer == event.robot:
            context.signal(Signal.FOUND)
        elif context.spec.seeks:
            self.follow()

    def path_heard(self, event: RobotPath) -> None:
        """A robot will drive there."""
        context, track = self._context, self.search.targets.tracks.get(event.robot)
        if track is None or not track.path_heard(event.points, event.stamp_s, context.now_s):
            return
        searching = context.state is State.SEARCH and event.robot == context.robot
        if searching and self.search.foresees:
            self.follow()

    def radio_heard(self, event: RadioEvent) -> None:
        """A robot's radio was heard: it is near."""
        track, here = self.search.targets.tracks.get(event.peer), self.search.exploration.here
        if track is None:
            return
        if here is not None:
            track.radio = Sighting(here, self._context.now_s)
        if isinstance(event, SyncEnded) and event.complete:
            track.synced(event.direction, self._context.now_s)

    def sought_by_other(self, event: RobotSought) -> None:
        """Another UAV seeks a robot: one of the two goes on, if it is ours."""
        context, targets = self._context, self.search.targets
        news = targets.sought_by_other(event.by, event.robot, context.now_s)
        # A requested robot is not given up.
        free = context.state is State.SEARCH and context.robot != self._asked_for
        ours = free and context.robot is not None and context.robot == event.robot
        # A repeated message, or one that leaves no other robot, changes nothing.
        if ours and news and event.by < self.search.name and targets.free(context.now_s):
            context.say(f"{event.by} seeks {event.robot} as well, and keeps it")
            context.signal(Signal.YIELDED)


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
        context = self._context
        context.actions += (PublishMap(), Announce(f"COMM {context.robot}: found"))
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
        if event.peer == self._context.robot:
            self._began.add(event.direction)
        self._search_state.radio_heard(event)

    def sync_ended(self, event: SyncEnded) -> None:
        """One direction has everything."""
        if event.peer == self._context.robot and event.direction in self._began:
            self._began.discard(event.direction)
            self._synced.add(event.direction)
        self._search_state.radio_heard(event)
        if self._context.state is State.COMM and len(self._synced) == len(Direction):
            self._context.signal(Signal.SYNCED)
