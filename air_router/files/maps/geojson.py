"""No-fly zones from GeoJSON (RFC 7946): polygons, and points with a radius.

Every area is a zone, unless its property `kind` says that it is something else: the files that
`air-router convert` writes hold waypoints and fences too.
"""

from collections.abc import Mapping
from typing import Any, Final

from air_router.files.json_document import JsonDocument, JsonValues, is_number
from air_router.files.maps.limits import terms_of
from air_router.files.maps.zone_reading import (
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
from air_router.files.mission_document import Keys
from geo.frame import Geodetic

_GEOMETRIES: Final = frozenset(
    {"Polygon", "MultiPolygon", "Point", "MultiPoint", "LineString", "MultiLineString"}
)
_WGS84_NAMES = ("CRS84", "EPSG::4326", "EPSG:4326")
_NAME_KEYS: Final = ("name", "title", "NAME")


def read_geojson(document: JsonDocument) -> ZoneReading:
    """The zones of a GeoJSON file."""
    reader = _Reader(document, "GeoJSON")
    reader.read()
    return reader.reading


class GeometryReader(JsonValues):
    """Reads values and geometries of a JSON document, noting what is wrong with them.

    Attributes:
        reading: Takes zones, problems and notes.
    """

    def __init__(self, document: JsonDocument, kind: str) -> None:
        self.reading = ZoneReading(document, kind)
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
            return None
        if not (is_number(value[0]) and is_number(value[1])):
            self.wrong(keys, "a place must be two numbers, [longitude, latitude]")
            return None
        message = f"there is no longitude {value[0]:.10g}, latitude {value[1]:.10g}"
        self.reading.report_place(keys, message, float(value[0]), float(value[1]))
        return None

    def outline(self, keys: Keys) -> MapOutline | None:
        """A polygon's rings, the first around it, the others around its holes."""
        rings = [
            self._ring((*keys, index))
            for index in range(len(self.entries(keys, "a polygon's coordinates")))
        ]
        if not rings and self.at(*keys) == []:
            self.reading.report(
                keys, "a polygon without a ring; draw it again", "zone-too-few-corners"
            )
        return outline_of_rings(rings)

    def circle(self, keys: Keys, radius_keys: Keys) -> MapCircle | None:
        """A place and a radius in metres."""
        centre = self.position(keys)
        radius_m = self.number_within(radius_keys, "the radius in metres", 0.001, MAX_RADIUS_M)
        return None if centre is None or radius_m is None else MapCircle(centre, radius_m)

    def _ring(self, keys: Keys) -> MapRing | None:
        values = self.entries(keys, "a polygon's ring")
        ring = [place for place in map(_place, values) if place is not None]
        if len(ring) < len(values) or not isinstance(self.at(*keys), list):
            for index in range(len(values)):  # again, to tell what is wrong
                self.position((*keys, index))
            return None
        return self.reading.ring(ring, keys)

    def shapes(self, keys: Keys) -> Shapes:
        """The areas of a geometry; what is no area is a problem."""
        kind = self.at(*keys, "type")
        if kind == "Polygon":
            return self._kept(keys, self.outline((*keys, "coordinates")))
        if kind == "MultiPolygon":
            shapes: Shapes = []
            places: Keys = (*keys, "coordinates")
            for index in range(len(self.entries(places, "the coordinates"))):
                shapes += self._kept((*places, index), self.outline((*places, index)))
            return shapes
        if kind == "GeometryCollection":
            inner: Keys = (*keys, "geometries")
            count = len(self.entries(inner, "the geometries"))
            return [shape for index in range(count) for shape in self.shapes((*inner, index))]
        if kind == "Point":
            return self._kept(keys, self.point(keys))
        if kind in _GEOMETRIES:
            self.reading.report(
                (*keys, "type"),
                f"a {kind} has no area; draw a polygon, or give a point a radius",
                "no-area",
            )
        else:
            self.wrong((*keys, "type"), "the type of a geometry is Polygon, MultiPolygon or Point")
        return []

    def point(self, keys: Keys) -> MapCircle | None:
        """A point as a circle, if it has a radius."""
        message = "a point without a radius; add the property radius_m, or draw a polygon"
        self.reading.report(keys, message, "no-area")
        return None

    def _kept(self, keys: Keys, shape: MapOutline | MapCircle | None) -> Shapes:
        return [] if shape is None else [(keys, shape)]


def _place(value: Any) -> Geodetic | None:
    """[longitude, latitude] as a place; None if it is none."""
    if not isinstance(value, list) or len(value) < 2:
        return None
    longitude_deg, latitude_deg = value[0], value[1]
    if not (is_number(longitude_deg) and is_number(latitude_deg)):
        return None
    return place_of(latitude_deg, longitude_deg)


class _Reader(GeometryReader):
    def read(self) -> None:
        self._properties: Keys = ()
        self._others = 0
        self._check_crs()
        kind = self.at("type")
        if kind == "FeatureCollection":
            for index in range(len(self.entries(("features",), "the features"))):
                self._feature(("features", index), index + 1)
        elif kind == "Feature":
            self._feature((), 1)
        else:
            self._add((), (), f"{self.reading.path.stem} 1", {})
        if self._others:
            message = f"{self._others} features are no zones, by their property 'kind': left out"
            self.reading.note((), message, "not-a-zone")

    def _check_crs(self) -> None:
        name = self.at("crs", "properties", "name")
        if name is not None and not str(name).endswith(_WGS84_NAMES):
            message = f"coordinates are in {str(name)[:60]!r}, not in WGS-84 degrees; export again"
            self.reading.report(("crs",), message, "other-coordinates")

    def _feature(self, keys: Keys, number: int) -> None:
        properties = self.at(*keys, "properties") or {}
        if self.at(*keys, "type") != "Feature":
            self.wrong((*keys, "type"), 'an entry of "features" has the type Feature')
        elif not isinstance(properties, dict):
            self.wrong((*keys, "properties"), "the properties must be an object")
        elif properties.get("kind", ZONE_KIND) != ZONE_KIND:
            self._others += 1
        elif self.at(*keys, "geometry") is None:
            self.reading.note(keys, "a feature without a geometry: left out", "no-area")
        else:
            names = (*(properties.get(key) for key in _NAME_KEYS), self.at(*keys, "id"))
            fallback = f"{self.reading.path.stem} {number}"
            name = next((str(name) for name in names if name not in (None, "")), fallback)
            self._add((*keys, "geometry"), (*keys, "properties"), name[:80], properties)

    def _add(self, keys: Keys, properties_keys: Keys, name: str, properties: Any) -> None:
        self._properties = properties_keys
        terms = terms_of(properties, self.reading, lambda name: (*properties_keys, name))
        self.reading.add(name, self.shapes(keys), terms)

    def point(self, keys: Keys) -> MapCircle | None:
        for name in ("radius_m", "radius"):
            if self._properties and self.at(*self._properties, name) is not None:
                return self.circle((*keys, "coordinates"), (*self._properties, name))
        return super().point(keys)
