"""Everything that the controller can request. Data only: the flight shell carries it out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum

from air_router.controller.model.states import Signal, State
from air_router.vehicle import Severity
from geo.frame import Point


@dataclass(frozen=True, slots=True)
class FlyToNode:
    """Jump to a plan item: a straight leg in Mission mode, checked before it was commanded."""

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
    """Put the newest map into the gossip database now: a peer is about to fetch it."""


@dataclass(frozen=True, slots=True)
class Seeking:
    """Inform the team whom this UAV seeks, or hovers over, from now on; None: no robot."""

    robot: str | None  # None: no robot


@dataclass(frozen=True, slots=True)
class ReadAgain:
    """Read the mission file again, and report its changes."""


@dataclass(frozen=True, slots=True)
class RenewPlan:
    """Upload the mission with the fence as it is now, and report when it is on board."""


@dataclass(frozen=True, slots=True)
class ReplanAirspace:
    """Plan among the same zones as they count now, and report an `AirspaceChanged`."""


@dataclass(frozen=True, slots=True)
class Announce:
    """An announcement to the pilot and the operator.

    Attributes:
        text: What happened, as text.
        severity: The severity.
        instruction: What the pilot or the operator does about it; every warning and alarm has one.
        about: What goes on, for those that are repeated and end; empty: it is announced once.
    """

    text: str
    severity: Severity = Severity.INFO
    instruction: str = ""
    about: str = ""

    @property
    def words(self) -> str:
        """The text and, as a sentence of its own, the instruction."""
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
    """What keeps the mission from what it wants: an action once that has changed.

    `FlightStatus` shows the same as of now.

    Attributes:
        interlock: The row of `INTERLOCKS` that decides; None: the mission goes on.
        why: In words, as precisely as is known then.
        since_s: When it began to wait for that, vehicle's clock.
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
    """A request was made: whether it is done, and what, or why not.

    Attributes:
        request_id: The request's; `by`: the requester.
        accepted: Whether it is done.
        why: A sentence for people.
        code: The reason, for programs; None if accepted.
        points: Where the vehicle will hover, metres east/north, if it was sent to points.
    """

    request_id: str
    by: str
    accepted: bool
    why: str
    code: Refusal | None = None
    points: tuple[Point, ...] = ()


class ControlHolder(Enum):
    """Who else may have the vehicle."""

    PILOT = "the pilot"
    FAILSAFE = "an autopilot failsafe"


@dataclass(frozen=True, slots=True)
class Finish:
    """The flight is over: landed by us, or by the one that took over (None: neither)."""

    landed_by_us: bool  # after LAND, commanded by us
    why: str  # as text
    taken_by: ControlHolder | None = None  # None: the vehicle stayed ours
    refused: bool = False  # it was stopped as it took off, and has not flown


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
