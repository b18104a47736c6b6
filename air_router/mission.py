"""The mission: what to explore, where not to fly, whom to seek; checked, in one local frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from air_router.airspaces import Airspaces, FlightWindow, IdleZone, airspaces_of, airspaces_within
from air_router.draft import Draft
from air_router.errors import MissionFileError, UsageError
from air_router.fence_plan import FENCE_POINTS, FENCE_TOO_LONG, fence_plan
from air_router.fleet import Layer, ceiling_m, check_fleet, layers_of, merge, top_m, variants
from air_router.legality import check_geometry, check_team
from air_router.mission_file import read_mission
from air_router.qgc import read_plan
from air_router.settings import Accepted, PlannerSettings, SeekPolicy, Timers
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
        goals_from: Robots whose goals, by gossip, are requests to fly there.
        seek_policy: How the one that is sought next is chosen, and its place.
        uav: Name of this vehicle in the team; None without a team.
        explore: It explores between two searches; otherwise it only searches.
        layers: Where it and the other UAVs of the mission fly; empty if it is for one UAV only.
        team: The team file; None without one.
        world: The file of the simulated world; None without one.
        duration_s: When to come home, counted from take-off; None to stay out.
        battery_reserve: The charge (0..1) at which the vehicle comes home.
        accepts: What the pre-flight card would stop the flight for and its operator accepts.
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
        columns: What it keeps away from as from zones because other UAVs climb and descend there.
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
    seek_policy: SeekPolicy
    goals_from: tuple[str, ...]
    uav: str | None
    explore: bool
    layers: tuple[Layer, ...]
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
    columns: tuple[Zone, ...]
    idle_zones: tuple[IdleZone, ...]
    notes: tuple[Problem, ...]
    accepts: tuple[Accepted, ...] = ()

    def airspace_at(self, altitude_m: float) -> Airspace:
        """The airspace that counts at an altitude above home, with its clearance."""
        if altitude_m > self.cruise.upper_m:
            return self.above_airspace
        return self.airspace if altitude_m >= self.cruise.lower_m else self.column_airspace

    @property
    def ceiling_m(self) -> float:
        """How high above home it may be without coming near to the UAV above; mostly infinite."""
        return ceiling_m(self.layers, self.uav, self.planner.vertical_separation_m)

    @property
    def layer_top_m(self) -> float:
        """Higher above home it would be in the layer of another UAV; mostly infinite."""
        return top_m(self.layers, self.uav)

    def with_areas(self, fences: tuple[Shape, ...], zones: tuple[Zone, ...]) -> Mission:
        """The same mission among other fences and zones; columns of other UAVs stay."""
        clearance_m = self.planner.clearance_m
        areas = airspaces_within(fences, zones, self.columns, clearance_m, self.window, self.cruise)
        return replace(
            self,
            fences=areas.cruise.fences,
            zones=areas.zones,
            airspace=areas.cruise,
            planning_airspace=areas.cruise.with_margin(self.planner.tracking_margin_m),
            column_airspace=areas.column,
            above_airspace=areas.above,
            idle_zones=areas.idle,
        )

    @property
    def barred(self) -> frozenset[int]:
        """The waypoints that zones or fences were drawn over in flight; none before."""
        return frozenset(
            waypoint.number
            for waypoint in self.waypoints
            if not self.planning_airspace.point_clear(waypoint.position)
        )

    def altitude_of(self, node: int | None) -> float:
        """How high above home the vehicle hovers at a node; None: at any other point."""
        if not node:
            return self.altitude_above_home_m
        return self.waypoints[node - 1].altitude_above_home_m

    @property
    def landings(self) -> tuple[Point, ...]:
        """The rally points that nothing was drawn over in flight."""
        airspace = self.column_airspace.with_margin(self.planner.tracking_margin_m)
        return tuple(place for place in self.rally_points if airspace.point_clear(place))

    @property
    def latest_start(self) -> datetime | None:
        """After this the zones may be others; None when they are the same at all times."""
        timed = any(zone.validity is not None for zone in self.zones)
        return self.window.latest_start if timed else None


DRAWN_OVER: Final = frozenset(
    {"waypoint-in-zone", "waypoint-outside-fence", "waypoint-too-near", "waypoint-unreachable"}
    | {"rally-point-in-zone", "rally-point-outside-fence", "rally-point-too-near"}
)
"""Problems of a file that are none in flight: such a place is left out."""


def load_mission(
    path: Path,
    *,
    uav: str | None = None,
    start: datetime | None = None,
    duration_s: float | None = None,
    in_flight: bool = False,
) -> Mission:
    """Read and check a mission: a YAML mission file, or a QGroundControl `.plan`.

    Args:
        path: the file.
        uav: whose mission, by its name in the team; None: the first one's, if it is for several.
        start: when the vehicle takes off, in UTC; None: soon. Zones that do not apply then are
            left out of the mission's airspace.
        duration_s: how long it stays out; None: as the file says.
        in_flight: it is flown already: places that zones were drawn over since are no problem.

    Raises:
        MissionFileError: with every problem of the mission and of its team file.
        UsageError: the mission is for several UAVs, and this is none of them.
    """
    try:
        draft = read_draft(path)
    except DocumentError as error:
        raise MissionFileError(error.problems) from None
    if uav is not None:
        choose(draft, uav)
    draft.start = start
    draft.duration_s = draft.duration_s if duration_s is None else duration_s
    mission = judge(draft)
    problems = [p for p in draft.problems if not (in_flight and p.code in DRAWN_OVER)]
    if problems or mission is None:
        raise MissionFileError(problems or draft.problems)
    return mission


def read_draft(path: Path) -> Draft:
    """What a file says, not yet judged.

    Raises:
        DocumentError: it cannot be read at all.
    """
    if path.suffix.lower() == ".plan":
        return read_plan(path)
    return read_mission(Document.load(path))


def choose(draft: Draft, uav: str) -> None:
    """Make a draft that of one of its UAVs.

    Raises:
        UsageError: it is for others.
    """
    names = [each.name for each in draft.uavs]
    if names and uav not in names:
        known = " and ".join(names)
        raise UsageError(f"{draft.document.path}: is flown by {known}, not by '{uav}'")
    draft.uav = uav


def judge(draft: Draft) -> Mission | None:
    """Note every problem of a draft in it; the mission that it describes, however wrong.

    A mission for several UAVs is judged as each of them flies it; `draft.uav` is whose is returned.
    None if it says too little: the frame or home is missing. Do not fly one with problems.
    """
    if not draft.uavs or draft.frame is None or draft.home is None:
        return _judge(draft)
    check_fleet(draft)
    each = variants(draft)
    for variant in each:
        variant.problems, variant.notes = list(draft.problems), list(draft.notes)
    missions = [_judge(variant) for variant in each]
    merge(draft, each)
    draft.uav = each[0].uav
    return None if missions[0] is None else replace(missions[0], notes=tuple(draft.notes))


def _judge(draft: Draft) -> Mission | None:
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
        seek_policy=draft.seek_policy,
        goals_from=draft.goals_from,
        uav=draft.uav,
        explore=draft.explore,
        layers=layers_of(draft),
        team=draft.team,
        world=draft.world,
        duration_s=draft.duration_s,
        battery_reserve=draft.battery_reserve,
        accepts=draft.accepts,
        endurance_s=draft.endurance_s,
        window=window,
        cruise=airspaces.altitudes,
        airspace=airspaces.cruise,
        planning_airspace=airspaces.cruise.with_margin(draft.planner.tracking_margin_m),
        column_airspace=airspaces.column,
        above_airspace=airspaces.above,
        columns=airspaces.columns,
        idle_zones=airspaces.idle,
        notes=tuple(draft.notes),
    )


def _note_fence(draft: Draft, mission: Mission) -> None:
    """Note what of the mission's areas its fence on board will not be."""
    plan = fence_plan(mission)
    areas = {area.name: area for area in (*draft.zones, *draft.columns, *draft.fences)}
    if len(plan.items) > FENCE_POINTS:
        draft.note_area(
            next(iter(draft.fences or draft.zones)),
            f"the fence on board would have {len(plan.items)} points with all zones, PX4 1.17 "
            f"stores {FENCE_POINTS}; draw circles, and polygons with fewer corners",
            FENCE_TOO_LONG,
        )
    for name, reason in plan.simpler:
        message = f"'{name}' is not in the fence on board: {reason}; the companion keeps to it"
        draft.note_area(areas[name], message, "fence-simpler-on-board")
