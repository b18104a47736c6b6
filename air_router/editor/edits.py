"""The edits that the page may request: each kind is one class.

An edit is checked like anything that comes over a socket, and names itself by `do`. It changes a
copy of the mission's data, of which the text is made; undo shows the text of before again. So a
new kind of edit is a class here, and nothing elsewhere in Python.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar, Final, Literal, Union, get_type_hints

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from air_router.editor.parts import EditError, Handle, Parts
from air_router.files import (
    FlownAltitude,
    MissionForm,
    PlannerSettings,
    Radius,
    Timers,
    metres,
    value_at,
)
from geo.frame import FrameError, Geodetic, LocalFrame, Point

_LEAST_CORNERS = 3

SETTINGS: Final[dict[str, tuple[str, ...]]] = {
    "": (
        "name",
        "team",
        "uav",
        "altitude_m",
        "speed_m_s",
        "duration_s",
        "endurance_s",
        "battery_reserve",
    ),
    "planner": ("clearance_m", "tracking_margin_m", "max_edge_m"),
    "timers": ("init_s", "explore_s", "search_s", "communicate_s", "hold_s", "revisit_s"),
}
"""What `SetValue` sets, by the section of the mission file; '' is the file itself."""

_SECTION_OF = {name: section for section, names in SETTINGS.items() for name in names}
_FORMS: dict[str, type] = {"": MissionForm, "planner": PlannerSettings, "timers": Timers}


def _on_earth(longitude_deg: float) -> float:
    turns = 0 if abs(longitude_deg) <= 180 else round(longitude_deg / 360)
    return longitude_deg - 360 * turns


_Key = Annotated[str, Field(max_length=64)] | Annotated[int, Field(ge=0, le=1_000_000)]
_Keys = Annotated[tuple[_Key, ...], Field(min_length=1, max_length=16)]
_Latitude = Annotated[float, Field(ge=-90, le=90)]
_Longitude = Annotated[float, Field(ge=-540, le=540), AfterValidator(_on_earth)]
"""On a map around the antimeridian longitudes go on beyond 180 degrees."""

_Place = tuple[_Latitude, _Longitude]
_Index = Annotated[int, Field(ge=0, le=1_000_000)]


class Edit(BaseModel, ABC):
    """A change of a mission; its fields are what the page sends."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    label: ClassVar[str]
    """What undo calls it."""

    in_plans: ClassVar[bool] = True
    """QGroundControl plans have a place for it."""

    from_start: ClassVar[bool] = False
    """Of several in one gesture, each counts from the state before the first."""

    def applied(self, parts: Parts) -> Parts:
        """A copy of the parts with the change in its data.

        Raises:
            EditError: the mission has no such part, or would not survive.
        """
        if not (self.in_plans or parts.settable):
            raise EditError(
                f"{self.label}: a plan has no place for it; edit it in QGroundControl, or convert "
                "the plan to YAML"
            )
        changed = parts.copied()
        self._change(changed)
        return changed

    @abstractmethod
    def _change(self, parts: Parts) -> None:
        """Change the data of these parts."""


class _PartEdit(Edit):
    keys: _Keys  # of the part of the mission that it is about


# Places


class Move(_PartEdit):
    """Move a place, a corner or a circle's centre."""

    label: ClassVar[str] = "move"
    do: Literal["move"]
    to: _Place

    def _change(self, parts: Parts) -> None:
        parts.move(parts.handle(self.keys), self.to)


class AddWaypoint(Edit):
    """Insert a waypoint; with `index` waypoints before it."""

    label: ClassVar[str] = "add waypoint"
    do: Literal["add_waypoint"]
    index: _Index
    at: _Place

    def _change(self, parts: Parts) -> None:
        parts.insert_waypoint(self.index, self.at)


class Reorder(_PartEdit):
    """Move a waypoint to another place in the order; then so many waypoints are before it."""

    label: ClassVar[str] = "reorder waypoints"
    do: Literal["reorder"]
    index: _Index

    def _change(self, parts: Parts) -> None:
        moved = parts.handle(self.keys)
        if moved not in parts.waypoints:
            raise EditError("only waypoints have an order")
        if self.index >= len(parts.waypoints):
            raise EditError(f"the mission has only {len(parts.waypoints)} waypoints")
        order = [handle for handle in parts.waypoints if handle is not moved]
        order.insert(self.index, moved)
        _put_in_order(parts, order)


