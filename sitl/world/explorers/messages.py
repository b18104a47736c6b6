"""The messages that exploring ground robots send each other, when, and how they read them.

Poses, paths and sightings are those of `air_router.messages`; topics are the paper's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from pydantic import BaseModel, ConfigDict

from air_router.messages import (
    PATH_TOPIC,
    POSE_TOPIC,
    GossipMessage,
    Latitude,
    Longitude,
    PathMessage,
    PoseMessage,
    SeenObject,
    SightingsMessage,
    Stamp,
)
from geo.frame import LocalFrame, Point
from sitl.world.explorers.knowledge import GoalClaim, Knowledge, Status

DEGREE_DIGITS: Final = 9
"""Decimals of degrees in messages, 0.1 mm: what follows differs from machine to machine."""

CLAIMS_TOPIC: Final = "/claimed_goals"
REACHABILITY_TOPIC: Final = "/reachability"
OBJECTS_TOPIC: Final = "/object_map"
POLICY_TOPIC: Final = "/policy"


class ClaimedGoal(BaseModel):
    """A goal that a robot is on its way to, or has visited."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    latitude_deg: Latitude
    longitude_deg: Longitude
    status: Status


class ClaimedGoalsMessage(GossipMessage):
    """All claims of a robot: the newest message has all of them, dropped ones are missing."""

    stamp_s: Stamp
    goals: tuple[ClaimedGoal, ...]


def degrees(frame: LocalFrame, place: Point) -> dict[str, float]:
    """Latitude and longitude of a place, as messages have them: the same on every machine."""
    latitude_deg, longitude_deg = frame.to_geodetic(place)
    return {
        "latitude_deg": round(latitude_deg, DEGREE_DIGITS),
        "longitude_deg": round(longitude_deg, DEGREE_DIGITS),
    }


FRESH_CELLS = 10
"""Reachability is sent when the robot itself has found so many cells that no map had shown."""

_POSE_S, _REACHABILITY_S = 1.0, 30.0  # between two messages at least

_TICK_S = 1e-3
"""Stamps of one topic grow by so much at least: a node orders messages by milliseconds."""


@dataclass(slots=True)
class ExplorerPost:
    """A robot's outbox: notes changes, and makes messages of them.

    Attributes:
        frame: The frame of the robot's positions; messages are in degrees.
        claims, way, objects, policy: Changes since the last call of `collect`; None: none.
    """

    frame: LocalFrame
    claims: list[GoalClaim] | None = None
    way: list[Point] | None = None
    objects: list[Point] | None = None
    policy: bytes | None = None
    _stamps: dict[str, float] = field(default_factory=dict)
    _sent_cells: int = 0

    def collect(
        self, now_s: float, position: Point, heading_deg: float, knowledge: Knowledge
    ) -> list[tuple[str, bytes]]:
        """The messages that are due: (topic, data), the most urgent first."""
        messages: list[tuple[str, bytes]] = []

        def add(topic: str, kind: Callable[..., GossipMessage], **content: Any) -> None:
            message = kind(stamp_s=self._stamp(topic, now_s), **content)
            messages.append((topic, message.encode()))

        def there(place: Point) -> dict[str, float]:
            return degrees(self.frame, place)

        if self._due(POSE_TOPIC, now_s, _POSE_S):
            add(POSE_TOPIC, PoseMessage, **there(position), heading_deg=round(heading_deg, 1))
        if self.claims is not None:
            goals = [ClaimedGoal(**there(c.place), status=c.status) for c in self.claims]
            add(CLAIMS_TOPIC, ClaimedGoalsMessage, goals=tuple(goals))
        if self.way is not None:
            add(PATH_TOPIC, PathMessage, points=tuple(tuple(there(p).values()) for p in self.way))
        if knowledge.newly_seen - self._sent_cells >= FRESH_CELLS and self._due(
            REACHABILITY_TOPIC, now_s, _REACHABILITY_S
        ):
            self._sent_cells = knowledge.newly_seen
            self._stamp(REACHABILITY_TOPIC, now_s)
            messages.append(
                (REACHABILITY_TOPIC, knowledge.observed_map(self.frame.origin).encode())
            )
        if self.objects is not None:
            objects = [SeenObject(kind="vehicle", **there(place)) for place in self.objects]
            add(OBJECTS_TOPIC, SightingsMessage, objects=tuple(objects))
        if self.policy is not None:
            self._stamp(POLICY_TOPIC, now_s)
            messages.append((POLICY_TOPIC, self.policy))
        self.claims = self.way = self.objects = self.policy = None
        return messages

    def _due(self, topic: str, now_s: float, interval_s: float) -> bool:
        return now_s >= self._stamps.get(topic, -math.inf) + interval_s

    def _stamp(self, topic: str, now_s: float) -> float:
        stamp_s = max(now_s, self._stamps.get(topic, -math.inf) + _TICK_S)
        self._stamps[topic] = stamp_s
        return stamp_s


def read_claims(data: bytes, frame: LocalFrame) -> tuple[float, Sequence[GoalClaim]]:
    """Another robot's claims and their stamp. Raises MessageError, FrameError."""
    message = ClaimedGoalsMessage.decode(data)
    claims = [
        GoalClaim(frame.to_local(goal.latitude_deg, goal.longitude_deg), goal.status)
        for goal in message.goals
    ]
    return message.stamp_s, claims


def read_sightings(data: bytes, frame: LocalFrame) -> list[Point]:
    """The positions of vehicles in a message. Raises MessageError, FrameError."""
    return [
        frame.to_local(seen.latitude_deg, seen.longitude_deg)
        for seen in SightingsMessage.decode(data).objects
        if seen.kind == "vehicle"
    ]
