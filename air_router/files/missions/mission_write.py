"""Writes missions as YAML mission files: those of plans, and a first one to begin with."""

import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from air_router.files.maps.feature_set import corners_of
from air_router.files.mission_document import Area, MissionDocument, MissionPoint, Uav
from air_router.files.settings import (
    DEFAULT_BATTERY_RESERVE,
    DEFAULT_SEEK_POLICY,
    PlannerSettings,
    Timers,
)
from air_router.files.text_values import degrees_text
from air_router.files.zone_terms import terms_data
from geo.airspace.zone import Circle, Ring
from geo.frame import Geodetic, LocalFrame, Point
from mocha_link.team.document import as_yaml

_DIGITS: Final = 9
"""Of degrees: a tenth of a millimetre."""


def mission_text(draft: MissionDocument, folder: Path) -> str:
    """The mission as YAML, for a file in `folder`. The draft has a frame and a home."""
    frame = draft.frame
    if frame is None or draft.home is None:
        raise ValueError("a mission without a home is no mission file")
    home: dict[str, Any] = {"position": _pair(draft.home.position, frame)}
    if draft.home_altitude_amsl_m is not None:
        home["altitude_amsl_m"] = draft.home_altitude_amsl_m
    data: dict[str, Any] = {"name": draft.name, "home": home, "altitude_m": draft.altitude_m}
    data["speed_m_s"] = draft.speed_m_s
    data |= {
        key: Path(os.path.relpath(path, folder)).as_posix()
        for key, path in (("team", draft.team), ("world", draft.world))
        if path is not None
    }
    if draft.uavs:
        data["uavs"] = {uav.name: _uav(uav, frame) for uav in draft.uavs}
    elif draft.uav is not None:
        data["uav"] = draft.uav
    data |= _seek(draft)
    data |= {"goals_from": list(draft.goals_from)} if draft.goals_from else {}
    data |= _settings(draft)
    data["waypoints"] = [_waypoint(spot, draft, frame) for spot in draft.waypoints]
    data |= _fences(draft, frame)
    data["no_fly_zones"] = [_zone(area, frame) for area in draft.zones]
    rally_points = [_pair(spot.position, frame) for spot in draft.rally_points]
    data |= {"rally_points": rally_points} if rally_points else {}
    return as_yaml(data, short_in_line=True)


def _seek(draft: MissionDocument) -> dict[str, Any]:
    """Names alone, the policy alone, or both."""
    robots = {"robots": list(draft.seek)} if draft.seek else {}
    if draft.seek_policy == DEFAULT_SEEK_POLICY:
        return {"seek": robots["robots"]} if robots else {}
    return {"seek": {**robots, "policy": draft.seek_policy} if robots else draft.seek_policy}


def _uav(uav: Uav, frame: LocalFrame) -> dict[str, Any]:
    data: dict[str, Any] = {}
    if uav.altitude_m is not None:
        data["altitude_m"] = uav.altitude_m
    if not uav.explore:
        data["explore"] = False
    if uav.home is not None:
        data["home"] = {"position": _pair(uav.home.position, frame)}
        if uav.home_altitude_amsl_m is not None:
            data["home"]["altitude_amsl_m"] = uav.home_altitude_amsl_m
    return data


def _settings(draft: MissionDocument) -> dict[str, Any]:
    """What is not as it would be without saying so."""
    data: dict[str, Any] = {}
    for key, given, defaults in (
        ("timers", asdict(draft.timers), asdict(Timers())),
        ("planner", asdict(draft.planner), asdict(PlannerSettings())),
    ):
        changed = {name: value for name, value in given.items() if value != defaults[name]}
        data |= {key: changed} if changed else {}
    for key, value, default in (
        ("duration_s", draft.duration_s, None),
        ("endurance_s", draft.endurance_s, None),
        ("battery_reserve", draft.battery_reserve, DEFAULT_BATTERY_RESERVE),
        ("accepts", list(draft.accepts), []),
    ):
        data |= {key: value} if value != default else {}
    return data


def _waypoint(spot: MissionPoint, draft: MissionDocument, frame: LocalFrame) -> Any:
    pair = _pair(spot.position, frame)
    if spot.altitude_m is None or spot.altitude_m == draft.altitude_m:
        return pair
    return {"position": pair, "altitude_m": spot.altitude_m}


def _fences(draft: MissionDocument, frame: LocalFrame) -> dict[str, Any]:
    fences = [_shape(area, frame) for area in draft.fences]
    if len(fences) > 1:
        return {"fences": fences}
    return {"fence": fences[0] if fences else None}


def _zone(area: Area, frame: LocalFrame) -> dict[str, Any]:
    return {
        "name": area.name,
        **_shape(area, frame),
        **terms_data(area.terms, altitude_key="altitude"),
        **({"crosses_fence": True} if area.crosses_fence else {}),
    }


def _shape(area: Area, frame: LocalFrame) -> dict[str, Any]:
    if isinstance(area.shape, Circle):
        centre = _pair(area.shape.centre, frame)
        return {"circle": {"centre": centre, "radius_m": area.shape.radius_m}}
    data: dict[str, Any] = {"polygon": _ring(area.shape.ring, frame)}
    holes = [_ring(hole, frame) for hole in area.shape.holes]
    return {**data, "holes": holes} if holes else data


def _ring(ring: Ring, frame: LocalFrame) -> list[list[float]]:
    corners = corners_of(ring, frame)
    return [[round(degrees, _DIGITS) for degrees in corner] for corner in corners]


def _pair(point: Point, frame: LocalFrame) -> list[float]:
    return [round(degrees, _DIGITS) for degrees in frame.to_geodetic(point)]


_FIRST_MISSION: Final = """\
# A first mission, made by {made_by}. Every key is described in docs/mission-file.md.

# Where the vehicle takes off and lands: latitude, longitude.
home: [{home}]

# Cruise altitude in metres above home.
altitude_m: {altitude_m:g}

# What to explore, in order. To drag it on a map: air-router edit
waypoints:
{waypoints}

# The area to stay in, and areas to stay out of.
fence:
  circle: {{centre: [{home}], radius_m: {fence_radius_m:g}}}
no_fly_zones: []
"""


def first_mission_text(
    made_by: str,
    home: Geodetic,
    waypoints: Sequence[Point],
    *,
    altitude_m: float,
    fence_radius_m: float,
) -> str:
    """A mission that only lacks its team.

    Args:
        made_by: The command that makes it.
        home: Where the vehicle takes off, and the fence's centre.
        waypoints: From home.
        altitude_m: Cruise altitude above home.
        fence_radius_m: From home.
    """
    frame = LocalFrame(home)
    places = [", ".join(map(degrees_text, frame.to_geodetic(waypoint))) for waypoint in waypoints]
    return _FIRST_MISSION.format(
        made_by=made_by,
        home=", ".join(map(degrees_text, home)),
        altitude_m=altitude_m,
        waypoints="\n".join(f"  - [{place}]" for place in places),
        fence_radius_m=fence_radius_m,
    )