class Reverse(Edit):
    """Turn the order of the waypoints round."""

    label: ClassVar[str] = "reverse waypoints"
    do: Literal["reverse"]

    def _change(self, parts: Parts) -> None:
        _put_in_order(parts, parts.waypoints[::-1])


def _put_in_order(parts: Parts, order: Sequence[Handle]) -> None:
    """Write the waypoints' entries in another order; what stands between them stays there."""
    places = [handle.entry for handle in parts.waypoints if handle.entry is not None]
    entries = [value_at(parts.data, handle.entry) for handle in order if handle.entry is not None]
    for place, entry in zip(places, entries, strict=True):
        parts.at(place[:-1])[place[-1]] = entry


class SetAltitude(_PartEdit):
    """Give a waypoint an altitude of its own, in metres above home; None: the mission's."""

    label: ClassVar[str] = "altitude"
    do: Literal["set_altitude"]
    altitude_m: FlownAltitude | None

    def _change(self, parts: Parts) -> None:
        waypoint = parts.handle(self.keys)
        if waypoint not in parts.waypoints:
            raise EditError("only waypoints have altitudes of their own")
        parts.set_altitude(waypoint, self.altitude_m)


class AddRallyPoint(Edit):
    """Add a rally point."""

    label: ClassVar[str] = "add rally point"
    do: Literal["add_rally_point"]
    at: _Place

    def _change(self, parts: Parts) -> None:
        parts.add_rally_point(self.at)


# Areas


class Shift(_PartEdit):
    """Move a whole area by as much as from one place to another."""

    label: ClassVar[str] = "move area"
    from_start: ClassVar[bool] = True  # so that no rounding adds up
    do: Literal["shift"]
    origin: _Place
    to: _Place

    def _change(self, parts: Parts) -> None:
        region = parts.region(self.keys)
        try:
            frame = LocalFrame(Geodetic(*self.to))
            start = frame.to_local(*self.origin)
            for handle in region.handles:
                here = parts.geodetic(handle.pair)
                if here is None:
                    raise EditError(f"{region.name} has a corner that is not on Earth")
                point = frame.to_local(*here)
                there = Point(point.east_m - start.east_m, point.north_m - start.north_m)
                parts.move(handle, frame.to_geodetic(there))
        except FrameError as error:
            raise EditError(f"{region.name} cannot be moved there: {error}") from None


class Resize(_PartEdit):
    """Give a circle another radius."""

    label: ClassVar[str] = "resize circle"
    do: Literal["resize"]
    radius_m: Radius

    def _change(self, parts: Parts) -> None:
        region = parts.region(self.keys)
        if region.circle is None:
            raise EditError(f"{region.name} is no circle")
        *keys, name = region.circle.radius_keys
        parts.put(parts.at(keys), name, metres(self.radius_m, 1 if self.radius_m >= 1 else 2))


class AddCorner(_PartEdit):
    """Insert a corner into a ring, before the one that has the index."""

    label: ClassVar[str] = "insert corner"
    do: Literal["add_corner"]
    index: _Index
    at: _Place

    def _change(self, parts: Parts) -> None:
        ring = parts.rings.get(self.keys)
        if ring is None:
            raise EditError("the mission has no such border any more")
        if self.index > len(ring.corners):
            raise EditError(f"the ring has only {len(ring.corners)} corners")
        parts.at(self.keys).insert(self.index, parts.digits(self.at))


class AddArea(Edit):
    """Add a no-fly zone or a fence: a polygon, or a circle around the only place."""

    label: ClassVar[str] = "add zone"
    do: Literal["add_area"]
    fence: bool = False
    corners: Annotated[tuple[_Place, ...], Field(min_length=1, max_length=500)]
    radius_m: Radius | None = None

    def _change(self, parts: Parts) -> None:
        parts.add_area(self.corners, self.radius_m, fence=self.fence)


class Redraw(_PartEdit):
    """Give an area another outline, a polygon."""

    label: ClassVar[str] = "outline"
    do: Literal["redraw"]
    corners: Annotated[tuple[_Place, ...], Field(min_length=3, max_length=500)]

    def _change(self, parts: Parts) -> None:
        parts.redraw(parts.region(self.keys), self.corners)


class Rename(_PartEdit):
    """Give a no-fly zone another name."""

    label: ClassVar[str] = "rename"
    in_plans: ClassVar[bool] = False
    do: Literal["rename"]
    name: Annotated[str, Field(min_length=1, max_length=80)]

    def _change(self, parts: Parts) -> None:
        if parts.region(self.keys).is_fence:
            raise EditError("a fence has no name")
        parts.long_form(self.keys, "polygon")["name"] = self.name


