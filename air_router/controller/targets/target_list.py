"""Whom to seek next, and where: the list of robots and what is known of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from statistics import median
from typing import Final

from air_router.controller.targets.target_track import USUAL_SPEED_M_S, PredictedPath, TargetTrack
from geo.frame import Point
from mocha_link.links.metrics import Direction

RECENT_POSE_S = 60.0
"""A pose younger than this says where the robot is; an older one, only where it was."""

LOST_AFTER_S = 1200.0
"""A robot not heard of for so long counts as lost and is skipped while others are not."""

SOUGHT_BY_OTHER_S = 180.0
"""What another UAV said of whom it seeks holds for so long: a search takes less, mostly."""

NEVER_HEARD: Final = "never heard, so where the UAV passed longest ago"
"""Why a robot is sought at no place in particular."""


@dataclass(frozen=True, slots=True)
class SearchPlace:
    """Where to look for a robot (None: where the UAV passed longest ago) and why there."""

    robot: str
    position: Point | None  # None: nothing is known of it
    reason: str  # announced


@dataclass(slots=True)
class TargetList:
    """The robots to seek, in the mission's order, and the newest that is known of each.

    Times given as `now_s` are the vehicle's clock; stamps are the robots' own and only compared
    with stamps of the same robot, so that no two clocks have to agree.
    """

    names: tuple[str, ...]  # in the mission's order
    _records: dict[str, TargetTrack] = field(default_factory=dict)  # by name
    _last_sought: str | None = None  # the turn goes on after it
    # sought by other UAVs, and when heard
    _others: dict[str, tuple[str | None, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._records = {name: TargetTrack(name) for name in self.names}

    def pose_heard(self, robot: str, position: Point, stamp_s: float, now_s: float) -> bool:
        """Take a robot's pose in; True if it is newer than the one known before."""
        record = self._records.get(robot)
        return record is not None and record.pose_heard(position, stamp_s, now_s)

    def path_heard(
        self, robot: str, points: tuple[Point, ...], stamp_s: float, now_s: float
    ) -> bool:
        """Take the path that a robot published in; True if it is news."""
        record = self._records.get(robot)
        return record is not None and record.path_heard(points, stamp_s, now_s)

    def radio_heard(self, peer: str, here: Point, now_s: float) -> None:
        """A peer's radio was heard: it is near."""
        record = self._records.get(peer)
        if record is not None:
            record.radio_heard(here, now_s)

    def synced(self, peer: str, direction: Direction, now_s: float) -> None:
        """Everything that one side held has gone to the other."""
        record = self._records.get(peer)
        if record is None:
            return
        if direction is Direction.IN:
            record.taken_s = now_s
        else:
            record.given_s = now_s

    def __getitem__(self, robot: str) -> TargetTrack:
        """What is known of a robot."""
        return self._records[robot]

    def position_of(self, robot: str) -> Point | None:
        """The newest known position of a robot."""
        record = self._records.get(robot)
        return record.pose.position if record is not None and record.pose is not None else None

    def course(self, robot: str) -> PredictedPath | None:
        """Where a robot will be; one whose speed is not known drives as the others do."""
        speeds_m_s = [r.speed_m_s for r in self._records.values()]
        known_m_s = [speed_m_s for speed_m_s in speeds_m_s if speed_m_s is not None]
        return self._records[robot].course(median(known_m_s) if known_m_s else USUAL_SPEED_M_S)

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
        self._records[robot].tries += 1

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
        record = self._records[robot]
        pose, path = record.pose, record.path
        recent = record.news_s is not None and now_s - record.news_s <= RECENT_POSE_S
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
        news_s = self._records[robot].news_s
        return news_s is not None and now_s - news_s > LOST_AFTER_S
