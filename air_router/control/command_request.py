"""What the operator and programs may request of a flight: one tagged union.

A request comes as JSON (page, socket, ROS 2) or in words (terminal, `air-router ask`), with places
in degrees, and is never trusted. Its model says what it has to look like; docs/control.md describes
it, and docs/schemas/flight-request.json is its JSON schema. The controller decides on it.
"""

import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Final, Literal, Protocol, get_args

from pydantic import Field, TypeAdapter, ValidationError

from air_router.controller.model import (
    OPERATOR,
    AnyRequest,
    ChangeAltitude,
    ComeHome,
    ExploreNow,
    GoOn,
    GoTo,
    HoldNow,
    LandNow,
    Reload,
    SeekNow,
)
from air_router.messages import MOST_POINTS
from air_router.vehicle import loop_s
from geo.frame import FrameError, LocalFrame
from mocha_link.errors import RequestError
from mocha_link.sanitize import sanitize
from mocha_link.service import Request
from mocha_link.team import request_error_text

MAX_BYTES: Final = 64 * 1024

Latitude = Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
Longitude = Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]

_NO_ARGUMENTS: Final = "'{verb}' stands alone"


class CommandRequest(Request):
    """What every request has.

    Attributes:
        by: Who requests it, for the record and the pilot.
    """

    by: Annotated[str, Field(max_length=60)] | None = None

    def for_mission(self, frame: LocalFrame, by: str = OPERATOR) -> AnyRequest | None:
        """The request in the mission's metres; None for one that only reads the flight's state.

        Args:
            frame: The mission's.
            by: Who requests it, if the request does not say.

        Raises:
            RequestError: a place is out of the frame's reach.
        """
        del frame, by
        return None

    @classmethod
    def fields_of(cls, words: str) -> dict[str, Any]:
        """The fields that an operator typed behind the verb. Raises RequestError."""
        if words:
            raise RequestError(_NO_ARGUMENTS.format(verb=cls.verb()))
        return {}

    @classmethod
    def verb(cls) -> str:
        """The name of the request."""
        [verb] = get_args(cls.model_fields["request"].annotation)
        return str(verb)

    def requester(self, by: str) -> str:
        """Who requests it, in letters that a terminal shows."""
        return (sanitize(self.by).strip() if self.by else "") or by


class _Plain(CommandRequest):
    """A request with no fields of its own."""

    made: ClassVar[Callable[..., AnyRequest]]  # the controller's request

    def for_mission(self, frame: LocalFrame, by: str = OPERATOR) -> AnyRequest:
        """As the base class."""
        del frame
        return type(self).made(by=self.requester(by))


class Hold(_Plain):
    """Stop and hover."""

    request: Literal["hold"]
    made = HoldNow


class Resume(CommandRequest):
    """Continue what was held, or take the flight back from the pilot.

    Attributes:
        upload: Put this mission's plan on board first.
    """

    request: Literal["resume"]
    upload: bool = False

    def for_mission(self, frame: LocalFrame, by: str = OPERATOR) -> GoOn:
        """As the base class."""
        del frame
        return GoOn(self.upload, by=self.requester(by))

    @classmethod
    def fields_of(cls, words: str) -> dict[str, Any]:
        """`upload`, or nothing."""
        return {"upload": True} if words.lower() == "upload" else super().fields_of(words)


class Seek(CommandRequest):
    """Seek a robot next, at once."""

    request: Literal["seek"]
    robot: Annotated[str, Field(min_length=1, max_length=255)]

    def for_mission(self, frame: LocalFrame, by: str = OPERATOR) -> SeekNow:
        """As the base class."""
        del frame
        return SeekNow(sanitize(self.robot), by=self.requester(by))

    @classmethod
    def fields_of(cls, words: str) -> dict[str, Any]:
        """The robot's name."""
        if not words:
            raise RequestError("seek whom? type 'seek NAME'")
        return {"robot": words}


class Explore(_Plain):
    """Resume exploration."""

    request: Literal["explore"]
    made = ExploreNow


class Home(_Plain):
    """End the mission: home along the graph, and land."""

    request: Literal["home"]
    made = ComeHome


class Land(_Plain):
    """End the mission: land where the vehicle hovers."""

    request: Literal["land"]
    made = LandNow


class Goto(CommandRequest):
    """Fly to points in order, and hover at the last.

    Attributes:
        points: Latitude and longitude of each, in degrees.
        hold_s: How long to hover at the last; None: as set in the mission.
    """

    request: Literal["goto"]
    points: Annotated[
        list[Annotated[tuple[Latitude, Longitude], Field(strict=False)]],
        Field(min_length=1, max_length=MOST_POINTS),
    ]
    hold_s: Annotated[float, Field(ge=0, le=3600, allow_inf_nan=False)] | None = None

    def for_mission(self, frame: LocalFrame, by: str = OPERATOR) -> GoTo:
        """As the base class."""
        try:
            points = tuple(frame.to_local(*point) for point in self.points)
        except FrameError as error:
            raise RequestError(f"goto: {error}") from None
        return GoTo(points, self.hold_s, by=self.requester(by))

    @classmethod
    def fields_of(cls, words: str) -> dict[str, Any]:
        """`LAT,LON`, more places behind it."""
        try:
            numbers = [float(number) for number in re.split(r"[\s,;]+", words)]
        except ValueError:
            numbers = []
        if not numbers or len(numbers) % 2:
            raise RequestError("goto where? type 'goto LAT,LON', more places behind it, in degrees")
        return {"points": [[*pair] for pair in zip(numbers[::2], numbers[1::2], strict=True)]}


