"""No-fly zones from files of map programs and authorities: one way in for all of them.

GeoJSON, KML and KMZ, GPX, OpenAir, and the geozones of ED-269 and ED-318. What is near enough to
matter for a mission becomes part of its draft; docs/files.md says what is read of each format.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from air_router.files.json_document import json_from_text
from air_router.files.maps.geojson import read_geojson
from air_router.files.maps.geozones import is_ed318, read_ed269, read_ed318, zones_key
from air_router.files.maps.gpx import read_gpx_zones
from air_router.files.maps.kml import read_kml
from air_router.files.maps.openair import read_openair
from air_router.files.maps.zone_reading import MapArea, MapCircle, ZoneReading
from air_router.files.mission_document import Area, FilePlace, Keys, MissionDocument, local_ring
from air_router.files.whole_file import bytes_of, text_in
from air_router.files.xml_document import kml_in
from geo.airspace.zone import Circle, Outline, Shape, ZoneError
from geo.frame import FrameError, Geodetic, LocalFrame, Point
from mocha_link.team.problem import DocumentError, Problem

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
    raw = bytes_of(path, MAX_BYTES)
    suffix = path.suffix.lower()
    if suffix == ".kmz":
        raw, suffix = kml_in(raw, path, MAX_BYTES), ".kml"
    if suffix in _XML_READERS or raw[:200].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return _XML_READERS.get(suffix, read_kml)(raw, path)
    text = text_in(raw, path)
    if suffix in _OPENAIR_SUFFIXES:
        return read_openair(text, path, allow)
    document = json_from_text(text, path)
    data = document.data
    if isinstance(data, dict) and data.get("fileType") == "Plan":
        message = "a QGroundControl plan is a mission; use it as one, or convert it to GeoJSON"
        raise DocumentError([document.problem((), message, "unknown-format")])
    if isinstance(data, list) or (isinstance(data, dict) and _is_ed269(data)):
        return read_ed269(document, allow)
    if is_ed318(data):
        return read_ed318(document, allow)
    if isinstance(data, dict) and isinstance(data.get("type"), str):
        return read_geojson(document)
    message = (
        "none of GeoJSON, KML, GPX, OpenAir and geozones (ED-269, ED-318); choose another file"
    )
    raise DocumentError([document.problem((), message, "unknown-format")])


def add_zones(draft: MissionDocument, path: Path, keys: Keys, allow: Collection[str] = ()) -> None:
    """Add the zones of a file that are near enough to matter, once all else has been read.

    Problems and notices of the file go into the draft. `keys` say where the draft names the file.
    """
    if draft.frame is None:
        return
    try:
        reading = read_zones(path, allow=allow)
    except DocumentError as error:
        draft.problems.extend(error.problems)
        return
    draft.problems.extend(reading.problems)
    draft.notes.extend(reading.notes)
    box = _Box(draft)
    near = [zone for zone in reading.zones if box.near(_corners(zone))]
    if len(near) > MOST_ZONES:
        message = (
            f"{len(near)} zones near the mission, at most {MOST_ZONES} are read; thin them out"
        )
        draft.problems.append(reading.source.problem((), message, "too-large"))
        return
    if not _exchanged(draft, reading, near, box):
        _place(draft, reading, near, keys)


def placed(zone: MapArea, frame: LocalFrame, what: str = "no-fly zone ") -> Shape | Problem:
    """The zone's shape in a local frame, or why it has none there."""
    try:
        if isinstance(zone.shape, MapCircle):
            return Circle(frame.to_local(*zone.shape.centre), zone.shape.radius_m)
        ring, *holes = (local_ring(ring, frame) for ring in (zone.shape.ring, *zone.shape.holes))
        return Outline(ring, tuple(holes))
    except (ZoneError, FrameError) as error:
        code = error.code if isinstance(error, ZoneError) else "not-on-earth"
        message = f"{what}'{zone.name}' cannot be an area: {error}; draw it again"
        return zone.problem(message, code)


