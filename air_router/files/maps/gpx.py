"""No-fly zones from GPX: tracks and routes that were walked or drawn around them."""

from pathlib import Path
from typing import Final

from air_router.files.gpx_document import GpxLine, read_gpx
from air_router.files.maps.reading import MapOutline, ZoneReading, ZoneTerms
from geo.geodesic import polar

_CLOSED_M: Final = 25.0
"""A line whose ends are no farther from each other than this is the border of an area."""


def read_gpx_zones(raw: bytes, path: Path) -> ZoneReading:
    """The zones of a GPX file. Raises DocumentError: it is no GPX."""
    document = read_gpx(raw, path)
    reading = ZoneReading(document.source, "GPX")
    for problem in document.problems:
        reading.report((problem.line, problem.column), problem.message, problem.code)
    lines = [*document.routes, *document.tracks]
    zones = [line for line in lines if line.kind == "zone"] or lines
    for number, line in enumerate(zones, start=1):
        _add(reading, line, line.name or f"{path.stem} {number}")
    left = len(lines) - len(zones) + len(document.points)
    if left:
        message = f"{left} points and lines of other types than 'zone': left out"
        reading.note((), message, "not-a-zone")
    return reading


def _add(reading: ZoneReading, line: GpxLine, name: str) -> None:
    places = [point.place for point in line.points]
    if not places:
        reading.note(line.keys, f"'{name}' has no points: left out", "no-area")
        return
    _, gap_m = polar(places[0], places[-1])
    if gap_m > _CLOSED_M:
        message = (
            f"'{name}' ends {gap_m:.0f} m from where it begins, so it has no area; close it, or "
            "draw a polygon"
        )
        reading.report(line.keys, message, "no-area")
        return
    ring = reading.ring(places, line.keys)
    if ring is not None:
        reading.add(name, [(line.keys, MapOutline(ring))], ZoneTerms())
