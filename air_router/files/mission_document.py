"""A mission as a file has it: read, but not yet judged; every part knows its place in the file."""

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np

from air_router.files.seek_policies import DEFAULT_SEEK_POLICY, SeekPolicy
from air_router.files.settings import (
    DEFAULT_BATTERY_RESERVE,
    DEFAULT_WHEN_EXPLORED,
    LARGEST_RADIUS_M,
    Accepted,
    PlannerSettings,
    Timers,
    WhenExplored,
)
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
from mocha_link.team import Problem

Keys = tuple[str | int, ...]
"""The way to a value in a document."""


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


class DocumentSource(Protocol):
    """The file that a draft is made from: it knows where its values stand."""

    @property
    def path(self) -> Path:
        """The file."""

    def problem(self, keys: Sequence[str | int], message: str, code: str) -> Problem:
        """A problem with the value at these keys."""


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
        source: Its file, if that is another one than the draft's.
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
class RefusedRing:
    """A ring that bounds no area, for pictures; `place` is where its border is wrong."""

    name: str
    ring: Ring
    place: Point | None


@dataclass(slots=True)
class MissionDocument:
    """The contents of a mission file.

    What could not be read is missing here and has its problem noted. `air_router.mission` validates
    what was read, and notes its problems here in the same way. Altitudes are metres above home.
    """

    source: DocumentSource  # where it was read
    name: str = ""  # what people call it
    frame: LocalFrame | None = None
    in_metres: bool = False  # pairs are metres east and north of the frame's origin, not degrees
    home: MissionPoint | None = None
    home_altitude_amsl_m: float | None = None  # of the ground, above the sea
    waypoints: list[MissionPoint] = field(default_factory=list)  # in the order to explore
    rally_points: list[MissionPoint] = field(default_factory=list)
    fences: list[Area] = field(default_factory=list)  # none: it may fly anywhere but in zones
    zones: list[Area] = field(default_factory=list)
    altitude_m: float = 0.0  # of the cruise
    altitudes_m: tuple[float, ...] = ()  # the lowest and highest it may be sent to on request
    speed_m_s: float = 0.0  # over ground, in cruise
    timers: Timers = field(default_factory=Timers)
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    seek: tuple[str, ...] = ()  # in their order; none: every other robot
    seek_policy: SeekPolicy = DEFAULT_SEEK_POLICY
    when_explored: WhenExplored = DEFAULT_WHEN_EXPLORED
    goals_from: tuple[str, ...] = ()  # robots whose goals, sent by gossip, are flown to
    uav: str | None = None  # whose mission; of several UAVs the one that is meant
    uavs: tuple[Uav, ...] = ()  # of a mission for several
    explore: bool = True  # that UAV explores, and does not only search
    climb_corridors: list[Area] = field(default_factory=list)  # kept away from like zones
    team: Path | None = None  # its file
    world: Path | None = None  # what `air-router sim` simulates
    battery_reserve: float = DEFAULT_BATTERY_RESERVE  # charge to return at, 0 to 1
    accepts: tuple[Accepted, ...] = ()  # pre-flight findings that do not refuse the flight
    endurance_s: float | None = None  # of a full battery
    duration_s: float | None = None  # after which it returns; None: never
    start: datetime | None = None  # of the flight, UTC; None: soon
    unread: set[str] = field(default_factory=set)  # sections that could not be read
    problems: list[Problem] = field(default_factory=list)  # that keep it from being flown
    notes: list[Problem] = field(default_factory=list)  # no reason not to fly it
    refused: list[RefusedRing] = field(default_factory=list)  # rings that bound no area

    def begin_at(self, start: datetime | None, duration_s: float | None) -> None:
        """Fly it at this time, for so long; see `start` and `duration_s`."""
        self.start, self.duration_s = start, duration_s

    def report(self, keys: Keys, message: str, code: str) -> None:
        """Note a problem with the value at these keys."""
        self.problems.append(self.source.problem(keys, message, code))

    def note(self, keys: Keys, message: str, code: str) -> None:
        """Note something that the operator should know about the value at these keys."""
        self.notes.append(self.source.problem(keys, message, code))

    def report_area(self, area: Area, message: str, code: str) -> None:
        """Note a problem with an area, in the file that it comes from."""
        self.problems.append((area.source or self.source).problem(area.keys, message, code))

    def note_area(self, area: Area, message: str, code: str) -> None:
        """Note something about an area, in the file that it comes from."""
        self.notes.append((area.source or self.source).problem(area.keys, message, code))

    def band(self, area: Area) -> Band | None:
        """Where an area applies, in metres above home; None: everywhere.

        Raises:
            HomeAltitudeError, ZoneError: as `Altitudes.band`.
        """
        if area.terms.altitudes is None:
            return None
        return area.terms.altitudes.band(self.home_altitude_amsl_m, self.planner.terrain_relief_m)

    def find_frame(self, what: str, origin: Sequence[float], keys: Keys, advice: str = "") -> bool:
        """Lay the frame around a place in degrees; False, with a problem noted, if it is none."""
        try:
            self.frame = LocalFrame(Geodetic(*origin))
        except FrameError as error:
            self.report(keys, f"{what}: {error}; correct it{advice}", "not-on-earth")
        return self.frame is not None

    def spot(
        self, label: str, pair: Sequence[float], keys: Keys, altitude_m: float | None = None
    ) -> MissionPoint | None:
        """A place in the local frame; None, with a problem noted, if it is not on Earth."""
        try:
            return MissionPoint(label, self._to_local(pair), keys, altitude_m)
        except FrameError as error:
            order = "" if self.in_metres else " (latitude comes first)"
            self.report(keys, f"{label}: {error}; correct it{order}", "not-on-earth")
            return None

    def polygon(
        self,
        name: str,
        corners: Sequence[Sequence[float]],
        keys: Keys,
        holes: Sequence[Sequence[Sequence[float]]] = (),
        holes_keys: Keys = (),
    ) -> Outline | None:
        """An outline in the local frame; None, with a problem noted, if it bounds no area."""
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
            self.report(holes_keys if "hole" in str(error) else keys, message, error.code)
            self.refused.append(RefusedRing(name, ring, error.place))
            return None

    def circle(
        self, name: str, centre: Sequence[float], radius_m: float, keys: Keys
    ) -> Circle | None:
        """A circle in the local frame; None, with a problem noted, if it is none."""
        spot = self.spot(f"{name}, centre", centre, keys)
        if spot is None:
            return None
        if radius_m > LARGEST_RADIUS_M:
            message = f"{name} has a radius of {radius_m:g} m, at most {LARGEST_RADIUS_M:g} m"
            self.report(keys, f"{message}; correct it", "out-of-range")
            return None
        try:
            return Circle(spot.position, radius_m)
        except ZoneError as error:
            self.report(keys, f"{name} cannot be an area: {error}; correct it", error.code)
            return None

    def _ring(self, name: str, corners: Sequence[Sequence[float]], keys: Keys) -> Ring | None:
        if not self.in_metres and self.frame is not None and corners:
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
        if self.in_metres or self.frame is None:
            return f"{place.east_m:.2f}, {place.north_m:.2f}"
        return "{:.7f}, {:.7f}".format(*self.frame.to_geodetic(place))

    def _to_local(self, pair: Sequence[float]) -> Point:
        if self.in_metres:
            place = Point(float(pair[0]), float(pair[1]))
            if not math.hypot(*place) < _EARTH_M:
                raise FrameError(f"{pair[0]:g}, {pair[1]:g} metres is not a place on Earth")
            return place
        if self.frame is None:
            raise FrameError("the mission's frame is not known")
        return self.frame.to_local(pair[0], pair[1])
