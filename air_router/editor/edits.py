"""What the page may ask to be changed; checked like anything that comes over a socket."""

from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from air_router.errors import AirRouterError


def _on_earth(longitude_deg: float) -> float:
    turns = 0 if abs(longitude_deg) <= 180 else round(longitude_deg / 360)
    return longitude_deg - 360 * turns


_Key = Annotated[str, Field(max_length=64)] | Annotated[int, Field(ge=0, le=1_000_000)]
_Keys = Annotated[tuple[_Key, ...], Field(min_length=1, max_length=16)]
_Latitude = Annotated[float, Field(ge=-90, le=90)]
_Longitude = Annotated[float, Field(ge=-540, le=540), AfterValidator(_on_earth)]
"""On a map around the antimeridian longitudes go on beyond 180 degrees."""

_Place = tuple[_Latitude, _Longitude]
_Radius = Annotated[float, Field(gt=0, le=10_000)]
_Index = Annotated[int, Field(ge=0, le=1_000_000)]


class EditError(AirRouterError):
    """An edit that cannot be applied to the mission; the message says why."""


class _Edit(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    words: ClassVar[str]
    """What undo calls it."""


class _PartEdit(_Edit):
    keys: _Keys  # of the part of the mission that it is about


class Move(_PartEdit):
    """Move a place, a corner or a circle's centre."""

    words: ClassVar[str] = "move"
    do: Literal["move"]
    to: _Place


class Shift(_PartEdit):
    """Move a whole area by as much as from one place to another."""

    words: ClassVar[str] = "move area"
    do: Literal["shift"]
    origin: _Place
    to: _Place


class Resize(_PartEdit):
    """Give a circle another radius."""

    words: ClassVar[str] = "resize circle"
    do: Literal["resize"]
    radius_m: _Radius


class AddCorner(_PartEdit):
    """Insert a corner into a ring, before the one that has the index."""

    words: ClassVar[str] = "insert corner"
    do: Literal["add_corner"]
    index: _Index
    at: _Place


class AddWaypoint(_Edit):
    """Insert a waypoint; with `index` waypoints before it."""

    words: ClassVar[str] = "add waypoint"
    do: Literal["add_waypoint"]
    index: _Index
    at: _Place


class Reorder(_PartEdit):
    """Move a waypoint to another place in the order; then so many waypoints are before it."""

    words: ClassVar[str] = "reorder waypoints"
    do: Literal["reorder"]
    index: _Index


class Reverse(_Edit):
    """Turn the order of the waypoints round."""

    words: ClassVar[str] = "reverse waypoints"
    do: Literal["reverse"]


class AddRallyPoint(_Edit):
    """Add a rally point."""

    words: ClassVar[str] = "add rally point"
    do: Literal["add_rally_point"]
    at: _Place


class AddArea(_Edit):
    """Add a no-fly zone or a fence: a polygon, or a circle around the only place."""

    words: ClassVar[str] = "add zone"
    do: Literal["add_area"]
    fence: bool = False
    corners: Annotated[tuple[_Place, ...], Field(min_length=1, max_length=500)]
    radius_m: _Radius | None = None


class Remove(_PartEdit):
    """Remove a place, a corner or an area."""

    words: ClassVar[str] = "remove"
    do: Literal["remove"]


class Rename(_PartEdit):
    """Give a no-fly zone another name."""

    words: ClassVar[str] = "rename"
    do: Literal["rename"]
    name: Annotated[str, Field(min_length=1, max_length=80)]


class SetAltitude(_PartEdit):
    """Give a waypoint an altitude of its own, in metres above home; None: the mission's."""

    words: ClassVar[str] = "altitude"
    do: Literal["set_altitude"]
    altitude_m: Annotated[float, Field(gt=0, le=10_000)] | None


class SetValue(_Edit):
    """Change one of the mission's settings; None: its default."""

    words: ClassVar[str] = "setting"
    do: Literal["set_value"]
    name: Literal[
        "name",
        "team",
        "uav",
        "altitude_m",
        "speed_m_s",
        "duration_s",
        "endurance_s",
        "battery_reserve",
        "clearance_m",
        "tracking_margin_m",
        "max_edge_m",
        "init_s",
        "explore_s",
        "search_s",
        "communicate_s",
        "hold_s",
        "revisit_s",
    ]
    value: (
        Annotated[float, Field(ge=0, le=100_000)]
        | Annotated[str, Field(min_length=1, max_length=200)]
        | None
    )


class Seek(_Edit):
    """Seek these robots, in this order."""

    words: ClassVar[str] = "whom to seek"
    do: Literal["seek"]
    robots: Annotated[
        tuple[Annotated[str, Field(min_length=1, max_length=80)], ...], Field(max_length=500)
    ]


class SetCrossing(_PartEdit):
    """Say that a no-fly zone lies beyond the fence on purpose, or does not."""

    words: ClassVar[str] = "crossing"
    do: Literal["set_crossing"]
    crosses: bool


class Redraw(_PartEdit):
    """Give an area another outline, a polygon."""

    words: ClassVar[str] = "outline"
    do: Literal["redraw"]
    corners: Annotated[tuple[_Place, ...], Field(min_length=3, max_length=500)]


Edit = (
    Move
    | Shift
    | Resize
    | AddCorner
    | AddWaypoint
    | Reorder
    | Reverse
    | AddRallyPoint
    | AddArea
    | Remove
    | Rename
    | SetAltitude
    | SetValue
    | Seek
    | SetCrossing
    | Redraw
)

_ADAPTER: TypeAdapter[Edit] = TypeAdapter(Annotated[Edit, Field(discriminator="do")])


def read_edit(json: str) -> Edit:
    """An edit from JSON. Raises EditError."""
    try:
        return _ADAPTER.validate_json(json)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"])) or "the message"
        raise EditError(f"not an edit: {where}: {first['msg']}") from None
