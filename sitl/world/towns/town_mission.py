"""The mission of a UAV over a town that has no mission file: fence, lanes of waypoints, home."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import shapely
import yaml

from air_router.errors import MissionFileError
from air_router.files.missions.mission_file import read_mission
from air_router.mission.loading import validate
from air_router.mission.mission import Mission
from geo.frame import Point
from mocha_link.team.document import Document
from sitl.world.towns.town import Town

_BEYOND_M: Final = 15.0
"""The fence is so far outside of the town."""

_LANE_M: Final = 45.0
"""Between lanes, and between two waypoints on one, at most."""


def mission_over(town: Town, *, altitude_m: float = 60.0, speed_m_s: float = 5.0) -> Mission:
    """A mission as `air_router.mission` reads it: waypoints in lanes, a fence around the town.

    Args:
        town: What to explore.
        altitude_m: Above home.
        speed_m_s: Cruise speed.
    """
    text = mission_text(town, altitude_m=altitude_m, speed_m_s=speed_m_s)
    draft = read_mission(Document.from_text(text, Path(f"(mission over {town.name})")))
    mission = validate(draft)
    if draft.problems or mission is None:
        raise MissionFileError(draft.problems)
    return mission


def mission_text(town: Town, *, altitude_m: float = 60.0, speed_m_s: float = 5.0) -> str:
    """The same as a mission file."""
    west_m, south_m, east_m, north_m = shapely.Polygon(town.outline).bounds
    fence = shapely.box(west_m, south_m, east_m, north_m).buffer(_BEYOND_M, join_style="mitre")
    mission: dict[str, Any] = {
        "name": town.name,
        "coordinates": "local",
        "frame": {"origin": list(town.frame.origin)},
        "home": {"position": list(town.home)},
        "altitude_m": altitude_m,
        "speed_m_s": speed_m_s,
        "seek": [],
        "waypoints": [list(place) for place in _lanes(west_m, south_m, east_m, north_m)],
        "fence": [list(corner) for corner in fence.exterior.coords[:-1]],
        "no_fly_zones": [],
    }
    return yaml.safe_dump(mission, sort_keys=False, default_flow_style=None, width=98)


def _lanes(west_m: float, south_m: float, east_m: float, north_m: float) -> list[Point]:
    """Places in lanes from west to east and back, from the south on."""
    columns, rows = _spread(west_m, east_m), _spread(south_m, north_m)
    return [
        Point(east, north)
        for number, north in enumerate(rows)
        for east in (columns if number % 2 == 0 else columns[::-1])
    ]


def _spread(low_m: float, high_m: float) -> list[float]:
    """The middles of equal parts that are no longer than `_LANE_M`."""
    parts = max(1, math.ceil((high_m - low_m) / _LANE_M))
    edges = [low_m + (high_m - low_m) * k / parts for k in range(parts + 1)]
    return [round(a + b) / 2 for a, b in pairwise(edges)]
