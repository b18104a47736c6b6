"""Everything that reaches the controller, beside the vehicle's and the links' own events."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from air_router.actions import Motion
from air_router.vehicle import VehicleEvent
from geo.frame import Point
from mocha_link.metrics import LinkEvent


@dataclass(frozen=True, slots=True)
class RobotPose:
    """A robot's pose arrived by gossip.

    Attributes:
        robot: Whose pose.
        position: Metres east/north.
        stamp_s: When the robot was there, in its own Unix seconds.
        peer: Who handed it to us: the robot itself, or one that carried it.
    """

    robot: str
    position: Point
    stamp_s: float
    peer: str


@dataclass(frozen=True, slots=True)
class RobotPath:
    """A robot's intended path arrived by gossip; only its end matters for seeking it."""

    robot: str
    destination: Point
    stamp_s: float


class Request(Enum):
    """What the operator can ask for."""

    COME_HOME = "come home"
    RESUME = "go on with the mission"


@dataclass(frozen=True, slots=True)
class CommandConfirmed:
    """The vehicle does what this action asked of it."""

    action: Motion


@dataclass(frozen=True, slots=True)
class CommandFailed:
    """The vehicle did not follow an action."""

    action: Motion
    reason: str


Event = (
    VehicleEvent | LinkEvent | RobotPose | RobotPath | Request | CommandConfirmed | CommandFailed
)
