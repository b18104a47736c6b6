"""The mission: what to explore, where not to fly, whom to seek; checked, in one local frame."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from air_router.airspaces import Airspaces, FlightWindow, IdleZone, airspaces_of
from air_router.draft import Draft
from air_router.errors import MissionFileError
from air_router.fence_plan import FENCE_POINTS, fence_plan
from air_router.legality import check_geometry, check_team
from air_router.mission_file import read_mission
from air_router.qgc import read_plan
from air_router.settings import PlannerSettings, Timers
from geo.airspace import Airspace
from geo.frame import LocalFrame, Point
from geo.zone import Band, Shape, Zone
from mocha_link.document import Document, DocumentError, Problem
from mocha_link.printable import printable

__all__ = [
    "Mission",
    "PlannerSettings",
    "Timers",
    "Waypoint",
    "judge",
    "load_mission",
    "mission_of",
    "read_draft",
]


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A place to explore; `number` counts from 1 in the operator's order."""

    number: int
    position: Point
    altitude_above_home_m: float


@dataclass(frozen=True, slots=True)
class Mission:
    """A checked mission. Positions are metres east/north in `frame`, altitudes above home.

    Attributes:
        name: What people call it.
        path: The file that it came from.
        frame: Its local frame.
        home: Where the vehicle takes off and lands.
        home_altitude_amsl_m: Height of the ground at home above sea level, if known.
        waypoints: What to explore, in order; numbered 1, 2, 3 ... without gaps.
        fences: The vehicle stays inside of all of them; empty if there is none.
        zones: All no-fly zones of the file, also those that do not apply to this flight.
        rally_points: Places where the vehicle may land in need.
        altitude_above_home_m: The mission's altitude, for every point that has no other.
        speed_m_s: Cruise speed over ground.
        timers: Durations of the states.
        planner: How routes are planned.
        seek: Names of the robots to seek, in order; empty for all ground robots of the team.
        uav: Name of this vehicle in the team; None without a team.
        team: The team file; None without one.
        world: The file of the simulated world; None without one.
        duration_s: When to come home, counted from take-off; None to stay out.
        battery_reserve: The charge (0..1) at which the vehicle comes home.
        endurance_s: How long a full battery lasts in cruise flight, if that is known.
        window: When it flies.
        cruise: The altitudes above home that it flies at, and `planner.vertical_margin_m`.
        airspace: Fences, and the zones that apply at these altitudes and in that time, with the
            clearance that every flown metre keeps.
        planning_airspace: The same with the tracking margin on top: what routes are checked with.
        column_airspace: As `airspace`, with the zones that apply below the cruise altitudes too:
            for taking off and landing.
        above_airspace: As `airspace`, with the zones that apply above the cruise altitudes too: for
            a vehicle that a pilot has flown higher.
        idle_zones: The zones that are not in `airspace`, and why.
        notes: What the operator should know.
    """

    name: str
    path: Path
    frame: LocalFrame
    home: Point
    home_altitude_amsl_m: float | None
    waypoints: tuple[Waypoint, ...]
    fences: tuple[Shape, ...]
    zones: tuple[Zone, ...]
    rally_points: tuple[Point, ...]
    altitude_above_home_m: float
    speed_m_s: float
    timers: Timers
    planner: PlannerSettings
    seek: tuple[str, ...]
    uav: str | None
    team: Path | None
    world: Path | None
    duration_s: float | None
    battery_reserve: float
    endurance_s: float | None
    window: FlightWindow
    cruise: Band
    airspace: Airspace
    planning_airspace: Airspace
    column_airspace: Airspace
    above_airspace: Airspace
    idle_zones: tuple[IdleZone, ...]
    notes: tuple[Problem, ...]

    def airspace_at(self, altitude_m: float) -> Airspace:
        """The airspace that counts at an altitude above home, with its clearance."""
        if altitude_m > self.cruise.upper_m:
            return self.above_airspace
        return self.airspace if altitude_m >= self.cruise.lower_m else self.column_airspace

    @property
    def latest_start(self) -> datetime | None:
        """After this the zones may be others; None when they are the same at all times."""
        timed = any(zone.validity is not None for zone in self.zones)
        return self.window.latest_start if timed else None


