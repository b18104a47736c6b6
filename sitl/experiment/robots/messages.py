"""What exploring ground robots tell each other, when, and how they read it.

Poses, paths and sightings are those of `air_router.messages`; topics are the paper's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

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
from sitl.experiment.robots.knowledge import MOST_GOALS, Claim, Knowledge, Status

DEGREE_DIGITS: Final = 9
"""Decimals of degrees in messages, 0.1 mm: what follows differs from machine to machine."""

CLAIMS_TOPIC: Final = "/claimed_goals"
REACHABILITY_TOPIC: Final = "/reachability"
OBJECTS_TOPIC: Final = "/object_map"


class ClaimedGoal(BaseModel):
    """A goal that a robot is on its way to, or has visited."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    latitude_deg: Latitude
    longitude_deg: Longitude
    status: Literal["in_progress", "visited"]


class ClaimedGoalsMessage(GossipMessage):
    """All claims of a robot: the newest message says it all; what is missing was given up."""

    stamp_s: Stamp
    goals: Annotated[tuple[ClaimedGoal, ...], Field(max_length=MOST_GOALS)]


def degrees(frame: LocalFrame, place: Point) -> tuple[float, float]:
    """Latitude and longitude of a place: the same on every machine."""
    latitude_deg, longitude_deg = frame.to_geodetic(place)
    return round(latitude_deg, DEGREE_DIGITS), round(longitude_deg, DEGREE_DIGITS)


FRESH_CELLS = 10
"""Reachability is told when the robot's eyes have found so many cells that no map had shown."""

_TICK_S = 1e-3
"""Stamps of one topic grow by so much at least: a node tells news apart by milliseconds."""


@dataclass(slots=True)
class ExplorerPost:
    """What a robot says: notes what there is to tell, and makes messages of it.

    Attributes:
        frame: The frame of the robot's positions; messages are in degrees.
        pose_interval_s: It tells its pose so often.
        reachability_interval_s: It tells so often at most what its eyes have found.
        claims, way, objects: News since the last call of `collect`; None: none.
    """

    frame: LocalFrame
    pose_interval_s: float
    reachability_interval_s: float
    claims: list[Claim] | None = None
    way: list[Point] | None = None
    objects: list[Point] | None = None
    _stamps: dict[str, float] = field(default_factory=dict)
    _told_cells: int = 0

    def collect(
        self, now_s: float, position: Point, heading_deg: float, knowledge: Knowledge
    ) -> list[tuple[str, bytes]]:
        """The messages that are due: (topic, data), the most urgent first."""
        messages = []
        if self._due(POSE_TOPIC, now_s, self.pose_interval_s):
            latitude_deg, longitude_deg = degrees(self.frame, position)
            pose = PoseMessage(
                stamp_s=self._stamp(POSE_TOPIC, now_s),
                latitude_deg=latitude_deg,
                longitude_deg=longitude_deg,
                heading_deg=round(heading_deg, 1),
            )
            messages.append((POSE_TOPIC, pose.encode()))
        if self.claims is not None:
            messages.append((CLAIMS_TOPIC, self._claims(now_s, self.claims)))
        if self.way is not None:
            stamp_s = self._stamp(PATH_TOPIC, now_s)
            points = tuple(degrees(self.frame, place) for place in self.way)
            path = PathMessage(stamp_s=stamp_s, points=points)
            messages.append((PATH_TOPIC, path.encode()))
        if knowledge.first_seen - self._told_cells >= FRESH_CELLS and self._due(
            REACHABILITY_TOPIC, now_s, self.reachability_interval_s
        ):
            self._told_cells = knowledge.first_seen
            self._stamp(REACHABILITY_TOPIC, now_s)
            seen = knowledge.seen_map(self.frame.origin)
            messages.append((REACHABILITY_TOPIC, seen.encode()))
        if self.objects is not None:
            stamp_s = self._stamp(OBJECTS_TOPIC, now_s)
            messages.append((OBJECTS_TOPIC, sightings(self.frame, stamp_s, self.objects)))
        self.claims = self.way = self.objects = None
        return messages

    def _claims(self, now_s: float, claims: list[Claim]) -> bytes:
        goals = tuple(
            ClaimedGoal(
                latitude_deg=latitude_deg, longitude_deg=longitude_deg, status=claim.status.value
            )
            for claim in claims
            for latitude_deg, longitude_deg in [degrees(self.frame, claim.place)]
        )
        stamp_s = self._stamp(CLAIMS_TOPIC, now_s)
        return ClaimedGoalsMessage(stamp_s=stamp_s, goals=goals).encode()

    def _due(self, topic: str, now_s: float, interval_s: float) -> bool:
        return now_s >= self._stamps.get(topic, -math.inf) + interval_s

    def _stamp(self, topic: str, now_s: float) -> float:
        stamp_s = max(now_s, self._stamps.get(topic, -math.inf) + _TICK_S)
        self._stamps[topic] = stamp_s
        return stamp_s


def read_claims(data: bytes, frame: LocalFrame) -> tuple[float, list[Claim]]:
    """Another robot's claims and their stamp. Raises MessageError, FrameError."""
    message = ClaimedGoalsMessage.decode(data)
    claims = [
        Claim(frame.to_local(goal.latitude_deg, goal.longitude_deg), Status(goal.status))
        for goal in message.goals
    ]
    return message.stamp_s, claims


def read_sightings(data: bytes, frame: LocalFrame) -> list[Point]:
    """Where a message says that vehicles are. Raises MessageError, FrameError."""
    return [
        frame.to_local(seen.latitude_deg, seen.longitude_deg)
        for seen in SightingsMessage.decode(data).objects
        if seen.kind == "vehicle"
    ]


def sightings(frame: LocalFrame, stamp_s: float, places: Iterable[Point]) -> bytes:
    """A message on OBJECTS_TOPIC: vehicles are at these places."""
    objects = tuple(
        SeenObject(kind="vehicle", latitude_deg=latitude_deg, longitude_deg=longitude_deg)
        for latitude_deg, longitude_deg in (degrees(frame, place) for place in places)
    )
    return SightingsMessage(stamp_s=stamp_s, objects=objects).encode()
