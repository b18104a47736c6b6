"""Missions of other programs that are converted before they are flown: they say too little."""

from pathlib import Path
from typing import Final

from air_router.errors import UsageError
from air_router.files.gpx_document import gpx_draft, read_gpx
from air_router.files.json_document import MAX_BYTES
from air_router.files.mission_document import MissionDocument
from air_router.files.missions.sim_plan import SUFFIX, sim_plan_draft
from air_router.files.missions.waypoint_file import read_waypoints
from air_router.files.whole_file import bytes_of, text_in
from geo.frame import Geodetic
from mocha_link.team.document import Document, DocumentError

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


def foreign_draft(
    path: Path, *, altitude_m: float | None, origin: Geodetic | None
) -> MissionDocument | None:
    """The mission of such a file; None: it is one of those that are flown.

    Args:
        path: The file.
        altitude_m: Where a route in GPX is flown, above home.
        origin: Where the origin of a file in metres stands.

    Raises:
        UsageError: one of these is missing, or is for other files.
        DocumentError: the file cannot be read.
    """
    suffix, in_metres = path.suffix.lower(), path.name.endswith(SUFFIX)
    if altitude_m is not None and suffix != GPX:
        raise UsageError("--altitude is for a FROM in GPX; other missions say it themselves")
    if in_metres and origin is None:
        raise UsageError(f"{path} is in metres: say where it stands, --origin LAT,LON")
    if origin is not None and not in_metres:
        raise UsageError(f"--origin is for files in metres ({SUFFIX})")
    if in_metres and origin is not None:
        return sim_plan_draft(Document.load(path), origin)
    if altitude_m is not None:
        return gpx_draft(read_gpx(bytes_of(path, MAX_BYTES), path), altitude_m)
    if suffix == WAYPOINTS:
        return read_waypoints(text_in(bytes_of(path, MAX_BYTES), path), path)
    return None
