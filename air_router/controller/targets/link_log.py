"""Measured links of this flight: from where to where a robot's radio was received, or was not."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

from air_router.controller.targets.limits import (
    LINK_INTERVAL_S,
    LINK_POSE_S,
    MOST_LINK_SAMPLES,
)
from air_router.controller.targets.target_list import TargetList
from geo.frame import Point


@dataclass(frozen=True, slots=True)
class LinkSample:
    """Whether a robot's radio was received at a time, and where both were.

    Attributes:
        robot: Its name.
        time_s: On the vehicle's clock.
        here: Where the vehicle was.
        altitude_m: How high it was above home.
        place: Where the robot was, by a pose not older than `LINK_POSE_S` and the path that it
            published.
        linked: Its radio was received.
    """

    robot: str
    time_s: float
    here: Point
    altitude_m: float
    place: Point
    linked: bool


@dataclass(slots=True, eq=False)
class LinkLog:
    """Takes a sample of each robot whose position is known, every `LINK_INTERVAL_S`."""

    _samples: deque[LinkSample] = field(default_factory=partial(deque, maxlen=MOST_LINK_SAMPLES))
    _linked: set[str] = field(default_factory=set)  # robots whose radio is received now
    _next_s: float = -math.inf  # of the next samples, vehicle's clock

    @property
    def samples(self) -> Sequence[LinkSample]:
        """The latest, oldest first."""
        return self._samples

    def contact(self, robot: str, *, linked: bool) -> None:
        """A robot's radio is received from now on, or no longer."""
        if linked:
            self._linked.add(robot)
        else:
            self._linked.discard(robot)

    def update(self, here: Point, altitude_m: float, targets: TargetList, now_s: float) -> None:
        """The vehicle is there."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + LINK_INTERVAL_S
        for robot in targets.names:
            track = targets.tracks[robot]
            if track.pose is None or now_s - track.ours_s(track.pose.stamp_s) > LINK_POSE_S:
                continue
            course = targets.course(robot)
            if course is not None:
                place = course.place(course.along_m(now_s))
                linked = robot in self._linked
                sample = LinkSample(robot, now_s, here, altitude_m, place, linked)
                self._samples.append(sample)
