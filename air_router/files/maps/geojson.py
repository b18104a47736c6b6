"""GeoJSON (RFC 7946): no-fly zones read from it, and everything that can be drawn written as it.

Polygons and points with a radius are read. Every area is a zone, unless its property `kind` says
that it is something else: what we write has a `kind` each, and what is read back are its zones.
Longitude comes first, rings follow the right-hand rule, shapes are cut at the antimeridian.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, box
from shapely.affinity import translate
from shapely.geometry import mapping
from shapely.geometry.polygon import orient

from air_router.files import (
    NO_TERMS,
    JsonDocument,
    JsonValues,
    Keys,
    is_number,
    json_text,
    terms_data,
)
from air_router.files.maps.feature_set import FeatureSet, MapPoint
from air_router.files.maps.limits import terms_of
from air_router.files.maps.map_area import (
    MapArea,
    MapCircle,
    MapOutline,
    MapRing,
    outline_of_rings,
    place_of,
)
from air_router.files.maps.zone_reading import MAX_RADIUS_M, Shapes, ZoneChoice, ZoneReading
from geo.airspace import polygons_of
from geo.frame import Geodetic

_WITHOUT_AREA: Final = frozenset({"MultiPoint", "LineString", "MultiLineString"})
_WGS84_NAMES: Final = ("CRS84", "EPSG::4326", "EPSG:4326")
_NAME_KEYS: Final = ("name", "title", "NAME")
_KIND_KEYS: Final = ("kind", "type", "category", "class", "TYPE", "CLASS", "TYPE_CODE")
_RADIUS_KEYS: Final = ("radius_m", "radius")
_TWO_COMMAS: Final = 4  # numbers that a place becomes by two decimal commas


def read_geojson(document: JsonDocument, choice: ZoneChoice | None = None) -> ZoneReading:
    """The zones of a GeoJSON file."""
    reader = _Reader(document, "GeoJSON", choice)
    reader.read()
    return reader.reading


class GeometryReader(JsonValues):
    """Reads values and geometries of a JSON document, noting what is wrong with them.

    Attributes:
        reading: Takes zones, problems and notes.
    """

    def __init__(self, document: JsonDocument, kind: str, choice: ZoneChoice | None = None) -> None:
        self.reading = ZoneReading(document, kind, choice)
        super().__init__(document.data, self.reading.report)

    def number_within(
        self, keys: Keys, what: str, lowest: float, highest: float, *, in_text: bool = False
    ) -> float | None:
        """A number in a range; None, with a problem noted, if it is something else."""
        value = self.number(keys, what, in_text=in_text)
        if value is None or lowest <= value <= highest:
            return value
        message = f"{what} must be from {lowest:g} to {highest:g}, found {value:.10g}"
        self.reading.report(keys, f"{message}; correct it", "out-of-range")
        return None

    def choice(self, keys: Keys, what: str, choices: Mapping[str, Any]) -> Any:
        """What one of these words (in capitals or not) stands for; None, with a problem noted."""
        value = self.at(*keys)
        if isinstance(value, str) and value.upper() in choices:
            return choices[value.upper()]
        self.wrong(keys, f"{what} must be one of {', '.join(choices)}")
        return None

    def position(self, keys: Keys) -> Geodetic | None:
        """A place given as [longitude, latitude], perhaps with an altitude behind."""
        value = self.at(*keys)
        place = _place(value)
        if place is not None:
            return place
        if not isinstance(value, list) or len(value) < 2:
            self.wrong(keys, "a place must be [longitude, latitude]")
        elif not (is_number(value[0]) and is_number(value[1])):
            self.wrong(keys, "a place must be two numbers, [longitude, latitude]")
        elif len(value) == _TWO_COMMAS and (meant := _decimal_commas(value)):
            advice = f"decimals stand behind a point: {meant}"
            self.reading.report(keys, f"a place of four whole numbers; {advice}", "wrong-length")
        else:
            message = f"there is no longitude {value[0]:.10g}, latitude {value[1]:.10g}"
            self.reading.report_place(keys, message, float(value[0]), float(value[1]))
        return None

    def circle(self, keys: Keys, radius_keys: Keys) -> MapCircle | None:
        """A place and a radius in metres."""
        centre = self.position(keys)
        radius_m = self.number_within(radius_keys, "the radius in metres", 0.001, MAX_RADIUS_M)
        if centre is None or radius_m is None:
            self.reading.saw([] if centre is None else [centre])
            return None
        return MapCircle(centre, radius_m)

    def shapes(self, keys: Keys) -> Shapes:
        """The areas of a geometry; what is no area is noted."""
        kind = self.at(*keys, "type")
        places: Keys = (*keys, "coordinates")
        shape: MapOutline | MapCircle | None = None
        if kind == "MultiPolygon":
            parts = self.pieces(places, "the coordinates")
            outlines = [(part, self._outline(part)) for part in parts]
            return [(part, outline) for part, outline in outlines if outline is not None]
        if kind == "GeometryCollection":
            inner = self.pieces((*keys, "geometries"), "the geometries")
            return [shape for piece in inner for shape in self.shapes(piece)]
        if kind == "Polygon":
            shape = self._outline(places)
        elif kind == "Point":
            shape = self.point(keys)
        elif isinstance(kind, str) and kind in _WITHOUT_AREA:
            self.reading.without_area((*keys, "type"), f"a {kind} has no area")
        else:
            self.wrong((*keys, "type"), "the type of a geometry is Polygon, MultiPolygon or Point")
        return [] if shape is None else [(keys, shape)]

    def pieces(self, keys: Keys, what: str) -> list[Keys]:
        """Where the pieces of a geometry stand; that there are none is noted."""
        pieces = self.entries(keys, what)
        if not pieces and self.at(*keys) == []:
            self.reading.note(keys, "a geometry without pieces: left out", "no-area")
        return pieces

    def point(self, keys: Keys) -> MapCircle | None:
        """A point as a circle, if it has a radius."""
        self.reading.without_area(keys, "a point without a radius (radius_m) has no area")
        return None

    def _outline(self, keys: Keys) -> MapOutline | None:
        """A polygon's rings, the first around it, the others around its holes."""
        rings = self.entries(keys, "a polygon's coordinates")
        if not rings and self.at(*keys) == []:
            message = "a polygon without a ring; draw it again"
            self.reading.report(keys, message, "zone-too-few-corners")
        return outline_of_rings([*map(self._ring, rings)])

    def _ring(self, keys: Keys) -> MapRing | None:
        values = self.at(*keys)
        places = map(_place, values if isinstance(values, list) else [])
        ring = [place for place in places if place is not None]
        if not isinstance(values, list) or len(ring) < len(values):
            self.reading.saw(ring)
            for corner in self.entries(keys, "a polygon's ring"):  # to tell what is wrong
                self.position(corner)
            return None
        return self.reading.ring(ring, keys)


