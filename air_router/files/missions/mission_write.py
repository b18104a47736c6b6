"""Writes missions: as YAML mission files, for map programs, and a first one to begin with."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from air_router.files import (
    DEFAULT_SEEK_POLICY,
    Area,
    MissionForm,
    SeekForm,
    degrees_text,
    terms_data,
)
from air_router.files.maps import FeatureSet, MapCircle, MapPoint, map_area_of
from air_router.files.missions.placed_form import MissionPoint, PlacedForm, Uav
from geo.frame import Geodetic, LocalFrame, Point
from mocha_link.sanitize import sanitize
from mocha_link.team import as_yaml

_DIGITS: Final = 9
"""Of degrees: a tenth of a millimetre."""


_WRITTEN_ANEW: Final = {
    *("coordinates", "frame", "home", "waypoints", "fence", "fences", "no_fly_zones"),
    *("no_fly_files", "rally_points", "uavs", "uav", "name", "speed_m_s", "team", "world", "seek"),
}
"""Where things are is written in degrees, and paths from the folder of the new file."""


def mission_text(placed: PlacedForm, folder: Path) -> str:
    """The mission as YAML, for a file in `folder`. It has a frame and a home."""
    form, frame = placed.form, placed.frame
    if frame is None or placed.home is None:
        raise ValueError("a mission without a home is no mission file")
    fences = [_shape(area, frame) for area in placed.fences]
    data = form.model_dump(exclude=_WRITTEN_ANEW, exclude_defaults=True)
    data |= _given(
        {
            "name": form.title,
            "home": _home(placed.home, placed.home_altitude_amsl_m, frame),
            "speed_m_s": form.speed_m_s,
            "team": _relative(form.team_file, folder),
            "world": _relative(form.world_file, folder),
            "uavs": {uav.name: _uav(uav, frame) for uav in placed.uavs},
            "uav": None if placed.uavs else form.uav,
            "seek": _seek(form.seek),
            "fences": fences if len(fences) > 1 else None,
            "rally_points": [_pair(spot.position, frame) for spot in placed.rally_points],
        }
    )
    data["waypoints"] = [_waypoint(spot, form.altitude_m, frame) for spot in placed.waypoints]
    data["no_fly_zones"] = [_zone(area, frame) for area in placed.zones]
    if len(fences) < 2:
        data["fence"] = next(iter(fences), None)
    ordered = {name: data[name] for name in MissionForm.model_fields if name in data}
    return as_yaml(ordered, short_in_line=True)


def _given(data: dict[str, Any]) -> dict[str, Any]:
    """The data without null, and without empty lists and mappings."""
    return {key: value for key, value in data.items() if value not in (None, [], {})}


def _relative(path: Path | None, folder: Path) -> str | None:
    return None if path is None else Path(os.path.relpath(path, folder)).as_posix()


def _seek(seek: SeekForm) -> Any:
    """Names alone, the policy alone, or both."""
    if seek.policy == DEFAULT_SEEK_POLICY:
        return seek.robots
    return {"robots": seek.robots, "policy": seek.policy} if seek.robots else seek.policy


def _home(home: MissionPoint, altitude_amsl_m: float | None, frame: LocalFrame) -> dict[str, Any]:
    return _given({"position": _pair(home.position, frame), "altitude_amsl_m": altitude_amsl_m})


def _uav(uav: Uav, frame: LocalFrame) -> dict[str, Any]:
    home = None if uav.home is None else _home(uav.home, uav.home_altitude_amsl_m, frame)
    explore = None if uav.form.explore else False
    return _given({"altitude_m": uav.form.altitude_m, "explore": explore, "home": home})


def _waypoint(spot: MissionPoint, altitude_m: float, frame: LocalFrame) -> Any:
    pair = _pair(spot.position, frame)
    if spot.altitude_m is None or spot.altitude_m == altitude_m:
        return pair
    return {"position": pair, "altitude_m": spot.altitude_m}


def _zone(area: Area, frame: LocalFrame) -> dict[str, Any]:
    crosses = {"crosses_fence": True} if area.crosses_fence else {}
    terms = terms_data(area.terms, altitude_key="altitude")
    return {"name": area.name, **_shape(area, frame), **terms, **crosses}


def _shape(area: Area, frame: LocalFrame) -> dict[str, Any]:
    shape = map_area_of(area, frame).shape
    if isinstance(shape, MapCircle):
        return {"circle": {"centre": _rounded(shape.centre), "radius_m": shape.radius_m}}
    ring, *holes = ([*map(_rounded, ring)] for ring in (shape.ring, *shape.holes))
    return _given({"polygon": ring, "holes": holes})


def _pair(point: Point, frame: LocalFrame) -> list[float]:
    return _rounded(frame.to_geodetic(point))


def _rounded(place: Geodetic) -> list[float]:
    return [round(degrees, _DIGITS) for degrees in place]


def feature_set_of(placed: PlacedForm) -> FeatureSet:
    """The feature set of a mission. It has a frame."""
    frame = placed.frame
    if frame is None:
        raise ValueError("a mission without a frame has no feature set")
    features = FeatureSet(
        sanitize(placed.form.title),
        placed.home_altitude_amsl_m,
        [map_area_of(area, frame) for area in placed.fences],
        [map_area_of(area, frame) for area in placed.zones],
    )
    if placed.home is not None:
        home = MapPoint("home", frame.to_geodetic(placed.home.position), 0.0)
        features.spots.append(("home", home))
    for n, spot in enumerate(placed.waypoints, start=1):
        place = frame.to_geodetic(spot.position)
        altitude_m = spot.altitude_m or placed.form.altitude_m
        features.spots.append(("waypoint", MapPoint(str(n), place, altitude_m)))
    for n, spot in enumerate(placed.rally_points, start=1):
        place = frame.to_geodetic(spot.position)
        features.spots.append(("rally_point", MapPoint(f"rally point {n}", place)))
    return features


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
