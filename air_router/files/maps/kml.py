"""No-fly zones from KML: polygons with holes, in folders and multi-geometries; round ones.

A polygon that is extruded down to the ground ends at its altitude; any other has no altitude
limit. `ExtendedData` may say more, with the names of the mission file (`clearance_m`, `upper_m`).
"""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from air_router.files.json_document import is_number
from air_router.files.maps.limits import terms_of
from air_router.files.maps.zone_reading import (
    MAX_ALTITUDE_M,
    MAX_RADIUS_M,
    ZONE_KIND,
    MapCircle,
    MapOutline,
    MapRing,
    Shapes,
    ZoneReading,
    outline_of_rings,
    place_of,
)
from air_router.files.whole_file import PlacedSource
from air_router.files.xml_document import Element, parse_xml
from air_router.files.zone_terms import AltitudeLimit, Altitudes, Reference
from geo.frame import Geodetic

_FOLDERS: Final = frozenset({"kml", "Document", "Folder"})
_NOT_FOLLOWED: Final = frozenset(
    {"NetworkLink", "GroundOverlay", "ScreenOverlay", "PhotoOverlay", "Tour"}
)
_NO_AREAS: Final = frozenset({"Point", "LineString", "LinearRing", "Model", "Track", "MultiTrack"})
_REFERENCES: Final = {"relativeToGround": Reference.GROUND, "absolute": Reference.AMSL}


def read_kml(raw: bytes, path: Path) -> ZoneReading:
    """The zones of a KML file's bytes. Raises DocumentError: it is not XML."""
    root = parse_xml(raw, path)
    reader = _Reader(ZoneReading(PlacedSource(path), "KML"))
    if root.name in _FOLDERS:
        reader.read(root)
    else:
        message = f"the outermost element is <{root.name[:30]}>, not <kml>; choose another file"
        reader.reading.report(root.keys, message, "not-kml")
    return reader.reading


