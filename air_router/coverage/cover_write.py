"""Writes a coverage's waypoints: as a section of a mission file, or as a whole mission."""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from air_router.coverage.cover_area import Field
from air_router.errors import AirRouterError, MissionFileError, UsageError
from air_router.files.mission_document import MissionPoint
from air_router.files.missions.mission_file import read_mission
from air_router.files.missions.mission_write import mission_text
from air_router.files.text_edit import with_section
from air_router.mission.loading import validate
from geo.coverage.coverage import Coverage
from geo.frame import Point
from mocha_link.team.document import Document

_METRES, _DEGREES = 2, 7
"""Decimals: rows keep 3 cm to spare, these move a place by less than 1 cm."""

_APART_M = 0.2
"""Waypoints that are nearer to each other than this would be taken for one."""


def waypoints_of(plan: Coverage, field: Field, every_m: float | None) -> list[Point]:
    """The ends of the rows in order of flight, as they will be written.

    Where rows are longer than `every_m` there are waypoints between the ends too. The ways from
    row to row are left to the autopilot or pilot: a mission's router finds clear ones.
    """
    places: list[Point] = []
    for row in plan.rows:
        count = 1 if every_m is None else max(1, math.ceil(row.length_m / every_m))
        for share in np.linspace(0.0, 1.0, count + 1).tolist():
            east_m, north_m = (a + share * (b - a) for a, b in zip(row.start, row.end, strict=True))
            place = _rounded(Point(east_m, north_m), field)
            if all(math.dist(place, other) >= _APART_M for other in places):
                places.append(place)
    _check(plan, field)
    return places


def place_text(field: Field, waypoints: Sequence[Point]) -> str:
    """The section `waypoints` of a mission file."""
    lines = ["waypoints:"]
    for number, waypoint in enumerate(waypoints, start=1):
        pair = _pair(field, waypoint)
        if field.altitude_m != field.draft.altitude_m and not field.draft.uavs:
            pair = f"{{position: {pair}, altitude_m: {field.altitude_m:g}}}"
        lines.append(f"  - {pair}" + (f"  # {number}" if number % 5 in {0, 1} else ""))
    return "\n".join(lines) + "\n"


def written(field: Field, waypoints: Sequence[Point], source: Path, folder: Path) -> str:
    """A whole mission for a file in `folder`, from the mission in `source` if it is one.

    Raises:
        UsageError: there is no mission, and no home for one; or paths of the mission would be lost.
        MissionFileError: the mission cannot be flown with these waypoints.
    """
    draft = field.draft
    if draft.home is None:
        raise UsageError("a mission needs a home; give --home LAT,LON, or leave --out away")
    text = None
    if draft.source.path == source and source.suffix.lower() in {".yaml", ".yml"}:
        old = source.read_text(encoding="utf-8")
        document = Document.from_text(old, source)
        text = with_section(old, document, "waypoints", place_text(field, waypoints))
    if text is not None:
        if folder.resolve() != source.parent.resolve() and (draft.team or draft.world):
            raise UsageError(
                f"the mission names files beside it; write into {source.parent} as well"
            )
        _check_mission(text, source)
        return text
    draft.waypoints = [
        MissionPoint(f"waypoint {number}", place, (), None if draft.uavs else field.altitude_m)
        for number, place in enumerate(waypoints, start=1)
    ]
    validate(
        draft
    )  # home may be too near to a zone, the sea's level that limits count from not known
    if draft.problems:
        raise MissionFileError(draft.problems)
    return mission_text(draft, folder)


def _check_mission(text: str, source: Path) -> None:
    """The mission with its new waypoints has no other problems than it had."""
    draft = read_mission(Document.from_text(text, source))
    validate(draft)
    if draft.problems:
        raise MissionFileError(draft.problems)


def _check(plan: Coverage, field: Field) -> None:
    """Every leg is clear as it is written, too."""
    places = [_rounded(point, field) for point in plan.track]
    legs = np.array([leg for leg in pairwise(places) if leg[0] != leg[1]], dtype=float)
    if not len(legs):
        return
    clear = field.airspace.legs_clear_between(legs[:, 0], legs[:, 1])
    if not clear.all():
        start, _ = legs[int(np.flatnonzero(~clear)[0])]
        raise AirRouterError(
            f"a leg from {_pair(field, Point(*start))} would come too near to a zone when written "
            "with so many decimals; please report this area"
        )


def _rounded(point: Point, field: Field) -> Point:
    if field.draft.in_metres:
        return Point(round(point.east_m, _METRES), round(point.north_m, _METRES))
    latitude_deg, longitude_deg = field.frame.to_geodetic(point)
    return field.frame.to_local(round(latitude_deg, _DEGREES), round(longitude_deg, _DEGREES))


def _pair(field: Field, place: Point) -> str:
    if field.draft.in_metres:
        return f"[{place.east_m:.{_METRES}f}, {place.north_m:.{_METRES}f}]"
    latitude_deg, longitude_deg = field.frame.to_geodetic(place)
    return f"[{latitude_deg:.{_DEGREES}f}, {longitude_deg:.{_DEGREES}f}]"
