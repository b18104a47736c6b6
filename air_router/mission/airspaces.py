"""Which zones apply to a mission: where it cruises, where it climbs and lands, and which not.

The vehicle cruises between the lowest and the highest altitude of the mission, and what it may be
off them (`planner.vertical_margin_m`). Below that it climbs or descends: it takes off, lands, or
returns, and keeps from every zone from the ground up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache

from air_router.files.mission_document import Area, MissionDocument
from air_router.files.settings import PlannerSettings
from air_router.files.zone_terms import HomeAltitudeError
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Band, Shape, Zone, ZoneError
from geo.validity import Validity

LAUNCH_WAIT = timedelta(hours=1)
"""So much later than it was to start a mission may start."""

COMING_HOME = timedelta(minutes=10)
"""What it may take to come home and land, after `duration_s`; more where the way takes more."""


@dataclass(frozen=True, slots=True)
class FlightWindow:
    """From when to when the vehicle may be in the air; without `end`, for ever.

    A vehicle that takes off after `latest_start` may still fly when the window is over.
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
    """A zone that the mission need not keep away from where it cruises, and why.

    `below` says that it applies below the cruise altitudes all the same.
    """

    zone: Zone
    reason: str  # in words
    below: bool = False


@dataclass(frozen=True, slots=True)
class Airspaces:
    """The airspaces of a mission; see the module.

    Attributes:
        zones: All zones of the mission, in the file's order.
        climb_corridors: What is kept from beside them, because of other UAVs.
        cruise: What applies where the mission flies, with its clearance.
        planning: The same with the tracking margin on top: what routes are checked with.
        climb: What applies from the ground to there.
        above: What applies there and higher.
        idle: The zones that are not in `cruise`.
        altitudes: The cruise altitudes, margin included, in metres above home.
    """

    zones: tuple[Zone, ...]
    climb_corridors: tuple[Zone, ...]
    cruise: Airspace
    planning: Airspace
    climb: Airspace
    above: Airspace
    idle: tuple[IdleZone, ...]
    altitudes: Band


def airspaces_of(draft: MissionDocument, window: FlightWindow) -> Airspaces:
    """The airspaces of a draft. An altitude limit that cannot be read is taken for none."""
    zones = tuple(_zone(area, draft) for area in draft.zones)
    fences = tuple(area.shape for area in draft.fences)
    climb_corridors = tuple(_zone(area, draft) for area in draft.climb_corridors)
    altitudes = cruise_altitudes(draft)
    return airspaces_within(fences, zones, climb_corridors, draft.planner, window, altitudes)


def airspaces_within(  # noqa: PLR0913, PLR0917 - all that counts
    fences: tuple[Shape, ...],
    zones: tuple[Zone, ...],
    climb_corridors: tuple[Zone, ...],
    planner: PlannerSettings,
    window: FlightWindow,
    altitudes: Band,
) -> Airspaces:
    """The airspaces that fences and zones make for a flight at these altitudes in that time.

    They are kept for a while: an edit that changes none of this costs nothing here, nor in what is
    found in these airspaces.
    """
    timed = any(zone.validity is not None for zone in zones)
    kept = planner.clearance_m, planner.tracking_margin_m
    return _airspaces(fences, zones, climb_corridors, *kept, window if timed else None, altitudes)


@lru_cache(maxsize=4)
def _airspaces(  # noqa: PLR0913, PLR0917 - all that counts
    fences: tuple[Shape, ...],
    zones: tuple[Zone, ...],
    climb_corridors: tuple[Zone, ...],
    clearance_m: float,
    margin_m: float,
    window: FlightWindow | None,
    altitudes: Band,
) -> Airspaces:
    active = Airspace(fences, (*zones, *climb_corridors), clearance_m)
    if window is not None:
        active = active.during(window.start, window.end)
    climb = active.at(-math.inf, altitudes.upper_m)
    cruise = active.at(altitudes.lower_m, altitudes.upper_m)
    above = active.at(altitudes.lower_m, math.inf)
    active_ids, below = {id(zone) for zone in cruise.zones}, {id(zone) for zone in climb.zones}
    in_time = {id(zone) for zone in active.zones}
    idle = []
    for zone in zones:
        if id(zone) not in in_time and zone.validity is not None and window is not None:
            idle.append(IdleZone(zone, _out_of_time(zone.validity, window)))
        elif id(zone) not in active_ids and zone.band is not None:
            reason = _out_of_height(zone.band, altitudes)
            idle.append(IdleZone(zone, reason, below=id(zone) in below))
    planning = cruise.with_margin(margin_m)
    return Airspaces(zones, climb_corridors, cruise, planning, climb, above, tuple(idle), altitudes)


def cruise_altitudes(draft: MissionDocument) -> Band:
    """From the lowest to the highest altitude that may be flown, and the margin on both sides."""
    flown_m = [draft.altitude_m, *(s.altitude_m for s in draft.waypoints if s.altitude_m)]
    flown_m += draft.altitudes_m
    margin_m = draft.planner.vertical_margin_m
    return Band(min(flown_m) - margin_m, max(flown_m) + margin_m)


def band_of(area: Area, draft: MissionDocument) -> Band | None:
    """Where an area applies, in metres above home; None: everywhere.

    Raises:
        HomeAltitudeError, ZoneError: as `Altitudes.band`.
    """
    if area.terms.altitudes is None:
        return None
    return area.terms.altitudes.band(draft.home_altitude_amsl_m, draft.planner.terrain_relief_m)


def _zone(area: Area, draft: MissionDocument) -> Zone:
    try:
        band = band_of(area, draft)
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


def _out_of_time(validity: Validity, window: FlightWindow) -> str:
    return f"applies {validity}, the flight is from {window}"


def _out_of_height(band: Band, altitudes: Band) -> str:
    parts = []
    if math.isfinite(band.lower_m):
        parts.append(f"from {band.lower_m:g} m")
    if math.isfinite(band.upper_m):
        parts.append(f"up to {band.upper_m:g} m")
    return (
        f"applies {' '.join(parts)} above home, the mission flies at "
        f"{altitudes.lower_m:g} to {altitudes.upper_m:g} m, its vertical margin included"
    )
