"""The form of a mission, whatever file it was read from, placed in the mission's local frame."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Final, TypeVar

from air_router.files import (
    Area,
    AreaForm,
    HomeForm,
    Keys,
    MissionDocument,
    MissionForm,
    MissionPoint,
    SpotForm,
    Uav,
    UavForm,
    WaypointForm,
)
from air_router.files.maps import add_zones
from geo.airspace import FENCE, Shape

_ORIGIN_M: Final = 50_000.0
"""Farther from its origin a frame is turned noticeably, and its distances are wrong."""

_POLAR_DEG, _POLAR_ORIGIN_M = 70.0, 20_000.0
"""Meridians draw together: so near to a pole a frame is turned as much nearer to its origin."""

_MADE: Final = frozenset(
    {"name", "altitudes_m", "seek", "team", "world", "frame", "home", "uavs"}
    | {"waypoints", "rally_points", "fences"}
)
"""What a draft has under the name of a form's, but not as it stands there."""

_UNCHANGED: Final = (
    MissionForm.model_fields.keys() & {field.name for field in fields(MissionDocument)} - _MADE
)
"""Fields that a draft takes unchanged from the form."""

Entry = TypeVar("Entry")


@dataclass(frozen=True, slots=True)
class FormPlaces:
    """Where the values of a form stand in its file.

    Attributes:
        known: The keys of a value in the file, by those in the form. A part of such a value has the
            name of its own behind them; other parts stand under the keys of the form.
    """

    known: Mapping[Keys, Keys] = field(default_factory=dict)

    def of(self, *keys: str | int) -> Keys:
        """The place of a value."""
        found = self.known.get(keys)
        if found is None and keys[:-1] in self.known:
            found = (*self.known[keys[:-1]], keys[-1])
        return keys if found is None else found


AS_FORM: Final = FormPlaces()


def place_form(draft: MissionDocument, form: MissionForm, places: FormPlaces = AS_FORM) -> None:
    """Fill a draft from a form; what cannot be placed has its problem noted.

    Args:
        draft: Takes all; `unread` names the sections of the form that are placeholders.
        form: The contents of the file; an entry of a list that could not be read is None.
        places: Where each value of it stands.
    """
    place_home(draft, form, places)
    if draft.frame is None:
        return
    if "home" not in draft.unread:
        _check_origin(draft)
        _place_uavs(draft, form)
    draft.waypoints = _spots(draft, "waypoint", "waypoints", form.waypoints, places)
    draft.rally_points = _spots(draft, "rally point", "rally_points", form.rally_points, places)
    _place_fences(draft, form, places)
    for number, zone in _right(form.no_fly_zones):
        name, way = zone.name or f"zone {number + 1}", ("no_fly_zones", number)
        shape, keys = _shape(draft, zone, f"no-fly zone '{name}'", way, places), places.of(*way)
        if shape:
            crosses = zone.crosses_fence
            draft.zones.append(Area(name, shape, keys, crosses_fence=crosses, terms=zone.terms()))
    for number, listed in _right(form.no_fly_files):
        keys = places.of("no_fly_files", number, "file")
        add_zones(draft, draft.source.path.parent / listed.file, keys, listed.allow, listed.skip)


def place_home(draft: MissionDocument, form: MissionForm, places: FormPlaces = AS_FORM) -> None:
    """Fill a draft with what has no place, its frame, and home."""
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
    if draft.frame is None:
        _lay_frame(draft, form, places)
    if draft.frame is not None and draft.home is None and "home" not in draft.unread:
        draft.home = draft.spot("home", form.home.position, places.of("home", "position"))


