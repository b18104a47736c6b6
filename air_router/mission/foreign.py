"""Missions of other programs that are converted before they are flown: they say too little."""

from pathlib import Path
from typing import Final

from air_router.errors import UsageError
from air_router.files.json_document import MAX_BYTES
from air_router.files.maps.gpx import gpx_draft, read_gpx
from air_router.files.mission_document import MissionDocument
from air_router.files.missions.waypoint_file import read_waypoints
from air_router.files.whole_file import bytes_of, text_in
from mocha_link.team.document import DocumentError

GPX: Final = ".gpx"
WAYPOINTS: Final = ".waypoints"

_TO_CONVERT: Final = "not flown as it is: first `air-router convert {path} {path.stem}.yaml"
_ZONES: Final = "a file of zones is no mission: name it under no_fly_files in one"
_ADVICE: Final = {
    WAYPOINTS: f"{_TO_CONVERT}`",
    GPX: f"{_TO_CONVERT} --altitude M`",
    **dict.fromkeys((".kml", ".kmz", ".geojson", ".txt", ".air", ".openair"), _ZONES),
}


def check_own(path: Path) -> None:
    """Make sure that a file is none of another program, by its name.

    Raises:
        DocumentError: it is; says what to do with it.
    """
    advice = _ADVICE.get(path.suffix.lower())
    if advice is not None:
        raise DocumentError.at(path, advice.format(path=path), "unknown-format")


def foreign_draft(path: Path, *, altitude_m: float | None) -> MissionDocument | None:
    """The mission of such a file; None: it is one of those that are flown.

    Args:
        path: The file.
        altitude_m: Where a route in GPX is flown, above home.

    Raises:
        UsageError: the altitude is for other files.
        DocumentError: the file cannot be read.
    """
    suffix = path.suffix.lower()
    if altitude_m is not None and suffix != GPX:
        raise UsageError("--altitude is for a FROM in GPX; other missions say it themselves")
    if altitude_m is not None:
        return gpx_draft(read_gpx(bytes_of(path, MAX_BYTES), path), altitude_m)
    if suffix == WAYPOINTS:
        return read_waypoints(text_in(bytes_of(path, MAX_BYTES), path), path)
    return None
