"""No-fly zones from files of map programs and authorities: one way in for all of them.

GeoJSON, KML and KMZ, GPX, OpenAir, and the geozones of ED-269 and ED-318. What is near enough to
matter for a mission becomes part of its draft; docs/files.md says what is read of each format.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from air_router.files.json_document import json_from_text
from air_router.files.maps.geojson import read_geojson
from air_router.files.maps.geozones import read_geozones
from air_router.files.maps.gpx import read_gpx_zones
from air_router.files.maps.kml import read_kml
from air_router.files.maps.openair import read_openair
from air_router.files.maps.zone_reading import (
    AllowedZones,
    MapArea,
    MapCircle,
    MapOutline,
    ZoneReading,
    unique_names,
)
from air_router.files.mission_document import Area, Keys, MissionDocument
from air_router.files.whole_file import PlacedSource, bytes_within, is_file
from air_router.files.xml_document import kml_in
from geo.airspace.airspace import FENCE
from geo.airspace.zone import Shape
from geo.frame import LocalFrame, Point
from mocha_link.team.problem import DocumentError, Problem, text_in

MAX_BYTES: Final = 32 * 1024 * 1024
"""Of a file of zones: a country's geozones are larger than any mission."""

FENCED_REACH_M: Final = 2_000.0
OPEN_REACH_M: Final = 50_000.0
"""Zones farther than this from the fence, or from the mission's places without one, are left out:
no mission reaches farther."""

MOST_ZONES: Final = 3_000
"""Of one file near a mission; more are not looked at one by one by any person."""

_XML_READERS: Final = {".kml": read_kml, ".gpx": read_gpx_zones}
_OPENAIR_SUFFIXES: Final = (".txt", ".air", ".openair")
_DEGREE_M: Final = 111_000.0
_HALF_TURN_DEG: Final = 180.0
_TALL_DEG: Final = 20.0


def read_zones(path: Path, *, allow: Collection[str] = ()) -> ZoneReading:
    """The no-fly zones of a file, wherever on Earth they are.

    Args:
        path: a `.geojson`, `.json`, `.kml`, `.kmz`, `.gpx` or OpenAir file (`.txt`, `.air`).
        allow: restriction types (CONDITIONAL, ...) and identifiers of geozones, classes and names
            of airspaces to leave out, because the operator may fly there.

    Raises:
        DocumentError: the file cannot be read, or is of no known format; all else that is wrong
            with it is in the answer's `problems`.
    """
    raw = bytes_within(path, MAX_BYTES)
    suffix = path.suffix.lower()
    if suffix == ".kmz":
        kml, others = kml_in(raw, path, MAX_BYTES)
        packed = _without_kinds(read_kml(kml, path), allow)
        if others:
            message = f"of its KML files one is read; left out: {', '.join(others)[:80]}"
            packed.note((), message, "not-a-zone")
        return packed
    if suffix in _XML_READERS or raw[:200].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return _without_kinds(_XML_READERS.get(suffix, read_kml)(raw, path), allow)
    if suffix in _OPENAIR_SUFFIXES:
        return read_openair(raw, path, allow)
    document = json_from_text(text_in(raw, path), path)
    data = document.data
    if isinstance(data, dict) and data.get("fileType") == "Plan":
        message = "a QGroundControl plan is a mission; use it as one, or convert it to GeoJSON"
        raise DocumentError([document.problem((), message, "unknown-format")])
    reading = read_geozones(document, allow)
    if reading is None and isinstance(data, dict) and isinstance(data.get("type"), str):
        reading = _without_kinds(read_geojson(document), allow)
    if reading is not None:
        return reading
    message = (
        "none of GeoJSON, KML, GPX, OpenAir and geozones (ED-269, ED-318); choose another file"
    )
    raise DocumentError([document.problem((), message, "unknown-format")])


def _without_kinds(reading: ZoneReading, allow: Collection[str]) -> ZoneReading:
    """The zones of a file that does not say of what kind they are: none can be allowed."""
    AllowedZones(allow).tell(reading, f"restriction or class ({reading.kind} has none)")
    return reading


def add_zones(draft: MissionDocument, path: Path, keys: Keys, allow: Collection[str] = ()) -> None:
    """Add the zones of a file that are near enough to matter, once all else has been read.

    Problems and notices of the file go into the draft. `keys` say where the draft names the file.
    """
    if draft.frame is None:
        return
    if keys and not is_file(path):
        draft.report(keys, f"there is no file {path}; correct the path", "no-such-file")
        return
    try:
        reading = read_zones(path, allow=allow)
    except DocumentError as error:
        draft.problems.extend(error.problems)
        return
    draft.problems.extend(reading.problems)
    draft.notes.extend(reading.notes)
    if not (reading.zones or reading.problems or reading.notes):
        draft.note(keys, f"{reading.path.name}: there are no zones in it", "no-zones")
    around = _Surroundings(draft, draft.frame)
    near = [zone for zone in reading.zones if around.may_reach(_corners(zone))]
    exchanged = list(_exchanged(reading, near, around))
    if len(near) > MOST_ZONES:
        message = (
            f"{len(near)} zones near the mission, at most {MOST_ZONES} are read; thin them out"
        )
        draft.problems.append(reading.source.problem((), message, "too-large"))
    elif exchanged:
        draft.problems.extend(exchanged)
    else:
        kept = _add_near(draft, near, around)
        draft.problems.extend(_too_wide(reading, kept, around))
        if len(kept) < len(reading.zones) and not reading.problems:
            message = (
                f"{reading.path.name}: {len(kept)} of {len(reading.zones)} zones are within "
                f"{around.reach_m / 1000:g} km of the mission; the others are left out"
            )
            draft.note(keys, message, "zones-far")


