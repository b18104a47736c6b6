"""KML of Google Earth and others: no-fly zones read from it, and everything that can be drawn.

Zones are polygons with holes, in folders and multi-geometries, and points with a radius. A polygon
that is extruded down to the ground ends at its altitude; any other has no altitude limit. What KML
has no element for (clearances, lower limits, schedules) is in `ExtendedData`, with the names of
the mission file, and is read back from there; circles that we write are polygons around them.
"""

import json
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, Final

from air_router.files import (
    AltitudeLimit,
    Altitudes,
    Element,
    PlacedSource,
    Reference,
    is_number,
    kml_in,
    parse_xml,
    terms_data,
)
from air_router.files.maps.feature_set import FeatureSet, MapPoint, counterclockwise
from air_router.files.maps.gpx import GPX
from air_router.files.maps.limits import terms_of
from air_router.files.maps.map_area import (
    MapArea,
    MapCircle,
    MapOutline,
    MapRing,
    outline_of_rings,
    place_of,
)
from air_router.files.maps.property_names import is_zone
from air_router.files.maps.zone_format import (
    MAX_ALTITUDE_M,
    MAX_RADIUS_M,
    Shapes,
    ZoneFeature,
    ZoneFeatures,
    short_name,
)
from geo.frame import Geodetic, circle_around
from mocha_link.team import pair_in

_FOLDERS: Final = frozenset({"kml", "Document", "Folder"})
_NOT_FOLLOWED: Final = frozenset(
    {"NetworkLink", "GroundOverlay", "ScreenOverlay", "PhotoOverlay", "Tour"}
)
_NO_AREAS: Final = frozenset({"Point", "LineString", "LinearRing", "Model", "Track", "MultiTrack"})
_AREAS: Final = frozenset({"Placemark", "Polygon"})
"""Elements that must not stand elsewhere: they would be left out silently."""

_GROUND, _SEA = "relativeToGround", "absolute"  # KML's altitude modes
_REFERENCES: Final = {_GROUND: Reference.GROUND, _SEA: Reference.AMSL}
_LONGEST_JSON: Final = 10_000
_COMMA = re.compile(r"\s*,\s*")
_ADVICE: Final = "draw a polygon, or give a point the data 'radius_m'"
_ZIP: Final = b"PK\x03\x04"
MAX_BYTES: Final = 32 * 1024 * 1024
"""Of a KML file that is unpacked: as of any file of zones."""

_DJI_MISSION: Final = "templateType"
_DJI_TEMPLATES: Final = frozenset({"waypoint", "mapping2d", "mapping3d", "mappingStrip"})
"""What folders of DJI's missions are for: their polygons are survey areas."""


class KmlFormat:
    """KML."""

    name: Final = "KML"
    suffixes: Final = (".kml",)

    def recognises(self, head: bytes) -> bool:
        """Whether it is XML that no other format knows."""
        return head.startswith(b"<") and not GPX.recognises(head)

    def read(self, content: bytes, path: Path) -> ZoneFeatures:
        """The placemarks. Raises DocumentError: it is not XML."""
        root = parse_xml(content, path)
        return ZoneFeatures(_Reader(PlacedSource(path)).features(root), self.name)


class KmzFormat:
    """KML in a zip archive."""

    name: Final = "KMZ"
    suffixes: Final = (".kmz",)

    def recognises(self, head: bytes) -> bool:
        """Whether it is a zip archive."""
        return head.startswith(_ZIP)

    def read(self, content: bytes, path: Path) -> ZoneFeatures:
        """The placemarks. Raises DocumentError: it is no archive with a KML file in it."""
        kml, others = kml_in(content, path, MAX_BYTES)
        packed = KML.read(kml, path)
        if not others:
            return packed
        file = ZoneFeature(PlacedSource(path))
        message = f"of its KML files one is read; left out: {', '.join(others)[:80]}"
        file.note((), message, "not-a-zone")
        return replace(packed, features=chain(packed.features, [file]))


KML: Final = KmlFormat()
KMZ: Final = KmzFormat()


