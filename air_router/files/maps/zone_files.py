"""No-fly zones from files of map programs and authorities: one way in for all of them.

Their formats are those of `zone_formats`: ours, and those of other packages. Zones near enough to
matter for a mission become part of it; docs/files.md lists what is read of each format.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from air_router.files import (
    Area,
    Findings,
    Keys,
    PlacedSource,
    bytes_within,
)
from air_router.files.maps.json_zones import KNOWN
from air_router.files.maps.map_area import MapArea, MapCircle, MapOutline, unique_names
from air_router.files.maps.surroundings import Surroundings
from air_router.files.maps.zone_formats import read_features
from air_router.files.maps.zone_reading import ZoneChoice, ZoneReading
from geo.airspace import FENCE, Shape
from mocha_link.team import Problem

MAX_BYTES: Final = 32 * 1024 * 1024
"""Of a file of zones: a country's geozones are larger than any mission."""

MOST_ZONES: Final = 3_000
"""Problems of one file near a mission: no operator checks more one by one."""

_HALF_TURN_DEG: Final = 180.0
_TALL_DEG: Final = 20.0


def read_zones(
    path: Path, *, allow: Collection[str] = (), skip: Collection[str] = ()
) -> ZoneReading:
    """The no-fly zones of a file, wherever on Earth they are.

    What format it is of is seen in it; its name only decides where nothing in it does.

    Args:
        path: GeoJSON, KML, KMZ, GPX, OpenAir, geozones, or ArduPilot's fences.
        allow: restriction types (CONDITIONAL, ...) and identifiers of geozones, classes and names
            of airspaces to leave out, because the operator may fly there.
        skip: kinds and names of zones of any file to leave out, because they are none.

    Raises:
        DocumentError: the file cannot be read, or is of no known format; all else that is wrong
            with it is in the answer's `problems`.
    """
    elsewhere = _ELSEWHERE.get(path.suffix.lower(), "")
    advice = elsewhere and f"{elsewhere}; zones are read from {KNOWN}"
    features = read_features(bytes_within(path, MAX_BYTES), path, advice)
    return ZoneReading(features, path, ZoneChoice(allow, skip))


_YAML: Final = "a YAML file: `air-router convert` writes the zones of a mission as GeoJSON"
_ELSEWHERE: Final = {
    ".yaml": _YAML,
    ".yml": _YAML,
    ".shp": "a shapefile: `ogr2ogr zones.geojson zones.shp` writes it as GeoJSON",
    ".dxf": "a drawing: a GIS program writes its areas as GeoJSON",
    ".csv": "a table: a GIS program writes its areas as GeoJSON",
}
"""Files that people try, by the ending of their names, and what leads to zones."""


def zones_near(
    reading: ZoneReading,
    around: Surroundings,
    taken: Collection[str],
    keys: Keys,
    findings: Findings,
) -> Sequence[Area]:
    """The zones of a file that are near enough to matter for a mission, under names of their own.

    Args:
        reading: The file.
        around: The mission's surroundings.
        taken: Names of other zones.
        keys: Where the mission names the file.
        findings: Get problems and notices of the file, but for those of zones that are far from
            the mission: one that cannot be read is noted.
    """
    problems, notes = reading.findings(around.may_reach)
    findings.problems += problems
    findings.notes += notes
    if not (reading.zones or reading.problems or reading.notes):
        findings.note(keys, f"{reading.path.name}: there are no zones in it", "no-zones")
    near = [zone for zone in reading.zones if around.may_reach(zone.extent())]
    if len(near) > MOST_ZONES:
        message = (
            f"{len(near)} zones near the mission, at most {MOST_ZONES} are read; thin them out"
        )
        findings.problems.append(reading.source.problem((), message, "too-large"))
        return ()
    if exchanged := list(_exchanged(reading, near, around)):
        findings.problems += exchanged
        return ()
    areas, kept = _near(near, around, taken, findings)
    findings.problems += _too_wide(reading, kept, around)
    if len(kept) < len(reading.zones) and not problems:
        message = (
            f"{reading.path.name}: {len(kept)} of {len(reading.zones)} zones are within "
            f"{around.reach_m / 1000:g} km of the mission; the others are left out"
        )
        findings.note(keys, message, "zones-far")
    return areas


def _near(
    near: Sequence[MapArea], around: Surroundings, taken: Collection[str], findings: Findings
) -> tuple[list[Area], list[MapArea]]:
    """The zones that are near enough, and which these are, as the file has them."""
    kept: list[tuple[MapArea, Shape]] = []
    read: list[MapArea] = []
    for zone in near:
        sound, repair = zone.sound()
        found: list[tuple[MapArea, Shape]] = []
        for area in sound:
            shapes = area.placed_areas(around.frame)
            if isinstance(shapes, Problem):
                findings.problems.append(shapes)
            else:
                found += [each for each in shapes if around.distance_m(each[1]) <= around.reach_m]
        kept += found
        read += [zone] if found else []
        if repair is not None and found:
            findings.notes.append(repair)
    names = unique_names((zone.name for zone, _ in kept), (FENCE, *taken))
    return [_area(name, *each) for name, each in zip(names, kept, strict=True)], read


def _area(name: str, zone: MapArea, shape: Shape) -> Area:
    here = zone.problem("", "")  # without the whole document that it was read from
    keys, source = (here.line, here.column), PlacedSource(here.path)
    return Area(name, shape, keys, True, zone.terms, source)


def _exchanged(
    reading: ZoneReading, near: Sequence[MapArea], around: Surroundings
) -> Iterator[Problem]:
    """The message that latitudes and longitudes are exchanged, of all circles or all outlines.

    Nothing of that shape is near the mission, but something would be the other way around.
    """
    for kind in (MapCircle, MapOutline):
        if any(isinstance(zone.shape, kind) for zone in near):
            continue
        for zone in (zone for zone in reading.zones if isinstance(zone.shape, kind)):
            turned = zone.extent()[:, ::-1]
            if np.abs(turned[:, 0]).max() <= 90 and around.may_reach(turned):
                message = (
                    f"no-fly zone '{zone.name}' is far from the mission, and near with latitude "
                    "and longitude exchanged; put the longitude first in this file"
                )
                yield zone.problem(message, "coordinates-exchanged")
                break


def _too_wide(
    reading: ZoneReading, kept: Sequence[MapArea], around: Surroundings
) -> Iterator[Problem]:
    """The message that a zone is far only because sides lead around the Earth the short way.

    A mask of the whole world would be a line along the edge of the map. What is less tall is taken
    for a zone that lies on the antimeridian.
    """
    near = {id(zone) for zone in kept}
    for zone in reading.zones:
        corners = zone.extent()
        wide = np.ptp(corners[:, 1]) >= _HALF_TURN_DEG and not isinstance(zone.shape, MapCircle)
        if id(zone) in near or not wide:
            continue
        sides_deg = np.abs(np.diff(corners[:, 1], append=corners[0, 1]))
        tall = np.ptp(corners[:, 0]) >= _TALL_DEG or np.ptp(corners[:, 1] % 360) == 0
        if sides_deg.max() >= _HALF_TURN_DEG and tall and around.may_reach_unwrapped(corners):
            message = (
                f"no-fly zone '{zone.name}' has a side over 180 degrees of longitude or more, "
                "which is taken to lead over the antimeridian, far from the mission; draw it "
                "smaller"
            )
            yield zone.problem(message, "too-wide")
