"""Writes a feature set as KML for Google Earth and others. Zones with an upper limit stand as high.

What KML cannot say (clearances, lower limits, schedules) is in `ExtendedData`, and is read back
from there; circles are polygons around them.
"""

import json
import re
import xml.etree.ElementTree as ET
from typing import Any, Final

from air_router.files.maps.feature_set import FeatureSet, MapPoint, counterclockwise
from air_router.files.maps.zone_reading import MapArea, MapCircle, MapRing
from air_router.files.zone_terms import AltitudeLimit, Reference, terms_data
from geo.geodesic import circle_around

_NAMESPACE: Final = "http://www.opengis.net/kml/2.2"
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_STYLES: Final = {  # line and fill as KML has them: alpha, blue, green, red
    "fence": ("ff2a7f2a", "00ffffff"),
    "zone": ("ff0000c0", "600000c0"),
}


def kml_text(feature_set: FeatureSet) -> str:
    """The feature set as text."""
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = add(root, "Document")
    add(document, "name", feature_set.name)
    for kind, (line, fill) in _STYLES.items():
        style = add(document, "Style", id=kind)
        add(add(style, "LineStyle"), "color", line)
        add(add(style, "PolyStyle"), "color", fill)
    for title, kind, areas in (
        ("Fence", "fence", feature_set.fences),
        ("No-fly zones", "zone", feature_set.zones),
    ):
        folder = _folder(document, title, bool(areas))
        for area in areas:
            _area(folder, kind, area, feature_set)
    spots = [("home", feature_set.home)] if feature_set.home else []
    spots += [("waypoint", spot) for spot in feature_set.waypoints]
    folder = _folder(document, "Waypoints", bool(spots))
    for kind, spot in spots:
        _spot(folder, kind, spot, feature_set.home_altitude_amsl_m)
    folder = _folder(document, "Rally points", bool(feature_set.rally_points))
    for spot in feature_set.rally_points:
        _spot(folder, "rally_point", spot, feature_set.home_altitude_amsl_m)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _area(folder: ET.Element, kind: str, area: MapArea, feature_set: FeatureSet) -> None:
    data: dict[str, Any] = {"kind": kind, **terms_data(area.terms)}
    ring: MapRing
    holes: tuple[MapRing, ...] = ()
    if isinstance(area.shape, MapCircle):
        ring = circle_around(area.shape.centre, area.shape.radius_m)
    else:
        ring, holes = area.shape.ring, area.shape.holes
    placemark = _placemark(folder, kind, area.name, data)
    upper = area.terms.altitudes.upper if area.terms.altitudes else None
    height = None if upper is None or kind != "zone" else _height(upper, feature_set)
    polygon = add(placemark, "Polygon")
    if height is not None:
        add(polygon, "extrude", "1")
        add(polygon, "altitudeMode", height[0])
    altitude_m = None if height is None else height[1]
    _ring(add(polygon, "outerBoundaryIs"), counterclockwise(ring), altitude_m)
    for hole in holes:
        _ring(add(polygon, "innerBoundaryIs"), counterclockwise(hole), altitude_m)


def _height(upper: AltitudeLimit, feature_set: FeatureSet) -> tuple[str, float] | None:
    """How high a zone is drawn; None: it would not stand above the ground."""
    mode, metres = "relativeToGround", upper.metres
    if upper.reference is Reference.AMSL:
        mode = "absolute"
    elif upper.reference is Reference.HOME and feature_set.home_altitude_amsl_m is not None:
        mode, metres = "absolute", metres + feature_set.home_altitude_amsl_m
    return (mode, metres) if metres > 0 else None


def _spot(folder: ET.Element, kind: str, spot: MapPoint, home_amsl_m: float | None) -> None:
    data: dict[str, Any] = {"kind": kind}
    altitude_m = spot.altitude_above_home_m
    if altitude_m is not None:
        data["altitude_above_home_m"] = altitude_m
    point = add(_placemark(folder, kind, spot.name, data), "Point")
    if altitude_m:
        mode = "relativeToGround" if home_amsl_m is None else "absolute"
        add(point, "altitudeMode", mode)
        altitude_m += home_amsl_m or 0.0
    add(point, "coordinates", _coordinates((spot.place,), altitude_m or None))


def _placemark(folder: ET.Element, kind: str, name: str, data: dict[str, Any]) -> ET.Element:
    placemark = add(folder, "Placemark")
    add(placemark, "name", name)
    if kind in _STYLES:
        add(placemark, "styleUrl", f"#{kind}")
    extended = add(placemark, "ExtendedData")
    for key, value in data.items():
        text = value if isinstance(value, str) else json.dumps(value)
        add(add(extended, "Data", name=key), "value", text)
    return placemark


def _ring(boundary: ET.Element, ring: MapRing, altitude_m: float | None) -> None:
    text = _coordinates((*ring, ring[0]), altitude_m)
    add(add(boundary, "LinearRing"), "coordinates", text)


def _coordinates(places: MapRing, altitude_m: float | None) -> str:
    height = "" if altitude_m is None else f",{decimal(altitude_m, 3)}"
    return " ".join(
        f"{decimal(place.longitude_deg, 9)},{decimal(place.latitude_deg, 9)}{height}"
        for place in places
    )


def decimal(value: float, digits: int) -> str:
    """A number without zeros at its end."""
    return f"{value:.{digits}f}".rstrip("0").rstrip(".")


def _folder(document: ET.Element, title: str, wanted: bool) -> ET.Element:
    folder = add(document, "Folder") if wanted else ET.Element("Folder")
    add(folder, "name", title)
    return folder


def add(parent: ET.Element, tag: str, text: str | None = None, /, **attributes: str) -> ET.Element:
    """Add an element; characters that XML has not become question marks."""
    element = ET.SubElement(parent, tag, attributes)
    element.text = None if text is None else _NOT_XML.sub("?", text)
    return element
