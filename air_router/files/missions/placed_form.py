"""A form in the mission's local frame: where all is that it names, each part with its keys.

What could not be placed is missing here, and among the findings. Positions are metres east and
north of the frame's origin, altitudes metres above home.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypeVar

from air_router.files import (
    LARGEST_RADIUS_M,
    Area,
    AreaForm,
    Findings,
    Keys,
    MissionForm,
    RefusedRing,
    SpotForm,
    UavForm,
    WaypointForm,
    is_file,
)
from air_router.files.maps import Surroundings, read_zones, zones_near
from geo.airspace import FENCE, Band, Circle, Outline, Ring, Shape, ZoneError
from geo.frame import FrameError, Geodetic, LocalFrame, Point, local_ring
from mocha_link.team import DocumentError, path_advice

_EARTH_M = 2e7
"""No two places are farther from each other."""

_MOST_KEPT: Final = 2_000
"""Outlines that were found to be areas: an edit changes one and leaves the rest."""

_ORIGIN_M: Final = 50_000.0
"""Farther from its origin a frame is turned noticeably, and its distances are wrong."""

_POLAR_DEG, _POLAR_ORIGIN_M = 70.0, 20_000.0
"""Meridians draw together: so near to a pole a frame is turned as much nearer to its origin."""

Entry = TypeVar("Entry")

_outline = lru_cache(maxsize=_MOST_KEPT)(Outline)


@dataclass(frozen=True, slots=True)
class MissionPoint:
    """A named place of a mission: home, a waypoint, a rally point."""

    label: str  # as messages name it
    position: Point
    keys: Keys
    altitude_m: float | None = None  # above home; None: the mission's


@dataclass(frozen=True, slots=True)
class Uav:
    """One of several UAVs that fly a mission.

    Attributes:
        name: In the team.
        keys: Where it stands in the file.
        form: Its part of the file.
        home: Where it takes off and lands; None: at the mission's home.
    """

    name: str
    keys: Keys
    form: UavForm
    home: MissionPoint | None

    @property
    def home_altitude_amsl_m(self) -> float | None:
        """Height of the ground at a home of its own above the sea, if the file has it."""
        return None if self.form.home is None else self.form.home.altitude_amsl_m


@dataclass(frozen=True, slots=True)
class PlacedForm:
    """A form, and where its parts are.

    Attributes:
        form: The content of the file.
        frame: The mission's local frame; None: the file does not say where it is, and nothing is
            placed.
        home: Where the vehicle takes off and lands; None: it could not be read.
        waypoints: What to explore, in order.
        rally_points: Where the vehicle may land in need.
        fences: It stays inside of all of them; none: it may fly anywhere but in zones.
        zones: It stays outside of them; those of other files too.
        uavs: Of a mission for several.
        climb_corridors: Where other UAVs climb and descend; kept away from like zones.
    """

    form: MissionForm
    frame: LocalFrame | None = None
    home: MissionPoint | None = None
    waypoints: tuple[MissionPoint, ...] = ()
    rally_points: tuple[MissionPoint, ...] = ()
    fences: tuple[Area, ...] = ()
    zones: tuple[Area, ...] = ()
    uavs: tuple[Uav, ...] = ()
    climb_corridors: tuple[Area, ...] = ()

    def with_settings(self, **settings: Any) -> PlacedForm:
        """The same with other values of the form; what has a place stays where it is."""
        return replace(self, form=self.form.model_copy(update=settings))

    def with_zones(self, more: Iterable[Area]) -> PlacedForm:
        """The same with more zones."""
        return replace(self, zones=(*self.zones, *more))

    def with_zones_of(
        self,
        path: Path,
        keys: Keys,
        findings: Findings,
        *,
        allow: Collection[str] = (),
        skip: Collection[str] = (),
    ) -> PlacedForm:
        """The same with the zones of a file that are near enough to matter.

        What is wrong with the file is found, but for zones that are far from the mission: one that
        cannot be read is noted.

        Args:
            path: The file.
            keys: Where the mission names it; none: an option does.
            findings: Of the mission.
            allow: Zones to leave out, see `read_zones`.
            skip: The same.
        """
        if self.frame is None:
            return self
        if keys and not is_file(path):
            findings.report(keys, f"there is no file {path}; {path_advice(path)}", "no-such-file")
            return self
        try:
            reading = read_zones(path, allow=allow, skip=skip)
        except DocumentError as error:
            findings.problems += error.problems
            return self
        corners = [corner for area in self.fences for corner in area.shape.corners]
        spots = (self.home, *self.waypoints, *self.rally_points)
        places = corners or [spot.position for spot in spots if spot is not None]
        around = Surroundings(self.frame, places, fenced=bool(corners))
        taken = [area.name for area in self.zones]
        return self.with_zones(zones_near(reading, around, taken, keys, findings))

    @property
    def explores(self) -> bool:
        """Whether the UAV whose mission it is explores, and does not only search."""
        return all(uav.form.explore for uav in self.uavs if uav.name == self.form.uav)

    @property
    def home_altitude_amsl_m(self) -> float | None:
        """Height of the ground at home above the sea; None: not known."""
        return self.form.home.altitude_amsl_m

    def band(self, area: Area) -> Band | None:
        """Where an area applies, in metres above home; None: everywhere.

        Raises:
            HomeAltitudeError, ZoneError: as `Altitudes.band`.
        """
        if area.terms.altitudes is None:
            return None
        relief_m = self.form.planner.terrain_relief_m
        return area.terms.altitudes.band(self.home_altitude_amsl_m, relief_m)


@dataclass(frozen=True, slots=True)
class Placer:
    """Places parts of a file in a local frame; what is no place or area is reported.

    Attributes:
        frame: The mission's.
        findings: Of the file.
        in_metres: Its pairs are metres east and north, not degrees.
    """

    frame: LocalFrame
    findings: Findings
    in_metres: bool = False

    @classmethod
    def around(
        cls, what: str, origin: Sequence[float], keys: Keys, findings: Findings, advice: str = ""
    ) -> Placer | None:
        """One whose frame lies around a place in degrees; None, and reported, if it is none."""
        try:
            return cls(LocalFrame(Geodetic(*origin)), findings)
        except FrameError as error:
            findings.report(keys, f"{what}: {error}; correct it{advice}", "not-on-earth")
            return None

    def spot(
        self, label: str, pair: Sequence[float], keys: Keys, altitude_m: float | None = None
    ) -> MissionPoint | None:
        """A place in the local frame; None, and reported, if it is not on Earth."""
        try:
            return MissionPoint(label, self._to_local(pair), keys, altitude_m)
        except FrameError as error:
            order = "" if self.in_metres else " (latitude comes first)"
            self.findings.report(keys, f"{label}: {error}; correct it{order}", "not-on-earth")
            return None

    def polygon(
        self,
        name: str,
        corners: Sequence[Sequence[float]],
        keys: Keys,
        holes: Sequence[Sequence[Sequence[float]]] = (),
        holes_keys: Keys = (),
    ) -> Outline | None:
        """An outline in the local frame; None, and reported, if it bounds no area."""
        ring = self._ring(name, corners, keys)
        rings = [
            self._ring(f"{name}, hole {index + 1}", hole, (*holes_keys, index))
            for index, hole in enumerate(holes)
        ]
        read = tuple(hole for hole in rings if hole is not None)
        if ring is None or len(read) < len(rings):
            return None
        try:
            return _outline(ring, read)
        except ZoneError as error:
            where = "" if error.place is None else f" near {self._place_text(error.place)}"
            message = f"{name} cannot be an area: {error}{where}; draw it again"
            self.findings.report(holes_keys if "hole" in str(error) else keys, message, error.code)
            self.findings.refused.append(RefusedRing(name, ring, error.place))
            return None

    def circle(
        self, name: str, centre: Sequence[float], radius_m: float, keys: Keys
    ) -> Circle | None:
        """A circle in the local frame; None, and reported, if it is none."""
        spot = self.spot(f"{name}, centre", centre, keys)
        if spot is None:
            return None
        if radius_m > LARGEST_RADIUS_M:
            message = f"{name} has a radius of {radius_m:g} m, at most {LARGEST_RADIUS_M:g} m"
            self.findings.report(keys, f"{message}; correct it", "out-of-range")
            return None
        try:
            return Circle(spot.position, radius_m)
        except ZoneError as error:
            self.findings.report(keys, f"{name} cannot be an area: {error}; correct it", error.code)
            return None

    def _ring(self, name: str, corners: Sequence[Sequence[float]], keys: Keys) -> Ring | None:
        if not self.in_metres and corners:
            places = tuple(Geodetic(float(corner[0]), float(corner[1])) for corner in corners)
            with contextlib.suppress(FrameError):  # the faulty corner is reported below
                return local_ring(places, self.frame)
        spots = []
        for index, corner in enumerate(corners):
            spot = self.spot(f"{name}, corner {index + 1}", corner, (*keys, index))
            if spot is None:
                return None
            spots.append(spot)
        return tuple(spot.position for spot in spots)

    def _place_text(self, place: Point) -> str:
        if self.in_metres:
            return f"{place.east_m:.2f}, {place.north_m:.2f}"
        return "{:.7f}, {:.7f}".format(*self.frame.to_geodetic(place))

    def _to_local(self, pair: Sequence[float]) -> Point:
        if self.in_metres:
            place = Point(float(pair[0]), float(pair[1]))
            if not math.hypot(*place) < _EARTH_M:
                raise FrameError(f"{pair[0]:g}, {pair[1]:g} metres is not a place on Earth")
            return place
        return self.frame.to_local(pair[0], pair[1])


# From a form


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
        allow, skip = listed.allow, listed.skip
        placed = placed.with_zones_of(file, keys, findings, allow=allow, skip=skip)
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
        uav, keys, home = given or UavForm(), ("uavs", name), None
        if uav.home is not None:
            home = placer.spot("home", uav.home.position, (*keys, "home", "position"))
        yield Uav(name, keys, uav, home)


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
