"""Going where a robot should be, and hovering over it while data are exchanged: SEARCH, COMM."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from air_router.controller.model import (
    Goal,
    Hover,
    MissionContext,
    Planned,
    Progress,
    PublishMap,
    Rest,
    RobotPath,
    RobotPose,
    RobotSought,
    Signal,
    State,
    StateHandler,
    Wanted,
)
from air_router.controller.motion import Navigator
from air_router.controller.states.limits import FOLLOW_M, SEEK_AGAIN_S
from air_router.controller.states.search_points import Search, SearchPoint
from air_router.controller.targets import (
    MOVES_S,
    YIELDS_S,
    PeerRate,
    PoseVerdict,
    TargetTrack,
)
from air_router.vehicle import CHECK_LOCALISATION
from mocha_link.links import (
    ContactBegan,
    ContactEnded,
    Direction,
    SyncEnded,
    SyncStarted,
)

RadioEvent = ContactBegan | ContactEnded | SyncStarted | SyncEnded
"""What tells that a robot's radio is heard where the vehicle is."""


@dataclass(slots=True, eq=False)
class SearchState(StateHandler):
    """Chooses a robot, flies to where it should be, and follows what is heard of it.

    Args:
        context: Where it signals that the robot was found, or that no robot can be sought.
        navigator: Plans the way there.
        search: The robots, and where to seek them.
    """

    _context: MissionContext
    _navigator: Navigator
    search: Search
    _wanted: str | None = None  # by a request, to be sought next
    _asked_for: str | None = None  # by a request, sought now
    _stops: deque[str] = field(default_factory=deque)  # robots still to be flown to, in order
    _places: deque[Goal] = field(default_factory=deque)  # where else the present one may be
    _over: str | None = None  # the present one: flown to last in this search
    _began_s: float = -math.inf  # the search, vehicle's clock
    _waits_at: Goal | None = None  # where its time began, or it has followed the robot to since
    _follows: PeerRate = field(default_factory=lambda: PeerRate(MOVES_S))  # for poses and paths
    _yields: PeerRate = field(default_factory=lambda: PeerRate(YIELDS_S))  # to other UAVs
    _jumpers: set[str] = field(default_factory=set)  # robots whose jumps were announced

    def seek(self, robot: str) -> None:
        """The operator asks for this robot."""
        self._wanted = robot
        self._context.signal(Signal.SEEK)

    # The flight itself.

    def begin(self) -> Wanted:
        """Seek the requested robot, or else the robot whose turn it is."""
        self._asked_for, self._wanted = self._wanted, None
        self._over, self._began_s, self._waits_at = None, self._context.now_s, None
        if self._asked_for is None and self._began_s < self.search.next_due_s:
            return Signal.ALL_MET
        return self._set_out(self._asked_for)

    def _set_out(self, first: str | None) -> Wanted:
        """Seek this robot, if any, or the next one that there is a way to."""
        for point in self._candidates(first):
            over, *stops = *point.over, point.robot
            nearest = point if over == point.robot else self._point(over)
            self._stops, self._places = deque(stops), deque(nearest.places)
            place = self._next_place()
            motion = self._navigator.plan_to(place)
            if self._context.task.way.progress is not Progress.NO_ROUTE:
                if self._is_elsewhere(place):
                    self._context.task.stop_timer()  # its time begins there
                self._context.task.seek(point.robot)
                self.search.targets.sought(point.robot)
                self._try(over)
                self._context.say(f"SEARCH {point.robot}: {point.reason}")
                return Planned(motion)
            self._context.say(f"no way to {point.robot}: {self._navigator.refusal}")
        self._stops.clear()
        self._places.clear()
        return self._no_target()

    def _try(self, robot: str) -> None:
        """It is on the way to where a robot may be; planned anew, that is no further try."""
        if robot != self._over:
            self.search.targets.tracks[robot].tried()
        self._over = robot

    def arrived(self) -> Wanted:
        """On over the next robot, or wait for the one that is sought here."""
        while self._find_next_place():
            motion = self._navigator.plan_to(self._next_place())
            # Over a place where it is already, or that no way leads to, it goes on to the next.
            if self._context.task.way.progress is Progress.FLYING or not self._more:
                return Planned(motion)
        self._waits_at = self._context.task.way.goal
        if self._context.task.ends_s is None:
            self._context.start_timer()
            self._context.say(f"at the search position of {self._context.task.robot}")
        return Rest("it waits for the robot")

    def no_route(self, refusal: str) -> Wanted:
        """Give it up, or only those that were to be flown over on the way."""
        if self._more:
            return self.arrived()
        self._context.say(f"no way to {self._context.task.robot}: {refusal}")
        return self._no_target()

    @property
    def _more(self) -> bool:
        """Whether places are left before the vehicle waits."""
        return bool(self._places or self._stops)

    def _is_elsewhere(self, place: Goal) -> bool:
        """Whether that is not where it waits, or others follow."""
        at = self._waits_at
        moved = at is None or math.dist(at.position, place.position) >= FOLLOW_M
        return moved or self._more

    def _find_next_place(self) -> bool:
        """Whether there is one: of this robot, or of the next that was not met on the way."""
        while not self._places and self._stops:
            robot = self._stops.popleft()
            if not (self._stops and self._met(robot)):
                self._places.extend(self._point(robot).places)
                self._try(robot)
        return bool(self._places)

    def _next_place(self) -> Goal:
        """The next place; if others follow, as near to it as a clear way leads."""
        goal = self._places.popleft()
        return Goal(self._navigator.hover_point(goal.position)) if self._more else goal

    def _point(self, robot: str) -> SearchPoint:
        """Where one of the robots would be sought now."""
        return self.search.search_point(robot, self._context.now_s)

    def _met(self, robot: str) -> bool:
        """Whether both have had all from each other since the search began."""
        return self.search.targets.tracks[robot].met_s >= self._began_s

    def retry(self) -> Wanted:
        """To the same place, or choose again if no robot could be sought."""
        if self._context.task.robot is None:
            return self.begin()
        return Planned(self._navigator.again())

    def replan(self) -> Wanted:
        """Seek the same robot, if there is a way to it now."""
        return self._set_out(self._context.task.robot)

    def _candidates(self, first: str | None) -> Iterator[SearchPoint]:
        """Where to seek that robot, then the others in their turn."""
        now_s = self._context.now_s
        if first is not None:
            yield self._point(first)
        yield from (point for point in self.search.search_points(now_s) if point.robot != first)

    def _no_target(self) -> Wanted:
        self._context.task.seek(None)
        self._context.task.head_for(None)
        to_explore = self.search.to_explore
        if to_explore is not None and to_explore.remaining:
            return Signal.NO_TARGET
        self._context.retry_in(SEEK_AGAIN_S)
        return Hover("no robot can be sought from here")

    def follow(self, *, force: bool = False) -> Wanted:
        """Hover over the robot's newest position once it has moved away, or search ahead of it."""
        context, robot = self._context, self._context.task.robot
        track = None if robot is None else self.search.targets.tracks.get(robot)
        searching = context.task.state is State.SEARCH
        if robot is None or track is None or track.pose is None or (searching and self._more):
            return Rest("it is not known where the robot is, or others are flown over first")
        if (searching and self.search.foresees) or self.search.hovers:
            point = self._point(robot)
            hover, beside_m = point.goal, point.beside_m
        else:
            place = self._navigator.hover_point(track.pose.position)
            hover, beside_m = Goal(place), math.dist(track.pose.position, place)
        goal = context.task.way.goal
        if not force and goal is not None and math.dist(goal.position, hover.position) < FOLLOW_M:
            return Rest("the robot has not moved away")
        if not force:
            if not self._follows.allows(context.now_s):
                return Rest("it was followed just now: the robot's next pose, or path, does")
            self._follows.moved(context.now_s)
        if beside_m > 0:
            context.say(f"no hovering over {robot}: waiting {beside_m:.0f} m beside it")
        return hover

    # What is received of robots: what is wanted then, if anything.

    def pose_heard(self, event: RobotPose) -> Wanted | None:
        """A robot is, or was, there; its own pose from itself means that it was found."""
        context, track = self._context, self.search.targets.tracks.get(event.robot)
        if track is None:
            return None
        believed = track.pose_heard(event.position, event.stamp_s, context.now_s)
        if track.verdict is PoseVerdict.OLD:
            return None
        self._tell_jumps(track)
        if event.robot != context.task.robot:
            return None
        if context.task.state is State.SEARCH and event.peer == event.robot:
            return Signal.FOUND  # wherever it says to be, its radio is heard here
        return self.follow() if context.task.spec.seeks and believed else None

    def _tell_jumps(self, track: TargetTrack) -> None:
        """Say once that a robot's position jumps, and that it is believed again."""
        robot, jump = track.robot, track.check.jump
        if track.verdict is PoseVerdict.JUMPED and jump is not None:
            if robot not in self._jumpers:
                self._jumpers.add(robot)
                self._context.warn(
                    f"the position of {robot} jumped {jump.metres:.0f} m in {jump.seconds:.1f} s: "
                    "it is not followed there",
                    CHECK_LOCALISATION,
                )
        elif track.verdict is PoseVerdict.BACK:
            self._jumpers.discard(robot)
            self._context.say(f"the position of {robot} counts again: it stayed where it jumped to")

    def path_heard(self, event: RobotPath) -> Wanted | None:
        """A robot will drive there."""
        context, track = self._context, self.search.targets.tracks.get(event.robot)
        if track is None or not track.path_heard(event.points, event.stamp_s, context.now_s):
            return None
        searching = context.task.state is State.SEARCH and event.robot == context.task.robot
        return self.follow() if searching and self.search.foresees else None

    def radio_heard(self, event: RadioEvent) -> Wanted | None:
        """A robot's radio was heard: it is near."""
        track, here = self.search.targets.tracks.get(event.peer), self.search.exploration.here
        if track is None:
            return None
        self.search.links.contact(event.peer, linked=not isinstance(event, ContactEnded))
        if here is not None:
            track.radio_heard(here, self._context.now_s)
        if isinstance(event, SyncEnded) and event.complete:
            track.synced(event.direction, self._context.now_s)
            passes = self._context.task.state is State.SEARCH and self._stops
            if passes and event.peer == self._over and self._met(event.peer):
                self._places.clear()
                return self.arrived()
        return None

    def sought_by_other(self, event: RobotSought) -> Wanted | None:
        """Another UAV seeks a robot: one of the two goes on, if it is ours."""
        context, targets = self._context, self.search.targets
        news = targets.sought_by_other(event.by, event.robot, context.now_s)
        # A requested robot is not given up.
        free = context.task.state is State.SEARCH and context.task.robot != self._asked_for
        ours = free and context.task.robot is not None and context.task.robot == event.robot
        # A repeated message, or one that leaves no other robot, changes nothing.
        if ours and news and event.by < self.search.name and targets.free(context.now_s):
            if not self._yields.allows(context.now_s):
                return None  # two UAVs over one robot harm nothing
            self._yields.moved(context.now_s)
            context.say(f"{event.by} seeks {event.robot} as well, and keeps it")
            return Signal.YIELDED
        return None


