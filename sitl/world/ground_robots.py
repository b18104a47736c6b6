"""The ground robots of a world, on patrol or exploring: when they drive, publish and receive."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Final

from air_router.messages import (
    PATH_TOPIC,
    POSE_TOPIC,
    SIGHTINGS_TOPIC,
    PathMessage,
    PoseMessage,
    SeenObject,
    SightingsMessage,
)
from geo.frame import LocalFrame, Point
from sitl.world.explorers import GroundRobot
from sitl.world.ugv import PatrolRobot

POSE_INTERVAL_S: Final = 1.0
PATH_INTERVAL_S: Final = 10.0
SIGHTINGS_INTERVAL_S: Final = 5.0

EXPLORER_STEP_S: Final = 1.0
"""Exploring robots drive and think in steps of this, as in experiments."""


@dataclass(frozen=True, slots=True)
class Publication:
    """A message that a robot publishes."""

    robot: str
    topic: str
    data: bytes


class Every:
    """A timer of fixed intervals; late events are not made up for."""

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._next_s = -math.inf  # of the caller's clock; the first event is due

    def due(self, now_s: float) -> bool:
        """Whether it is time; a yes takes the turn."""
        if now_s < self._next_s:
            return False
        late = now_s >= self._next_s + self._interval_s
        self._next_s = (now_s if late else self._next_s) + self._interval_s
        return True


@dataclass(slots=True)
class PatrolUgv:
    """A robot on patrol, or one that a program plays; it makes nothing of messages."""

    robot: PatrolRobot
    frame: LocalFrame
    topics: Collection[str]
    pose: Every = field(default_factory=lambda: Every(POSE_INTERVAL_S))
    path: Every = field(default_factory=lambda: Every(PATH_INTERVAL_S))
    sightings: Every = field(default_factory=lambda: Every(SIGHTINGS_INTERVAL_S))
    sent_path: tuple[Point, ...] | None = None

    def drive(self, dt_s: float, unix_s: float) -> None:  # noqa: ARG002 - as an explorer
        """Drive for some simulated seconds."""
        self.robot.step(dt_s)

    def receive(self, robot: str, topic: str, data: bytes) -> None:
        """Nothing follows from it."""

    def publish(self, time_s: float, unix_s: float) -> list[Publication]:
        """The messages it publishes at a simulated time; they are stamped with Unix time."""
        robot, frame = self.robot, self.frame
        publications: list[Publication] = []
        if self.pose.due(time_s) and POSE_TOPIC in self.topics:
            here = frame.to_geodetic(robot.position)
            pose = PoseMessage(
                stamp_s=unix_s,
                latitude_deg=here.latitude_deg,
                longitude_deg=here.longitude_deg,
                heading_deg=robot.heading_deg,
            )
            publications.append(Publication(robot.name, POSE_TOPIC, pose.encode()))
        path_due = self.path.due(time_s)
        if (path_due or robot.path != self.sent_path) and PATH_TOPIC in self.topics:
            self.sent_path = robot.path
            path = PathMessage(stamp_s=unix_s, points=tuple(map(frame.to_geodetic, robot.path)))
            publications.append(Publication(robot.name, PATH_TOPIC, path.encode()))
        if self.sightings.due(time_s) and SIGHTINGS_TOPIC in self.topics:
            seen = map(frame.to_geodetic, robot.sightings)
            objects = tuple(SeenObject(kind="vehicle", **place._asdict()) for place in seen)
            sightings = SightingsMessage(stamp_s=unix_s, objects=objects)
            publications.append(Publication(robot.name, SIGHTINGS_TOPIC, sightings.encode()))
        return publications


@dataclass(slots=True)
class ExplorerUgv:
    """A robot that explores a town; its clock is Unix time, which its messages have."""

    robot: GroundRobot
    topics: Collection[str]
    turn: Every = field(default_factory=lambda: Every(EXPLORER_STEP_S))
    now_s: float = 0.0  # Unix, of its last step

    def drive(self, dt_s: float, unix_s: float) -> None:  # noqa: ARG002 - as on patrol
        """Drive and think up to a Unix time."""
        if self.turn.due(unix_s):
            self.now_s = unix_s
            self.robot.step(unix_s)

    def receive(self, robot: str, topic: str, data: bytes) -> None:
        """A message of another robot has arrived. Raises MessageError, GridError, FrameError."""
        self.robot.take(robot, topic, data, self.now_s)

    def publish(self, time_s: float, unix_s: float) -> list[Publication]:  # noqa: ARG002 - as on patrol
        """What it publishes; nothing before it has set off."""
        publications = self.robot.outbox()
        return [
            Publication(self.robot.name, *each) for each in publications if each[0] in self.topics
        ]


Ugv = PatrolUgv | ExplorerUgv
"""A ground robot, and when it drives, publishes and receives."""
