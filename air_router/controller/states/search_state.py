"""The states SEARCH and COMM: flies to where a robot should be, hovers, and exchanges data."""

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
"""An event that shows a robot's radio in range of the vehicle."""


@dataclass(slots=True, eq=False)
class SearchState(StateHandler):
    """Chooses a robot, flies to where it should be, and follows its messages.

    Args:
        context: Receives the signals that the robot was found, or that none can be sought.
        navigator: Plans and flies routes.
        search: The robots, and where to seek them.
    """

    _context: MissionContext
    _navigator: Navigator
    search: Search
    _wanted: str | None = None  # requested, to be sought next
    _requested: str | None = None  # requested, sought now
    _stops: deque[str] = field(default_factory=deque)  # robots to fly to, in order
    _places: deque[Goal] = field(default_factory=deque)  # further places of the current robot
    _over: str | None = None  # the current robot: flown to last in this search
    _began_s: float = -math.inf  # start of the search, vehicle's clock
    _waits_at: Goal | None = None  # where the timer started, or the place followed since
    _follows: PeerRate = field(default_factory=lambda: PeerRate(MOVES_S))  # for poses and paths
    _yields: PeerRate = field(default_factory=lambda: PeerRate(YIELDS_S))  # to other UAVs
    _jumpers: set[str] = field(default_factory=set)  # robots whose jumps were announced

    def seek(self, robot: str) -> None:
        """Seek this robot, as the operator requested."""
        self._wanted = robot
        self._context.signal(Signal.SEEK)

    # The flight.

    def begin(self) -> Wanted:
        """Seek the requested robot, or else the next one."""
        self._requested, self._wanted = self._wanted, None
        self._over, self._began_s, self._waits_at = None, self._context.now_s, None
        if self._requested is None and self._began_s < self.search.next_due_s:
            return Signal.ALL_MET
        return self._set_out(self._requested)

    def _set_out(self, first: str | None) -> Wanted:
        """Seek this robot, or the next one that can be reached."""
        for point in self._candidates(first):
            over, *stops = *point.over, point.robot
            nearest = point if over == point.robot else self._point(over)
            self._stops, self._places = deque(stops), deque(nearest.places)
            place = self._next_place()
            motion = self._navigator.plan_to(place)
            if self._context.task.way.progress is not Progress.NO_ROUTE:
                if self._is_elsewhere(place):
                    self._context.task.stop_timer()  # the timer starts there
                self._context.task.seek(point.robot)
                self.search.targets.sought(point.robot)
                self._try(over)
                self._context.inform(f"SEARCH {point.robot}: {point.reason}")
                return Planned(motion)
            self._context.inform(f"no way to {point.robot}: {self._navigator.refusal}")
        self._stops.clear()
        self._places.clear()
        return self._no_target()

    def _try(self, robot: str) -> None:
        """Count an attempt to find a robot; replanning to the same robot is no new attempt."""
        if robot != self._over:
            self.search.targets.tracks[robot].tried()
        self._over = robot

    def arrived(self) -> Wanted:
        """Fly over the next place, or wait for the sought robot here."""
        while self._find_next_place():
            motion = self._navigator.plan_to(self._next_place())
            # A place that is reached already, or that no way leads to, is skipped.
            if self._context.task.way.progress is Progress.FLYING or not self._more:
                return Planned(motion)
        self._waits_at = self._context.task.way.goal
        if self._context.task.ends_s is None:
            self._context.start_timer()
            self._context.inform(f"at the search position of {self._context.task.robot}")
        return Rest("it waits for the robot")

    def no_route(self, refusal: str) -> Wanted:
        """Give the robot up, or only the places to be flown over on the way."""
        if self._more:
            return self.arrived()
        self._context.inform(f"no way to {self._context.task.robot}: {refusal}")
        return self._no_target()

    @property
    def _more(self) -> bool:
        """Whether further places come before the wait."""
        return bool(self._places or self._stops)

    def _is_elsewhere(self, place: Goal) -> bool:
        """Whether this is not where the vehicle waits, or further places follow."""
        at = self._waits_at
        moved = at is None or math.dist(at.position, place.position) >= FOLLOW_M
        return moved or self._more

    def _find_next_place(self) -> bool:
        """Prepare the next place, of this robot or the next; return whether there is one."""
        while not self._places and self._stops:
            robot = self._stops.popleft()
            if not (self._stops and self._met(robot)):
                self._places.extend(self._point(robot).places)
                self._try(robot)
        return bool(self._places)

    def _next_place(self) -> Goal:
        """The next place; if further ones follow, the nearest point with a clear way."""
        goal = self._places.popleft()
        return Goal(self._navigator.hover_point(goal.position)) if self._more else goal

    def _point(self, robot: str) -> SearchPoint:
        """Where one of the robots would be sought now."""
        return self.search.search_point(robot, self._context.now_s)

    def _met(self, robot: str) -> bool:
        """Whether both directions have synced since the search began."""
        return self.search.targets.tracks[robot].met_s >= self._began_s

    def retry(self) -> Wanted:
        """Fly to the same place, or choose again if no robot could be sought."""
        if self._context.task.robot is None:
            return self.begin()
        return Planned(self._navigator.again())

    def replan(self) -> Wanted:
        """Seek the same robot, if there is a way to it."""
        return self._set_out(self._context.task.robot)

    def _candidates(self, first: str | None) -> Iterator[SearchPoint]:
        """Where to seek that robot, then the others in order."""
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
        """Hover over the robot's newest position once it has moved, or search ahead of it."""
        context, robot = self._context, self._context.task.robot
        track = None if robot is None else self.search.targets.tracks.get(robot)
        searching = context.task.state is State.SEARCH
        if robot is None or track is None or track.pose is None or (searching and self._more):
            return Rest("it is not known where the robot is, or others are flown over first")
        if (searching and self.search.foresees) or self.search.hovers:
            point = self._point(robot)
            hover, offset_m = point.goal, point.offset_m
        else:
            place = self._navigator.hover_point(track.pose.position)
            hover, offset_m = Goal(place), math.dist(track.pose.position, place)
        goal = context.task.way.goal
        if not force and goal is not None and math.dist(goal.position, hover.position) < FOLLOW_M:
            return Rest("the robot has not moved away")
        if not force:
            if not self._follows.allows(context.now_s):
                return Rest("it was followed just now: the robot's next pose, or path, does")
            self._follows.moved(context.now_s)
        if offset_m > 0:
            context.inform(f"no hovering over {robot}: waiting {offset_m:.0f} m beside it")
        return hover

    # Messages from robots; each returns the motion wanted, if any.

    def pose_received(self, event: RobotPose) -> Wanted | None:
        """Handle a robot's pose; if the sought robot itself sent it, the robot was found."""
        context, track = self._context, self.search.targets.tracks.get(event.robot)
        if track is None:
            return None
        believed = track.pose_received(event.position, event.stamp_s, context.now_s)
        if track.verdict is PoseVerdict.OLD:
            return None
        self._announce_jumps(track)
        if event.robot != context.task.robot:
            return None
        if context.task.state is State.SEARCH and event.peer == event.robot:
            return Signal.FOUND  # its radio is in range, whatever the pose
        return self.follow() if context.task.spec.seeks and believed else None

    def _announce_jumps(self, track: TargetTrack) -> None:
        """Announce once that a robot's position jumped, and that it counts again."""
        robot, jump = track.robot, track.check.jump
        if track.verdict is PoseVerdict.JUMPED and jump is not None:
            if robot not in self._jumpers:
                self._jumpers.add(robot)
                self._context.warn(
                    f"the position of {robot} jumped {jump.metres:.0f} m in {jump.seconds:.1f} s: "
                    "ignored for now",
                    CHECK_LOCALISATION,
                )
        elif track.verdict is PoseVerdict.BACK:
            self._jumpers.discard(robot)
            self._context.inform(
                f"the position of {robot} counts again: it stayed where it jumped to"
            )

    def path_received(self, event: RobotPath) -> Wanted | None:
        """Handle a robot's path."""
        context, track = self._context, self.search.targets.tracks.get(event.robot)
        if track is None or not track.path_received(event.points, event.stamp_s, context.now_s):
            return None
        searching = context.task.state is State.SEARCH and event.robot == context.task.robot
        return self.follow() if searching and self.search.foresees else None

    def radio_received(self, event: RadioEvent) -> Wanted | None:
        """Handle a contact with a robot's radio."""
        track, here = self.search.targets.tracks.get(event.peer), self.search.exploration.here
        if track is None:
            return None
        self.search.links.contact(event.peer, linked=not isinstance(event, ContactEnded))
        if here is not None:
            track.radio_received(here, self._context.now_s)
        if isinstance(event, SyncEnded) and event.complete:
            track.synced(event.direction, self._context.now_s)
            passes = self._context.task.state is State.SEARCH and self._stops
            if passes and event.peer == self._over and self._met(event.peer):
                self._places.clear()
                return self.arrived()
        return None

    def sought_by_other(self, event: RobotSought) -> Wanted | None:
        """Handle another UAV's search; if both seek the same robot, one of them yields."""
        context, targets = self._context, self.search.targets
        is_new = targets.sought_by_other(event.by, event.robot, context.now_s)
        # A requested robot is never left to another UAV.
        free = context.task.state is State.SEARCH and context.task.robot != self._requested
        ours = free and context.task.robot is not None and context.task.robot == event.robot
        # A repeated message has no effect, nor has one that leaves no other robot.
        if ours and is_new and event.by < self.search.name and targets.free(context.now_s):
            if not self._yields.allows(context.now_s):
                return None  # two UAVs over one robot do no harm
            self._yields.moved(context.now_s)
            context.inform(f"{event.by} seeks {event.robot} as well, and keeps it")
            return Signal.YIELDED
        return None


