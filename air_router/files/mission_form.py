"""The form of a mission file: keys, types, limits and defaults, in the file's own coordinates.

Files of every format become this form; `PlacedForm` has where its parts are.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import BaseModel, Field, PrivateAttr, model_validator
from pydantic_core import PydanticCustomError

from air_router.files.findings import Keys
from air_router.files.seek_policies import DEFAULT_SEEK_POLICY, SeekPolicy
from air_router.files.zone_terms import ActiveForm, AltitudeForm, Clearance, ZoneTerms

PlannerKind = Literal["waypoints", "shortest"]
"""`waypoints` stays on the operator's waypoint graph (the paper's), `shortest` goes straight."""

Accepted = Literal[
    "rtl_crosses_zones", "rtl_altitude", "rtl_type", "sticks_do_not_override", "fence_action"
]
"""What a mission file may accept of a vehicle by name; without it nothing takes off like that."""

WhenExplored = Literal["patrol", "hover", "home"]
"""What the vehicle does once every waypoint is explored; see docs/state-machine.md."""

DEFAULT_WHEN_EXPLORED: Final[WhenExplored] = "patrol"

Seconds = Annotated[float, Field(gt=0, le=86_400)]
"""Limits hold for values in files; programs may go beyond."""


@dataclass(frozen=True, slots=True)
class Timers:
    """How long the mission's states last, in seconds of the vehicle's clock (defaults: paper).

    Attributes:
        init_s: first exploration, before any robot is sought (the paper's t_i).
        explore_s: exploration between two searches (t_e).
        search_s: waiting for a robot, from the arrival where it should be (t_s).
        communicate_s: the longest that the vehicle hovers over a robot (t_c).
        hold_s: hovering at the last of the points that it was sent to on request.
        revisit_s: once all is explored, the least time from a complete exchange with a robot to
            the next search for it.
    """

    init_s: Seconds = 180.0
    explore_s: Seconds = 120.0
    search_s: Seconds = 45.0
    communicate_s: Seconds = 20.0
    hold_s: Seconds = 20.0
    revisit_s: Seconds = 30.0


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """How routes are planned.

    Attributes:
        clearance_m: the least distance of the vehicle to zones and fence.
        tracking_margin_m: kept on top of it when planning, at least: what wind, position noise and
            braking may take. Speed, wind and accuracy may require more (`mission.tracking`).
        wind_m_s: the mean wind that the mission is planned for, with the gusts that come with it.
        position_accuracy_m: the horizontal accuracy that it is planned for, as the satellite
            receiver reports it.
        max_edge_m: the longest connection between two waypoints of the graph.
        acceptance_radius_m: nearer than this to a waypoint counts as there.
        vertical_margin_m: how far the vehicle may be off the altitudes that it flies at, when zones
            are chosen by their altitude limits.
        terrain_relief_m: how much higher or lower than at home the ground may be, for zones whose
            limits count from the ground.
        vertical_separation_m: what lies between the layers of two UAVs of one mission, at least.
        home_separation_m: what lies between their homes, at least.
        kind: whether routes stay on the waypoint graph or are the shortest there are.
    """

    clearance_m: Clearance = 5.0
    tracking_margin_m: Annotated[float, Field(ge=0.02, le=1_000)] = 1.5
    wind_m_s: Annotated[float, Field(ge=0, le=25)] = 5.0
    position_accuracy_m: Annotated[float, Field(gt=0, le=10)] = 1.0
    max_edge_m: Annotated[float, Field(gt=0, le=10_000)] = 100.0
    acceptance_radius_m: Annotated[float, Field(ge=0.5, le=20)] = 2.0
    vertical_margin_m: Annotated[float, Field(ge=2, le=1_000)] = 5.0
    terrain_relief_m: Clearance = 20.0
    vertical_separation_m: Annotated[float, Field(ge=4, le=1_000)] = 10.0
    home_separation_m: Annotated[float, Field(ge=4, le=1_000)] = 20.0
    kind: PlannerKind = "waypoints"


DEFAULT_SPEED_M_S = 3.5
SLOWEST_M_S = 1.0  # a slower one cannot be distinguished from one that hovers
DEFAULT_BATTERY_RESERVE = 0.25
LOWEST_HOME_M, HIGHEST_HOME_M = -500.0, 9_000.0  # of the ground at home, above the sea
LARGEST_RADIUS_M = 1_000_000.0  # of a circle


# The form of a mission file in YAML; see docs/mission-file.md


Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Position = Annotated[Pair, Field(description="[latitude, longitude] in degrees")]
Polygon = Annotated[list[Pair], Field(max_length=20_000)]
FlownAltitude = Annotated[float, Field(ge=1, le=10_000, description="metres above home")]
Radius = Annotated[float, Field(gt=0, le=LARGEST_RADIUS_M)]


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
    radius_m: Radius


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
    skip: list[str] = []


class SpotForm(_Form):
    """A place."""

    short_for = {list: "position"}

    position: Position


class WaypointForm(SpotForm):
    """A place to explore."""

    altitude_m: FlownAltitude | None = None


class HomeForm(SpotForm):
    """Where the vehicle takes off and lands."""

    altitude_amsl_m: Annotated[float, Field(ge=LOWEST_HOME_M, le=HIGHEST_HOME_M)] | None = None


class UavForm(BaseModel):
    """One of several UAVs that fly the mission."""

    altitude_m: FlownAltitude | None = None
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
    """A whole file, and where in it the values stand. Missions are written in this order."""

    name: str | None = None
    coordinates: Literal["degrees", "local"] = "degrees"
    frame: FrameForm | None = None
    home: Annotated[HomeForm, Field(description="where the vehicle takes off and lands")]
    altitude_m: FlownAltitude
    altitudes_m: Annotated[list[FlownAltitude], Field(min_length=2, max_length=2)] | None = None
    speed_m_s: Annotated[float, Field(ge=SLOWEST_M_S, le=50)] = DEFAULT_SPEED_M_S
    team: str | None = None
    world: str | None = None
    uavs: dict[str, UavForm | None] = {}
    uav: str | None = None
    seek: SeekForm = SeekForm()
    when_explored: WhenExplored = DEFAULT_WHEN_EXPLORED
    goals_from: list[str] = []
    timers: Timers = Timers()
    planner: PlannerSettings = PlannerSettings()
    duration_s: Seconds | None = None
    endurance_s: Seconds | None = None
    battery_reserve: Annotated[float, Field(ge=0, lt=1)] = DEFAULT_BATTERY_RESERVE
    accepts: list[Accepted] = []
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

    _path: Path = PrivateAttr(default=Path())
    _places: Mapping[Keys, Keys] = PrivateAttr(default_factory=dict)
    _unread: frozenset[str] = PrivateAttr(default=frozenset())

    def of_file(
        self, path: Path, *, places: Mapping[Keys, Keys] | None = None, unread: Collection[str] = ()
    ) -> Self:
        """This form, from now on that of a file.

        Args:
            path: The file.
            places: The keys of a value in the file, by those here, where they differ. A part of
                such a value has the name of its own behind them.
            unread: Sections whose values are placeholders, because theirs cannot be read. An entry
                of a list that cannot be read is None.
        """
        self._path, self._unread = path, frozenset(unread)
        self._places = {} if places is None else places
        return self

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def unread(self) -> frozenset[str]:
        """Sections whose values are placeholders."""
        return self._unread

    @property
    def in_own_keys(self) -> bool:
        """Whether the file's keys are those here: it is one of ours."""
        return not self._places

    @property
    def in_metres(self) -> bool:
        """Whether pairs are metres east and north of the frame's origin, not degrees."""
        return self.coordinates == "local"

    @property
    def title(self) -> str:
        """What people call the mission: its name, or its folder's."""
        return self.name or self._path.resolve().parent.name

    @property
    def team_file(self) -> Path | None:
        """The path of the team file."""
        return None if self.team is None else self._path.parent / self.team

    @property
    def world_file(self) -> Path | None:
        """The path of the world file."""
        return None if self.world is None else self._path.parent / self.world

    def keys_of(self, *keys: str | int) -> Keys:
        """The keys of a value in the file."""
        found = self._places.get(keys)
        if found is None and keys[:-1] in self._places:
            found = (*self._places[keys[:-1]], keys[-1])
        return keys if found is None else found
