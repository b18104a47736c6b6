"""The controller's actions: data only, carried out by the flight loop."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Self

from air_router.controller.model.states import Signal, State
from air_router.vehicle import Severity
from geo.frame import Point


@dataclass(frozen=True, slots=True)
class FlyToNode:
    """Jump to a plan item: a straight, checked leg in Mission mode."""

    node: int  # 0: home
    position: Point  # of that node


@dataclass(frozen=True, slots=True)
class FlyToPoint:
    """Fly a checked straight leg to a point and hover there, at an altitude above home."""

    position: Point
    altitude_m: float


@dataclass(frozen=True, slots=True)
class HoldHere:
    """Stop and hover."""

    why: str  # as text, for records


@dataclass(frozen=True, slots=True)
class LandHere:
    """Descend and touch down here."""


Motion = FlyToNode | FlyToPoint | HoldHere | LandHere


@dataclass(frozen=True, slots=True)
class PublishMap:
    """Publish the newest map now: a peer is about to fetch it."""


@dataclass(frozen=True, slots=True)
class Seeking:
    """Publish to the team which robot this UAV seeks or hovers over from now on."""

    robot: str | None  # None: no robot


@dataclass(frozen=True, slots=True)
class ReadAgain:
    """Read the mission file again, and report its changes."""


@dataclass(frozen=True, slots=True)
class RenewPlan:
    """Upload the mission with the current fence, and report when it is on board."""


@dataclass(frozen=True, slots=True)
class ReplanAirspace:
    """Make a router for the zones that apply now, and report an `AirspaceChanged`."""


@dataclass(frozen=True, slots=True)
class Announce:
    """An announcement to the pilot and the operator.

    Attributes:
        text: What happened, as text.
        severity: The severity.
        instruction: Action of the pilot or the operator; every warning and alarm has one.
        about: The subject of an announcement that repeats until it is over; empty: announced once.
    """

    text: str
    severity: Severity = Severity.INFO
    instruction: str = ""
    about: str = ""

    @property
    def words(self) -> str:
        """The text, followed by the instruction as its own sentence."""
        return f"{self.text}. {self.instruction}" if self.instruction else self.text


@dataclass(frozen=True, slots=True)
class StateChanged:
    """The mission entered another state; for logs and displays."""

    source: State  # the state before
    signal: Signal
    target: State
    robot: str | None  # sought or hovered over


@dataclass(frozen=True, slots=True)
class MissionWaits:
    """The interlock that blocks the mission; recorded when it changes.

    `FlightStatus` has the current one.

    Attributes:
        interlock: The deciding row of `INTERLOCKS`; None: the mission is not blocked.
        why: The reason, as precisely as it is known.
        since_s: Since when it blocks, vehicle's clock.
    """

    interlock: str | None
    why: str = ""
    since_s: float = 0.0


class Refusal(StrEnum):
    """Why a request is refused, as a code for programs."""

    NOT_FLYING = "not-flying"
    FLIGHT_OVER = "flight-over"
    NOT_OURS = "not-ours"
    OTHER_PLAN = "other-plan"
    HANDS_OFF = "hands-off"
    COMING_HOME = "coming-home"
    NO_FIX = "no-fix"
    NOT_HEARD = "not-heard"
    NO_WAY = "no-way"
    OUTSIDE_FENCE = "outside-fence"
    ALTITUDE = "altitude"
    RESERVE = "battery-reserve"
    UNKNOWN_ROBOT = "unknown-robot"
    ONLY_SEARCHES = "only-searches"
    NOTHING_TO_DO = "nothing-to-do"
    REPLACED = "replaced-by-newer"
    TOO_LATE = "too-late"
    BUSY = "busy"
    NOT_READ = "not-read"


@dataclass(frozen=True, slots=True)
class CommandAck:
    """The answer to a request: accepted, or refused with the reason.

    Attributes:
        request_id: Id of the request; `by`: the requester.
        accepted: Whether it is carried out.
        why: What the vehicle does, or why the request is refused, for people.
        code: The reason, for programs; None if accepted.
        points: Where the vehicle will hover after a go-to, meters east/north.
    """

    request_id: str
    by: str
    accepted: bool
    why: str
    code: Refusal | None = None
    points: tuple[Point, ...] = ()

    @classmethod
    def replaced(cls, request_id: str, by: str) -> Self:
        """The answer to goals that wait, and that newer ones replace."""
        return cls(request_id, by, False, "replaced by a newer request", Refusal.REPLACED)


class ControlHolder(Enum):
    """Who else may command the vehicle."""

    PILOT = "the pilot"
    FAILSAFE = "an autopilot failsafe"


@dataclass(frozen=True, slots=True)
class Finish:
    """The flight is over: landed by this program, the pilot or a failsafe."""

    landed_by_us: bool  # after LAND
    why: str  # as text
    taken_by: ControlHolder | None = None  # None: the vehicle stayed ours
    refused: bool = False  # stopped at take-off, without having flown


Action = (
    Motion
    | PublishMap
    | Seeking
    | ReadAgain
    | RenewPlan
    | ReplanAirspace
    | Announce
    | StateChanged
    | MissionWaits
    | CommandAck
    | Finish
)