class SetCrossing(_PartEdit):
    """Say that a no-fly zone lies beyond the fence on purpose, or does not."""

    label: ClassVar[str] = "crossing"
    in_plans: ClassVar[bool] = False
    do: Literal["set_crossing"]
    crosses: bool

    def _change(self, parts: Parts) -> None:
        if parts.region(self.keys).is_fence:
            raise EditError("only zones cross the fence")
        zone = parts.long_form(self.keys, "polygon")
        if self.crosses:
            zone["crosses_fence"] = True
        else:
            zone.pop("crosses_fence", None)


# Of any part


class Remove(_PartEdit):
    """Remove a place, a corner or an area."""

    label: ClassVar[str] = "remove"
    do: Literal["remove"]

    def _change(self, parts: Parts) -> None:
        region = next((region for region in parts.regions if region.keys == self.keys), None)
        if region is not None:
            if region.entry is None:
                raise EditError(f"the {region.name} is removed by hand: write 'fence: null'")
            parts.take_out(region.entry)
            return
        handle = parts.handle(self.keys)
        if handle.entry is None:
            raise EditError("this cannot be removed; move it instead")
        ring = parts.rings.get(self.keys[:-1])
        if ring and len(ring.corners) <= _LEAST_CORNERS:
            raise EditError("an area needs three corners; remove the whole area instead")
        if parts.waypoints == [handle]:
            raise EditError("a mission needs a waypoint; move it instead")
        parts.take_out(handle.entry)


# Settings


def _setting(name: str) -> str:
    if name not in _SECTION_OF:
        raise ValueError(f"no setting is called '{name}'")
    return name


class SetValue(Edit):
    """Change one of the mission's settings; None: its default."""

    label: ClassVar[str] = "setting"
    in_plans: ClassVar[bool] = False
    do: Literal["set_value"]
    name: Annotated[str, AfterValidator(_setting)]
    value: (
        Annotated[float, Field(ge=0, le=100_000)]
        | Annotated[str, Field(min_length=1, max_length=200)]
        | None
    )

    def _change(self, parts: Parts) -> None:
        name, value, values = self.name, self.value, parts.data
        section = _SECTION_OF[name]
        if value is not None:
            self._check(section)
        if section:
            if section in values and not isinstance(values[section], dict):
                raise EditError(f"{section} is empty in the file; write {section}.{name} by hand")
            if value is not None:
                values.setdefault(section, {})
            values = parts.at((section,)) if section in values else {}
        if value is None:
            values.pop(name, None)
        elif isinstance(value, str):
            values[name] = value
        else:
            values.setdefault(name, None)
            parts.put(values, name, metres(value))

    def _check(self, section: str) -> None:
        """The form of a mission file has the values that a setting may have."""
        kind = get_type_hints(_FORMS[section], include_extras=True)[self.name]
        try:
            TypeAdapter(kind).validate_python(self.value, strict=True)
        except ValidationError as error:
            why = error.errors(include_url=False, include_input=False)[0]["msg"]
            raise EditError(f"{self.name} cannot be '{self.value}': {why}") from None


class Seek(Edit):
    """Seek these robots, in this order."""

    label: ClassVar[str] = "whom to seek"
    in_plans: ClassVar[bool] = False
    do: Literal["seek"]
    robots: Annotated[
        tuple[Annotated[str, Field(min_length=1, max_length=80)], ...], Field(max_length=500)
    ]

    def _change(self, parts: Parts) -> None:
        """Write the list of robots, whatever stood there."""
        if not self.robots:
            raise EditError("a mission seeks at least one robot")
        seek = parts.data.get("seek")
        if isinstance(seek, str):
            seek = {"policy": seek}
        robots = [*self.robots]
        parts.data["seek"] = {**seek, "robots": robots} if isinstance(seek, dict) else robots


def _kinds(of: Any) -> Iterator[Any]:
    """All classes above that have a name."""
    for kind in of.__subclasses__():
        if "do" in kind.model_fields:
            yield kind
        else:
            yield from _kinds(kind)


_EDITS: Any = Union[tuple(_kinds(Edit))]  # noqa: UP007 - of a tuple that is made here
_ADAPTER: TypeAdapter[Edit] = TypeAdapter(Annotated[_EDITS, Field(discriminator="do")])


def read_edit(json: str) -> Edit:
    """An edit from JSON. Raises EditError."""
    try:
        return _ADAPTER.validate_json(json)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"])) or "the message"
        raise EditError(f"not an edit: {where}: {first['msg']}") from None
