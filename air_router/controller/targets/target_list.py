"""Whom to seek: the robots, and where each is and will be, from what it said and when that came."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from statistics import median
from typing import Final

from air_router.controller.targets.limits import (
    BEFORE_S,
    FASTEST_M_S,
    LEFT_M,
    LEFT_S,
    LOST_AFTER_S,
    RECENT_POSE_S,
    SET_BACK,
    SOUGHT_BY_OTHER_S,
    STRETCH_S,
    STRETCHES,
    USUAL_SPEED_M_S,
)
from air_router.controller.targets.pose_check import PoseCheck, PoseVerdict
from air_router.controller.targets.predicted_path import PredictedPath, ahead_of
from geo.frame import Point
from mocha_link.links import Direction

NEVER_HEARD: Final = "never heard, so where the UAV passed longest ago"
"""Why a robot is sought at no place in particular."""


_SPEEDS_M_S: Final = (0.1, FASTEST_M_S)
"""Slower is standing; faster is a jump of its position, not a drive."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """Where a robot was, and when."""

    position: Point
    stamp_s: float  # on the robot's clock, of a pose


@dataclass(frozen=True, slots=True)
class Intent:
    """The path that a robot published, and when, in its Unix seconds."""

    points: tuple[Point, ...]  # the last is its destination
    stamp_s: float


@dataclass(slots=True)
class _Stamps:
    """The stamps of one topic of a robot, in its own seconds, against when they came.

    What is stamped no later than the newest is old, carried by others. But a robot whose clock was
    set back, or that stamped one message with a time to come, would never be heard again: stamps
    that go on at the pace at which they come, `SET_BACK` one after the other, are its clock.

    Attributes:
        newest_s: The newest.
        behind_s: What its clock is behind ours at least, by the least delay of a message.
    """

    newest_s: float = -math.inf
    behind_s: float = math.inf
    _late: tuple[float, float] | None = None  # the last old stamp, and when it came
    _in_step: int = 0  # late stamps in a row that fit together

    def is_newer(self, stamp_s: float, now_s: float) -> bool:
        """Whether a message is newer than all before; `now_s` is our clock."""
        if not math.isfinite(stamp_s):
            return False
        set_back = stamp_s <= self.newest_s and self._set_back(stamp_s, now_s)
        if set_back:
            self.behind_s = math.inf
        self.behind_s = min(self.behind_s, now_s - stamp_s)
        if stamp_s <= self.newest_s and not set_back:
            return False
        self.newest_s, self._late, self._in_step = stamp_s, None, 0
        return True

    def _set_back(self, stamp_s: float, now_s: float) -> bool:
        before, self._late = self._late, (stamp_s, now_s)
        passed_s = 0.0 if before is None else now_s - before[1]
        ticked_s = 0.0 if before is None else stamp_s - before[0]
        in_step = 0.5 * passed_s < ticked_s < 1.5 * passed_s
        self._in_step = self._in_step + 1 if in_step else 0
        return self._in_step >= SET_BACK


@dataclass(slots=True)
class TargetTrack:
    """What is known of one robot.

    Clocks of robots differ, from ours and from each other's. A robot's stamps are compared with
    its own, and moved to our clock by the least delay that any of its messages had, as one-way
    measurements of clocks do: what came straight from the robot was hardly delayed. So what came
    through others is as old as it is, not as old as its arrival.

    Attributes:
        robot: Its name.
        pose: Its newest pose, at a time in the robot's Unix seconds.
        path: Its newest path, likewise.
        updated_s: When anything new about it arrived.
        radio: Where the vehicle was when it last heard the robot's radio, on the vehicle's clock.
        taken_s: When we last had everything from it.
        given_s: When it last had everything from us.
        tries: How often the vehicle flew to where it should be since the last update.
        check: Whether it can have driven to where its poses say.
        verdict: What became of its latest pose.
    """

    robot: str
    pose: Sighting | None = None
    path: Intent | None = None
    updated_s: float | None = None
    radio: Sighting | None = None
    taken_s: float | None = None
    given_s: float | None = None
    tries: int = 0
    check: PoseCheck = field(default_factory=PoseCheck)
    verdict: PoseVerdict = PoseVerdict.OLD
    _poses: _Stamps = field(default_factory=_Stamps)  # clock of its poses
    _paths: _Stamps = field(default_factory=_Stamps)  # clock of its paths
    # poses some seconds apart, for its speed
    _marks: deque[Sighting] = field(default_factory=partial(deque, maxlen=STRETCHES + 1))

    def tried(self) -> None:
        """The vehicle flies to where it should be."""
        self.tries += 1

    def radio_received(self, here: Point, now_s: float) -> None:
        """The vehicle, which is there, hears its radio."""
        self.radio = Sighting(here, now_s)

    def pose_received(self, position: Point, stamp_s: float, now_s: float) -> bool:
        """Take its pose in; True if it is newer than the one before, and can be true."""
        if not self._poses.is_newer(stamp_s, now_s):
            self.verdict = PoseVerdict.OLD
            return False
        if self.pose is not None and stamp_s <= self.pose.stamp_s:  # its clock was set back
            self._marks.clear()
            self.check.set_back()
        self.verdict = self.check.verdict(position, stamp_s, now_s)
        if self.verdict is PoseVerdict.JUMPED:
            return False
        if self.verdict is PoseVerdict.BACK:
            self._marks.clear()  # that was no drive
        self.pose = Sighting(position, stamp_s)
        if not self._marks or stamp_s - self._marks[-1].stamp_s >= STRETCH_S[0]:
            self._marks.append(self.pose)
        self.updated_s, self.tries = now_s, 0
        return True

    def path_received(self, points: tuple[Point, ...], stamp_s: float, now_s: float) -> bool:
        """Take the path that it published in; True if it is new."""
        if not points or not self._paths.is_newer(stamp_s, now_s):
            return False
        self.path = Intent(points, stamp_s)
        self.updated_s, self.tries = now_s, 0
        return True

    def synced(self, direction: Direction, now_s: float) -> None:
        """Everything that one side held has gone to the other."""
        if direction is Direction.IN:
            self.taken_s = now_s
        else:
            self.given_s = now_s

    @property
    def met_s(self) -> float:
        """When both last had everything from each other; minus infinity: they never had."""
        return min(-math.inf if at is None else at for at in (self.taken_s, self.given_s))

    @property
    def newest_s(self) -> float | None:
        """When it published the newest that we know of it, on our clock; None: never received."""
        stamps_s = [
            self.ours_s(update.stamp_s) for update in (self.pose, self.path) if update is not None
        ]
        return max(stamps_s, default=None)

    @property
    def speed_m_s(self) -> float | None:
        """How fast it drives when it drives: the middle one of its latest stretches."""
        stretches = [
            math.dist(a.position, b.position) / (b.stamp_s - a.stamp_s)
            for a, b in pairwise(self._marks)
            if b.stamp_s - a.stamp_s <= STRETCH_S[1]
        ]
        slowest, fastest = _SPEEDS_M_S
        driven = [speed for speed in stretches if speed >= slowest]
        return min(median(driven), fastest) if driven else None

    def ours_s(self, stamp_s: float) -> float:
        """A time on the robot's clock, on ours."""
        return stamp_s + min(self._poses.behind_s, self._paths.behind_s)

    def course(self, usual_m_s: float = USUAL_SPEED_M_S) -> PredictedPath | None:
        """Where it will be; None if nothing was received from it.

        From its newest pose on along its path; when that was over and its radio was received, from
        there.

        Args:
            usual_m_s: How fast it drives if that is not known.
        """
        speed_m_s = self.speed_m_s or usual_m_s
        stamps_s, radio = self._published_path(speed_m_s), self.radio
        if radio is not None and (stamps_s is None or radio.stamp_s > stamps_s.end_s):
            return PredictedPath((radio.position,), radio.stamp_s, speed_m_s)
        return stamps_s

    def _published_path(self, speed_m_s: float) -> PredictedPath | None:
        """Where it reported that it will be.

        A path that it has left counts no more, nor does a pose from long before the path.
        """
        pose, path = self.pose, self.path
        if path is None:
            if pose is None:
                return None
            return PredictedPath((pose.position,), self.ours_s(pose.stamp_s), speed_m_s)
        if pose is None or path.stamp_s - pose.stamp_s > BEFORE_S:
            return PredictedPath(path.points, self.ours_s(path.stamp_s), speed_m_s)
        ahead, off_m = ahead_of(path.points, pose.position)
        if off_m > LEFT_M and pose.stamp_s - path.stamp_s > LEFT_S:
            ahead = ()
        return PredictedPath((pose.position, *ahead), self.ours_s(pose.stamp_s), speed_m_s)


