"""Reads mission files in YAML. The format is described in docs/mission-file.md."""

from __future__ import annotations

import copy
import json
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, Field, ValidationError, model_validator

from air_router.draft import Area, Draft, Keys
from air_router.settings import (
    DEFAULT_BATTERY_RESERVE,
    DEFAULT_SPEED_M_S,
    PlannerKind,
    PlannerSettings,
    Timers,
)
from geo.airspace import FENCE
from geo.frame import FrameError, Geodetic, LocalFrame
from geo.zone import Ring
from mocha_link.document import Document, DocumentError

_Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
_Seconds = Annotated[float, Field(gt=0, le=86_400)]
_Metres = Annotated[float, Field(gt=0, le=10_000)]
_Altitude = Annotated[float, Field(gt=0, le=10_000, description="metres above home")]
_TIMERS, _PLANNER = Timers(), PlannerSettings()


class _Circle(BaseModel):
    centre: Annotated[_Pair, Field(description="[latitude, longitude] in degrees")]
    radius_m: _Metres


class _Area(BaseModel):
    polygon: list[_Pair] | None = None
    circle: _Circle | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.polygon is None) == (self.circle is None):
            raise ValueError("an area needs either 'polygon' or 'circle'; write exactly one")
        return self


class _Zone(_Area):
    name: str | None = None
    crosses_fence: bool = False


class _Spot(BaseModel):
    position: Annotated[_Pair, Field(description="[latitude, longitude] in degrees")]


class _Waypoint(_Spot):
    altitude_m: _Altitude | None = None


class _Home(_Spot):
    altitude_amsl_m: Annotated[float, Field(ge=-500, le=9_000)] | None = None


class _Frame(BaseModel):
    origin: Annotated[_Pair, Field(description="[latitude, longitude] in degrees")]


class _Timers(BaseModel):
    init_s: _Seconds = _TIMERS.init_s
    explore_s: _Seconds = _TIMERS.explore_s
    search_s: _Seconds = _TIMERS.search_s
    communicate_s: _Seconds = _TIMERS.communicate_s


class _Planner(BaseModel):
    clearance_m: Annotated[float, Field(ge=0, le=1_000)] = _PLANNER.clearance_m
    tracking_margin_m: Annotated[float, Field(ge=0, le=1_000)] = _PLANNER.tracking_margin_m
    max_edge_m: _Metres = _PLANNER.max_edge_m
    acceptance_radius_m: Annotated[float, Field(ge=0.5, le=20)] = _PLANNER.acceptance_radius_m
    kind: PlannerKind = _PLANNER.kind


class _Mission(BaseModel):
    name: str | None = None
    coordinates: Literal["degrees", "local"] = "degrees"
    frame: _Frame | None = None
    home: Annotated[_Home, Field(description="where the vehicle takes off and lands")]
    altitude_m: _Altitude
    speed_m_s: Annotated[float, Field(gt=0, le=50)] = DEFAULT_SPEED_M_S
    waypoints: Annotated[list[_Waypoint], Field(description="what to explore, in order")]
    fence: Annotated[
        _Area | None, Field(description="the area to stay in; 'fence: null' if there is none")
    ]
    no_fly_zones: Annotated[
        list[_Zone], Field(description="areas to stay out of; 'no_fly_zones: []' if there are none")
    ]
    rally_points: list[_Spot] = []
    timers: _Timers = _Timers()
    planner: _Planner = _Planner()
    uav: str | None = None
    seek: list[str] = []
    team: str | None = None
    world: str | None = None
    duration_s: _Seconds | None = None
    battery_reserve: Annotated[float, Field(ge=0, lt=1)] = DEFAULT_BATTERY_RESERVE


_LISTS = ("waypoints", "no_fly_zones", "rally_points")
_STAND_INS: dict[str, Any] = {
    "home": {"position": [0.0, 0.0]},
    "altitude_m": 1.0,
    "waypoints": [],
    "fence": None,
    "no_fly_zones": [],
}
"""For mandatory sections that are missing or unreadable, so that the others are still checked."""


def read_mission(document: Document) -> Draft:
    """A draft of the mission that a YAML document describes.

    Problems of the form are collected in the draft beside whatever could be read all the same,
    so that one look at a file tells everything that is wrong with it.
    """
    draft = Draft(document)
    if not isinstance(document.data, dict):
        draft.complain((), "a mission is a mapping of keys and values; see docs/mission-file.md")
        return draft
    _write_out(document.data)
    places = {name: list(range(_length(document.data, name))) for name in _LISTS}
    try:
        model: _Mission | None = document.parse(_Mission)
    except DocumentError as error:
        draft.problems.extend(error.problems)
        model = _salvaged(document.data, draft, places)
    if model is not None:
        _fill(draft, model, places)
    return draft


def _write_out(data: dict[Any, Any]) -> None:
    """Bring short forms into the long one: a bare pair is a position, a bare list a polygon."""
    for name, key in (("home", "position"), ("fence", "polygon")):
        if isinstance(data.get(name), list):
            data[name] = {key: data[name]}
    for name, key in zip(_LISTS, ("position", "polygon", "position"), strict=True):
        if isinstance(data.get(name), list):
            data[name] = [{key: item} if isinstance(item, list) else item for item in data[name]]


