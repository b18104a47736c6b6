"""A new mission to begin with: home, one waypoint, a fence around both."""

from pathlib import Path

from air_router.editor.mission_file import MissionFile
from air_router.errors import UsageError
from air_router.files.text.first_mission import mission_text
from geo.frame import Geodetic, Point

_FIRST_WAYPOINT = Point(0.0, 40.0)


def write_starter(path: Path, home: Geodetic) -> None:
    """Write a new mission around its home.

    Raises:
        UsageError: the file is there already or is no YAML.
        SaveError: it cannot be written.
    """
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise UsageError(f"{path}: new missions are YAML files; call it {path.stem}.yaml")
    if path.exists():
        raise UsageError(f"{path} is there already; leave --new out to edit it")
    text = mission_text(
        "air-router edit", home, [_FIRST_WAYPOINT], altitude_m=40, fence_radius_m=150
    )
    MissionFile(path).write(text, overwrite=True)
