"""Checks whether a robot can have driven to its reported position, before the vehicle follows.

A peer's pose redirects the vehicle. A robot with jumping localization, or a hostile peer, could
redirect it five times a second. So the vehicle follows no position that the robot cannot have
driven to since its last accepted pose, until the robot has stayed there for a while. Peers'
messages also redirect the vehicle only at intervals.
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
    """The verdict on a pose."""

    OLD = "no newer than the last pose"
    JUMPED = "the robot cannot have driven there"
    BACK = "accepted again after a jump"
    BELIEVED = "accepted"


class Jump(NamedTuple):
    """The distance of a jump of a robot's position, and its duration on the robot's clock."""

    metres: float
    seconds: float


class _Claim(NamedTuple):
    """A robot's reported position, with the time on its clock and on ours."""

    position: Point
    stamp_s: float
    now_s: float


@dataclass(slots=True)
class PoseCheck:
    """Checks the poses of one robot.

    Attributes:
        jump: The latest jump; None: there was none.
    """

    jump: Jump | None = None
    _accepted: _Claim | None = None  # the last accepted pose
    _rejected: _Claim | None = None  # the newest rejected pose since
    _there: _Claim | None = None  # first pose near the rejected one
    _stays_s: float = STAYS_S  # how long a rejected position has to last

    def verdict(self, position: Point, stamp_s: float, now_s: float) -> PoseVerdict:
        """Check a pose that is newer than all before.

        Args:
            position: East and north, meters.
            stamp_s: Seconds on the robot's clock.
            now_s: Time of reception, seconds on our clock.
        """
        claim = _Claim(position, stamp_s, now_s)
        believed, doubted = self._accepted, self._rejected
        if believed is None or _drivable(believed, claim):
            self._accepted, self._rejected, self._there = claim, None, None
            return PoseVerdict.BELIEVED
        self._rejected = claim
        if doubted is None or self._there is None or not _drivable(doubted, claim):
            self._there = claim
            self.jump = Jump(math.dist(believed.position, position), stamp_s - believed.stamp_s)
            return PoseVerdict.JUMPED
        lasts_s = min(stamp_s - self._there.stamp_s, now_s - self._there.now_s)
        if lasts_s < self._stays_s:
            return PoseVerdict.JUMPED
        self._stays_s = min(2.0 * self._stays_s, LONGEST_S)
        self._accepted, self._rejected, self._there = claim, None, None
        return PoseVerdict.BACK

    def set_back(self) -> None:
        """The robot's clock was set back: earlier poses cannot be compared."""
        self._accepted = self._rejected = self._there = None


def _drivable(before: _Claim, after: _Claim) -> bool:
    """Whether a robot can drive between two positions in the time on its own clock."""
    seconds = max(after.stamp_s - before.stamp_s, 0.0)
    return math.dist(before.position, after.position) <= NOISE_M + FASTEST_M_S * seconds


@dataclass(slots=True)
class PeerRate:
    """Limits how often peers' messages redirect the vehicle."""

    _every_s: float
    _moved_s: float = -math.inf  # last redirection, vehicle's clock

    def allows(self, now_s: float) -> bool:
        """Whether a message may redirect the vehicle now."""
        return now_s >= self._moved_s + self._every_s

    def moved(self, now_s: float) -> None:
        """It did."""
        self._moved_s = now_s