class _Reader:
    def __init__(self, source: PlacedSource) -> None:
        self._source = source
        self._feature = ZoneFeature(source)  # the one that is read
        self._count = 0  # of placemarks
        self._others = 0  # placemarks that are no zones

    def features(self, root: Element) -> Iterator[ZoneFeature]:
        """One for each placemark, and for parts that are not read."""
        if root.name not in _FOLDERS:
            file = ZoneFeature(self._source)
            message = f"the outermost element is <{root.name[:30]}>, not <kml>; choose another file"
            file.report(root.keys, message, "not-kml")
            yield file
            return
        yield from self._in_folder(root, ())
        if self._others:
            file = ZoneFeature(self._source)
            message = f"{self._others} placemarks are no zones, by their data 'kind': left out"
            file.note((), message, "not-a-zone")
            yield file

    def _in_folder(self, folder: Element, within: tuple[str, ...]) -> Iterator[ZoneFeature]:
        """All in a folder; `within` is what the folders around it are called and are for."""
        within = (*within, folder.text_of("name"), folder.text_of(_DJI_MISSION))
        for child in folder.children:
            if child.name in _FOLDERS:
                yield from self._in_folder(child, within)
                continue
            self._feature = ZoneFeature(self._source)
            if child.name == "Placemark":
                self._count += 1
                self._placemark(child, within)
            elif child.name in _NOT_FOLLOWED:
                message = f"<{child.name}> is not followed: left out"
                self._feature.note(child.keys, message, "not-a-zone")
            else:
                self._refuse_hidden(child)
            yield self._feature

    def _refuse_hidden(self, element: Element) -> None:
        """Report an element that is not read, but for areas in it."""
        if any(inner.name in _AREAS for inner in element.all_below()):
            message = (
                f"the content of <{element.name[:30]}> is not read; put its areas into a Folder"
            )
            self._feature.report(element.keys, message, "not-kml")

    def _placemark(self, element: Element, folders: tuple[str, ...]) -> None:
        feature = self._feature
        places = {data.attributes["name"]: data for data in _data_elements(element)}
        data = {name: _value(place) for name, place in places.items()}
        if not is_zone(data):
            self._others += 1
            return
        feature.name = short_name(element.text_of("name"), self._source.path, self._count)
        feature.kinds = [*filter(None, folders)]
        circle = self._circle(element, data)
        polygons = list(self._polygons(element, besides=circle))
        shapes: Shapes = [] if circle is None else [(element.keys, circle)]
        for polygon in polygons:
            outline = self._outline(polygon)
            shapes += [(polygon.keys, outline)] if outline else []
        heights = [self._height(polygon) for polygon in polygons]
        upper = _highest(heights if circle is None else [])
        if not shapes:
            return
        terms = terms_of(data, feature, lambda way: places.get(str(way[0]), element).keys)
        if kinds := [kind for kind in folders if kind in _DJI_TEMPLATES]:
            message = (
                f"'{feature.name}' is the area of a DJI mission ({kinds[0]}): read as a no-fly "
                f"zone; if it is none, skip '{kinds[0]}'"
            )
            feature.note(element.keys, message, "mission-area")
        if upper is not None and terms.altitudes is None:
            terms = replace(terms, altitudes=Altitudes(upper=upper))
        feature.add(shapes, terms)

    def _circle(self, element: Element, data: dict[str, Any]) -> MapCircle | None:
        """A point with a radius."""
        point, radius_m = element.child("Point", "coordinates"), data.get("radius_m")
        if radius_m is None:
            return None
        if not is_number(radius_m) or not 0 < radius_m <= MAX_RADIUS_M:
            message = f"'radius_m' must be more than 0 metres, found {str(radius_m)[:20]!r}"
            self._feature.report(element.keys, f"{message}; correct it", "out-of-range")
            return None
        places = [] if point is None else self._places(point)
        if places == []:
            message = "a radius without a place: add a <Point> with coordinates"
            self._feature.report(element.keys, message, "missing-key")
        return MapCircle(places[0], radius_m) if places else None

    def _polygons(self, element: Element, *, besides: MapCircle | None = None) -> Iterator[Element]:
        """The polygons of a placemark that may have a circle besides, whose point is no fault."""
        found = False
        for child in element.children:
            found = found or child.name in {"Polygon", "MultiGeometry", *_NO_AREAS}
            if child.name == "Polygon":
                yield child
            elif child.name == "MultiGeometry":
                yield from self._polygons(child)
            elif child.name == "Point" and besides is not None:
                continue
            elif child.name in _NO_AREAS:
                self._feature.without_area(child.keys, f"a {child.name} has no area", _ADVICE)
            elif child.name != "ExtendedData":
                self._refuse_hidden(child)
        if not found:
            message = f"a {element.name} without a geometry: left out"
            self._feature.note(element.keys, message, "no-area")

    def _outline(self, polygon: Element) -> MapOutline | None:
        outer = list(polygon.all("outerBoundaryIs"))
        if len(outer) != 1:
            message = f"a polygon has one outer boundary, found {len(outer)}; draw it again"
            self._feature.report(polygon.keys, message, "missing-key")
            return None
        rings = [self._ring(ring) for ring in [*outer, *polygon.all("innerBoundaryIs")]]
        return outline_of_rings(rings)

    def _ring(self, boundary: Element) -> MapRing | None:
        rings = [c for ring in boundary.all("LinearRing") for c in ring.all("coordinates")]
        if len(rings) != 1:
            message = f"a boundary has one ring of coordinates, found {len(rings)}; draw it again"
            self._feature.report(boundary.keys, message, "missing-key")
            return None
        places = self._places(rings[0])
        return None if places is None else self._feature.ring(places, rings[0].keys)

    def _places(self, element: Element) -> list[Geodetic] | None:
        """The places of <coordinates>; None, with a problem noted."""
        places: list[Geodetic] = []
        for part in _tuples(element.text):
            try:
                longitude_deg, latitude_deg, _ = _numbers(part)
            except ValueError:
                message = f"'{part[:40]}' is not longitude,latitude or longitude,latitude,altitude"
                self._feature.saw(places)
                meant = pair_in(part).strip("[]").replace(" ", "")
                advice = f"decimals stand behind a point: {meant}" if meant else "correct it"
                self._feature.report(element.keys, f"{message}; {advice}", "wrong-type")
                return None
            place = place_of(latitude_deg, longitude_deg)
            if place is None:
                message = f"there is no place '{part[:40]}'"
                self._feature.saw(places)
                self._feature.report_place(element.keys, message, longitude_deg, latitude_deg)
                return None
            places.append(place)
        return places

    def _height(self, polygon: Element) -> AltitudeLimit | None:
        """Where an extruded polygon ends; None: it has no limit."""
        reference = _REFERENCES.get(polygon.text_of("altitudeMode"))
        parts = _tuples(polygon.text_of("outerBoundaryIs", "LinearRing", "coordinates"))
        try:
            highest_m = max(_numbers(part)[2] for part in parts)
        except ValueError:
            return None
        if reference is None:
            return None
        if polygon.text_of("extrude") not in ("1", "true") or highest_m <= 0:
            message = "an area that is not extruded from the ground: read as without altitude limit"
            self._feature.note(polygon.keys, message, "no-height")
            return None
        return AltitudeLimit(min(highest_m, MAX_ALTITUDE_M), reference)