def _place(value: Any) -> Geodetic | None:
    """[longitude, latitude] as a place; None if it is none."""
    if not isinstance(value, list) or len(value) < 2 or not all(map(is_number, value[:2])):
        return None
    if len(value) == _TWO_COMMAS and _decimal_commas(value):
        return None
    return place_of(value[1], value[0])


def _decimal_commas(value: list[Any]) -> str:
    """The place that [8,5, 47,3] means; "" where four numbers are a place, height and measure."""
    whole = all(isinstance(each, int) and is_number(each) for each in value)
    if not whole or value[1] < 0 or value[3] < 0 or value[2:] == [0, 0]:
        return ""
    return "[{}.{}, {}.{}]".format(*value)


class _Reader(GeometryReader):
    _properties: Keys = ()  # of the feature that is read

    def read(self) -> None:
        crs = self.at("crs")
        name = self.at("crs", "properties", "name")
        if crs is not None and not str(name).endswith(_WGS84_NAMES):
            message = (
                f"coordinates are in {str(name or crs)[:60]!r}, not in WGS-84 degrees; export again"
            )
            self.reading.report(("crs",), message, "other-coordinates")
        kind = self.at("type")
        if kind == "FeatureCollection":
            for number, keys in enumerate(self.entries(("features",), "the features"), start=1):
                with self.reading.area():
                    self._feature(keys, number)
        elif kind == "Feature":
            self._feature((), 1)
        else:
            self.reading.add(self.reading.name_of("", 1), self.shapes(()), NO_TERMS)
        self.reading.tell_others("features", "property")
        self.reading.refuse_without_areas("draw a polygon, or give a point the property radius_m")

    def _feature(self, keys: Keys, number: int) -> None:
        self._properties = (*keys, "properties")
        properties = self.at(*self._properties) or {}
        if self.at(*keys, "type") != "Feature":
            self.wrong((*keys, "type"), 'an entry of "features" has the type Feature')
        elif not isinstance(properties, dict):
            self.wrong(self._properties, "the properties must be an object")
        elif not self.reading.takes(properties):
            return
        elif self.at(*keys, "geometry") is None:
            self.reading.note(keys, "a feature without a geometry: left out", "no-area")
        else:
            names = (*(properties.get(key) for key in _NAME_KEYS), self.at(*keys, "id"))
            given = next((str(name) for name in names if name not in (None, "")), "")
            name = self.reading.name_of(given, number)
            kinds = (properties.get(key) for key in _KIND_KEYS)
            if self.reading.skips(name, *(str(kind) for kind in kinds if kind is not None)):
                return
            shapes = self.shapes((*keys, "geometry"))
            if shapes:
                terms = terms_of(properties, self.reading, lambda way: (*self._properties, *way))
                self.reading.add(name, shapes, terms)

    def point(self, keys: Keys) -> MapCircle | None:
        for name in _RADIUS_KEYS:
            if self._properties and self.at(*self._properties, name) is not None:
                return self.circle((*keys, "coordinates"), (*self._properties, name))
        return super().point(keys)


# Writing


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