def _add_near(
    draft: MissionDocument, near: Sequence[MapArea], around: _Surroundings
) -> list[MapArea]:
    """Add the zones that are near enough; which these are."""
    kept: list[tuple[MapArea, Shape]] = []
    for zone in near:
        shape = zone.placed(around.frame)
        if isinstance(shape, Problem):
            draft.problems.append(shape)
        elif around.distance_m(shape) <= around.reach_m:
            kept.append((zone, shape))
    taken = (FENCE, *(area.name for area in draft.zones))
    names = unique_names((zone.name for zone, _ in kept), taken)
    for name, (zone, shape) in zip(names, kept, strict=True):
        here = zone.problem("", "")  # without the whole document that it was read from
        keys, source = (here.line, here.column), PlacedSource(here.path)
        draft.zones.append(Area(name, shape, keys, True, zone.terms, source))
    return [zone for zone, _ in kept]


def _exchanged(
    reading: ZoneReading, near: Sequence[MapArea], around: _Surroundings
) -> Iterator[Problem]:
    """What says that latitudes and longitudes are exchanged, of all circles or all outlines.

    Nothing of that shape is near the mission, but something would be the other way around.
    """
    for kind in (MapCircle, MapOutline):
        if any(isinstance(zone.shape, kind) for zone in near):
            continue
        for zone in (zone for zone in reading.zones if isinstance(zone.shape, kind)):
            turned = _corners(zone)[:, ::-1]
            if np.abs(turned[:, 0]).max() <= 90 and around.may_reach(turned):
                message = (
                    f"no-fly zone '{zone.name}' is far from the mission, and near with latitude "
                    "and longitude exchanged; put the longitude first in this file"
                )
                yield zone.problem(message, "coordinates-exchanged")
                break


def _too_wide(
    reading: ZoneReading, kept: Sequence[MapArea], around: _Surroundings
) -> Iterator[Problem]:
    """What says of a zone that it is far only because sides lead around the Earth the short way.

    A mask of the whole world would be a line along the edge of the map. What is less tall is taken
    for a zone that lies on the antimeridian.
    """
    near = {id(zone) for zone in kept}
    for zone in reading.zones:
        corners = _corners(zone)
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


class _Surroundings:
    """Those of a mission, in degrees for a first look and in metres for the second.

    Attributes:
        frame: The mission's.
        reach_m: Zones that are farther away are left out.
    """

    def __init__(self, draft: MissionDocument, frame: LocalFrame) -> None:
        places = [corner for area in draft.fences for corner in area.shape.corners]
        self.frame, self.reach_m = frame, FENCED_REACH_M if places else OPEN_REACH_M
        if not places:
            spots = (draft.home, *draft.waypoints, *draft.rally_points)
            places = [spot.position for spot in spots if spot is not None] or [Point(0.0, 0.0)]
        west, south, east, north = shapely.MultiPoint(places).bounds
        self._box = shapely.box(west, south, east, north)  # around the mission's places
        middle = frame.to_geodetic(Point((west + east) / 2, (south + north) / 2))
        half_m = math.hypot(east - west, north - south) / 2 + self.reach_m
        half_deg = 1.01 * half_m / _DEGREE_M  # of latitude, from the middle to the edge
        widest_deg = min(abs(middle.latitude_deg) + half_deg, 89.9)
        self._middle = np.array(middle)  # latitude, longitude
        self._half = np.array([half_deg, half_deg / math.cos(math.radians(widest_deg))])

    def may_reach(self, corners: NDArray[np.float64]) -> bool:
        """Whether a box around corners (rows of latitude, longitude) may come near enough."""
        offsets = corners - self._middle
        offsets[:, 1] = (offsets[:, 1] + 180) % 360 - 180
        if np.ptp(offsets[:, 1]) > 180:  # around half the Earth: the look in metres decides
            return True
        return bool(
            (offsets.min(axis=0) <= self._half).all() and (offsets.max(axis=0) >= -self._half).all()
        )

    def may_reach_unwrapped(self, corners: NDArray[np.float64]) -> bool:
        """The same on a map that ends at the antimeridian."""
        near = (corners.min(axis=0) <= self._middle + self._half) & (
            corners.max(axis=0) >= self._middle - self._half
        )
        return bool(near.all())

    def distance_m(self, shape: Shape) -> float:
        """From the box of the mission's places to a shape."""
        return float(self._box.distance(shape.polygon))


def _corners(zone: MapArea) -> NDArray[np.float64]:
    """Latitudes and longitudes around which the zone's box is drawn."""
    if not isinstance(zone.shape, MapCircle):
        return np.array(zone.shape.ring)
    half_deg = 1.01 * zone.shape.radius_m / _DEGREE_M
    widest_deg = min(abs(zone.shape.centre.latitude_deg) + half_deg, 89.9)
    half_lon_deg = min(half_deg / math.cos(math.radians(widest_deg)), 89.0)
    half = np.array([half_deg, half_lon_deg])
    return np.array([zone.shape.centre - half, zone.shape.centre + half])
