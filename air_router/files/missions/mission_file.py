"""Reads mission files in YAML. The format is described in docs/mission-file.md."""

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import fields
from typing import Any, Final, TypeVar

from pydantic import ValidationError, ValidationInfo, ValidatorFunctionWrapHandler, field_validator

from air_router.files import (
    MISSION,
    Area,
    AreaForm,
    Keys,
    MissionDocument,
    MissionForm,
    MissionPoint,
    SpotForm,
    Uav,
    UavForm,
    WaypointForm,
    notes,
)
from air_router.files.maps import add_zones
from air_router.files.missions.mission_mistakes import (
    empty_notes,
    explained_mission,
    other_kind,
)
from geo.airspace import FENCE, Shape
from mocha_link.team import Document, DocumentError

_ORIGIN_M = 50_000.0
"""Farther from its origin a frame is turned noticeably, and its distances are wrong."""

_POLAR_DEG, _POLAR_ORIGIN_M = 70.0, 20_000.0
"""Meridians draw together: so near to a pole a frame is turned as much nearer to its origin."""

_LISTS = ("waypoints", "fences", "no_fly_zones", "no_fly_files", "rally_points")
"""Sections of which what is right is read, whatever is wrong with other entries."""

_STAND_INS: dict[str, Any] = {
    "home": {"position": [0.0, 0.0]},
    "altitude_m": 1.0,
    "waypoints": [],
    "no_fly_zones": [],
}
"""For mandatory sections that are missing or unreadable, so that the others are still checked."""

_MADE: Final = frozenset(
    {"name", "altitudes_m", "seek", "team", "world", "frame", "home", "uavs"}
    | {"waypoints", "rally_points", "fences"}
)
"""What a draft has under the name of a form's, but not as it stands there."""

_UNCHANGED: Final = (
    MissionForm.model_fields.keys() & {field.name for field in fields(MissionDocument)} - _MADE
)
"""What a draft takes from the form as it is."""

Entry = TypeVar("Entry")


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
    if other := other_kind(document.data, "mission"):
        message = f"this is {other}: name the mission, which says the path of this file"
        draft.report((), message, "no-mission")
        return draft
    try:
        form = document.parse(MissionForm)
    except DocumentError as error:
        draft.problems.extend(explained_mission(error, document).problems)
        draft.unread |= _STAND_INS.keys() - document.data.keys()
        text = json.dumps({**_STAND_INS, **document.data})
        form = _RightParts.model_validate_json(
            text, strict=True, extra="ignore", context=draft.unread
        )
    refused = {problem.keys for problem in draft.problems}
    noted = (*empty_notes(document), *notes(document, MISSION))
    draft.notes += [note for note in noted if note.keys not in refused]
    _fill(draft, form)
    return draft