@dataclass(slots=True, eq=False)
class CommState(StateHandler):
    """Stays over the found robot until both directions have synced.

    Only a sync that began after the robot was found, and that no byte budget cut short, counts:
    only it includes all data of both.

    Args:
        context: Knows the robot that was found.
        search_state: Follows the robot.
    """

    _context: MissionContext
    _search_state: SearchState
    _began: set[Direction] = field(default_factory=set)  # syncs that began in this state
    _synced: set[Direction] = field(default_factory=set)  # of these, the completed ones

    def begin(self) -> Wanted:
        """Publish the newest map, and fly over the robot."""
        self._began.clear()
        self._synced.clear()
        context = self._context
        context.actions.append(PublishMap())
        context.inform(f"COMM {context.task.robot}: found")
        return self._search_state.follow(force=True)

    def retry(self) -> Wanted:
        """Fly over the robot's newest position."""
        return self._search_state.follow(force=True)

    replan = retry

    def sync_started(self, event: SyncStarted) -> Wanted | None:
        """Note that a sync began."""
        if event.peer == self._context.task.robot:
            self._began.add(event.direction)
        return self._search_state.radio_received(event)

    def sync_ended(self, event: SyncEnded) -> Wanted | None:
        """Note that a sync ended; signal when both directions are complete."""
        if event.peer == self._context.task.robot and event.direction in self._began:
            self._began.discard(event.direction)
            if event.complete:
                self._synced.add(event.direction)
        wanted = self._search_state.radio_received(event)
        if self._context.task.state is State.COMM and len(self._synced) == len(Direction):
            return Signal.SYNCED
        return wanted
