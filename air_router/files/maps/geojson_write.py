"""Writes a feature set as GeoJSON (RFC 7946).

Longitude comes first, rings follow the right-hand rule, shapes are cut at the antimeridian. Every
feature has a `kind`; what is read back of such a file are its zones.
"""

from typing import Any, Final

import shapely
from shapely import Polygon, box
from shapely.affinity import translate
from shapely.geometry.polygon import orient

from air_router.files.json_document import json_text
from air_router.files.maps.feature_set import FeatureSet, MapPoint
from air_router.files.maps.zone_reading import MapArea, MapCircle, MapOutline, MapRing
from air_router.files.zone_terms import terms_data
from geo.airspace.zone import polygons_of
from geo.frame import Geodetic

_DIGITS: Final = 9
_COLOURS: Final = {"fence": "#2a7f2a", "zone": "#c00000"}


def geojson_text(feature_set: FeatureSet) -> str:
    """The feature set as text."""
    return json_text(geojson_of(feature_set))


def geojson_of(feature_set: FeatureSet) -> dict[str, Any]:
    """The feature set as a feature collection."""
    features = [_area("fence", area) for area in feature_set.fences]
    features += [_area("zone", area) for area in feature_set.zones]
    features += [_spot("home", feature_set.home)] if feature_set.home else []
    features += [_spot("waypoint", spot) for spot in feature_set.waypoints]
    features += [_spot("rally_point", spot) for spot in feature_set.rally_points]
    return {"type": "FeatureCollection", "name": feature_set.name, "features": features}


def _area(kind: str, area: MapArea) -> dict[str, Any]:
    properties = {"kind": kind, "name": area.name, **terms_data(area.terms)}
    if isinstance(area.shape, MapCircle):
        properties["radius_m"] = area.shape.radius_m
        geometry: dict[str, Any] = _point(area.shape.centre)
    else:
        geometry = _polygons(area.shape)
    colour = _COLOURS[kind]
    fill = {"fill": colour, "fill-opacity": 0.0 if kind == "fence" else 0.2}
    return _feature({**properties, "stroke": colour, **fill}, geometry)


def _spot(kind: str, spot: MapPoint) -> dict[str, Any]:
    properties: dict[str, Any] = {"kind": kind, "name": spot.name}
    if spot.altitude_above_home_m is not None:
        properties["altitude_above_home_m"] = spot.altitude_above_home_m
    return _feature(properties, _point(spot.place))


def _feature(properties: dict[str, Any], geometry: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _point(place: Geodetic) -> dict[str, Any]:
    return {"type": "Point", "coordinates": _pair(place.longitude_deg, place.latitude_deg)}


def _polygons(outline: MapOutline) -> dict[str, Any]:
    """A Polygon, or the pieces on both sides of the antimeridian as a MultiPolygon."""
    ring = _unwrapped(outline.ring)
    holes = [_near(_unwrapped(hole), ring[0][0]) for hole in outline.holes]
    turns = _full_turns(outline.ring)
    if turns:  # around a pole: the ring goes on along the edge of the map
        pole = 90.0 if outline.ring[0].latitude_deg > 0 else -90.0
        end = (ring[0][0] + 360.0 * turns, ring[0][1])
        ring = [*ring, end, (end[0], pole), (ring[0][0], pole)]
    coordinates = [_rings(orient(piece)) for piece in _cut(Polygon(ring, holes))]
    if len(coordinates) == 1:
        return {"type": "Polygon", "coordinates": coordinates[0]}
    return {"type": "MultiPolygon", "coordinates": coordinates}


def _rings(polygon: Polygon) -> list[list[list[float]]]:
    rings = [polygon.exterior, *polygon.interiors]
    return [[_pair(x, y) for x, y in ring.coords] for ring in rings]


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


def _unwrapped(ring: MapRing) -> list[tuple[float, float]]:
    """Longitudes and latitudes without a jump: each step is the short way around the Earth."""
    steps = [(ring[0].longitude_deg, ring[0].latitude_deg)]
    for place in ring[1:]:
        before = steps[-1][0]
        steps.append((before + _short_way(place.longitude_deg - before), place.latitude_deg))
    return steps


def _near(ring: list[tuple[float, float]], longitude_deg: float) -> list[tuple[float, float]]:
    """A hole on the same turn around the Earth as its ring."""
    turn = 360.0 * round((longitude_deg - ring[0][0]) / 360.0)
    return [(x + turn, y) for x, y in ring]


def _full_turns(ring: MapRing) -> int:
    """How often a ring goes around the Earth: 0, or 1 or -1 around a pole."""
    steps = zip(ring, (*ring[1:], ring[0]), strict=True)
    return round(sum(_short_way(b.longitude_deg - a.longitude_deg) for a, b in steps) / 360.0)


def _short_way(longitude_deg: float) -> float:
    return (longitude_deg + 180.0) % 360.0 - 180.0


def _pair(x: float, y: float) -> list[float]:
    return [round(x, _DIGITS), round(y, _DIGITS)]