class _RightParts(MissionForm):
    """A mission without the parts that are wrong; the context takes the names of such sections.

    An entry of a list that is wrong is None.
    """

    @field_validator("*", mode="wrap")
    @classmethod
    def _right(cls, value: Any, read: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        try:
            return read(value)
        except ValidationError as error:
            wrong = {detail["loc"][0] if detail["loc"] else None for detail in error.errors()}
        name = str(info.field_name)
        if name in _LISTS and None not in wrong:
            right = iter(read([entry for i, entry in enumerate(value) if i not in wrong]))
            return [None if i in wrong else next(right) for i in range(len(value))]
        if info.context is not None:
            info.context.add(name)
        return read(_STAND_INS.get(name, cls.model_fields[name].get_default()))


def _fill(draft: MissionDocument, form: MissionForm) -> None:
    for name in _UNCHANGED:
        value = getattr(form, name)
        setattr(draft, name, tuple(value) if isinstance(value, list) else value)
    folder = draft.source.path.parent
    draft.name = form.name or draft.source.path.resolve().parent.name
    draft.altitudes_m = tuple(form.altitudes_m or ())
    draft.seek, draft.seek_policy = tuple(form.seek.robots), form.seek.policy
    draft.team = None if form.team is None else folder / form.team
    draft.world = None if form.world is None else folder / form.world
    draft.home_altitude_amsl_m = form.home.altitude_amsl_m
    draft.in_metres = form.coordinates == "local"
    _fill_frame(draft, form)
    if draft.frame is None:
        return
    if "home" not in draft.unread:
        draft.home = draft.spot("home", form.home.position, ("home", "position"))
        _check_origin(draft)
        _fill_uavs(draft, form)
    draft.waypoints = _spots(draft, "waypoint", "waypoints", form.waypoints)
    draft.rally_points = _spots(draft, "rally point", "rally_points", form.rally_points)
    _fill_fences(draft, form)
    for keys, zone in _right("no_fly_zones", form.no_fly_zones):
        name = zone.name or f"zone {keys[1] + 1}"
        shape = _shape(draft, zone, f"no-fly zone '{name}'", keys)
        if shape:
            crosses = zone.crosses_fence
            draft.zones.append(Area(name, shape, keys, crosses_fence=crosses, terms=zone.terms()))
    for keys, listed in _right("no_fly_files", form.no_fly_files):
        add_zones(draft, folder / listed.file, (*keys, "file"), listed.allow, listed.skip)


def _right(
    section: str, entries: Iterable[Entry | None]
) -> Iterator[tuple[tuple[str, int], Entry]]:
    """The entries of a list that are right, with their keys."""
    return (((section, i), entry) for i, entry in enumerate(entries) if entry is not None)


def _spots(
    draft: MissionDocument, label: str, section: str, forms: Iterable[SpotForm | None]
) -> list[MissionPoint]:
    spots = []
    for keys, form in _right(section, forms):
        altitude_m = form.altitude_m if isinstance(form, WaypointForm) else None
        named = f"{label} {keys[1] + 1}"
        spots.append(draft.spot(named, form.position, (*keys, "position"), altitude_m))
    return [spot for spot in spots if spot is not None]


def _fill_uavs(draft: MissionDocument, form: MissionForm) -> None:
    if form.uav is not None and form.uavs:
        message = "'uav' and 'uavs' are given; keep one of them"
        draft.report(("uavs",), message, "one-uav-key")
        return
    uavs = []
    for name, given in form.uavs.items():
        uav, keys = given or UavForm(), ("uavs", name)
        home = None
        if uav.home is not None:
            home = draft.spot("home", uav.home.position, (*keys, "home", "position"))
        above_sea_m = None if uav.home is None else uav.home.altitude_amsl_m
        uavs.append(Uav(name, keys, uav.altitude_m, uav.explore, home, above_sea_m))
    draft.uavs = tuple(uavs)


def _fill_fences(draft: MissionDocument, form: MissionForm) -> None:
    given = {"fence", "fences"} & (form.model_fields_set | draft.unread)
    if not given:
        message = (
            "missing key 'fence' (the area to stay in; 'fence: null' if there is none); add it"
        )
        draft.report((), message, "missing-key")
    elif len(given) > 1:
        draft.report(
            ("fences",), "'fence' and 'fences' are given; list all in 'fences'", "one-fence-key"
        )
    areas: list[tuple[AreaForm, Keys]] = [] if form.fence is None else [(form.fence, ("fence",))]
    areas += [(area, keys) for keys, area in _right("fences", form.fences)]
    for area, keys in areas:
        shape = _shape(draft, area, "the fence", keys)
        if shape is None:
            draft.unread.add("fence")
        else:
            draft.fences.append(Area(FENCE, shape, keys))


def _fill_frame(draft: MissionDocument, form: MissionForm) -> None:
    keys: Keys
    if draft.unread & {"frame", "coordinates"}:
        return
    if form.frame is not None:
        origin, keys = form.frame.origin, ("frame", "origin")
    elif draft.in_metres:
        draft.report(
            ("coordinates",),
            "local coordinates need to know where they are; add frame: {origin: [lat, lon]}",
            "frame-missing",
        )
        return
    elif "home" not in draft.unread:
        origin, keys = form.home.position, ("home", "position")
    elif right := next(_right("waypoints", form.waypoints), None):
        keys, origin = right[0], right[1].position  # only to look at the rest of the file
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
