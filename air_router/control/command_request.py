"""What the operator and programs may request of a flight: one tagged union.

A request is JSON (page, socket, ROS 2) or text (terminal, `air-router ask`), with places in
degrees. It is untrusted: a model validates it. docs/control.md describes the requests, and
docs/schemas/flight-request.json is their JSON schema. The controller decides on them.
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
    """The common part of all requests.

    Attributes:
        by: The requester, for the record and the pilot.
    """

    by: Annotated[str, Field(max_length=60)] | None = None

    def for_mission(self, frame: LocalFrame, by: str = OPERATOR) -> AnyRequest | None:
        """Convert to the controller's request, in meters; None: it only reads the flight's state.

        Args:
            frame: The mission's frame.
            by: The requester, if the request has none.

        Raises:
            RequestError: A place is outside the frame's range.
        """
        del frame, by
        return None

    @classmethod
    def fields_of(cls, words: str) -> dict[str, Any]:
        """Parse the text after the verb, as typed by an operator. Raises RequestError."""
        if words:
            raise RequestError(_NO_ARGUMENTS.format(verb=cls.verb()))
        return {}

    @classmethod
    def verb(cls) -> str:
        """The name of the request."""
        [verb] = get_args(cls.model_fields["request"].annotation)
        return str(verb)

    def requester(self, by: str) -> str:
        """The requester, without unprintable characters."""
        return (sanitize(self.by).strip() if self.by else "") or by


class _Plain(CommandRequest):
    """A request without fields."""

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
    """Resume what was held, or take the flight back from the pilot.

    Attributes:
        upload: Upload this mission's plan first.
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
    """End the mission: fly home along the graph, and land."""

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
        hold_s: How long to hover at the last; None: the mission's time.
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
        """`LAT,LON`, separated by spaces."""
        try:
            numbers = [float(number) for number in re.split(r"[\s,;]+", words)]
        except ValueError:
            numbers = []
        if not numbers or len(numbers) % 2:
            raise RequestError("goto where? type 'goto LAT,LON', more places behind it, in degrees")
        return {"points": [[*pair] for pair in zip(numbers[::2], numbers[1::2], strict=True)]}


class Altitude(CommandRequest):
    """Climb or descend in place, and hold there.

    Attributes:
        altitude_m: Altitude above home.
    """

    request: Literal["altitude"]
    altitude_m: Annotated[float, Field(gt=0, le=10_000, allow_inf_nan=False)]

    def for_mission(self, frame: LocalFrame, by: str = OPERATOR) -> ChangeAltitude:
        """As the base class."""
        del frame
        return ChangeAltitude(self.altitude_m, by=self.requester(by))

    @classmethod
    def fields_of(cls, words: str) -> dict[str, Any]:
        """Meters above home."""
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
    """Read the flight's status."""

    request: Literal["status"]


class View(CommandRequest):
    """Read the data of a program that shows the flight.

    Attributes:
        areas: Include fences, zones and waypoints.
        map: Include the map that the vehicle has painted.
    """

    request: Literal["view"]
    areas: bool = False
    map: bool = False


FlightRequest = Annotated[
    Hold | Resume | Seek | Explore | Home | Land | Goto | Altitude | ReloadMission | Status | View,
    Field(discriminator="request"),
]
"""Every request, discriminated by `request`."""

MODELS: Final[Mapping[str, type[CommandRequest]]] = {
    model.verb(): model for model in get_args(get_args(FlightRequest)[0])
}
"""The model of every verb."""


def json_schema() -> dict[str, Any]:
    """The JSON schema of all requests, stored in docs/schemas/flight-request.json."""
    schema: dict[str, Any] = TypeAdapter(FlightRequest).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def command_request_of(values: object) -> CommandRequest:
    """Parse a request from a JSON object. Raises RequestError with the fault."""
    if not isinstance(values, dict):
        raise RequestError("a request is a JSON object")
    model = _model(values.get("request"))
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise RequestError(f"{model.verb()}: {request_error_text(error, model)}") from None


def parse_command(text: str) -> CommandRequest:
    """Parse a request from text: `hold`, `resume upload`, `seek NAME`, `goto LAT,LON LAT,LON` ...

    Raises:
        RequestError: It is invalid.
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
    """Carries out requests."""

    def execute(self, command: CommandRequest, by: str) -> dict[str, Any]:
        """Carry a request out; returns the answer. Raises RequestError."""


# Rate limits, so that no program takes too much of the flight's time.


COSTLY: Final = frozenset({"seek", "goto", "reload"})
"""Requests that plan routes or read a file."""

COSTLY_PER_S, COSTLY_AT_ONCE = 5.0, 10.0
"""Rate of such requests per second, and burst after a pause."""

POINTS_AT_ONCE: Final = 10
"""Number of points of a `goto` that count as one request: routes to and from each are planned."""

TOO_MANY: Final = "too many requests; try again in a second"


class Budget:
    """A token bucket."""

    def __init__(
        self, per_s: float, at_once: float, monotonic: Callable[[], float] = loop_s
    ) -> None:
        self._per_s = per_s
        self._at_once = self._left = at_once
        self._monotonic = monotonic
        self._at_s = monotonic()  # last refill, monotonic

    def spend(self, amount: float = 1.0) -> bool:
        """Spend an amount; return whether there was enough."""
        now_s = self._monotonic()
        gained = max(0.0, now_s - self._at_s) * self._per_s
        self._at_s = now_s
        self._left = min(self._at_once, self._left + gained)
        if self._left < amount:
            return False
        self._left -= amount
        return True

    def affords(self, command: CommandRequest) -> bool:
        """Whether the budget allows a request; cheap requests are always allowed."""
        return command.request not in COSTLY or self.affords_routes(
            len(getattr(command, "points", ()))
        )

    def affords_routes(self, points: int) -> bool:
        """Whether the budget allows routes to this many points."""
        return self.spend(max(1.0, points / POINTS_AT_ONCE))