class _Reader:
    def __init__(self, reading: ZoneReading) -> None:
        self.reading = reading
        self._number = 0  # of the placemark
        self._others = 0  # placemarks that are no zones

    def read(self, root: Element) -> None:
        for element in self._placemarks(root):
            self._number += 1
            self._placemark(element)
        if self._others:
            message = f"{self._others} placemarks are no zones, by their data 'kind': left out"
            self.reading.note((), message, "not-a-zone")

    def _placemarks(self, folder: Element) -> Iterator[Element]:
        for child in folder.children:
            if child.name == "Placemark":
                yield child
            elif child.name in _FOLDERS:
                yield from self._placemarks(child)
            elif child.name in _NOT_FOLLOWED:
                message = f"<{child.name}> is not followed: left out"
                self.reading.note(child.keys, message, "not-a-zone")

    def _placemark(self, element: Element) -> None:
        data = dict(_data(element))
        if data.get("kind", ZONE_KIND) != ZONE_KIND:
            self._others += 1
            return
        name = element.text_of("name")[:80] or f"{self.reading.path.stem} {self._number}"

        def place(key: str) -> tuple[int, int]:
            named = (e for e in _data_elements(element) if e.attributes["name"] == key)
            return next(named, element).keys

        terms = terms_of(data, self.reading, place)
        circle = self._circle(element, data)
        shapes: Shapes = []
        heights: list[AltitudeLimit | None] = []
        if circle is not None:
            shapes = [(element.keys, circle)]
        else:
            for polygon in self._polygons(element):
                outline = self._outline(polygon)
                shapes += [(polygon.keys, outline)] if outline else []
                heights.append(self._height(polygon))
        upper = _highest(heights)
        if upper is not None and terms.altitudes is None:
            terms = replace(terms, altitudes=Altitudes(upper=upper))
        self.reading.add(name, shapes, terms)

    def _circle(self, element: Element, data: dict[str, Any]) -> MapCircle | None:
        """A point with a radius."""
        point, radius_m = element.child("Point", "coordinates"), data.get("radius_m")
        if radius_m is None:
            return None
        if not is_number(radius_m) or not 0 < radius_m <= MAX_RADIUS_M:
            message = f"'radius_m' must be more than 0 metres, found {str(radius_m)[:20]!r}"
            self.reading.report(element.keys, f"{message}; correct it", "out-of-range")
            return None
        places = None if point is None else self._places(point)
        return MapCircle(places[0], radius_m) if places else None

    def _polygons(self, element: Element) -> Iterator[Element]:
        found = False
        for child in element.children:
            if child.name == "Polygon":
                found = True
                yield child
            elif child.name == "MultiGeometry":
                found = True
                yield from self._polygons(child)
            elif child.name in _NO_AREAS:
                found = True
                self.reading.report(
                    child.keys,
                    f"a {child.name} has no area; draw a polygon, or give a point the data "
                    "'radius_m'",
                    "no-area",
                )
        if not found and element.name == "Placemark":
            message = "a placemark without a geometry: left out"
            self.reading.note(element.keys, message, "no-area")

    def _outline(self, polygon: Element) -> MapOutline | None:
        outer = list(polygon.all("outerBoundaryIs"))
        if len(outer) != 1:
            message = f"a polygon has one outer boundary, found {len(outer)}; draw it again"
            self.reading.report(polygon.keys, message, "missing-key")
            return None
        rings = [self._ring(ring) for ring in [*outer, *polygon.all("innerBoundaryIs")]]
        return outline_of_rings(rings)

    def _ring(self, boundary: Element) -> MapRing | None:
        coordinates = boundary.child("LinearRing", "coordinates")
        if coordinates is None:
            message = "a boundary without coordinates; draw it again"
            self.reading.report(boundary.keys, message, "missing-key")
            return None
        places = self._places(coordinates)
        return None if places is None else self.reading.ring(places, coordinates.keys)

    def _places(self, element: Element) -> list[Geodetic] | None:
        """The places of <coordinates>; None, with a problem noted."""
        places = []
        for word in element.text.split():
            try:
                longitude_deg, latitude_deg, _ = _numbers(word)
            except ValueError:
                message = f"'{word[:40]}' is not longitude,latitude or longitude,latitude,altitude"
                self.reading.report(element.keys, f"{message}; correct it", "wrong-type")
                return None
            place = place_of(latitude_deg, longitude_deg)
            if place is None:
                message = f"there is no place '{word[:40]}'"
                self.reading.report_place(element.keys, message, longitude_deg, latitude_deg)
                return None
            places.append(place)
        if not places:
            self.reading.report(
                element.keys, "no coordinates; draw it again", "zone-too-few-corners"
            )
            return None
        return places

    def _height(self, polygon: Element) -> AltitudeLimit | None:
        """Where an extruded polygon ends; None: it has no limit."""
        reference = _REFERENCES.get(polygon.text_of("altitudeMode"))
        coordinates = polygon.child("outerBoundaryIs", "LinearRing", "coordinates")
        if reference is None or coordinates is None:
            return None
        try:
            highest_m = max(_numbers(word)[2] for word in coordinates.text.split())
        except ValueError:
            return None
        if polygon.text_of("extrude") not in ("1", "true") or highest_m <= 0:
            message = "an area that is not extruded from the ground: read as without altitude limit"
            self.reading.note(polygon.keys, message, "no-height")
            return None
        return AltitudeLimit(min(highest_m, MAX_ALTITUDE_M), reference)


def _data_elements(placemark: Element) -> Iterator[Element]:
    extended = placemark.child("ExtendedData")
    if extended is None:
        return
    simple = [data for schema in extended.all("SchemaData") for data in schema.all("SimpleData")]
    for element in [*extended.all("Data"), *simple]:
        if "name" in element.attributes:
            yield element


def _data(placemark: Element) -> Iterator[tuple[str, Any]]:
    for element in _data_elements(placemark):
        text = element.text_of("value") if element.name == "Data" else element.text.strip()
        try:
            value = json.loads(text) if len(text) < 10_000 else text
        except (ValueError, RecursionError):
            value = text
        yield element.attributes["name"], value


def _numbers(word: str) -> tuple[float, float, float]:
    parts = [float(part) for part in word.split(",")]
    if not 2 <= len(parts) <= 3 or not all(map(math.isfinite, parts)):
        raise ValueError(word)
    return parts[0], parts[1], parts[2] if len(parts) == 3 else 0.0


def _highest(limits: list[AltitudeLimit | None]) -> AltitudeLimit | None:
    """The limit of several polygons of one zone: the highest, none if one has none."""
    known = [limit for limit in limits if limit is not None]
    if not known or len(known) < len(limits) or len({limit.reference for limit in known}) > 1:
        return None
    return max(known, key=lambda limit: limit.metres)