@dataclass(slots=True)
class FileForm:
    """The form of a mission from another program's file, while it is read.

    Attributes:
        values: By the form's keys.
        places: The keys of a value in the file, by those in the form.
    """

    values: dict[str, Any] = field(default_factory=dict)
    places: dict[Keys, Keys] = field(default_factory=dict)

    def put(self, key: str, value: Any) -> None:
        """Set a value."""
        self.values[key] = value

    def set_home(
        self, position: Sequence[float], keys: Keys, altitude_amsl_m: float | None = None
    ) -> None:
        """Set home, and where it stands."""
        self.values["home"] = HomeForm.model_construct(
            position=list(position), altitude_amsl_m=altitude_amsl_m
        )
        self.places["home", "position"] = keys

    def append(self, section: str, value: Any, /, **places: Keys) -> None:
        """Add an entry to a list, with the places of its parts; `entry` is its own."""
        entries = self.values.setdefault(section, [])
        for part, keys in places.items():
            way = (section, len(entries))
            self.places[way if part == "entry" else (*way, part)] = keys
        entries.append(value)

    def place_home(self, draft: MissionDocument) -> None:
        """Fill a draft with all that has no place, with its frame and home."""
        place_home(draft, self._form(), FormPlaces(self.places))

    def place(self, draft: MissionDocument) -> None:
        """Fill a draft with everything."""
        place_form(draft, self._form(), FormPlaces(self.places))

    def _form(self) -> MissionForm:
        """The form, without its limits: they are those of our files."""
        empty: dict[str, Any] = {"altitude_m": 0.0, "speed_m_s": 0.0}
        empty |= {"waypoints": [], "no_fly_zones": [], "fences": []}
        return MissionForm.model_construct(**(empty | self.values))


def _right(entries: Iterable[Entry | None]) -> Iterator[tuple[int, Entry]]:
    """The entries of a list that are right, with their numbers from 0."""
    return ((i, entry) for i, entry in enumerate(entries) if entry is not None)


def _spots(
    draft: MissionDocument,
    label: str,
    section: str,
    forms: Iterable[SpotForm | None],
    places: FormPlaces,
) -> list[MissionPoint]:
    spots = []
    for number, form in _right(forms):
        altitude_m = form.altitude_m if isinstance(form, WaypointForm) else None
        keys = places.of(section, number, "position")
        spots.append(draft.spot(f"{label} {number + 1}", form.position, keys, altitude_m))
    return [spot for spot in spots if spot is not None]


def _place_uavs(draft: MissionDocument, form: MissionForm) -> None:
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


def _place_fences(draft: MissionDocument, form: MissionForm, places: FormPlaces) -> None:
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
    areas += [(area, ("fences", number)) for number, area in _right(form.fences)]
    for area, way in areas:
        shape = _shape(draft, area, "the fence", way, places)
        if shape:
            draft.fences.append(Area(FENCE, shape, places.of(*way)))


def _lay_frame(draft: MissionDocument, form: MissionForm, places: FormPlaces) -> None:
    if draft.unread & {"frame", "coordinates"}:
        return
    what, position = "home", form.home.position
    if form.frame is not None:
        what, position = "frame", form.frame.origin
        keys: Keys = ("frame", "origin")
    elif draft.in_metres:
        draft.report(
            ("coordinates",),
            "local coordinates need to know where they are; add frame: {origin: [lat, lon]}",
            "frame-missing",
        )
        return
    elif "home" not in draft.unread:
        keys = places.of("home", "position")
    elif right := next(_right(form.waypoints), None):
        what, position = "waypoints", right[1].position  # only to check the rest of the file
        keys = ("waypoints", right[0])
    else:
        return
    advice = " (latitude comes first)" if places is AS_FORM else ""
    draft.find_frame(what, position, keys, advice)


def _check_origin(draft: MissionDocument) -> None:
    """Far from its origin a frame's distances are wrong, and its north is not north."""
    far_m = 0.0 if draft.home is None else math.hypot(*draft.home.position)
    polar = draft.frame is not None and abs(draft.frame.origin.latitude_deg) > _POLAR_DEG
    if far_m > (_POLAR_ORIGIN_M if polar else _ORIGIN_M):
        message = f"the frame's origin is {far_m / 1000:.0f} km from home; put it near home"
        draft.report(("frame", "origin"), message, "far-from-home")


def _shape(
    draft: MissionDocument, area: AreaForm, name: str, way: Keys, places: FormPlaces
) -> Shape | None:
    """The shape of an area of the form, which stands at `way` in it."""
    circle, polygon, holes = (places.of(*way, part) for part in ("circle", "polygon", "holes"))
    if area.circle is not None:
        return draft.circle(name, area.circle.centre, area.circle.radius_m, circle)
    return draft.polygon(name, area.polygon or [], polygon, area.holes, holes)
