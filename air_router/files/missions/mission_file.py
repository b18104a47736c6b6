"""Reads mission files in YAML. The format is described in docs/mission-file.md."""

import copy
import json
import math
from typing import Any

from pydantic import ValidationError

from air_router.files.maps.zone_files import add_zones
from air_router.files.mission_document import Area, Keys, MissionDocument, Uav
from air_router.files.missions.mission_form import (
    AreaForm,
    MissionForm,
)
from air_router.files.settings import PlannerSettings, Timers
from geo.airspace.airspace import FENCE
from geo.airspace.zone import Shape
from mocha_link.team.document import Document, DocumentError

_ORIGIN_M = 50_000.0
"""Farther from its origin a frame is turned noticeably, and its distances are wrong."""

_POLAR_DEG, _POLAR_ORIGIN_M = 70.0, 20_000.0
"""Meridians draw together: so near to a pole a frame is turned as much nearer to its origin."""

_LISTS = {
    "waypoints": "position",
    "fences": "polygon",
    "no_fly_zones": "polygon",
    "no_fly_files": "file",
    "rally_points": "position",
}
"""Sections that are lists, and what a bare list (of files, a bare path) in them is short for."""

_STAND_INS: dict[str, Any] = {
    "home": {"position": [0.0, 0.0]},
    "altitude_m": 1.0,
    "waypoints": [],
    "no_fly_zones": [],
}
"""For mandatory sections that are missing or unreadable, so that the others are still checked."""


def read_mission(document: Document) -> MissionDocument:
    """A draft of the mission that a YAML document describes.

    Problems of the form are collected in the draft beside whatever could be read all the same,
    so that one look at a file tells everything that is wrong with it.
    """
    draft = MissionDocument(document)
    if not isinstance(document.data, dict):
        message = "a mission is a mapping of keys and values; see docs/mission-file.md"
        draft.report((), message, "no-mission")
        return draft
    if {"robots", "kinds"} <= document.data.keys() and "waypoints" not in document.data:
        message = "this is a team file: name the mission, which says 'team: ...' for this file"
        draft.report((), message, "no-mission")
        return draft
    data = _written_out(document.data)
    places = {name: list(range(_length(data, name))) for name in _LISTS}
    try:
        written_out = Document(document.path, document.node(), data)
        model: MissionForm | None = written_out.parse(MissionForm)
    except DocumentError as error:
        draft.problems.extend(error.problems)
        model = _salvaged(data, draft, places)
    if model is not None:
        _fill(draft, model, places)
    return draft


def _written_out(short: dict[Any, Any]) -> dict[Any, Any]:
    """Short forms in the long one: a bare pair is a position, a bare list a polygon."""
    data = {**short}
    for kind, key in ((list, "robots"), (str, "policy")):
        if isinstance(data.get("seek"), kind):
            data["seek"] = {key: data["seek"]}
    for name, key in (("home", "position"), ("fence", "polygon")):
        if isinstance(data.get(name), list):
            data[name] = {key: data[name]}
    if isinstance(data.get("uavs"), dict):
        data["uavs"] = {name: _uav_written_out(uav) for name, uav in data["uavs"].items()}
    for name, key in _LISTS.items():
        bare = str if key == "file" else list
        if isinstance(data.get(name), list):
            data[name] = [{key: item} if isinstance(item, bare) else item for item in data[name]]
    return data


def _uav_written_out(uav: Any) -> Any:
    if isinstance(uav, dict) and isinstance(uav.get("home"), list):
        return {**uav, "home": {"position": uav["home"]}}
    return {} if uav is None else uav


def _length(data: dict[Any, Any], name: str) -> int:
    value = data.get(name)
    return len(value) if isinstance(value, list) else 0


def _salvaged(
    original: dict[Any, Any], draft: MissionDocument, places: dict[str, list[int]]
) -> MissionForm | None:
    """What is left of a mission when the parts that are wrong are taken out of it."""
    data = copy.deepcopy(original)
    for _ in range(3):  # taking a part out may uncover a problem of what it was in
        try:
            return MissionForm.model_validate_json(json.dumps(data), strict=True, extra="forbid")
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
        if key not in (data if isinstance(data, dict) else range(len(data))):
            return  # it went with the section that it is in
        data = data[key]
    data.pop(next((key for key in data if str(key) == keys[-1]), None), None)