class Altitude(CommandRequest):
    """Climb or descend where the vehicle holds, and hold there.

    Attributes:
        altitude_m: Above home.
    """

    request: Literal["altitude"]
    altitude_m: Annotated[float, Field(gt=0, le=10_000, allow_inf_nan=False)]

    def for_mission(self, frame: LocalFrame, by: str = OPERATOR) -> ChangeAltitude:
        """As the base class."""
        del frame
        return ChangeAltitude(self.altitude_m, by=self.requester(by))

    @classmethod
    def fields_of(cls, words: str) -> dict[str, Any]:
        """Metres above home."""
        try:
            return {"altitude_m": float(words)}
        except ValueError:
            how = "altitude of what? type 'altitude METRES', above home"
            raise RequestError(how) from None


class ReloadMission(_Plain):
    """Read no-fly zones and fences from the changed mission file."""

    request: Literal["reload"]
    made = Reload


class Status(CommandRequest):
    """What the flight is doing."""

    request: Literal["status"]


class View(CommandRequest):
    """What a program reads that shows the flight.

    Attributes:
        areas: With fences, zones and waypoints.
        map: With the map that the vehicle has painted.
    """

    request: Literal["view"]
    areas: bool = False
    map: bool = False


FlightRequest = Annotated[
    Hold | Resume | Seek | Explore | Home | Land | Goto | Altitude | ReloadMission | Status | View,
    Field(discriminator="request"),
]
"""Every request; `request` tells them apart."""

MODELS: Final[Mapping[str, type[CommandRequest]]] = {
    model.verb(): model for model in get_args(get_args(FlightRequest)[0])
}
"""The model of every verb."""


def json_schema() -> dict[str, Any]:
    """The JSON schema of all requests, as docs/schemas/flight-request.json has it."""
    schema: dict[str, Any] = TypeAdapter(FlightRequest).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def command_request_of(values: object) -> CommandRequest:
    """A request from a JSON object. Raises RequestError: what is wrong with it."""
    if not isinstance(values, dict):
        raise RequestError("a request is a JSON object")
    model = _model(values.get("request"))
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise RequestError(f"{model.verb()}: {request_error_text(error, model)}") from None


def parse_command(text: str) -> CommandRequest:
    """A request as text: `hold`, `resume upload`, `seek NAME`, `goto LAT,LON LAT,LON` ...

    Raises:
        RequestError: what is wrong with it.
    """
    name, _, words = text.strip().partition(" ")
    model = _model(name.lower())
    return command_request_of({"request": model.verb(), **model.fields_of(words.strip())})


def _model(verb: object) -> type[CommandRequest]:
    if not isinstance(verb, str) or verb not in MODELS:
        known = ", ".join(MODELS)
        raise RequestError(f"no request '{sanitize(str(verb)[:40])}'; use one of {known}")
    return MODELS[verb]


class RequestHandler(Protocol):
    """What carries out requests."""

    def execute(self, command: CommandRequest, by: str) -> dict[str, Any]:
        """Carry a request out; returns the answer. Raises RequestError."""


# How many requests are handled: no program may take the flight's time with them.


COSTLY: Final = frozenset({"seek", "goto", "reload"})
"""Requests for which routes are planned, or a file is read."""

COSTLY_PER_S, COSTLY_AT_ONCE = 5.0, 10.0
"""So many of them are handled in a second, and so many after a pause."""

POINTS_AT_ONCE: Final = 10
"""So many points of a `goto` count as one request: routes to and from each are planned."""

TOO_MANY: Final = "too many requests; try again in a second"


class Budget:
    """A token bucket: fills up with time, and is spent."""

    def __init__(
        self, per_s: float, at_once: float, monotonic: Callable[[], float] = loop_s
    ) -> None:
        self._per_s = per_s
        self._at_once = self._left = at_once
        self._monotonic = monotonic
        self._at_s = monotonic()  # when it was filled up last, monotonic

    def spend(self, amount: float = 1.0) -> bool:
        """Whether there was enough for so much more."""
        now_s = self._monotonic()
        gained = max(0.0, now_s - self._at_s) * self._per_s
        self._at_s = now_s
        self._left = min(self._at_once, self._left + gained)
        if self._left < amount:
            return False
        self._left -= amount
        return True

    def affords(self, command: CommandRequest) -> bool:
        """Whether a request may be handled; those that cost nothing always."""
        return command.request not in COSTLY or self.affords_routes(
            len(getattr(command, "points", ()))
        )

    def affords_routes(self, points: int) -> bool:
        """Whether routes to so many points may be planned."""
        return self.spend(max(1.0, points / POINTS_AT_ONCE))