def _data_elements(placemark: Element) -> Iterator[Element]:
    """The pieces of extended data that have a name."""
    for extended in placemark.all("ExtendedData"):
        simple = (
            data for schema in extended.all("SchemaData") for data in schema.all("SimpleData")
        )
        yield from (data for data in [*extended.all("Data"), *simple] if "name" in data.attributes)


def _value(data: Element) -> Any:
    """Its text, as JSON where it is JSON."""
    text = data.text_of("value") if data.name == "Data" else data.text.strip()
    try:
        return json.loads(text) if len(text) < _LONGEST_JSON else text
    except (ValueError, RecursionError):
        return text


def _tuples(text: str) -> list[str]:
    """The tuples of <coordinates>, a place each; blanks after commas as Google Earth reads them."""
    return _COMMA.sub(",", text).split()


def _numbers(text: str) -> tuple[float, float, float]:
    parts = [float(number) for number in text.split(",")]
    if not 2 <= len(parts) <= 3 or not all(map(math.isfinite, parts)):
        raise ValueError(text)
    return parts[0], parts[1], parts[2] if len(parts) == 3 else 0.0


def _highest(limits: list[AltitudeLimit | None]) -> AltitudeLimit | None:
    """The limit of several polygons of one zone: the highest, none if one has none."""
    known = [limit for limit in limits if limit is not None]
    if not known or len(known) < len(limits) or len({limit.reference for limit in known}) > 1:
        return None
    return max(known, key=lambda limit: limit.metres)


# Writing


_NAMESPACE: Final = "http://www.opengis.net/kml/2.2"
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_STYLES: Final = {  # line and fill as KML has them: alpha, blue, green, red
    "fence": ("ff2a7f2a", "00ffffff"),
    "zone": ("ff0000c0", "600000c0"),
}
_TITLES: Final = {  # of the folders, by their contents
    "fence": "Fence",
    "zone": "No-fly zones",
    **dict.fromkeys(("home", "waypoint"), "Waypoints"),
    "rally_point": "Rally points",
}


