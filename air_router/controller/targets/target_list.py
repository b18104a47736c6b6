"""The robots to seek, and where each is and will be, from its messages and their times."""

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

NEVER_RECEIVED: Final = "never received; trying the waypoint passed longest ago"
"""The reason for the search position of a robot that was never received."""


_SPEEDS_M_S: Final = (0.1, FASTEST_M_S)
"""A slower robot is at rest; a faster change is a jump of its position."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A robot's position at a time."""

    position: Point
    stamp_s: float  # of a pose, on the robot's clock


@dataclass(frozen=True, slots=True)
class Intent:
    """A robot's published path, and when, in its Unix seconds."""

    points: tuple[Point, ...]  # the last is its destination
    stamp_s: float


@dataclass(slots=True)
class _Stamps:
    """The stamps of one topic of a robot, compared with their times of reception.

    A message stamped no later than the newest is old: others carried it. After its clock was set
    back, or after one stamp from the future, a robot would never be accepted again. So `SET_BACK`
    consecutive stamps that advance at the pace of reception become its clock.

    Attributes:
        newest_s: The newest stamp.
        behind_s: Smallest difference between reception and stamp: the clocks' offset.
    """

    newest_s: float = -math.inf
    behind_s: float = math.inf
    _late: tuple[float, float] | None = None  # the last old stamp, and its reception
    _in_step: int = 0  # consecutive old stamps in step

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
    """The data about one robot.

    Robots' clocks differ. A robot's stamps are compared only with its own, and converted to our
    clock by the smallest delay of any of its messages (one-way clock measurement): a message
    received directly has hardly any delay. So a message relayed by others has its true age, not the
    age of its reception.

    Attributes:
        robot: Its name.
        pose: Its newest pose, in the robot's Unix seconds.
        path: Its newest path, likewise.
        updated_s: When the last new message about it was received.
        radio: Where the vehicle was at the last contact with the robot's radio, on the vehicle's
            clock.
        taken_s: End of the last complete sync from it.
        given_s: End of the last complete sync to it.
        tries: Number of searches since the last update.
        check: Checks whether it can have driven to its reported positions.
        verdict: The verdict on its latest pose.
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
    # poses some seconds apart, to measure its speed
    _marks: deque[Sighting] = field(default_factory=partial(deque, maxlen=STRETCHES + 1))

    def tried(self) -> None:
        """Count a search for the robot."""
        self.tries += 1

    def radio_received(self, here: Point, now_s: float) -> None:
        """Note a contact with the robot's radio, with the vehicle's position."""
        self.radio = Sighting(here, now_s)

    def pose_received(self, position: Point, stamp_s: float, now_s: float) -> bool:
        """Add a pose; return whether it is newer and plausible."""
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
            self._marks.clear()  # a jump is no driving
        self.pose = Sighting(position, stamp_s)
        if not self._marks or stamp_s - self._marks[-1].stamp_s >= STRETCH_S[0]:
            self._marks.append(self.pose)
        self.updated_s, self.tries = now_s, 0
        return True

    def path_received(self, points: tuple[Point, ...], stamp_s: float, now_s: float) -> bool:
        """Add a published path; return whether it is new."""
        if not points or not self._paths.is_newer(stamp_s, now_s):
            return False
        self.path = Intent(points, stamp_s)
        self.updated_s, self.tries = now_s, 0
        return True

    def synced(self, direction: Direction, now_s: float) -> None:
        """Note a complete sync in one direction."""
        if direction is Direction.IN:
            self.taken_s = now_s
        else:
            self.given_s = now_s

    @property
    def met_s(self) -> float:
        """When both directions were last complete; minus infinity: never."""
        return min(-math.inf if at is None else at for at in (self.taken_s, self.given_s))

    @property
    def newest_s(self) -> float | None:
        """When its newest received message was published, on our clock; None: never received."""
        stamps_s = [
            self.ours_s(update.stamp_s) for update in (self.pose, self.path) if update is not None
        ]
        return max(stamps_s, default=None)

    @property
    def speed_m_s(self) -> float | None:
        """Its driving speed: the median of its latest stretches."""
        stretches = [
            math.dist(a.position, b.position) / (b.stamp_s - a.stamp_s)
            for a, b in pairwise(self._marks)
            if b.stamp_s - a.stamp_s <= STRETCH_S[1]
        ]
        slowest, fastest = _SPEEDS_M_S
        driven = [speed for speed in stretches if speed >= slowest]
        return min(median(driven), fastest) if driven else None

    def ours_s(self, stamp_s: float) -> float:
        """Convert a time on the robot's clock to ours."""
        return stamp_s + min(self._poses.behind_s, self._paths.behind_s)

    def course(self, usual_m_s: float = USUAL_SPEED_M_S) -> PredictedPath | None:
        """Its predicted path; None if nothing was received from it.

        From its newest pose along its path; if the path is over, from where its radio was received.

        Args:
            usual_m_s: Assumed speed if its own is unknown.
        """
        speed_m_s = self.speed_m_s or usual_m_s
        published, radio = self._published_path(speed_m_s), self.radio
        if radio is not None and (published is None or radio.stamp_s > published.end_s):
            return PredictedPath((radio.position,), radio.stamp_s, speed_m_s)
        return published

    def _published_path(self, speed_m_s: float) -> PredictedPath | None:
        """The prediction along its published path.

        A path that the robot has left does not count, nor does a pose from long before the path.
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
    """Where to search for a robot, why there, and which robots to fly over on the way.

    Attributes:
        robot: Its name.
        position: Where to search; None: the waypoint passed longest ago, because nothing is known.
        reason: The announced reason.
        over: Robots to fly over on the way, in this order.
        along: Other places where the robot may be, flown over before this one.
    """

    robot: str
    position: Point | None
    reason: str
    over: tuple[str, ...] = ()
    along: tuple[Point, ...] = ()


@dataclass(slots=True)
class TargetList:
    """The robots to seek, in the mission's order, with their newest data.

    `now_s` is the vehicle's clock. Stamps are the robots' own and compared only with stamps of the
    same robot, so no two clocks have to agree.
    """

    names: tuple[str, ...]  # in the mission's order
    tracks: dict[str, TargetTrack] = field(default_factory=dict)  # by name
    _last_sought: str | None = None  # the next turn begins after it
    # robots sought by other UAVs, and when received
    _others: dict[str, tuple[str | None, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.tracks = {name: TargetTrack(name) for name in self.names}

    def course(self, robot: str) -> PredictedPath | None:
        """A robot's predicted path; a robot with unknown speed drives as the others do."""
        speeds_m_s = [track.speed_m_s for track in self.tracks.values()]
        known_m_s = [speed_m_s for speed_m_s in speeds_m_s if speed_m_s is not None]
        return self.tracks[robot].course(median(known_m_s) if known_m_s else USUAL_SPEED_M_S)

    def candidates(self, now_s: float) -> tuple[str, ...]:
        """The robots in the order in which to seek them.

        Round robin; lost robots after the others; robots that another UAV seeks last.
        """
        return tuple(name for group in self.groups(now_s) for name in group)

    def groups(self, now_s: float) -> tuple[tuple[str, ...], ...]:
        """The robots in turn, in three groups: normal, lost, sought by other UAVs."""
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
        """Note that this robot had its turn."""
        self._last_sought = robot

    def sought_by_other(self, by: str, robot: str | None, now_s: float) -> bool:
        """Note which robot another UAV seeks (None: none); return whether this is new."""
        before = self._others.get(by)
        self._others[by] = (robot, now_s)
        return before is None or before[0] != robot or now_s - before[1] > SOUGHT_BY_OTHER_S

    def free(self, now_s: float) -> tuple[str, ...]:
        """The robots that no other UAV seeks."""
        taken = self._sought_by_others(now_s)
        return tuple(name for name in self.names if name not in taken)

    def place(self, robot: str, now_s: float) -> SearchPlace:
        """Where a robot is most likely to be.

        Its last pose, if a new pose or path was received recently; else the end of its path; else
        its last pose, however old; else no position (None: the waypoint passed longest ago).
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
        return SearchPlace(robot, None, NEVER_RECEIVED)

    def _sought_by_others(self, now_s: float) -> set[str | None]:
        return {
            robot
            for robot, received_s in self._others.values()
            if now_s - received_s <= SOUGHT_BY_OTHER_S
        }

    def _is_lost(self, robot: str, now_s: float) -> bool:
        updated_s = self.tracks[robot].updated_s
        return updated_s is not None and now_s - updated_s > LOST_AFTER_S
