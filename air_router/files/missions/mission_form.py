"""The form of a mission file in YAML: keys, types, limits. See docs/mission-file.md."""

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, Field, model_validator
from pydantic_core import PydanticCustomError

from air_router.files.settings import (
    DEFAULT_BATTERY_RESERVE,
    DEFAULT_SEEK_POLICY,
    DEFAULT_SPEED_M_S,
    SLOWEST_M_S,
    Accepted,
    PlannerSettings,
    Seconds,
    SeekPolicy,
    Timers,
)
from air_router.files.zone_terms import ActiveForm, AltitudeForm, ZoneTerms

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Position = Annotated[Pair, Field(description="[latitude, longitude] in degrees")]
Polygon = Annotated[list[Pair], Field(max_length=20_000)]
_Altitude = Annotated[float, Field(gt=0, le=10_000, description="metres above home")]


class _Form(BaseModel):
    """A mapping; the bare value of its most important key may stand for it."""

    short_for: ClassVar[dict[type, str]] = {}  # that key, by the type of such a value

    @model_validator(mode="before")
    @classmethod
    def _written_out(cls, value: Any) -> Any:
        key = cls.short_for.get(type(value))
        return value if key is None else {key: value}


class CircleForm(BaseModel):
    """A circle."""

    centre: Position
    radius_m: Annotated[float, Field(gt=0, le=1_000_000)]


class AreaForm(_Form):
    """A fence, or the place of a zone."""

    short_for = {list: "polygon"}
    polygon: Polygon | None = None
    holes: Annotated[list[Polygon], Field(max_length=1_000)] = []
    circle: CircleForm | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.polygon is None) == (self.circle is None):
            raise PydanticCustomError(
                "one-shape", "an area needs either 'polygon' or 'circle'; write exactly one"
            )
        if self.circle is not None and self.holes:
            raise PydanticCustomError(
                "one-shape", "a circle has no holes; draw a polygon, or remove 'holes'"
            )
        return self


class ZoneForm(AreaForm, ActiveForm):
    """A no-fly zone."""

    name: str | None = None
    crosses_fence: bool = False
    altitude: AltitudeForm | None = None

    def terms(self) -> ZoneTerms:
        """How far, how high and when it is kept away from."""
        altitudes = None if self.altitude is None else self.altitude.altitudes()
        return ZoneTerms(self.clearance_m, altitudes, self.validity())


class ZoneFileForm(_Form):
    """A file with more zones."""

    short_for = {str: "file"}
    file: str
    allow: list[str] = []


class SpotForm(_Form):
    """A place."""

    short_for = {list: "position"}
    position: Position


class WaypointForm(SpotForm):
    """A place to explore."""

    altitude_m: _Altitude | None = None


class HomeForm(SpotForm):
    """Where the vehicle takes off and lands."""

    altitude_amsl_m: Annotated[float, Field(ge=-500, le=9_000)] | None = None


class UavForm(BaseModel):
    """One of several UAVs that fly the mission."""

    altitude_m: _Altitude | None = None
    explore: bool = True
    home: HomeForm | None = None


class FrameForm(BaseModel):
    """The local frame."""

    origin: Position


class SeekForm(_Form):
    """Whom to seek, and in which order."""

    short_for = {list: "robots", str: "policy"}
    robots: list[str] = []
    policy: SeekPolicy = DEFAULT_SEEK_POLICY


class MissionForm(BaseModel):
    """A whole file."""

    name: str | None = None
    coordinates: Literal["degrees", "local"] = "degrees"
    frame: FrameForm | None = None
    home: Annotated[HomeForm, Field(description="where the vehicle takes off and lands")]
    altitude_m: _Altitude
    altitudes_m: Annotated[list[_Altitude], Field(min_length=2, max_length=2)] | None = None
    speed_m_s: Annotated[float, Field(ge=SLOWEST_M_S, le=50)] = DEFAULT_SPEED_M_S
    waypoints: Annotated[
        list[WaypointForm], Field(max_length=5_000, description="what to explore, in order")
    ]
    fence: AreaForm | None = None
    fences: list[AreaForm] = []
    no_fly_zones: Annotated[
        list[ZoneForm],
        Field(description="areas to stay out of; 'no_fly_zones: []' if there are none"),
    ]
    no_fly_files: list[ZoneFileForm] = []
    rally_points: list[SpotForm] = []
    timers: Timers = Timers()
    planner: PlannerSettings = PlannerSettings()
    uav: str | None = None
    uavs: dict[str, UavForm | None] = {}
    seek: SeekForm = SeekForm()
    goals_from: list[str] = []
    team: str | None = None
    world: str | None = None
    duration_s: Seconds | None = None
    endurance_s: Seconds | None = None
    battery_reserve: Annotated[float, Field(ge=0, lt=1)] = DEFAULT_BATTERY_RESERVE
    accepts: list[Accepted] = []
