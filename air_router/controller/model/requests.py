"""Requests of the operator, other programs and a base station to a mission in flight.

Each is answered with `actions.CommandAck`: accepted, or refused and why.
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
        request_id: By which the asking program knows the answer.
        by: The requester, as text.
    """

    request_id: str = ""
    by: str = OPERATOR


@dataclass(frozen=True, slots=True)
class HoldNow(ControlRequest):
    """Stop and hover here until something else is requested, or it has to come home."""


@dataclass(frozen=True, slots=True)
class GoOn(ControlRequest):
    """Go on with what was held, or with a flight that was given away.

    Attributes:
        upload: Another plan may be on board: put ours there first.
    """

    upload: bool = False


@dataclass(frozen=True, slots=True)
class SeekNow(ControlRequest):
    """Seek this robot next, at once."""

    robot: str


@dataclass(frozen=True, slots=True)
class ExploreNow(ControlRequest):
    """Explore on where exploration stopped."""


@dataclass(frozen=True, slots=True)
class ComeHome(ControlRequest):
    """End the mission: home along the graph, and land."""


@dataclass(frozen=True, slots=True)
class LandNow(ControlRequest):
    """End the mission: land where it hovers, on whatever is below."""


@dataclass(frozen=True, slots=True)
class GoTo(ControlRequest):
    """Fly to points, one after the other, and hover at the last.

    Attributes:
        points: Metres east/north, in order; at least one.
        hold_s: How long to hover at the last; None: as set in the mission.
        waits: Before take-off, and while the vehicle holds, it waits for its time instead of being
            refused: no operator is there to repeat it.
        waits_s: So long at most, on the vehicle's clock.
    """

    points: tuple[Point, ...]
    hold_s: float | None = None
    waits: bool = False
    waits_s: float = math.inf


@dataclass(frozen=True, slots=True)
class ChangeAltitude(ControlRequest):
    """Climb or descend where it holds, and hold there.

    Attributes:
        altitude_m: Above home.
    """

    altitude_m: float


@dataclass(frozen=True, slots=True)
class Reload(ControlRequest):
    """Read the mission file again: its zones and fences have changed."""


AnyRequest = (
    HoldNow | GoOn | SeekNow | ExploreNow | ComeHome | LandNow | GoTo | ChangeAltitude | Reload
)


class RequestRefusedError(AirRouterError):
    """A request is not done; the message is a sentence for people.

    Args:
        code: The reason, for programs; see docs/errors.md.
        why: The message.
    """

    def __init__(self, code: Refusal, why: str) -> None:
        super().__init__(why)
        self.code = code
