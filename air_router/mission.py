"""The mission: what to explore, where not to fly, whom to seek; checked, in one local frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from air_router.draft import Draft
from air_router.errors import MissionFileError
from air_router.legality import airspace_of, check_geometry, check_team
from air_router.mission_file import read_mission
from air_router.qgc import read_plan
from air_router.settings import PlannerSettings, Timers
from geo.airspace import Airspace
from geo.frame import LocalFrame, Point
from geo.zone import Ring, Zone
from mocha_link.document import Document, DocumentError

__all__ = ["Mission", "PlannerSettings", "Timers", "Waypoint", "load_mission"]


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
        fence: The vehicle stays inside; None if there is none.
        zones: The vehicle stays outside.
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
        airspace: Fence and zones, with the clearance that every flown metre keeps.
        planning_airspace: The same with the tracking margin on top: what routes are checked with.
    """

    name: str
    path: Path
    frame: LocalFrame
    home: Point
    home_altitude_amsl_m: float | None
    waypoints: tuple[Waypoint, ...]
    fence: Ring | None
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
    airspace: Airspace
    planning_airspace: Airspace


def load_mission(path: Path) -> Mission:
    """Read and check a mission: a YAML mission file, or a QGroundControl `.plan`.

    Raises:
        MissionFileError: with every problem of the mission and of its team file.
    """
    read = read_plan if path.suffix.lower() == ".plan" else _read_yaml
    try:
        draft = read(path)
    except DocumentError as error:
        raise MissionFileError(error.problems) from None
    check_geometry(draft)
    check_team(draft)
    if draft.problems or draft.frame is None or draft.home is None:
        raise MissionFileError(draft.problems)
    return _mission(draft, draft.frame, draft.home.position)


def _read_yaml(path: Path) -> Draft:
    return read_mission(Document.load(path))


def _mission(draft: Draft, frame: LocalFrame, home: Point) -> Mission:
    airspace = airspace_of(draft, draft.planner.clearance_m)
    return Mission(
        name=draft.name,
        path=draft.document.path,
        frame=frame,
        home=home,
        home_altitude_amsl_m=draft.home_altitude_amsl_m,
        waypoints=tuple(
            Waypoint(number, spot.position, spot.altitude_m or draft.altitude_m)
            for number, spot in enumerate(draft.waypoints, start=1)
        ),
        fence=airspace.fence,
        zones=airspace.zones,
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
        airspace=airspace,
        planning_airspace=airspace.with_clearance(draft.planner.distance_m),
    )
