"""No-fly zones from GeoJSON (RFC 7946): polygons, and points with a radius.

Every area is a zone, unless its property `kind` says that it is something else: the files that
`air-router convert` writes hold waypoints and fences too.
"""

from typing import Any, Final

from air_router.files.json_document import JsonDocument
from air_router.files.maps.properties import terms_of
from air_router.files.maps.reading import JsonReader, MapCircle, MapOutline, ZoneReading
from air_router.files.mission_document import Keys

Shapes = list[tuple[Keys, MapOutline | MapCircle]]

_GEOMETRIES: Final = frozenset(
    {"Polygon", "MultiPolygon", "Point", "MultiPoint", "LineString", "MultiLineString"}
)
_WGS84_NAMES = ("CRS84", "EPSG::4326", "EPSG:4326")
_NAME_KEYS: Final = ("name", "title", "NAME")
ZONE_KIND: Final = "zone"


def read_geojson(document: JsonDocument) -> ZoneReading:
    """The zones of a GeoJSON file."""
    reader = _Reader(document, "GeoJSON")
    reader.read()
    return reader.reading


class GeometryReader(JsonReader):
    """Reads GeoJSON geometries into shapes."""

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
