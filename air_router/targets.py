"""Whom to seek next, and where: the roster of robots and what is known of them."""

from __future__ import annotations

from dataclasses import dataclass, field

from geo.frame import Point

RECENT_POSE_S = 60.0
"""A pose younger than this says where the robot is; an older one, only where it was."""

LOST_AFTER_S = 1200.0
"""A robot not heard of for so long counts as lost and is skipped while others are not."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """Where a robot was (or will be) and when that was said, in the robot's Unix seconds."""

    position: Point
    stamp_s: float


@dataclass(frozen=True, slots=True)
class SearchPlace:
    """Where to look for a robot and why there."""

    robot: str
    position: Point | None
    reason: str


@dataclass(slots=True)
class _Record:
    pose: Sighting | None = None
    destination: Sighting | None = None
    news_s: float | None = None  # when anything about it arrived here


@dataclass(slots=True)
class Roster:
    """The robots to seek, in the mission's order, and the newest that is known of each.

    Times given as `now_s` are the vehicle's clock; stamps are the robots' own and only compared
    with stamps of the same robot, so that nobody's clock has to agree with another's.
    """

    names: tuple[str, ...]
    _records: dict[str, _Record] = field(default_factory=dict)
    _last_sought: str | None = None

    def __post_init__(self) -> None:
        self._records = {name: _Record() for name in self.names}

    def pose_heard(self, robot: str, position: Point, stamp_s: float, now_s: float) -> bool:
        """Take a robot's pose in; True if it is newer than the one known before."""
        record = self._records.get(robot)
        if record is None or (record.pose is not None and stamp_s <= record.pose.stamp_s):
            return False
        record.pose = Sighting(position, stamp_s)
        record.news_s = now_s
        return True

    def path_heard(self, robot: str, destination: Point, stamp_s: float, now_s: float) -> bool:
        """Take the end of a robot's published path in; True if it is news."""
        record = self._records.get(robot)
        if record is None or (
            record.destination is not None and stamp_s <= record.destination.stamp_s
        ):
            return False
        record.destination = Sighting(destination, stamp_s)
        record.news_s = now_s
        return True

    def position_of(self, robot: str) -> Point | None:
        """The newest known position of a robot."""
        record = self._records.get(robot)
        return record.pose.position if record is not None and record.pose is not None else None

    def candidates(self, now_s: float) -> tuple[str, ...]:
        """Robots in the order in which they are to be tried: round robin, lost ones last."""
        names = self.names
        if self._last_sought in names:
            at = names.index(self._last_sought) + 1
            names = names[at:] + names[:at]
        lost = {name for name in names if self._is_lost(name, now_s)}
        return tuple(n for n in names if n not in lost) + tuple(n for n in names if n in lost)

    def sought(self, robot: str) -> None:
        """Remember that it was this robot's turn."""
        self._last_sought = robot

    def place(self, robot: str, now_s: float) -> SearchPlace:
        """Where a robot is most likely met.

        A recent pose; else the end of its path; else its last pose, however old; else nowhere
        in particular (`position` None: look where one has not been for longest).
        """
        record = self._records[robot]
        pose, destination = record.pose, record.destination
        recent = record.news_s is not None and now_s - record.news_s <= RECENT_POSE_S
        if pose is not None and recent:
            return SearchPlace(robot, pose.position, "its last position")
        if destination is not None and (pose is None or destination.stamp_s >= pose.stamp_s - 60.0):
            return SearchPlace(robot, destination.position, "where its path ends")
        if pose is not None:
            return SearchPlace(robot, pose.position, "its last known position, an old one")
        return SearchPlace(robot, None, "never heard of, so where it is longest since we passed")

    def _is_lost(self, robot: str, now_s: float) -> bool:
        news_s = self._records[robot].news_s
        return news_s is not None and now_s - news_s > LOST_AFTER_S