def kml_text(feature_set: FeatureSet) -> str:
    """The feature set as text; zones with an upper limit stand as high."""
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = _add(root, "Document")
    _add(document, "name", feature_set.name)
    for kind, (line, fill) in _STYLES.items():
        style = _add(document, "Style", id=kind)
        _add(_add(style, "LineStyle"), "color", line)
        _add(_add(style, "PolyStyle"), "color", fill)
    folders: dict[str, ET.Element] = {}
    for kind, area in feature_set.areas():
        _add_area(_folder(document, kind, folders), kind, area, feature_set.home_altitude_amsl_m)
    for kind, spot in feature_set.spots:
        _add_spot(_folder(document, kind, folders), kind, spot, feature_set.home_altitude_amsl_m)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _folder(document: ET.Element, kind: str, folders: dict[str, ET.Element]) -> ET.Element:
    """The folder of a kind, made when it is first needed."""
    title = _TITLES[kind]
    if title not in folders:
        folders[title] = _add(document, "Folder")
        _add(folders[title], "name", title)
    return folders[title]


def _add_area(folder: ET.Element, kind: str, area: MapArea, home_amsl_m: float | None) -> None:
    placemark = _add_placemark(folder, kind, area.name, terms_data(area.terms))
    if isinstance(area.shape, MapCircle):
        rings: tuple[MapRing, ...] = (circle_around(area.shape.centre, area.shape.radius_m),)
    else:
        rings = (area.shape.ring, *area.shape.holes)
    polygon, altitude_m = _add(placemark, "Polygon"), None
    if kind == "zone" and area.terms.altitudes is not None and area.terms.altitudes.upper:
        mode, height_m = _height(area.terms.altitudes.upper, home_amsl_m)
        if height_m > 0:  # it stands above the ground
            altitude_m = height_m
            _add(polygon, "extrude", "1")
            _add(polygon, "altitudeMode", mode)
    for index, ring in enumerate(map(counterclockwise, rings)):
        boundary = _add(polygon, "innerBoundaryIs" if index else "outerBoundaryIs")
        text = _coordinates((*ring, ring[0]), altitude_m)
        _add(_add(boundary, "LinearRing"), "coordinates", text)


def _height(upper: AltitudeLimit, home_amsl_m: float | None) -> tuple[str, float]:
    """How high a zone is drawn: KML's altitude mode, and metres."""
    if upper.reference is Reference.HOME and home_amsl_m is not None:
        return _SEA, upper.metres + home_amsl_m
    return _SEA if upper.reference is Reference.AMSL else _GROUND, upper.metres


def _add_spot(folder: ET.Element, kind: str, spot: MapPoint, home_amsl_m: float | None) -> None:
    altitude_m = spot.altitude_above_home_m
    data = {} if altitude_m is None else {"altitude_above_home_m": altitude_m}
    point = _add(_add_placemark(folder, kind, spot.name, data), "Point")
    if altitude_m:
        _add(point, "altitudeMode", _GROUND if home_amsl_m is None else _SEA)
        altitude_m += home_amsl_m or 0.0
    _add(point, "coordinates", _coordinates((spot.place,), altitude_m or None))


def _add_placemark(folder: ET.Element, kind: str, name: str, data: dict[str, Any]) -> ET.Element:
    placemark = _add(folder, "Placemark")
    _add(placemark, "name", name)
    if kind in _STYLES:
        _add(placemark, "styleUrl", f"#{kind}")
    extended = _add(placemark, "ExtendedData")
    for key, value in {"kind": kind, **data}.items():
        text = value if isinstance(value, str) else json.dumps(value)
        _add(_add(extended, "Data", name=key), "value", text)
    return placemark


def _coordinates(places: MapRing, altitude_m: float | None) -> str:
    height = "" if altitude_m is None else f",{_decimal(altitude_m, 3)}"
    return " ".join(
        f"{_decimal(place.longitude_deg, 9)},{_decimal(place.latitude_deg, 9)}{height}"
        for place in places
    )


def _decimal(value: float, digits: int) -> str:
    """A number without zeros at its end."""
    return f"{value:.{digits}f}".rstrip("0").rstrip(".")


def _add(parent: ET.Element, tag: str, text: str | None = None, /, **attributes: str) -> ET.Element:
    """Add an element; characters that XML has not become question marks."""
    element = ET.SubElement(parent, tag, attributes)
    element.text = None if text is None else _NOT_XML.sub("?", text)
    return element
