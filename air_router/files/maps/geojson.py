"""GeoJSON (RFC 7946): everything that can be drawn, written as it.

Longitude comes first, rings follow the right-hand rule, shapes are cut at the antimeridian.
"""

import math
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, box
from shapely.affinity import translate
from shapely.geometry import mapping
from shapely.geometry.polygon import orient

from air_router.files import json_text, terms_data
from air_router.files.maps.feature_set import FeatureSet, MapPoint
from air_router.files.maps.map_area import MapArea, MapCircle, MapOutline, MapRing
from geo.airspace import polygons_of
from geo.frame import Geodetic

_DIGITS: Final = 9  # of degrees
_COLOURS: Final = {"fence": "#2a7f2a", "zone": "#c00000"}


def geojson_text(feature_set: FeatureSet) -> str:
    """The feature set as text."""
    return json_text(geojson_of(feature_set))


def geojson_of(feature_set: FeatureSet) -> dict[str, Any]:
    """The feature set as a feature collection."""
    features = [_area_feature(kind, area) for kind, area in feature_set.areas()]
    features += [_spot_feature(kind, spot) for kind, spot in feature_set.spots]
    return {"type": "FeatureCollection", "name": feature_set.name, "features": features}


def _area_feature(kind: str, area: MapArea) -> dict[str, Any]:
    properties = {"kind": kind, "name": area.name, **terms_data(area.terms)}
    if isinstance(area.shape, MapCircle):
        properties["radius_m"] = area.shape.radius_m
        geometry = _point(area.shape.centre)
    else:
        geometry = _polygons(area.shape)
    colour = _COLOURS[kind]
    fill = {"fill": colour, "fill-opacity": 0.0 if kind == "fence" else 0.2}
    return _feature({**properties, "stroke": colour, **fill}, geometry)


def _spot_feature(kind: str, spot: MapPoint) -> dict[str, Any]:
    properties: dict[str, Any] = {"kind": kind, "name": spot.name}
    if spot.altitude_above_home_m is not None:
        properties["altitude_above_home_m"] = spot.altitude_above_home_m
    return _feature(properties, _point(spot.place))


def _feature(properties: dict[str, Any], geometry: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _point(place: Geodetic) -> dict[str, Any]:
    pair = (place.longitude_deg, place.latitude_deg)
    return {"type": "Point", "coordinates": [round(degrees, _DIGITS) for degrees in pair]}


def _polygons(outline: MapOutline) -> dict[str, Any]:
    """A Polygon, or the pieces on both sides of the antimeridian as a MultiPolygon."""
    ring = _unwrapped((*outline.ring, outline.ring[0]))
    west_deg, east_deg = ring[0, 0], ring[-1, 0]
    holes = [_unwrapped(hole) for hole in outline.holes]
    for hole in holes:  # on the same turn around the Earth as its ring
        hole[:, 0] += 360.0 * np.round((west_deg - hole[0, 0]) / 360.0)
    if round((east_deg - west_deg) / 360.0):  # around a pole: it goes on along the map's edge
        pole_deg = math.copysign(90.0, ring[0, 1])
        ring = np.vstack([ring, (east_deg, pole_deg), (west_deg, pole_deg)])
    pieces = [
        shapely.transform(orient(piece), lambda places: places.round(_DIGITS))
        for piece in _cut(Polygon(ring, holes))
    ]
    return mapping(pieces[0] if len(pieces) == 1 else MultiPolygon(pieces))


def _unwrapped(ring: MapRing) -> NDArray[np.float64]:
    """Longitudes and latitudes without a jump: each step is the short way around the Earth."""
    places = np.array([(place.longitude_deg, place.latitude_deg) for place in ring], float)
    places[1:, 0] -= 360.0 * np.cumsum(np.round(np.diff(places[:, 0]) / 360.0))
    return places


def _cut(polygon: Polygon) -> list[Polygon]:
    """The pieces of a polygon with unwrapped longitudes, each moved onto the map."""
    west, _, east, _ = polygon.bounds
    if west >= -180 and east <= 180:
        return [polygon]
    pieces = []
    for turn in range(-2, 3):
        piece = polygon.intersection(box(360.0 * turn - 180, -90, 360.0 * turn + 180, 90))
        pieces.append(translate(piece, xoff=-360.0 * turn))
    return polygons_of(shapely.union_all(pieces))
