"""Where one robot is and will be: from what it said, and from when that came."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate, pairwise
from statistics import median
from typing import Final

from geo.frame import Point, off_line_m

USUAL_SPEED_M_S: Final = 1.0
"""Of a ground robot, where no robot's speed is known."""

_SPEEDS_M_S: Final = (0.1, 5.0)
"""Slower is standing; faster is a jump of its position, not a drive."""

_STRETCH_S: Final = (5.0, 120.0)
"""Speed is measured between poses so far apart: noise counts in shorter, corners in longer."""

_STRETCHES: Final = 12

_LEFT_M: Final = 15.0
_LEFT_S: Final = 60.0
"""A pose so far off a path, and so much younger, says that the robot does not follow it."""

_SET_BACK: Final = 3
"""So many stamps in a row that keep step with our clock say what a robot's clock shows now."""

_BEFORE_S: Final = 30.0
"""A pose so much older than a path does not say where on it the robot is."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """Where a robot was, and when."""

    position: Point
    stamp_s: float  # on the robot's clock, of a pose


@dataclass(frozen=True, slots=True)
class Intent:
    """The path that a robot said it would take, and when it said so, in its Unix seconds."""

    points: tuple[Point, ...]  # the last is its destination
    stamp_s: float


@dataclass(frozen=True, slots=True)
class PredictedPath:
    """Where a robot will be, if it does as it said; a single point is a robot that stands.

    Attributes:
        points: Its way.
        start_s: When it is at the first point, on the vehicle's clock.
        speed_m_s: How fast it drives.
    """

    points: tuple[Point, ...]
    start_s: float
    speed_m_s: float

    @property
    def length_m(self) -> float:
        """Length of the way."""
        return sum(math.dist(a, b) for a, b in pairwise(self.points))

    @property
    def end_s(self) -> float:
        """When it comes to the end, beyond which nothing is known of it."""
        return self.due_s(self.length_m)

    def due_s(self, along_m: float) -> float:
        """When it has driven so far."""
        return self.start_s + along_m / self.speed_m_s

    def along_m(self, now_s: float) -> float:
        """How far it has driven by now: between nothing and the whole way."""
        return min(max((now_s - self.start_s) * self.speed_m_s, 0.0), self.length_m)

    def place(self, along_m: float) -> Point:
        """The place after so many metres."""
        starts_m = accumulate((math.dist(a, b) for a, b in pairwise(self.points)), initial=0.0)
        for start_m, (a, b) in zip(starts_m, pairwise(self.points), strict=False):
            leg_m = math.dist(a, b)
            if along_m <= start_m + leg_m and leg_m > 0:
                share = max(along_m - start_m, 0.0) / leg_m
                return Point(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
        return self.points[-1]


@dataclass(slots=True)
class _Stamps:
    """The stamps of one topic of a robot, in its own seconds, against when they came.

    What is stamped no later than the newest is old, carried by others. But a robot whose clock was
    set back, or that stamped one message with a time to come, would never be heard again: stamps
    that go on at the pace at which they come, `_SET_BACK` one after the other, are its clock.

    Attributes:
        newest_s: The newest.
        behind_s: What its clock is behind ours at least, by the least delay of a message.
    """

    newest_s: float = -math.inf
    behind_s: float = math.inf
    _late: tuple[float, float] | None = None  # the last old stamp, and when it came
    _in_step: int = 0  # late stamps in a row that fit together

    def news(self, stamp_s: float, now_s: float) -> bool:
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
        return self._in_step >= _SET_BACK


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
        news_s: When anything new about it arrived.
        radio: Where the vehicle was when it last heard the robot's radio, on the vehicle's clock.
        taken_s: When we last had everything from it.
        given_s: When it last had everything from us.
        tries: How often it was sought since the last news.
    """

    robot: str
    pose: Sighting | None = None
    path: Intent | None = None
    news_s: float | None = None
    radio: Sighting | None = None
    taken_s: float | None = None
    given_s: float | None = None
    tries: int = 0
    _poses: _Stamps = field(default_factory=_Stamps)  # clock of its poses
    _paths: _Stamps = field(default_factory=_Stamps)  # clock of its paths
    # poses some seconds apart, for its speed
    _marks: deque[Sighting] = field(default_factory=partial(deque, maxlen=_STRETCHES + 1))

    def pose_heard(self, position: Point, stamp_s: float, now_s: float) -> bool:
        """Take its pose in; True if it is newer than the one known before."""
        if not self._poses.news(stamp_s, now_s):
            return False
        if self.pose is not None and stamp_s <= self.pose.stamp_s:  # its clock was set back
            self._marks.clear()
        self.pose = Sighting(position, stamp_s)
        if not self._marks or stamp_s - self._marks[-1].stamp_s >= _STRETCH_S[0]:
            self._marks.append(self.pose)
        self._news(now_s)
        return True

    def path_heard(self, points: tuple[Point, ...], stamp_s: float, now_s: float) -> bool:
        """Take the path that it published in; True if it is news."""
        if not points or not self._paths.news(stamp_s, now_s):
            return False
        self.path = Intent(points, stamp_s)
        self._news(now_s)
        return True

    def radio_heard(self, here: Point, now_s: float) -> None:
        """Its radio was heard, so it is near the vehicle."""
        self.radio = Sighting(here, now_s)

    @property
    def word_s(self) -> float | None:
        """When it said the newest that we know of it, on our clock; None: never heard of."""
        said = [self.ours_s(word.stamp_s) for word in (self.pose, self.path) if word is not None]
        return max(said, default=None)

    @property
    def speed_m_s(self) -> float | None:
        """How fast it drives when it drives: the middle one of its latest stretches."""
        stretches = [
            math.dist(a.position, b.position) / (b.stamp_s - a.stamp_s)
            for a, b in pairwise(self._marks)
            if b.stamp_s - a.stamp_s <= _STRETCH_S[1]
        ]
        slowest, fastest = _SPEEDS_M_S
        driven = [speed for speed in stretches if speed >= slowest]
        return min(median(driven), fastest) if driven else None

    def ours_s(self, stamp_s: float) -> float:
        """A time on the robot's clock, on ours."""
        return stamp_s + min(self._poses.behind_s, self._paths.behind_s)

    def course(self, usual_m_s: float = USUAL_SPEED_M_S) -> PredictedPath | None:
        """Where it will be; None if it was never heard of.

        From its newest pose on along its path; when that was over and its radio was heard, from
        there.

        Args:
            usual_m_s: How fast it drives if that is not known.
        """
        speed_m_s = self.speed_m_s or usual_m_s
        said, radio = self._said(speed_m_s), self.radio
        if radio is not None and (said is None or radio.stamp_s > said.end_s):
            return PredictedPath((radio.position,), radio.stamp_s, speed_m_s)
        return said

    def _said(self, speed_m_s: float) -> PredictedPath | None:
        """Where it said that it will be.

        A path that it has left counts no more, nor does a pose from long before the path.
        """
        pose, path = self.pose, self.path
        if path is None:
            if pose is None:
                return None
            return PredictedPath((pose.position,), self.ours_s(pose.stamp_s), speed_m_s)
        if pose is None or path.stamp_s - pose.stamp_s > _BEFORE_S:
            return PredictedPath(path.points, self.ours_s(path.stamp_s), speed_m_s)
        ahead, off_m = _ahead(path.points, pose.position)
        if off_m > _LEFT_M and pose.stamp_s - path.stamp_s > _LEFT_S:
            ahead = ()
        return PredictedPath((pose.position, *ahead), self.ours_s(pose.stamp_s), speed_m_s)

    def _news(self, now_s: float) -> None:
        self.news_s = now_s
        self.tries = 0


def _ahead(path: tuple[Point, ...], place: Point) -> tuple[tuple[Point, ...], float]:
    """What of a path lies ahead of a place, and how far off the path that place is."""
    best, off_m = 0, math.dist(path[0], place)
    for index, (a, b) in enumerate(pairwise(path), start=1):
        away_m = off_line_m(place, a, b)
        if away_m < off_m:
            best, off_m = index, away_m
    return path[best:], off_m
