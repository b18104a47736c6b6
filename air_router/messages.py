"""Messages that robots publish, in JSON: where they are, where they go, what they see.

Latitude and longitude, because robots need not share a local frame. Everything that comes from
the network is bounded and checked here before it is used.
"""

from collections.abc import Callable
from typing import Annotated, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

POSE_TOPIC: Final = "/pose"
PATH_TOPIC: Final = "/path"
SIGHTINGS_TOPIC: Final = "/sightings"
MAP_TOPIC: Final = "/map"
SEEK_TOPIC: Final = "/seek"
GOALS_TOPIC: Final = "/goals"
ANSWERS_TOPIC: Final = "/answers"

JSON_PACKAGE: Final = "json/"
"""How the types of JSON begin in a team file; their meaning follows from the topic's name."""

MESSAGE_LIMIT_BYTES: Final = 1 << 20

MOST_POINTS: Final = 50
"""Points in one request at most: for each, the ways there and home are checked."""

FARTHEST_M: Final = 10_000.0
"""A place farther than this from the mission's origin is a mistake, and nothing is flown to there:
no fence may be drawn that would keep the vehicle from going."""

Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=180)]
Stamp = Annotated[float, Field(ge=0, le=1e11)]
GoalsId = Annotated[str, Field(min_length=1, max_length=64)]
ForUav = Annotated[str, Field(max_length=255)] | None


class MessageError(ValueError):
    """A peer's message is not what its topic promises; it is counted and left alone."""


class GossipMessage(BaseModel):
    """JSON in both directions; unknown keys are left to newer versions of us."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    def encode(self) -> bytes:
        """The message as UTF-8 JSON."""
        return self.model_dump_json().encode()

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a message from a peer.

        Raises:
            MessageError: what is wrong with it.
        """
        if len(data) > MESSAGE_LIMIT_BYTES:
            raise MessageError(f"{cls.__name__} of {len(data)} bytes: too large")
        return cls._checked(lambda: cls.model_validate_json(data))

    @classmethod
    def of(cls, **values: object) -> Self:
        """Make a message of values that a peer sent in another form.

        Raises:
            MessageError: what is wrong with it.
        """
        return cls._checked(lambda: cls.model_validate(values))

    @classmethod
    def _checked(cls, make: Callable[[], Self]) -> Self:
        try:
            return make()
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(part) for part in first["loc"]) or "message"
            raise MessageError(f"{cls.__name__}: {where}: {first['msg']}") from None


class PoseMessage(GossipMessage):
    """Where a robot is: WGS-84 degrees, heading clockwise from true north, Unix seconds.

    A stamp of 0, of a robot without a clock, is the time at which its node took the message.
    """

    stamp_s: Stamp
    latitude_deg: Latitude
    longitude_deg: Longitude
    heading_deg: Annotated[float, Field(ge=-360, le=720)] = 0.0


class PathMessage(GossipMessage):
    """Where a robot intends to go: (latitude, longitude) points, the last is its destination."""

    stamp_s: Stamp
    points: Annotated[tuple[tuple[Latitude, Longitude], ...], Field(max_length=10_000)]


class SeekMessage(GossipMessage):
    """Whom a UAV seeks, so that another one seeks another robot; None: no robot."""

    stamp_s: Stamp
    robot: Annotated[str, Field(min_length=1, max_length=255)] | None


class GoalsMessage(GossipMessage):
    """Points that a base station wants a UAV to fly to; docs/control.md.

    Attributes:
        stamp_s: When it was published.
        id: Another one for other goals: the same is done once.
        points: (latitude, longitude), in order.
        hold_s: How long to hover at the last; None: as the mission says.
        to: For which UAV; None: for every UAV that receives the sender.
        until_s: Too late after that; None: never.
    """

    stamp_s: Stamp
    id: GoalsId
    points: Annotated[
        tuple[tuple[Latitude, Longitude], ...], Field(min_length=1, max_length=MOST_POINTS)
    ]
    hold_s: Annotated[float, Field(ge=0, le=3600)] | None = None
    to: ForUav = None
    until_s: Stamp | None = None


class GoalsHead(GossipMessage):
    """What an answer needs of goals, whatever else they contain."""

    id: GoalsId
    to: ForUav = None


class AnswerMessage(GossipMessage):
    """What became of the goals of a robot: `code` is one of docs/errors.md, None if accepted."""

    stamp_s: Stamp
    to: Annotated[str, Field(max_length=255)]  # who sent the goals
    id: Annotated[str, Field(max_length=64)]  # of the goals, as it was sent
    accepted: bool
    why: Annotated[str, Field(max_length=2_000)]  # as text
    code: Annotated[str, Field(max_length=64)] | None = None


class SeenObject(BaseModel):
    """One thing that a robot saw, and where."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    kind: Literal["vehicle", "person", "building", "other"]
    latitude_deg: Latitude
    longitude_deg: Longitude


class SightingsMessage(GossipMessage):
    """Everything that a robot has seen so far, so that the newest message is sufficient."""

    stamp_s: Stamp
    objects: Annotated[tuple[SeenObject, ...], Field(max_length=10_000)]
