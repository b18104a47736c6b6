"""The mission: what to explore, where not to fly, whom to seek; checked, in one local frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path

import numpy as np

from air_router.files.settings import Accepted, PlannerSettings, SeekPolicy, Timers
from air_router.mission.airspaces import FlightWindow, IdleZone, airspaces_within
from air_router.mission.fleet import Layer, below, ceiling_m, top_m
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Band, Shape, Zone
from geo.frame import LocalFrame, Point
from mocha_link.team.document import Problem


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A place to explore; `number` counts from 1 in the operator's order."""

    number: int
    position: Point
    altitude_above_home_m: float  # of the flight there


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
        climb_airspace: As `airspace`, with the zones that apply below the cruise altitudes too:
            for taking off and landing.
        above_airspace: As `airspace`, with the zones that apply above the cruise altitudes too: for
            a vehicle that a pilot has flown higher.
        climb_corridors: Where other UAVs climb and descend; kept away from like zones.
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
    climb_airspace: Airspace
    above_airspace: Airspace
    climb_corridors: tuple[Zone, ...]
    idle_zones: tuple[IdleZone, ...]
    notes: tuple[Problem, ...]
    accepts: tuple[Accepted, ...] = ()

    def airspace_at(self, altitude_m: float) -> Airspace:
        """The airspace that counts at an altitude above home, with its clearance.

        Above or below the cruise altitudes: what applies from there to them.
        """
        if altitude_m > self.cruise.upper_m:
            return _between(self.above_airspace, -math.inf, altitude_m)
        if altitude_m < self.cruise.lower_m:
            return _between(self.climb_airspace, altitude_m, math.inf)
        return self.airspace

    @property
    def altitudes_m(self) -> tuple[float, float]:
        """The lowest and the highest above home that it flies at, or may be sent to."""
        margin_m, cruise = self.planner.vertical_margin_m, self.cruise
        return round(cruise.lower_m + margin_m, 3), round(cruise.upper_m - margin_m, 3)

    @property
    def ceiling_m(self) -> float:
        """How high above home it may be without coming near to the UAV above; mostly infinite."""
        return ceiling_m(self.layers, self.uav, self.planner.vertical_separation_m)

    @property
    def layer_top_m(self) -> float:
        """Higher above home it would be in the layer of another UAV; mostly infinite."""
        return top_m(self.layers, self.uav)

    @property
    def layers_below(self) -> tuple[str, ...]:
        """The UAVs whose layers it would descend through away from home; mostly none."""
        return below(self.layers, self.uav)

    def with_areas(self, fences: tuple[Shape, ...], zones: tuple[Zone, ...]) -> Mission:
        """The same mission among other fences and zones; climb_corridors of other UAVs stay."""
        areas = airspaces_within(
            fences, zones, self.climb_corridors, self.planner, self.window, self.cruise
        )
        return replace(
            self,
            fences=areas.cruise.fences,
            zones=areas.zones,
            airspace=areas.cruise,
            planning_airspace=areas.planning,
            climb_airspace=areas.climb,
            above_airspace=areas.above,
            idle_zones=areas.idle,
        )

    @property
    def skipped(self) -> frozenset[int]:
        """The waypoints that zones or fences were drawn over in flight; none before."""
        if not self.waypoints:
            return frozenset()
        places = np.array([waypoint.position for waypoint in self.waypoints], dtype=float)
        clear = self.planning_airspace.legs_clear_between(places, places)
        return frozenset(self.waypoints[index].number for index in np.flatnonzero(~clear))

    def altitude_of(self, node: int | None) -> float:
        """How high above home the vehicle hovers at a node; None: at any other point."""
        if not node:
            return self.altitude_above_home_m
        return self.waypoints[node - 1].altitude_above_home_m

    @property
    def landings(self) -> tuple[Point, ...]:
        """The rally points that nothing was drawn over in flight."""
        airspace = self.climb_airspace.with_margin(self.planner.tracking_margin_m)
        return tuple(place for place in self.rally_points if airspace.point_clear(place))

    @property
    def latest_start(self) -> datetime | None:
        """After this the zones may be others; None when they are the same at all times."""
        timed = any(zone.validity is not None for zone in self.zones)
        return self.window.latest_start if timed else None


def _between(airspace: Airspace, low_m: float, high_m: float) -> Airspace:
    """The airspace with only the zones that apply somewhere between."""
    bands = ((zone, zone.band) for zone in airspace.zones)
    zones = tuple(zone for zone, band in bands if band is None or band.meets(low_m, high_m))
    return airspace if len(zones) == len(airspace.zones) else _among(airspace, zones)


@lru_cache(maxsize=8)
def _among(airspace: Airspace, zones: tuple[Zone, ...]) -> Airspace:
    """Of a vehicle off its altitudes in one telemetry after the other: mostly the same zones."""
    return Airspace(airspace.fences, zones, airspace.clearance_m)
