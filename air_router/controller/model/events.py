"""Everything that reaches the controller beside the vehicle's and the links' own events."""

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
    """A robot's intended path arrived by gossip.

    Attributes:
        robot: Whose path.
        points: Metres east/north, at least one; the last is its destination.
        stamp_s: When the robot published it, in its own Unix seconds.
    """

    robot: str
    points: tuple[Point, ...]
    stamp_s: float


@dataclass(frozen=True, slots=True)
class RobotSought:
    """Another UAV published by gossip whom it seeks now.

    Attributes:
        by: The other UAV.
        robot: Whom it seeks; None: no robot.
        stamp_s: When it published this, in its own Unix seconds.
    """

    by: str
    robot: str | None
    stamp_s: float


@dataclass(frozen=True, slots=True)
class PeerFault:
    """A robot's messages are of no use to the mission, and the operator can change that."""

    words: str  # whose, and what is wrong


@dataclass(frozen=True, slots=True)
class CompanionLagged:
    """This program stood still, or did not get the processor: for so long, on its own clock."""

    lag_s: float


@dataclass(frozen=True, slots=True)
class CommandConfirmed:
    """The vehicle follows the command of this action."""

    action: Motion


@dataclass(frozen=True, slots=True)
class CommandFailed:
    """The vehicle did not follow an action."""

    action: Motion
    reason: str  # as text
    sent: bool = True  # False: it was objected to in its turn
    taken: FlightMode | None = None  # the vehicle is in this mode, which the action may not end


@dataclass(frozen=True, slots=True)
class AirspaceChanged:
    """Fences and zones are others from now on: the operator has drawn the mission's anew.

    With the altitude in doubt it is the same zones, which count whatever their height.

    Attributes:
        fences: All fences.
        zones: All zones, also those that do not apply to this flight.
    """

    fences: tuple[Shape, ...]
    zones: tuple[Zone, ...]


@dataclass(frozen=True, slots=True)
class PlanRenewed:
    """The plan with the changed fence is on board and read back; or not, and why."""

    why_not: str | None = None  # None: it is on board


@dataclass(frozen=True, slots=True)
class FlownBefore:
    """The flight was begun by another companion; this is what is known of it.

    Attributes:
        airborne_s: When the mission began in the air, on the vehicle's clock.
        visited: So many waypoints, in the operator's order, were visited or left out.
        left_out: Numbers of those that were left out.
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
