"""The mission: waypoints, fences, no-fly zones and robots to seek, in one local frame.

The vehicle cruises within the *cruise band*: from the lowest to the highest altitude of the
mission, extended by `planner.vertical_margin_m`. Below that band it takes off, lands or climbs, and
also keeps clear of zones that end below the band.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from datetime import datetime, timedelta
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Final

from shapely import Point as ShapelyPoint

from air_router.files import (
    Accepted,
    Area,
    HomeAltitudeError,
    MissionForm,
    PlannerSettings,
    SeekPolicy,
    Timers,
    WhenExplored,
)
from air_router.files.missions import PlacedForm
from air_router.mission.fleet import Layer
from air_router.mission.tracking import TrackingMargin
from geo.airspace import Airspace, Band, Shape, Zone, ZoneError
from geo.frame import LocalFrame, Point
from mocha_link.sanitize import sanitize
from mocha_link.team import Problem

LAUNCH_WAIT = timedelta(hours=1)
"""Longest delay of the take-off after the given start time."""

COMING_HOME = timedelta(minutes=10)
"""Time allowed for coming home and landing after `duration_s`; a longer way home extends it."""


@dataclass(frozen=True, slots=True)
class FlightWindow:
    """The period in which the vehicle may be in the air; `end` is None if there is no limit.

    After a take-off later than `latest_start` the flight may outlast the window.
    """

    start: datetime
    end: datetime | None
    latest_start: datetime | None = None

    @classmethod
    def of(
        cls,
        now: datetime,
        start: datetime | None,
        duration_s: float | None,
        way_home_s: float = 0.0,
    ) -> FlightWindow:
        """The window of a flight that starts at `start`, or soon after `now`."""
        first = now if start is None else start
        if duration_s is None:
            return cls(first, None)
        latest = first + LAUNCH_WAIT
        home = max(COMING_HOME, timedelta(seconds=way_home_s))
        return cls(first, latest + timedelta(seconds=duration_s) + home, latest)

    def __str__(self) -> str:
        end = "on" if self.end is None else f"to {self.end:%Y-%m-%d %H:%M}"
        return f"{self.start:%Y-%m-%d %H:%M} {end} UTC"


@dataclass(frozen=True, slots=True)
class IdleZone:
    """A zone that does not apply in the cruise band, and the reason.

    `below`: it applies below the cruise band, during climb and landing.
    """

    zone: Zone
    reason: str  # for people
    below: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionAreas:
    """The fences and zones of a mission, and the airspaces for its flight.

    Attributes:
        fences: The vehicle stays inside all of these; empty: no fence.
        zones: All no-fly zones of the file, including those that do not apply to this flight.
        cruise: The cruise band, in meters above home.
        airspace: The fences, and the zones that apply in the cruise band during the flight, with
            the clearance that the vehicle must keep everywhere.
        planning_airspace: The same with the tracking margin added; routes are planned in it.
        climb_airspace: `airspace` with the zones below the cruise band, for take-off and landing.
        above_airspace: `airspace` with the zones above the cruise band, for a vehicle that a pilot
            has flown higher.
        climb_corridors: Where other UAVs climb and descend; avoided like zones.
        idle_zones: The zones that are not in `airspace`, with the reasons.
    """

    fences: tuple[Shape, ...]
    zones: tuple[Zone, ...]
    cruise: Band
    airspace: Airspace
    planning_airspace: Airspace
    climb_airspace: Airspace
    above_airspace: Airspace
    climb_corridors: tuple[Zone, ...]
    idle_zones: tuple[IdleZone, ...]

    def parts(self) -> dict[str, Any]:
        """All fields by name, to construct a `Mission` with these areas."""
        return {field.name: getattr(self, field.name) for field in fields(MissionAreas)}


def areas_of(placed: PlacedForm, window: FlightWindow) -> MissionAreas:
    """The areas of a form. A zone with an invalid altitude limit applies at all altitudes."""
    form = placed.form
    zones = tuple(_zone(area, placed) for area in placed.zones)
    fences = tuple(area.shape for area in placed.fences)
    climb_corridors = tuple(_zone(area, placed) for area in placed.climb_corridors)
    flown_m = [form.altitude_m, *(s.altitude_m for s in placed.waypoints if s.altitude_m)]
    flown_m += form.altitudes_m or ()
    margin_m = form.planner.vertical_margin_m
    cruise = Band(min(flown_m) - margin_m, max(flown_m) + margin_m)
    tracking_m = TrackingMargin.of(form.planner, form.speed_m_s).planned_m
    timed = _if_timed(zones, window)
    return _areas(fences, zones, climb_corridors, form.planner, tracking_m, timed, cruise)


def _if_timed(zones: tuple[Zone, ...], window: FlightWindow) -> FlightWindow | None:
    """The window if any zone has hours; None if all zones always apply."""
    return window if any(zone.validity is not None for zone in zones) else None


# Cached: edits of other values keep the airspaces, and the paths found in them.
@lru_cache(maxsize=4)
def _areas(  # noqa: PLR0913, PLR0917 - everything that the areas depend on
    fences: tuple[Shape, ...],
    zones: tuple[Zone, ...],
    climb_corridors: tuple[Zone, ...],
    planner: PlannerSettings,
    margin_m: float,
    window: FlightWindow | None,
    cruise: Band,
) -> MissionAreas:
    """The areas for a flight in this cruise band; window None: no zone has hours."""
    active = Airspace(fences, (*zones, *climb_corridors), planner.clearance_m)
    if window is not None:
        active = active.during(window.start, window.end)
    climb = active.at(-math.inf, cruise.upper_m)
    airspace = active.at(cruise.lower_m, cruise.upper_m)
    active_ids, below = {id(zone) for zone in airspace.zones}, {id(zone) for zone in climb.zones}
    in_time = {id(zone) for zone in active.zones}
    idle = []
    for zone in zones:
        if id(zone) not in in_time and zone.validity is not None and window is not None:
            reason = f"applies {zone.validity}, the flight is from {window}"
            idle.append(IdleZone(zone, reason))
        elif id(zone) not in active_ids and zone.band is not None:
            reason = _out_of_height(zone.band, cruise)
            idle.append(IdleZone(zone, reason, below=id(zone) in below))
    kept = partial(_airspace, fences, planner.clearance_m)
    return MissionAreas(
        fences=fences,
        zones=zones,
        climb_corridors=climb_corridors,
        cruise=cruise,
        airspace=kept(airspace.zones),
        planning_airspace=kept(airspace.zones, margin_m),
        climb_airspace=kept(climb.zones),
        above_airspace=kept(active.at(cruise.lower_m, math.inf).zones),
        idle_zones=tuple(idle),
    )


@lru_cache(maxsize=16)
def _airspace(
    fences: tuple[Shape, ...], clearance_m: float, zones: tuple[Zone, ...], margin_m: float = 0.0
) -> Airspace:
    """Cached: another cruise band with the same zones reuses the paths found in the airspace."""
    return Airspace(fences, zones, clearance_m, margin_m)


def _zone(area: Area, placed: PlacedForm) -> Zone:
    try:
        band = placed.band(area)
    except (HomeAltitudeError, ZoneError):
        band = None
    return Zone(
        area.name,
        area.shape,
        clearance_m=area.terms.clearance_m,
        band=band,
        validity=area.terms.validity,
        crosses_fence=area.crosses_fence,
    )


def _out_of_height(band: Band, cruise: Band) -> str:
    parts = []
    if math.isfinite(band.lower_m):
        parts.append(f"from {band.lower_m:g} m")
    if math.isfinite(band.upper_m):
        parts.append(f"up to {band.upper_m:g} m")
    return (
        f"applies {' '.join(parts)} above home, the mission flies at "
        f"{cruise.lower_m:g} to {cruise.upper_m:g} m, its vertical margin included"
    )


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A place to explore; numbered from 1 in the operator's order."""

    number: int
    position: Point
    altitude_above_home_m: float  # flown at this waypoint


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission(MissionAreas):
    """A mission. Positions are meters east and north in `frame`, altitudes above home.

    Attributes:
        name: Name for display.
        path: The mission file.
        frame: The local frame.
        home: Take-off and landing place.
        home_altitude_amsl_m: Ground elevation at home above mean sea level, if known.
        waypoints: Places to explore, in order; numbered 1, 2, 3 ... without gaps.
        rally_points: Emergency landing places.
        altitude_above_home_m: Altitude of every point that has none of its own.
        speed_m_s: Cruise speed over ground.
        timers: Durations of the states.
        planner: Settings of the route planner.
        seek: Names of the robots to seek, in order; empty: all ground robots of the team.
        goals_from: Robots that may send goals by gossip.
        seek_policy: Policy that chooses the next robot and where to seek it.
        when_explored: Behavior once every waypoint is explored.
        uav: This vehicle's name in the team; None without a team.
        explore: Whether the vehicle explores between searches; False: it only searches.
        layers: The layers of all UAVs of the mission; empty for a single UAV.
        team: The team file; None without one.
        world: The file of the simulated world; None without one.
        duration_s: Time after take-off at which the vehicle comes home; None: no limit.
        battery_reserve: The charge (0 to 1) at which the vehicle comes home.
        accepts: Pre-flight findings that do not stop this mission.
        endurance_s: Endurance of a full battery in cruise flight, if known.
        window: The period of the flight.
        notes: Notes for the operator.
        drawn_zones: The zones with their own altitude limits, while `zones` apply at all altitudes;
            None: `zones` have their own limits.
    """

    name: str
    path: Path
    frame: LocalFrame
    home: Point
    home_altitude_amsl_m: float | None
    waypoints: tuple[Waypoint, ...]
    rally_points: tuple[Point, ...]
    altitude_above_home_m: float
    speed_m_s: float
    timers: Timers
    planner: PlannerSettings
    seek: tuple[str, ...]
    seek_policy: SeekPolicy
    when_explored: WhenExplored
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
    notes: tuple[Problem, ...]
    accepts: tuple[Accepted, ...] = ()
    drawn_zones: tuple[Zone, ...] | None = None

    @classmethod
    def of(
        cls,
        placed: PlacedForm,
        areas: MissionAreas,
        window: FlightWindow,
        layers: tuple[Layer, ...] = (),
    ) -> Mission | None:
        """The mission of a form, even if it has problems; None without a frame or a home."""
        form = placed.form
        if placed.frame is None or placed.home is None:
            return None
        return cls(
            name=sanitize(form.title),
            path=form.path,
            frame=placed.frame,
            home=placed.home.position,
            home_altitude_amsl_m=placed.home_altitude_amsl_m,
            waypoints=tuple(
                Waypoint(number, spot.position, spot.altitude_m or form.altitude_m)
                for number, spot in enumerate(placed.waypoints, start=1)
            ),
            rally_points=tuple(spot.position for spot in placed.rally_points),
            altitude_above_home_m=form.altitude_m,
            seek=tuple(form.seek.robots),
            seek_policy=form.seek.policy,
            explore=placed.explores,
            layers=layers,
            team=form.team_file,
            world=form.world_file,
            window=window,
            notes=(),
            **areas.parts(),
            **{name: _frozen(getattr(form, name)) for name in _UNCHANGED},
        )

    def cruises_at(self, altitude_m: float) -> bool:
        """Whether an altitude above home lies in the cruise band."""
        return self.cruise.lower_m <= altitude_m <= self.cruise.upper_m

    def at_reserve(self, charge: float | None) -> bool:
        """Whether a charge, 0 to 1, is known and brings the vehicle home anywhere."""
        return charge is not None and charge <= self.battery_reserve

    def airspace_at(self, altitude_m: float) -> Airspace:
        """The airspace that applies at an altitude above home, with the clearance.

        Outside the cruise band: all zones between this altitude and the band apply too.
        """
        if altitude_m > self.cruise.upper_m:
            return _between(self.above_airspace, -math.inf, altitude_m)
        if altitude_m < self.cruise.lower_m:
            return _between(self.climb_airspace, altitude_m, math.inf)
        return self.airspace

    def airspace_off_cruise(self, altitude_m: float) -> Airspace:
        """The same for legs that begin there: the altitude may be wrong by the vertical margin."""
        margin_m = self.planner.vertical_margin_m
        if altitude_m < self.cruise.lower_m:
            return self.airspace_at(altitude_m - margin_m)
        return self.airspace_at(
            altitude_m + margin_m if altitude_m > self.cruise.upper_m else altitude_m
        )

    @property
    def tracking(self) -> TrackingMargin:
        """The margin on top of every clearance."""
        return TrackingMargin.of(self.planner, self.speed_m_s)

    @property
    def planning_distance_m(self) -> float:
        """Planned distance to fences, and to zones without their own clearance."""
        return self.planner.clearance_m + self.tracking.planned_m

    @property
    def altitudes_m(self) -> tuple[float, float]:
        """Lowest and highest altitude above home that the vehicle flies, or may be commanded to."""
        margin_m, cruise = self.planner.vertical_margin_m, self.cruise
        return round(cruise.lower_m + margin_m, 3), round(cruise.upper_m - margin_m, 3)

    @property
    def layer(self) -> Layer | None:
        """The layer of this UAV; None in a mission for a single UAV."""
        return next((layer for layer in self.layers if layer.uav == self.uav), None)

    @property
    def ceiling_m(self) -> float:
        """Highest altitude that keeps separation from the next layer; infinite without one."""
        own = self.layer
        return self._layer_above_m(own) - self.planner.vertical_separation_m if own else math.inf

    @property
    def layer_top_m(self) -> float:
        """Border to the next layer, halfway between the two; infinite without one."""
        own = self.layer
        return (self._layer_above_m(own) + own.altitude_m) / 2 if own else math.inf

    def _layer_above_m(self, own: Layer) -> float:
        """Altitude of the next layer, above the own home; infinite without one."""
        above = [layer.level_m for layer in self.layers if layer.level_m > own.level_m]
        return own.altitude_m + min(above, default=math.inf) - own.level_m

    @property
    def layers_below(self) -> tuple[str, ...]:
        """UAVs in lower layers, which a landing away from home would cross."""
        own = self.layer
        return tuple(each.uav for each in self.layers if own and each.level_m < own.level_m)

    def with_areas(self, fences: tuple[Shape, ...], zones: tuple[Zone, ...]) -> Mission:
        """The mission with other fences and zones; climb corridors of other UAVs remain."""
        window = _if_timed(zones, self.window)
        margin_m = self.tracking.planned_m
        areas = _areas(
            fences, zones, self.climb_corridors, self.planner, margin_m, window, self.cruise
        )
        return replace(self, **areas.parts(), drawn_zones=None)

    def with_all_zones(self, above_m: float) -> Mission:
        """The mission with its zones at all altitudes, for a vehicle with a doubtful altitude.

        Zones above home keep their limits: the vehicle took off below them, and otherwise there
        would be no route home.

        Args:
            above_m: Zones that begin this far above the cruise band keep their limits, too.
        """
        drawn, top_m = self.drawn, self.cruise.upper_m + above_m
        home, margin_m = ShapelyPoint(self.home), self.tracking.planned_m

        def stays(zone: Zone) -> bool:
            if zone.band is None or zone.band.lower_m > top_m:
                return True
            clearance_m = self.planner.clearance_m if zone.clearance_m is None else zone.clearance_m
            above = zone.band.lower_m > self.cruise.upper_m
            return above and zone.polygon.distance(home) < clearance_m + margin_m

        zones = tuple(zone if stays(zone) else replace(zone, band=None) for zone in drawn)
        if zones == drawn:
            return self.as_drawn()
        return replace(self.with_areas(self.fences, zones), drawn_zones=drawn)

    def as_drawn(self) -> Mission:
        """The mission with the altitude limits of the file."""
        return self.with_areas(self.fences, self.drawn) if self.all_zones else self

    @property
    def all_zones(self) -> bool:
        """Whether zones apply at all altitudes."""
        return self.drawn_zones is not None

    @property
    def drawn(self) -> tuple[Zone, ...]:
        """The zones with the altitude limits of the file."""
        return self.zones if self.drawn_zones is None else self.drawn_zones

    @property
    def skipped(self) -> frozenset[int]:
        """Numbers of waypoints that are too near to zones or fences changed in flight."""
        places = [waypoint.position for waypoint in self.waypoints]
        clear = self.planning_airspace.points_clear(places)
        return frozenset(w.number for w, ok in zip(self.waypoints, clear, strict=True) if not ok)

    def altitude_of(self, node: int | None) -> float:
        """Altitude above home at a node; None: at any other point."""
        if not node:
            return self.altitude_above_home_m
        return self.waypoints[node - 1].altitude_above_home_m

    @property
    def landings(self) -> tuple[Point, ...]:
        """The rally points that are still clear of zones and fences changed in flight."""
        airspace = self.climb_airspace.with_margin(self.tracking.planned_m)
        return tuple(place for place in self.rally_points if airspace.point_clear(place))

    @property
    def latest_start(self) -> datetime | None:
        """Latest take-off for which the zones are valid; None if no zone has hours."""
        return self.window.latest_start if _if_timed(self.zones, self.window) else None


_PLACED: Final = frozenset({"name", "frame", "home", "waypoints", "rally_points", "fences"})
_UNCHANGED: Final = (
    ({field.name for field in fields(Mission)} & MissionForm.model_fields.keys())
    - _PLACED
    - {"seek", "team", "world"}
)
"""Fields that a mission copies unchanged from its form."""


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _between(airspace: Airspace, low_m: float, high_m: float) -> Airspace:
    """The airspace with only the zones that apply somewhere between these altitudes."""
    zones = tuple(z for z in airspace.zones if z.band is None or z.band.meets(low_m, high_m))
    if len(zones) == len(airspace.zones):
        return airspace
    return _airspace(airspace.fences, airspace.clearance_m, zones)  # usually cached