@dataclass(frozen=True, slots=True)
class SearchPlace:
    """Where to search for a robot, why there, and over whom on the way.

    Attributes:
        robot: Its name.
        position: Where to search; None: where the UAV passed longest ago, since nothing is
            known of it.
        reason: In words, to be announced.
        over: Robots that are flown over before, in this order.
        along: Other places where it may be, that are flown over before this one.
    """

    robot: str
    position: Point | None
    reason: str
    over: tuple[str, ...] = ()
    along: tuple[Point, ...] = ()


@dataclass(slots=True)
class TargetList:
    """The robots to seek, in the mission's order, and the newest that is known of each.

    Times given as `now_s` are the vehicle's clock; stamps are the robots' own and only compared
    with stamps of the same robot, so that no two clocks have to agree.
    """

    names: tuple[str, ...]  # in the mission's order
    tracks: dict[str, TargetTrack] = field(default_factory=dict)  # by name
    _last_sought: str | None = None  # the turn goes on after it
    # sought by other UAVs, and when heard
    _others: dict[str, tuple[str | None, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.tracks = {name: TargetTrack(name) for name in self.names}

    def course(self, robot: str) -> PredictedPath | None:
        """Where a robot will be; one whose speed is not known drives as the others do."""
        speeds_m_s = [track.speed_m_s for track in self.tracks.values()]
        known_m_s = [speed_m_s for speed_m_s in speeds_m_s if speed_m_s is not None]
        return self.tracks[robot].course(median(known_m_s) if known_m_s else USUAL_SPEED_M_S)

    def candidates(self, now_s: float) -> tuple[str, ...]:
        """Robots in the order in which they are to be tried.

        Round robin; lost ones behind the others; behind them those that another UAV seeks.
        """
        return tuple(name for group in self.groups(now_s) for name in group)

    def groups(self, now_s: float) -> tuple[tuple[str, ...], ...]:
        """The robots in their turns: those to be sought, then lost ones, then others' ones."""
        names = self.names
        if self._last_sought in names:
            at = names.index(self._last_sought) + 1
            names = names[at:] + names[:at]
        lost = {name for name in names if self._is_lost(name, now_s)}
        taken = self._sought_by_others(now_s)
        free = [name for name in names if name not in taken]
        return (
            tuple(name for name in free if name not in lost),
            tuple(name for name in free if name in lost),
            tuple(sorted((n for n in names if n in taken), key=lambda name: name in lost)),
        )

    def sought(self, robot: str) -> None:
        """Remember that it was this robot's turn."""
        self._last_sought = robot

    def sought_by_other(self, by: str, robot: str | None, now_s: float) -> bool:
        """Take in whom another UAV seeks (None: no robot); True unless that was known already."""
        before = self._others.get(by)
        self._others[by] = (robot, now_s)
        return before is None or before[0] != robot or now_s - before[1] > SOUGHT_BY_OTHER_S

    def free(self, now_s: float) -> tuple[str, ...]:
        """The robots that no other UAV seeks."""
        taken = self._sought_by_others(now_s)
        return tuple(name for name in self.names if name not in taken)

    def place(self, robot: str, now_s: float) -> SearchPlace:
        """Where a robot is most likely met.

        A recent pose; else the end of its path; else its last pose, however old; else nowhere
        in particular (`position` None: look where one has not been for longest).
        """
        record = self.tracks[robot]
        pose, path = record.pose, record.path
        recent = record.updated_s is not None and now_s - record.updated_s <= RECENT_POSE_S
        if pose is not None and recent:
            return SearchPlace(robot, pose.position, "its last position")
        if path is not None and (pose is None or path.stamp_s >= pose.stamp_s - 60.0):
            return SearchPlace(robot, path.points[-1], "where its path ends")
        if pose is not None:
            return SearchPlace(robot, pose.position, "its last known position, an old one")
        return SearchPlace(robot, None, NEVER_HEARD)

    def _sought_by_others(self, now_s: float) -> set[str | None]:
        return {
            robot
            for robot, heard_s in self._others.values()
            if now_s - heard_s <= SOUGHT_BY_OTHER_S
        }

    def _is_lost(self, robot: str, now_s: float) -> bool:
        updated_s = self.tracks[robot].updated_s
        return updated_s is not None and now_s - updated_s > LOST_AFTER_S
