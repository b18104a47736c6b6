"""Whether a robot can be where its pose says: what moves the vehicle has to be drivable.

A pose comes from a peer, and the vehicle flies after it. A robot whose localisation jumps, or a
hostile one, would have the vehicle change its mind five times a second. So a place that the robot
cannot have driven to since its last believed pose is not followed, until it has stayed there, and
all that peers send moves the vehicle at most once in a while.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from air_router.controller.targets.limits import (
    FASTEST_M_S,
    LONGEST_S,
    NOISE_M,
    STAYS_S,
)
from geo.frame import Point


class PoseVerdict(Enum):
    """What becomes of a pose."""

    OLD = "no newer than what is known"
    JUMPED = "the robot cannot have driven there"
    BACK = "believed again, after a jump"
    BELIEVED = "news"


class Jump(NamedTuple):
    """How far a robot's position jumped, and in which time on its clock."""

    metres: float
    seconds: float


class _Claim(NamedTuple):
    """Where a robot is by its pose, on its clock and on ours."""

    position: Point
    stamp_s: float
    now_s: float


@dataclass(slots=True)
class PoseCheck:
    """Follows the poses of one robot.

    Attributes:
        jump: The latest jump; None: there was none.
    """

    jump: Jump | None = None
    _believed: _Claim | None = None  # the last pose that was
    _doubted: _Claim | None = None  # the newest since that was not
    _there: _Claim | None = None  # since when it has been where that is
    _stays_s: float = STAYS_S  # how long a doubted place has to last

    def verdict(self, position: Point, stamp_s: float, now_s: float) -> PoseVerdict:
        """Take a pose in that is newer than those before.

        Args:
            position: East and north, metres.
            stamp_s: Seconds on the robot's clock.
            now_s: Seconds on ours, when it came.
        """
        claim = _Claim(position, stamp_s, now_s)
        believed, doubted = self._believed, self._doubted
        if believed is None or _drivable(believed, claim):
            self._believed, self._doubted, self._there = claim, None, None
            return PoseVerdict.BELIEVED
        self._doubted = claim
        if doubted is None or self._there is None or not _drivable(doubted, claim):
            self._there = claim
            self.jump = Jump(math.dist(believed.position, position), stamp_s - believed.stamp_s)
            return PoseVerdict.JUMPED
        lasts_s = min(stamp_s - self._there.stamp_s, now_s - self._there.now_s)
        if lasts_s < self._stays_s:
            return PoseVerdict.JUMPED
        self._stays_s = min(2.0 * self._stays_s, LONGEST_S)
        self._believed, self._doubted, self._there = claim, None, None
        return PoseVerdict.BACK

    def set_back(self) -> None:
        """The robot's clock was set back: how long it drove cannot be determined from it."""
        self._believed = self._doubted = self._there = None


def _drivable(before: _Claim, after: _Claim) -> bool:
    """Whether a robot can drive from one place to the other in the time on its own clock."""
    seconds = max(after.stamp_s - before.stamp_s, 0.0)
    return math.dist(before.position, after.position) <= NOISE_M + FASTEST_M_S * seconds


@dataclass(slots=True)
class PeerRate:
    """Lets what peers send move the vehicle, once in a while."""

    _every_s: float
    _moved_s: float = -math.inf  # when it did last, vehicle's clock

    def allows(self, now_s: float) -> bool:
        """Whether it may now."""
        return now_s >= self._moved_s + self._every_s

    def moved(self, now_s: float) -> None:
        """It did."""
        self._moved_s = now_s
