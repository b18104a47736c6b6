"""The controller's events, in addition to those of the vehicle and the links."""

from __future__ import annotations

from dataclasses import dataclass

from air_router.controller.model.actions import Motion
from air_router.controller.model.requests import AnyRequest
from air_router.vehicle import FlightMode, VehicleEvent
from geo.airspace import Shape, Zone
from geo.frame import Point
from mocha_link.links import LinkEvent


@dataclass(frozen=True, slots=True)
class RobotPose:
    """A robot's pose was received by gossip.

    Attributes:
        robot: Name of the robot.
        position: Meters east/north.
        stamp_s: Time of the pose, in the robot's Unix seconds.
        peer: The sender: the robot itself, or a peer that carried the message.
    """

    robot: str
    position: Point
    stamp_s: float
    peer: str


@dataclass(frozen=True, slots=True)
class RobotPath:
    """A robot's planned path was received by gossip.

    Attributes:
        robot: Name of the robot.
        points: Meters east/north, at least one; the last is the destination.
        stamp_s: Time of publication, in the robot's Unix seconds.
    """

    robot: str
    points: tuple[Point, ...]
    stamp_s: float


@dataclass(frozen=True, slots=True)
class RobotSought:
    """Another UAV published which robot it seeks.

    Attributes:
        by: The other UAV.
        robot: The robot it seeks; None: none.
        stamp_s: Time of publication, in that UAV's Unix seconds.
    """

    by: str
    robot: str | None
    stamp_s: float


@dataclass(frozen=True, slots=True)
class PeerFault:
    """A robot's messages cannot be used, and the operator can fix that."""

    words: str  # the robot, and the fault


@dataclass(frozen=True, slots=True)
class CompanionLagged:
    """This program stalled, or did not get the processor, for this time on its own clock.

    Attributes:
        lag_s: For how long.
        within_s: `lag_s` is the sum of shorter lags within this time; None: it is one stall.
    """

    lag_s: float
    within_s: float | None = None


@dataclass(frozen=True, slots=True)
class CommandConfirmed:
    """The vehicle follows this command."""

    action: Motion


@dataclass(frozen=True, slots=True)
class CommandFailed:
    """The vehicle did not follow a command."""

    action: Motion
    reason: str  # as text
    sent: bool = True  # False: refused right before it was due
    taken: FlightMode | None = None  # a mode that the command may not end


@dataclass(frozen=True, slots=True)
class AirspaceChanged:
    """The fences and zones have changed: the operator has edited the mission.

    With the altitude in doubt the zones are the same, but apply at every altitude.

    Attributes:
        fences: All fences.
        zones: All zones, also those that do not apply to this flight.
    """

    fences: tuple[Shape, ...]
    zones: tuple[Zone, ...]


@dataclass(frozen=True, slots=True)
class PlanRenewed:
    """The plan with the changed fence is on board and read back, or the upload failed."""

    why_not: str | None = None  # None: it is on board


@dataclass(frozen=True, slots=True)
class FlownBefore:
    """Progress of a flight that another companion began.

    Attributes:
        airborne_s: When the mission began in the air, on the vehicle's clock.
        visited: Number of waypoints, in the operator's order, that were visited or left out.
        left_out: Numbers of the waypoints left out.
    """

    airborne_s: float
    visited: int = 0
    left_out: tuple[int, ...] = ()


Event = (
    VehicleEvent
    | LinkEvent
    | RobotPose
    | RobotPath
    | RobotSought
    | PeerFault
    | CompanionLagged
    | AnyRequest
    | AirspaceChanged
    | PlanRenewed
    | FlownBefore
    | CommandConfirmed
    | CommandFailed
)