def _length(data: dict[Any, Any], name: str) -> int:
    value = data.get(name)
    return len(value) if isinstance(value, list) else 0


def _salvaged(
    original: dict[Any, Any], draft: Draft, places: dict[str, list[int]]
) -> _Mission | None:
    """What is left of a mission when the parts that are wrong are taken out of it."""
    data = copy.deepcopy(original)
    for _ in range(3):  # taking a part out may uncover a problem of what it was in
        try:
            return _Mission.model_validate_json(json.dumps(data), strict=True, extra="forbid")
        except ValidationError as error:
            details = error.errors(include_url=False)
        entries: set[tuple[str, int]] = set()
        for detail in details:
            section, *rest = detail["loc"]
            if detail["type"] == "extra_forbidden":
                _drop(data, detail["loc"])
            elif section in _LISTS and rest and isinstance(rest[0], int):
                entries.add((str(section), rest[0]))
            else:
                draft.unread.add(str(section))
                data.pop(section, None)
                if section in _STAND_INS:
                    data[section] = copy.deepcopy(_STAND_INS[str(section)])
        for name, index in sorted(entries, reverse=True):
            del data[name][index], places[name][index]
    return None


def _drop(data: Any, keys: tuple[str | int, ...]) -> None:
    for key in keys[:-1]:
        data = data[key]
    data.pop(next((key for key in data if str(key) == keys[-1]), None), None)


def _fill(draft: Draft, model: _Mission, places: dict[str, list[int]]) -> None:
    draft.name = model.name or draft.document.path.resolve().parent.name
    draft.altitude_m, draft.speed_m_s = model.altitude_m, model.speed_m_s
    draft.timers = Timers(**model.timers.model_dump())
    draft.planner = PlannerSettings(**model.planner.model_dump())
    draft.uav, draft.seek = model.uav, tuple(model.seek)
    folder = draft.document.path.parent
    draft.team = None if model.team is None else folder / model.team
    draft.world = None if model.world is None else folder / model.world
    draft.duration_s, draft.battery_reserve = model.duration_s, model.battery_reserve
    draft.home_altitude_amsl_m = model.home.altitude_amsl_m
    draft.in_metres = model.coordinates == "local"
    _fill_frame(draft, model)
    if draft.frame is None:
        return
    if "home" not in draft.unread:
        draft.home = draft.spot("home", model.home.position, ("home", "position"))
    keys: Keys
    for index, waypoint in zip(places["waypoints"], model.waypoints, strict=True):
        keys = ("waypoints", index, "position")
        altitude_m = waypoint.altitude_m
        spot = draft.spot(f"waypoint {index + 1}", waypoint.position, keys, altitude_m)
        draft.waypoints += [spot] if spot else []
    for index, rally_point in zip(places["rally_points"], model.rally_points, strict=True):
        keys = ("rally_points", index, "position")
        spot = draft.spot(f"rally point {index + 1}", rally_point.position, keys)
        draft.rally_points += [spot] if spot else []
    if model.fence is not None:
        ring = _ring(draft, model.fence, "the fence", ("fence",))
        draft.fence = Area(FENCE, ring, ("fence",)) if ring else None
        if ring is None:
            draft.unread.add("fence")
    for index, zone in zip(places["no_fly_zones"], model.no_fly_zones, strict=True):
        keys = ("no_fly_zones", index)
        name = zone.name or f"zone {index + 1}"
        ring = _ring(draft, zone, f"no-fly zone '{name}'", keys)
        draft.zones += [Area(name, ring, keys, zone.crosses_fence)] if ring else []


def _fill_frame(draft: Draft, model: _Mission) -> None:
    keys: Keys
    if draft.unread & {"frame", "coordinates"}:
        return
    if model.frame is not None:
        origin, keys = model.frame.origin, ("frame", "origin")
    elif draft.in_metres:
        draft.complain(
            ("coordinates",),
            "local coordinates need to know where they are; add frame: {origin: [lat, lon]}",
        )
        return
    elif "home" not in draft.unread:
        origin, keys = model.home.position, ("home", "position")
    elif model.waypoints:  # only to look at the rest of a file whose home is wrong
        origin, keys = model.waypoints[0].position, ("waypoints", 0)
    else:
        return
    try:
        draft.frame = LocalFrame(Geodetic(*origin))
    except FrameError as error:
        draft.complain(keys, f"{keys[0]}: {error}; correct it (latitude comes first)")


def _ring(draft: Draft, area: _Area, name: str, keys: Keys) -> Ring | None:
    if area.circle is not None:
        centre, radius_m = area.circle.centre, area.circle.radius_m
        zone = keys != ("fence",)
        return draft.circle(name, centre, radius_m, (*keys, "circle"), zone=zone)
    return draft.polygon(name, area.polygon or [], (*keys, "polygon"))
