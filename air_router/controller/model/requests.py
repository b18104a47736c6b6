"""Requests of the operator, other programs and a base station to a mission in flight.

Each is answered with `actions.CommandAck`: accepted, or refused with the reason.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from air_router.controller.model.actions import Refusal
from air_router.errors import AirRouterError
from geo.frame import Point

OPERATOR: Final = "the operator"


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlRequest:
    """A request of the pilot, the operator or a program.

    Attributes:
        request_id: Id that the answer repeats.
        by: The requester, as text.
    """

    request_id: str = ""
    by: str = OPERATOR


@dataclass(frozen=True, slots=True)
class HoldNow(ControlRequest):
    """Stop and hover here until the next request, or until the vehicle has to come home."""


@dataclass(frozen=True, slots=True)
class GoOn(ControlRequest):
    """Resume what was held, or a flight that was released.

    Attributes:
        upload: Upload this mission's plan first; another one may be on board.
    """

    upload: bool = False


@dataclass(frozen=True, slots=True)
class SeekNow(ControlRequest):
    """Seek this robot next, at once."""

    robot: str


@dataclass(frozen=True, slots=True)
class ExploreNow(ControlRequest):
    """Resume exploration."""


@dataclass(frozen=True, slots=True)
class ComeHome(ControlRequest):
    """End the mission: fly home along the graph, and land."""


@dataclass(frozen=True, slots=True)
class LandNow(ControlRequest):
    """End the mission: land in place, on whatever is below."""


@dataclass(frozen=True, slots=True)
class GoTo(ControlRequest):
    """Fly to points in order, and hover at the last.

    Attributes:
        points: Meters east/north, in order; at least one.
        hold_s: How long to hover at the last; None: the mission's time.
        waits: Before take-off and while the vehicle holds, the request is deferred instead of
            refused: no operator is there to repeat it.
        waits_s: Longest deferral, on the vehicle's clock.
    """

    points: tuple[Point, ...]
    hold_s: float | None = None
    waits: bool = False
    waits_s: float = math.inf


@dataclass(frozen=True, slots=True)
class ChangeAltitude(ControlRequest):
    """Climb or descend in place, and hold there.

    Attributes:
        altitude_m: Altitude above home.
    """

    altitude_m: float


@dataclass(frozen=True, slots=True)
class Reload(ControlRequest):
    """Read the mission file again, because its zones or fences have changed."""


AnyRequest = (
    HoldNow | GoOn | SeekNow | ExploreNow | ComeHome | LandNow | GoTo | ChangeAltitude | Reload
)


class RequestRefusedError(AirRouterError):
    """A request is refused; the message is for people.

    Args:
        code: The reason, for programs; see docs/errors.md.
        why: The message.
    """

    def __init__(self, code: Refusal, why: str) -> None:
        super().__init__(why)
        self.code = code