def _fill(draft: MissionDocument, model: MissionForm, places: dict[str, list[int]]) -> None:
    draft.name = model.name or draft.source.path.resolve().parent.name
    draft.altitude_m, draft.speed_m_s = model.altitude_m, model.speed_m_s
    draft.timers = Timers(**model.timers.model_dump())
    draft.planner = PlannerSettings(**model.planner.model_dump())
    draft.uav = model.uav
    draft.seek, draft.seek_policy = tuple(model.seek.robots), model.seek.policy
    draft.goals_from = tuple(model.goals_from)
    folder = draft.source.path.parent
    draft.team = None if model.team is None else folder / model.team
    draft.world = None if model.world is None else folder / model.world
    draft.duration_s, draft.endurance_s = model.duration_s, model.endurance_s
    draft.battery_reserve = model.battery_reserve
    draft.accepts = tuple(model.accepts)
    draft.home_altitude_amsl_m = model.home.altitude_amsl_m
    draft.in_metres = model.coordinates == "local"
    _fill_frame(draft, model)
    if draft.frame is None:
        return
    if "home" not in draft.unread:
        draft.home = draft.spot("home", model.home.position, ("home", "position"))
        _check_origin(draft)
        _fill_uavs(draft, model)
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
    _fill_fences(draft, model, places["fences"])
    for index, zone in zip(places["no_fly_zones"], model.no_fly_zones, strict=True):
        keys = ("no_fly_zones", index)
        name = zone.name or f"zone {index + 1}"
        shape = _shape(draft, zone, f"no-fly zone '{name}'", keys)
        if shape:
            crosses = zone.crosses_fence
            draft.zones.append(Area(name, shape, keys, crosses_fence=crosses, terms=zone.terms()))
    for index, listed in zip(places["no_fly_files"], model.no_fly_files, strict=True):
        add_zones(draft, folder / listed.file, ("no_fly_files", index, "file"), listed.allow)


def _fill_uavs(draft: MissionDocument, model: MissionForm) -> None:
    if model.uav is not None and model.uavs:
        message = "'uav' and 'uavs' are given; keep one of them"
        draft.report(("uavs",), message, "one-uav-key")
        return
    uavs = []
    for name, uav in model.uavs.items():
        keys: Keys = ("uavs", name)
        home = None
        if uav.home is not None:
            home = draft.spot("home", uav.home.position, (*keys, "home", "position"))
        above_sea_m = None if uav.home is None else uav.home.altitude_amsl_m
        uavs.append(Uav(name, keys, uav.altitude_m, uav.explore, home, above_sea_m))
    draft.uavs = tuple(uavs)


def _fill_fences(draft: MissionDocument, model: MissionForm, places: list[int]) -> None:
    given = {"fence", "fences"} & (model.model_fields_set | draft.unread)
    if not given:
        message = (
            "missing key 'fence' (the area to stay in; 'fence: null' if there is none); add it"
        )
        draft.report((), message, "missing-key")
    elif len(given) > 1:
        draft.report(
            ("fences",), "'fence' and 'fences' are given; list all in 'fences'", "one-fence-key"
        )
    areas: list[tuple[AreaForm, Keys]] = [] if model.fence is None else [(model.fence, ("fence",))]
    areas += [(area, ("fences", i)) for i, area in zip(places, model.fences, strict=True)]
    for area, keys in areas:
        shape = _shape(draft, area, "the fence", keys)
        if shape is None:
            draft.unread.add("fence")
        else:
            draft.fences.append(Area(FENCE, shape, keys))


def _fill_frame(draft: MissionDocument, model: MissionForm) -> None:
    keys: Keys
    if draft.unread & {"frame", "coordinates"}:
        return
    if model.frame is not None:
        origin, keys = model.frame.origin, ("frame", "origin")
    elif draft.in_metres:
        draft.report(
            ("coordinates",),
            "local coordinates need to know where they are; add frame: {origin: [lat, lon]}",
            "frame-missing",
        )
        return
    elif "home" not in draft.unread:
        origin, keys = model.home.position, ("home", "position")
    elif model.waypoints:  # only to look at the rest of a file whose home is wrong
        origin, keys = model.waypoints[0].position, ("waypoints", 0)
    else:
        return
    draft.find_frame(str(keys[0]), origin, keys, " (latitude comes first)")


def _check_origin(draft: MissionDocument) -> None:
    """Far from its origin a frame's distances are wrong, and its north is not north."""
    far_m = 0.0 if draft.home is None else math.hypot(*draft.home.position)
    polar = draft.frame is not None and abs(draft.frame.origin.latitude_deg) > _POLAR_DEG
    if far_m > (_POLAR_ORIGIN_M if polar else _ORIGIN_M):
        message = f"the frame's origin is {far_m / 1000:.0f} km from home; put it near home"
        draft.report(("frame", "origin"), message, "far-from-home")


def _shape(draft: MissionDocument, area: AreaForm, name: str, keys: Keys) -> Shape | None:
    if area.circle is not None:
        return draft.circle(name, area.circle.centre, area.circle.radius_m, (*keys, "circle"))
    corners, holes = area.polygon or [], area.holes
    return draft.polygon(name, corners, (*keys, "polygon"), holes, (*keys, "holes"))
