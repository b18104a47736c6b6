"""A mission as a file has it: read, but not yet judged; every part knows its place in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from air_router.settings import DEFAULT_BATTERY_RESERVE, PlannerSettings, Timers
from geo.frame import FrameError, LocalFrame, Point
from geo.zone import Ring, ZoneError, checked_ring, circle_ring
from mocha_link.document import Document, Problem

Keys = tuple[str | int, ...]
"""The way to a value in a document."""


@dataclass(frozen=True, slots=True)
class Spot:
    """A named place of a mission: home, a waypoint, a rally point."""

    label: str
    position: Point
    keys: Keys
    altitude_m: float | None = None


@dataclass(frozen=True, slots=True)
class Area:
    """A fence or a no-fly zone."""

    name: str
    ring: Ring
    keys: Keys
    crosses_fence: bool = False


@dataclass(slots=True)
class Draft:
    """Everything that a mission file says.

    What could not be read is missing here and has its problem noted; `unread` holds the names of
    such sections, so that nothing is concluded from their absence. Altitudes are above home.
    `in_metres` says that pairs are metres east and north of the frame's origin, not degrees.
    """

    document: Document
    name: str = ""
    frame: LocalFrame | None = None
    in_metres: bool = False
    home: Spot | None = None
    home_altitude_amsl_m: float | None = None
    waypoints: list[Spot] = field(default_factory=list)
    rally_points: list[Spot] = field(default_factory=list)
    fence: Area | None = None
    zones: list[Area] = field(default_factory=list)
    altitude_m: float = 0.0
    speed_m_s: float = 0.0
    timers: Timers = field(default_factory=Timers)
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    seek: tuple[str, ...] = ()
    uav: str | None = None
    team: Path | None = None
    world: Path | None = None
    battery_reserve: float = DEFAULT_BATTERY_RESERVE
    duration_s: float | None = None
    unread: set[str] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)

    def complain(self, keys: Keys, message: str) -> None:
        """Note a problem with the value at these keys."""
        self.problems.append(self.document.problem(keys, message))

    def spot(
        self, label: str, pair: Sequence[float], keys: Keys, altitude_m: float | None = None
    ) -> Spot | None:
        """A place in the local frame; None, with a problem noted, if it is not on Earth."""
        try:
            return Spot(label, self._to_local(pair), keys, altitude_m)
        except FrameError as error:
            self.complain(keys, f"{label}: {error}; correct it (latitude comes first)")
            return None

    def polygon(self, name: str, corners: Sequence[Sequence[float]], keys: Keys) -> Ring | None:
        """A polygon in the local frame; None, with a problem noted, if it bounds no area."""
        points = []
        for index, corner in enumerate(corners):
            spot = self.spot(f"{name}, corner {index + 1}", corner, (*keys, index))
            if spot is None:
                return None
            points.append(spot.position)
        try:
            return checked_ring(points)
        except ZoneError as error:
            self.complain(keys, f"{name} cannot be an area: {error}; draw it again")
            return None

    def circle(
        self, name: str, centre: Sequence[float], radius_m: float, keys: Keys, *, zone: bool
    ) -> Ring | None:
        """A circle as a polygon: around it for a zone, within it for a fence."""
        spot = self.spot(f"{name}, centre", centre, keys)
        if spot is None:
            return None
        try:
            return circle_ring(spot.position, radius_m, outward=zone)
        except ZoneError as error:
            self.complain(keys, f"{name} cannot be an area: {error}; correct it")
            return None

    def _to_local(self, pair: Sequence[float]) -> Point:
        if self.in_metres:
            return Point(float(pair[0]), float(pair[1]))
        if self.frame is None:
            raise FrameError("the mission's frame is not known")
        return self.frame.to_local(pair[0], pair[1])
