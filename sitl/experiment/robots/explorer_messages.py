"""What exploring ground robots tell each other, besides poses, paths and sightings.

Topics and priorities are the paper's: pose, claimed goals and the base station's target goals are
of high priority, the path of medium, reachability of low, the map of objects of none.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from air_router.messages import (
    MAP_TOPIC,
    PATH_TOPIC,
    POSE_TOPIC,
    GossipMessage,
    Latitude,
    Longitude,
    Stamp,
)
from geo.frame import LocalFrame, Point
from sitl.experiment.robots.goal_book import MOST_GOALS

DEGREE_DIGITS: Final = 9
"""Decimals of degrees in messages, 0.1 mm: what follows differs from machine to machine."""

CLAIMS_TOPIC: Final = "/claimed_goals"
REACHABILITY_TOPIC: Final = "/reachability"
OBJECTS_TOPIC: Final = "/object_map"
TARGETS_TOPIC: Final = "/target_goals"

GROUND_TOPICS: Final = (
    {"name": POSE_TOPIC, "type": "json/Pose", "priority": "high", "min_interval_s": 1},
    {"name": CLAIMS_TOPIC, "type": "json/ClaimedGoals", "priority": "high"},
    {"name": PATH_TOPIC, "type": "json/Path", "priority": "medium"},
    {"name": REACHABILITY_TOPIC, "type": "grid/SemanticMap", "priority": "low"},
    {"name": OBJECTS_TOPIC, "type": "json/Sightings", "priority": "none"},
)
"""The topics of a ground robot, as a team file lists them."""

AERIAL_TOPICS: Final = (
    {"name": MAP_TOPIC, "type": "grid/SemanticMap", "priority": "high", "min_interval_s": 5},
    {"name": POSE_TOPIC, "type": "json/Pose", "priority": "none", "min_interval_s": 1},
)
"""The topics of a UAV."""

BASE_TOPICS: Final = ({"name": TARGETS_TOPIC, "type": "json/TargetGoals", "priority": "high"},)
"""The topics of a base station."""


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


class TargetGoalsMessage(GossipMessage):
    """Goals that the base station gives: (latitude, longitude) in degrees."""

    stamp_s: Stamp
    goals: Annotated[tuple[tuple[Latitude, Longitude], ...], Field(max_length=MOST_GOALS)]


def degrees(frame: LocalFrame, place: Point) -> tuple[float, float]:
    """Latitude and longitude of a place: the same on every machine."""
    latitude_deg, longitude_deg = frame.to_geodetic(place)
    return round(latitude_deg, DEGREE_DIGITS), round(longitude_deg, DEGREE_DIGITS)
