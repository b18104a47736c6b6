"""Writes a feature set as GPX for receivers and map programs: points, a route, borders."""

import xml.etree.ElementTree as ET

from air_router.files.conversion_warnings import ConversionWarnings
from air_router.files.gpx_document import HOME, RALLY_POINT
from air_router.files.maps.feature_set import FeatureSet, MapArea, MapPoint
from air_router.files.maps.kml_write import add, decimal
from air_router.files.maps.reading import MapCircle
from geo.frame import Geodetic
from geo.geodesic import circle_around


def gpx_text(feature_set: FeatureSet) -> str:
    """The feature set as text: circles as polygons, holes closed, without altitudes."""
    root = ET.Element(
        "gpx", version="1.1", creator="air-router", xmlns="http://www.topografix.com/GPX/1/1"
    )
    add(add(root, "metadata"), "name", feature_set.name)
    if feature_set.home is not None:
        _point(root, "wpt", feature_set.home.place, "home", HOME)
    for spot in feature_set.rally_points:
        _point(root, "wpt", spot.place, spot.name, RALLY_POINT)
    if feature_set.waypoints:
        _route(root, feature_set.name, feature_set.waypoints)
    for kind, areas in (("fence", feature_set.fences), ("zone", feature_set.zones)):
        for area in areas:
            _border(root, kind, area)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def warn_of_losses(feature_set: FeatureSet, warnings: ConversionWarnings) -> None:
    """Note what of a feature set GPX cannot say."""
    if feature_set.waypoints:
        message = "GPX has none: give it again with --altitude"
        warnings.add("altitudes of waypoints", message, "altitudes-lost")
    for area in (*feature_set.fences, *feature_set.zones):
        what, shape = f"'{area.name}'", area.shape
        for lost, message, code in (
            (area.altitudes, "it reaches over all altitudes", "altitudes-lost"),
            (area.validity, "it applies always", "schedule-lost"),
            (area.clearance_m, "its own clearance is not in the file", "clearance-lost"),
            (not isinstance(shape, MapCircle) and shape.holes, "holes are closed", "holes-closed"),
        ):
            if lost:
                warnings.add(what, message, code)


def _route(root: ET.Element, name: str, spots: list[MapPoint]) -> None:
    route = add(root, "rte")
    add(route, "name", name)
    for spot in spots:
        _point(route, "rtept", spot.place, spot.name, None)


def _border(root: ET.Element, kind: str, area: MapArea) -> None:
    shape = area.shape
    if isinstance(shape, MapCircle):
        ring = circle_around(shape.centre, shape.radius_m)
    else:
        ring = shape.ring
    track = add(root, "trk")
    add(track, "name", area.name)
    add(track, "type", kind)
    segment = add(track, "trkseg")
    for place in (*ring, ring[0]):
        _point(segment, "trkpt", place, None, None)


def _point(
    parent: ET.Element, tag: str, place: Geodetic, name: str | None, kind: str | None
) -> None:
    latitude, longitude = (decimal(degrees, 9) for degrees in place)
    point = add(parent, tag, lat=latitude, lon=longitude)
    for key, text in (("name", name), ("type", kind)):
        if text is not None:
            add(point, key, text)
