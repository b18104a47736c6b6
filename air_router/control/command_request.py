"""What a program or an operator asks for, as JSON or in words, places in degrees; never trusted.

docs/control.md describes both. Whether it is done is for the controller to say.
"""

import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Final, Protocol

from pydantic import Field, ValidationError

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


_PLAIN: Final[Mapping[str, Callable[..., AnyRequest]]] = {
    "hold": HoldNow,
    "explore": ExploreNow,
    "home": ComeHome,
    "land": LandNow,
    "reload": Reload,
}
"""Requests that say nothing but who asks, by their verbs."""


class CommandRequest(Request):
    """A request as it comes; `by`: who asks, for the record and the pilot."""

    by: Annotated[str, Field(max_length=60)] | None = None

    def asked(self, frame: LocalFrame, by: str = OPERATOR) -> AnyRequest | None:
        """The request for a mission; None for one that only wants to know something.

        Args:
            frame: The mission's.
            by: Who asks, if the request does not say.

        Raises:
            RequestError: a place cannot be told in the mission's frame.
        """
        del frame
        plain = _PLAIN.get(self.request)
        return None if plain is None else plain(by=self.who(by))

    def who(self, by: str) -> str:
        """Who asks, in letters that a terminal shows."""
        return (sanitize(self.by).strip() if self.by else "") or by


class _Resume(CommandRequest):
    upload: bool = False  # put this mission's plan on board first

    def asked(self, frame: LocalFrame, by: str = OPERATOR) -> GoOn:
        del frame
        return GoOn(self.upload, by=self.who(by))


class _Seek(CommandRequest):
    robot: Annotated[str, Field(min_length=1, max_length=255)]

    def asked(self, frame: LocalFrame, by: str = OPERATOR) -> SeekNow:
        del frame
        return SeekNow(sanitize(self.robot), by=self.who(by))


class _GoTo(CommandRequest):
    points: Annotated[
        list[Annotated[tuple[Latitude, Longitude], Field(strict=False)]],
        Field(min_length=1, max_length=MOST_POINTS),
    ]
    hold_s: Annotated[float, Field(ge=0, le=3600, allow_inf_nan=False)] | None = None  # at the last

    def asked(self, frame: LocalFrame, by: str = OPERATOR) -> GoTo:
        try:
            points = tuple(frame.to_local(*point) for point in self.points)
        except FrameError as error:
            raise RequestError(f"goto: {error}") from None
        return GoTo(points, self.hold_s, by=self.who(by))


class _Altitude(CommandRequest):
    altitude_m: Annotated[float, Field(gt=0, le=10_000, allow_inf_nan=False)]  # above home

    def asked(self, frame: LocalFrame, by: str = OPERATOR) -> ChangeAltitude:
        del frame
        return ChangeAltitude(self.altitude_m, by=self.who(by))


class View(CommandRequest):
    """What a program asks that shows the flight.

    Attributes:
        areas: With fences, zones and waypoints.
        map: With the map that the vehicle has painted.
    """

    areas: bool = False
    map: bool = False


MODELS: Final[Mapping[str, type[CommandRequest]]] = {
    "hold": CommandRequest,
    "resume": _Resume,
    "seek": _Seek,
    "explore": CommandRequest,
    "home": CommandRequest,
    "land": CommandRequest,
    "goto": _GoTo,
    "altitude": _Altitude,
    "reload": CommandRequest,
    "status": CommandRequest,
    "view": View,
}
"""The model of every verb."""


def command_request_of(values: object) -> CommandRequest:
    """A request from a JSON object. Raises RequestError: what is wrong with it."""
    if not isinstance(values, dict):
        raise RequestError("a request is a JSON object")
    name = values.get("request")
    if not isinstance(name, str) or name not in MODELS:
        known = ", ".join(MODELS)
        raise RequestError(f"no request '{sanitize(str(name)[:40])}'; use one of {known}")
    try:
        return MODELS[name].model_validate(values)
    except ValidationError as error:
        raise RequestError(f"{name}: {request_error_text(error, MODELS[name])}") from None


def parse_command(text: str) -> CommandRequest:
    """A request in words: `hold`, `resume upload`, `seek NAME`, `goto LAT,LON LAT,LON` ...

    Raises:
        RequestError: what is wrong with it.
    """
    name, _, rest = text.strip().partition(" ")
    values: dict[str, Any] = {"request": name.lower()}
    if values["request"] == "seek":
        values["robot"] = rest.strip()
        if not values["robot"]:
            raise RequestError("seek whom? type 'seek NAME'")
    elif values["request"] == "goto":
        values["points"] = _places(rest)
    elif values["request"] == "altitude":
        try:
            values["altitude_m"] = float(rest)
        except ValueError:
            how = "altitude of what? type 'altitude METRES', above home"
            raise RequestError(how) from None
    elif values["request"] == "resume" and rest.strip().lower() == "upload":
        values["upload"] = True
    elif rest.strip() and values["request"] in MODELS:
        raise RequestError(f"'{name}' stands alone")
    return command_request_of(values)


def _places(text: str) -> list[list[float]]:
    try:
        numbers = [float(word) for word in re.split(r"[\s,;]+", text.strip())]
    except ValueError:
        numbers = []
    if not numbers or len(numbers) % 2:
        raise RequestError("goto where? type 'goto LAT,LON', more places behind it, in degrees")
    return [[*pair] for pair in zip(numbers[::2], numbers[1::2], strict=True)]


class RequestHandler(Protocol):
    """Where requests are handed in."""

    def grant(self, command: CommandRequest, by: str) -> dict[str, Any]:
        """Ask for something; what became of it. Raises RequestError."""


# How many requests are looked at: no program may take the flight's time with them.


COSTLY: Final = frozenset({"seek", "goto", "reload"})
"""Requests that have ways planned, or a file read."""

COSTLY_PER_S, COSTLY_AT_ONCE = 5.0, 10.0
"""So many of them are looked at in a second, and so many after a pause."""

POINTS_AT_ONCE: Final = 10
"""So many points of a `goto` count as one request: ways to and from each are planned."""

TOO_MANY: Final = "too many requests; ask again in a second"


class Budget:
    """Fills up with time, and is spent."""

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
        """Whether a request may be looked at; those that cost nothing always."""
        return command.request not in COSTLY or self.affords_ways(
            len(getattr(command, "points", ()))
        )

    def affords_ways(self, points: int) -> bool:
        """Whether ways to so many points may be planned."""
        return self.spend(max(1.0, points / POINTS_AT_ONCE))
