"""A form in the mission's local frame: where all is that it names, each part with its keys.

What could not be placed is missing here, and among the findings. Positions are metres east and
north of the frame's origin, altitudes metres above home.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from air_router.files.findings import DocumentSource, Findings, Keys, RefusedRing
from air_router.files.mission_form import LARGEST_RADIUS_M, MissionForm
from air_router.files.zone_terms import NO_TERMS, ZoneTerms
from geo.airspace import Band, Circle, Outline, Ring, Shape, ZoneError
from geo.frame import (
    STEP_M,
    FrameError,
    Geodetic,
    LocalFrame,
    Point,
    check_on_earth,
    dense_ring,
)
from mocha_link.sanitize import sanitize

_EARTH_M = 2e7
"""No two places are farther from each other."""

_DEGREE_M = 111_000.0
_MOST_KEPT = 2_000
"""Rings, and outlines found to be areas, that are kept: an edit changes one and leaves the rest."""

_MOST_STEPS = 20_000
"""Corners that a ring of long sides gets in between, more or less."""


@lru_cache(maxsize=_MOST_KEPT)
def local_ring(ring: tuple[Geodetic, ...], frame: LocalFrame) -> Ring:
    """A ring of the map in a local frame, its long sides with corners in between.

    Raises:
        FrameError: a corner is not on Earth.
    """
    for corner in ring:
        check_on_earth(*corner)
    sides = np.diff(np.array([*ring, ring[0]]), axis=0)
    sides[:, 1] = (sides[:, 1] + 180) % 360 - 180
    around_m = float(np.hypot(*sides.T).sum()) * _DEGREE_M
    dense = dense_ring(ring, max(STEP_M, around_m / _MOST_STEPS))
    return tuple(Point(*place) for place in frame.to_local_many(*zip(*dense, strict=True)).tolist())


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
        altitude_m: Where it flies, above its home; None: at the mission's altitude.
        explore: It explores, and does not only search.
        home: Where it takes off and lands; None: at the mission's home.
        home_altitude_amsl_m: Height of the ground there above sea level, if the file has it.
    """

    name: str
    keys: Keys
    altitude_m: float | None = None
    explore: bool = True
    home: MissionPoint | None = None
    home_altitude_amsl_m: float | None = None


@dataclass(frozen=True, slots=True)
class Area:
    """A fence or a no-fly zone.

    Attributes:
        name: What people call it.
        shape: Where it is, in the local frame.
        keys: Where it stands in its file.
        crosses_fence: It is meant to reach beyond the fence.
        terms: How far, how high and when it is kept away from.
        source: Its file, if that is another one than the mission's.
    """

    name: str
    shape: Shape
    keys: Keys
    crosses_fence: bool = False
    terms: ZoneTerms = NO_TERMS
    source: DocumentSource | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", sanitize(self.name))


@dataclass(frozen=True, slots=True)
class PlacedForm:
    """A form, and where its parts are.

    Attributes:
        form: What the file says.
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

    @property
    def explores(self) -> bool:
        """Whether the UAV whose mission it is explores, and does not only search."""
        return all(uav.explore for uav in self.uavs if uav.name == self.form.uav)

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
