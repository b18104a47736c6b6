"""Everything that the controller can ask for. Data only: the flight shell carries it out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from air_router.behaviour import Signal, State
from geo.frame import Point


@dataclass(frozen=True, slots=True)
class FlyToNode:
    """Jump to a node of the plan: a straight leg in Mission mode, checked before it was asked."""

    node: int
    position: Point


@dataclass(frozen=True, slots=True)
class FlyToPoint:
    """Fly a checked straight leg to a point and hover there, at an altitude above home."""

    position: Point
    altitude_m: float


@dataclass(frozen=True, slots=True)
class HoldHere:
    """Stop and hover."""

    why: str


@dataclass(frozen=True, slots=True)
class LandHere:
    """Descend and touch down here."""


Motion = FlyToNode | FlyToPoint | HoldHere | LandHere


@dataclass(frozen=True, slots=True)
class PublishMap:
    """Put the newest map into the gossip database now: somebody is about to fetch it."""


@dataclass(frozen=True, slots=True)
class Announce:
    """Say something to the pilot and the operator."""

    text: str


@dataclass(frozen=True, slots=True)
class StateChanged:
    """The mission entered another state; for logs and displays."""

    source: State
    signal: Signal
    target: State
    robot: str | None


class Taker(Enum):
    """Who else may have the vehicle."""

    PILOT = "the pilot"
    FAILSAFE = "an autopilot failsafe"


@dataclass(frozen=True, slots=True)
class Finish:
    """The flight is over: landed by us, or by whoever took the vehicle over (None: nobody did)."""

    landed_by_us: bool
    why: str
    taken_by: Taker | None = None


Action = Motion | PublishMap | Announce | StateChanged | Finish
