"""A new mission to begin with: home, one waypoint, a fence around both."""

from __future__ import annotations

from pathlib import Path

from air_router.editor.mission_text import MissionText
from air_router.errors import UsageError
from air_router.files.text.rendering import degrees
from geo.frame import FrameError, Geodetic, LocalFrame, Point

_TEXT = """\
# A mission that air-router edit began. Every key is described in docs/mission-file.md.

# Where the vehicle takes off and lands: latitude, longitude.
home: [{home}]

# Cruise altitude in metres above home.
altitude_m: 40

# What to explore, in order.
waypoints:
  - [{waypoint}]

# The area to stay in.
fence:
  circle: {{centre: [{home}], radius_m: 150}}

# Areas to stay out of.
no_fly_zones: []
"""
_FIRST_WAYPOINT = Point(0.0, 40.0)


def write_starter(path: Path, place: str) -> None:
    """Write a new mission around a place "LAT,LON".

    Raises:
        UsageError: the file is there already or is no YAML, or the place is none.
        SaveError: it cannot be written.
    """
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise UsageError(f"{path}: new missions are YAML files; call it {path.stem}.yaml")
    if path.exists():
        raise UsageError(f"{path} is there already; leave --new out to edit it")
    try:
        latitude_deg, longitude_deg = map(float, place.split(","))
        frame = LocalFrame(Geodetic(latitude_deg, longitude_deg))
        waypoint = frame.to_geodetic(_FIRST_WAYPOINT)
    except (FrameError, ValueError):
        raise UsageError(f"'{place}' is no place; write LAT,LON in degrees") from None
    text = _TEXT.format(
        home=", ".join(map(degrees, frame.origin)), waypoint=", ".join(map(degrees, waypoint))
    )
    MissionText(path).write(text, overwrite=True)