@dataclass(slots=True, eq=False)
class CommState(StateHandler):
    """Stays over the robot that was found until both have all that the other has.

    Only a sync that began after the robot was found counts: it alone carries all that both had by
    then.

    Args:
        context: Which robot was found.
        search_state: Which robot was found; follows it.
    """

    _context: MissionContext
    _search_state: SearchState
    _began: set[Direction] = field(default_factory=set)  # syncs seen from their start
    _synced: set[Direction] = field(default_factory=set)  # syncs ended well since then

    def begin(self) -> Wanted:
        """Have the newest map ready, and go over the robot."""
        self._began.clear()
        self._synced.clear()
        context = self._context
        context.actions.append(PublishMap())
        context.say(f"COMM {context.task.robot}: found")
        return self._search_state.follow(force=True)

    def retry(self) -> Wanted:
        """Over the robot, wherever it is now."""
        return self._search_state.follow(force=True)

    replan = retry

    def sync_started(self, event: SyncStarted) -> Wanted | None:
        """Data begin to flow."""
        if event.peer == self._context.task.robot:
            self._began.add(event.direction)
        return self._search_state.radio_heard(event)

    def sync_ended(self, event: SyncEnded) -> Wanted | None:
        """One direction has everything."""
        if event.peer == self._context.task.robot and event.direction in self._began:
            self._began.discard(event.direction)
            self._synced.add(event.direction)
        wanted = self._search_state.radio_heard(event)
        if self._context.task.state is State.COMM and len(self._synced) == len(Direction):
            return Signal.SYNCED
        return wanted