def unique_names(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """The names, with a number behind those that are taken: two zones are never called the same."""
    used, answer = set(taken), []
    for name in names:
        unique, number = name, 1
        while unique in used:
            number += 1
            unique = f"{name} ({number})"
        used.add(unique)
        answer.append(unique)
    return answer


def _is_ed269(data: dict[str, Any]) -> bool:
    """Whether it has features, and not those of GeoJSON: their geometries are lists of volumes."""
    features = data.get(zones_key(data))
    if not isinstance(features, list):
        return False
    if data.get("type") != "FeatureCollection":
        return True
    first = next((entry for entry in features if isinstance(entry, dict)), {})
    return isinstance(first.get("geometry"), list)


def _place(
    draft: MissionDocument, reading: ZoneReading, near: Sequence[MapArea], keys: Keys
) -> None:
    frame, box = draft.frame, _Box(draft)
    if frame is None:
        return
    kept: list[tuple[MapArea, Shape]] = []
    for zone in near:
        shape = placed(zone, frame)
        if isinstance(shape, Problem):
            draft.problems.append(shape)
        elif box.distance_m(shape) <= box.reach_m:
            kept.append((zone, shape))
    names = unique_names((zone.name for zone, _ in kept), (area.name for area in draft.zones))
    for name, (zone, shape) in zip(names, kept, strict=True):
        here = zone.problem("", "")
        draft.zones.append(
            Area(
                name,
                shape,
                keys,
                crosses_fence=True,
                terms=zone.terms,
                place=FilePlace(reading.path, here.line, here.column),
            )
        )
    left = len(reading.zones) - len(kept)
    if left and not reading.problems:
        message = (
            f"{reading.path.name}: {len(kept)} of {len(reading.zones)} zones are within "
            f"{box.reach_m / 1000:g} km of the mission; the others are left out"
        )
        draft.note(keys, message, "zones-far")


def _exchanged(
    draft: MissionDocument, reading: ZoneReading, near: Sequence[MapArea], box: _Box
) -> bool:
    """Whether latitudes and longitudes are exchanged, of all circles or all outlines of a file.

    Nothing of that shape is near the mission, but something would be the other way around.
    """
    found = False
    for kind in (True, False):
        group = [zone for zone in reading.zones if isinstance(zone.shape, MapCircle) is kind]
        if any(isinstance(zone.shape, MapCircle) is kind for zone in near):
            continue
        turned = next((zone for zone in group if box.near(_turned(_corners(zone)))), None)
        if turned is not None:
            found = True
            message = (
                f"no-fly zone '{turned.name}' is far from the mission, and near with latitude and "
                "longitude exchanged; put the longitude first in this file"
            )
            code = "coordinates-exchanged"
            draft.problems.append(turned.problem(message, code))
    return found


class _Box:
    """The mission's surroundings, in degrees for a first look and in metres for the second."""

    def __init__(self, draft: MissionDocument) -> None:
        places = [corner for area in draft.fences for corner in area.shape.corners]
        self.reach_m = FENCED_REACH_M if places else OPEN_REACH_M  # farther zones are left out
        if not places:
            spots = [*([draft.home] if draft.home else []), *draft.waypoints]
            places = [spot.position for spot in (*spots, *draft.rally_points)]
        places = places or [Point(0.0, 0.0)]
        # south-west
        self._low = Point(min(p.east_m for p in places), min(p.north_m for p in places))
        # north-east
        self._high = Point(max(p.east_m for p in places), max(p.north_m for p in places))
        frame = draft.frame or LocalFrame(Geodetic(0.0, 0.0))
        middle = Point(*((low + high) / 2 for low, high in zip(self._low, self._high, strict=True)))
        self._middle = frame.to_geodetic(middle)  # of the surroundings
        half_m = math.dist(self._low, self._high) / 2 + self.reach_m
        self._half_lat_deg = 1.01 * half_m / _DEGREE_M  # from the middle to the edge
        widest_deg = min(abs(self._middle.latitude_deg) + self._half_lat_deg, 89.9)
        self._half_lon_deg = self._half_lat_deg / math.cos(math.radians(widest_deg))  # likewise

    def near(self, corners: NDArray[np.float64]) -> bool:
        """Whether a box around corners (rows of latitude, longitude) may come near enough."""
        if len(corners) == 0:
            return False
        lat = corners[:, 0] - self._middle.latitude_deg
        lon = (corners[:, 1] - self._middle.longitude_deg + 180) % 360 - 180
        if np.ptp(lon) > 180:  # reaches around half the Earth: the look in metres decides
            return True
        return bool(
            lat.min() <= self._half_lat_deg
            and lat.max() >= -self._half_lat_deg
            and lon.min() <= self._half_lon_deg
            and lon.max() >= -self._half_lon_deg
        )

    def distance_m(self, shape: Shape) -> float:
        """From the box of the mission's places to a shape."""
        return float(shapely.box(*self._low, *self._high).distance(shape.polygon))


def _corners(zone: MapArea) -> NDArray[np.float64]:
    """Latitudes and longitudes around which the zone's box is drawn."""
    if not isinstance(zone.shape, MapCircle):
        return np.array(zone.shape.ring)
    lat, lon = zone.shape.centre
    half_lat = 1.01 * zone.shape.radius_m / _DEGREE_M
    half_lon = min(half_lat / math.cos(math.radians(min(abs(lat) + half_lat, 89.9))), 89.0)
    return np.array([[lat - half_lat, lon - half_lon], [lat + half_lat, lon + half_lon]])


def _turned(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    turned = corners[:, ::-1]
    return turned if np.abs(turned[:, 0]).max() <= 90 else turned[:0]
