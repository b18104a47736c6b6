"""Places a form, whatever file it was read from, in the mission's local frame."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final, TypeVar

from air_router.files import (
    Area,
    AreaForm,
    Findings,
    Keys,
    MissionForm,
    MissionPoint,
    PlacedForm,
    Placer,
    SpotForm,
    Uav,
    UavForm,
    WaypointForm,
)
from air_router.files.maps import zones_near
from geo.airspace import FENCE, Shape

_ORIGIN_M: Final = 50_000.0
"""Farther from its origin a frame is turned noticeably, and its distances are wrong."""

_POLAR_DEG, _POLAR_ORIGIN_M = 70.0, 20_000.0
"""Meridians draw together: so near to a pole a frame is turned as much nearer to its origin."""

Entry = TypeVar("Entry")


def place(form: MissionForm, findings: Findings) -> PlacedForm:
    """The form in its frame; what cannot be placed is reported, and left out."""
    placer = _placer(form, findings)
    if placer is None:
        return PlacedForm(form)
    home, uavs = None, tuple[Uav, ...]()
    if "home" not in form.unread:
        home = placer.spot("home", form.home.position, form.keys_of("home", "position"))
        _check_origin(home, placer)
        uavs = tuple(_uavs(form, placer))
    placed = PlacedForm(
        form,
        placer.frame,
        home,
        waypoints=tuple(_spots("waypoint", "waypoints", form.waypoints, form, placer)),
        rally_points=tuple(_spots("rally point", "rally_points", form.rally_points, form, placer)),
        fences=tuple(_fences(form, placer)),
        zones=tuple(_zones(form, placer)),
        uavs=uavs,
    )
    for number, listed in _right(form.no_fly_files):
        keys, file = form.keys_of("no_fly_files", number, "file"), form.path.parent / listed.file
        zones = zones_near(placed, file, keys, findings, allow=listed.allow, skip=listed.skip)
        placed = placed.with_zones(zones)
    return placed


def _placer(form: MissionForm, findings: Findings) -> Placer | None:
    """A frame around the origin or home; None, and reported, if neither says where it is."""
    if form.unread & {"frame", "coordinates"}:
        return None
    what, position = "home", form.home.position
    if form.frame is not None:
        what, position = "frame", form.frame.origin
        keys: Keys = ("frame", "origin")
    elif form.in_metres:
        findings.report(
            ("coordinates",),
            "local coordinates need to know where they are; add frame: {origin: [lat, lon]}",
            "frame-missing",
        )
        return None
    elif "home" not in form.unread:
        keys = form.keys_of("home", "position")
    elif right := next(_right(form.waypoints), None):
        what, position = "waypoints", right[1].position  # only to check the rest of the file
        keys = ("waypoints", right[0])
    else:
        return None
    advice = " (latitude comes first)" if form.in_own_keys else ""
    placer = Placer.around(what, position, keys, findings, advice)
    return placer and replace(placer, in_metres=form.in_metres)


def _right(entries: Iterable[Entry | None]) -> Iterator[tuple[int, Entry]]:
    """The entries of a list that are right, with their numbers from 0."""
    return ((i, entry) for i, entry in enumerate(entries) if entry is not None)


def _spots(
    label: str, section: str, forms: Iterable[SpotForm | None], form: MissionForm, placer: Placer
) -> Iterator[MissionPoint]:
    for number, given in _right(forms):
        altitude_m = given.altitude_m if isinstance(given, WaypointForm) else None
        keys = form.keys_of(section, number, "position")
        if spot := placer.spot(f"{label} {number + 1}", given.position, keys, altitude_m):
            yield spot


def _uavs(form: MissionForm, placer: Placer) -> Iterator[Uav]:
    if form.uav is not None and form.uavs:
        message = "'uav' and 'uavs' are given; keep one of them"
        placer.findings.report(("uavs",), message, "one-uav-key")
        return
    for name, given in form.uavs.items():
        uav, keys = given or UavForm(), ("uavs", name)
        home = None
        if uav.home is not None:
            home = placer.spot("home", uav.home.position, (*keys, "home", "position"))
        above_sea_m = None if uav.home is None else uav.home.altitude_amsl_m
        yield Uav(name, keys, uav.altitude_m, uav.explore, home, above_sea_m)


def _fences(form: MissionForm, placer: Placer) -> Iterator[Area]:
    given = {"fence", "fences"} & (form.model_fields_set | form.unread)
    if not given:
        message = (
            "missing key 'fence' (the area to stay in; 'fence: null' if there is none); add it"
        )
        placer.findings.report((), message, "missing-key")
    elif len(given) > 1:
        message = "'fence' and 'fences' are given; list all in 'fences'"
        placer.findings.report(("fences",), message, "one-fence-key")
    areas: list[tuple[AreaForm, Keys]] = [] if form.fence is None else [(form.fence, ("fence",))]
    areas += [(area, ("fences", number)) for number, area in _right(form.fences)]
    for area, way in areas:
        if shape := _shape(area, "the fence", way, form, placer):
            yield Area(FENCE, shape, form.keys_of(*way))


def _zones(form: MissionForm, placer: Placer) -> Iterator[Area]:
    for number, zone in _right(form.no_fly_zones):
        name, way = zone.name or f"zone {number + 1}", ("no_fly_zones", number)
        if shape := _shape(zone, f"no-fly zone '{name}'", way, form, placer):
            yield Area(name, shape, form.keys_of(*way), zone.crosses_fence, zone.terms())


def _check_origin(home: MissionPoint | None, placer: Placer) -> None:
    """Far from its origin a frame's distances are wrong, and its north is not north."""
    far_m = 0.0 if home is None else math.hypot(*home.position)
    polar = abs(placer.frame.origin.latitude_deg) > _POLAR_DEG
    if far_m > (_POLAR_ORIGIN_M if polar else _ORIGIN_M):
        message = f"the frame's origin is {far_m / 1000:.0f} km from home; put it near home"
        placer.findings.report(("frame", "origin"), message, "far-from-home")


def _shape(area: AreaForm, name: str, way: Keys, form: MissionForm, placer: Placer) -> Shape | None:
    """The shape of an area of the form, which stands at `way` in it."""
    circle, polygon, holes = (form.keys_of(*way, part) for part in ("circle", "polygon", "holes"))
    if area.circle is not None:
        return placer.circle(name, area.circle.centre, area.circle.radius_m, circle)
    return placer.polygon(name, area.polygon or [], polygon, area.holes, holes)