def load_mission(
    path: Path, *, start: datetime | None = None, duration_s: float | None = None
) -> Mission:
    """Read and check a mission: a YAML mission file, or a QGroundControl `.plan`.

    Args:
        path: the file.
        start: when the vehicle takes off, in UTC; None: soon. Zones that do not apply then are
            left out of the mission's airspace.
        duration_s: how long it stays out; None: as the file says.

    Raises:
        MissionFileError: with every problem of the mission and of its team file.
    """
    try:
        draft = read_draft(path)
    except DocumentError as error:
        raise MissionFileError(error.problems) from None
    draft.start = start
    draft.duration_s = draft.duration_s if duration_s is None else duration_s
    mission = judge(draft)
    if draft.problems or mission is None:
        raise MissionFileError(draft.problems)
    return mission


def read_draft(path: Path) -> Draft:
    """What a file says, not yet judged.

    Raises:
        DocumentError: it cannot be read at all.
    """
    if path.suffix.lower() == ".plan":
        return read_plan(path)
    return read_mission(Document.load(path))


def judge(draft: Draft) -> Mission | None:
    """Note every problem of a draft in it; the mission that it describes, however wrong.

    None if it says too little: the frame or home is missing. Do not fly one with problems.
    """
    window = FlightWindow.of(datetime.now(UTC), draft.start, draft.duration_s)
    airspaces = airspaces_of(draft, window)
    check_geometry(draft, airspaces)
    check_team(draft)
    if not draft.problems and (mission := mission_of(draft, airspaces, window)) is not None:
        _note_fence(draft, mission)
    return mission_of(draft, airspaces, window)


def mission_of(draft: Draft, airspaces: Airspaces, window: FlightWindow) -> Mission | None:
    """The mission of a draft, whether it has problems or not; None without frame or home."""
    if draft.frame is None or draft.home is None:
        return None
    return Mission(
        name=printable(draft.name),
        path=draft.document.path,
        frame=draft.frame,
        home=draft.home.position,
        home_altitude_amsl_m=draft.home_altitude_amsl_m,
        waypoints=tuple(
            Waypoint(number, spot.position, spot.altitude_m or draft.altitude_m)
            for number, spot in enumerate(draft.waypoints, start=1)
        ),
        fences=airspaces.cruise.fences,
        zones=airspaces.zones,
        rally_points=tuple(spot.position for spot in draft.rally_points),
        altitude_above_home_m=draft.altitude_m,
        speed_m_s=draft.speed_m_s,
        timers=draft.timers,
        planner=draft.planner,
        seek=draft.seek,
        uav=draft.uav,
        team=draft.team,
        world=draft.world,
        duration_s=draft.duration_s,
        battery_reserve=draft.battery_reserve,
        endurance_s=draft.endurance_s,
        window=window,
        cruise=airspaces.altitudes,
        airspace=airspaces.cruise,
        planning_airspace=airspaces.cruise.with_margin(draft.planner.tracking_margin_m),
        column_airspace=airspaces.column,
        above_airspace=airspaces.above,
        idle_zones=airspaces.idle,
        notes=tuple(draft.notes),
    )


def _note_fence(draft: Draft, mission: Mission) -> None:
    """Note what of the mission's areas its fence on board will not be."""
    plan = fence_plan(mission)
    areas = {area.name: area for area in (*draft.zones, *draft.fences)}
    if len(plan.items) > FENCE_POINTS:
        draft.note_area(
            next(iter(draft.fences or draft.zones)),
            f"the fence on board would have {len(plan.items)} points with all zones, PX4 1.17 "
            f"stores {FENCE_POINTS}; draw circles, and polygons with fewer corners",
            "fence-points",
        )
    for name, reason in plan.simpler:
        message = f"'{name}' is not in the fence on board: {reason}; the companion keeps to it"
        draft.note_area(areas[name], message, "fence-simpler-on-board")
