"""UAS geographical zones in the GeoJSON of EUROCAE ED-318."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from air_router.files.altitudes import Altitudes
from air_router.files.json_document import JsonDocument
from air_router.files.mission_document import Keys
from air_router.files.zones.geojson import GeometryReader, Shapes
from air_router.files.zones.reading import MapCircle, ZoneReading
from air_router.files.zones.restriction import METRES_PER_UNIT, GeozoneReader


def is_ed318(data: Any) -> bool:
    """Whether GeoJSON is that of geozones: one of its first features has what only they have."""
    features = data.get("features") if isinstance(data, dict) else None
    for feature in features[:20] if isinstance(features, list) else ():
        if not isinstance(feature, dict):
            continue
        properties = feature.get("properties")
        if isinstance(properties, dict) and properties.keys() & {"zoneAuthority", "variant"}:
            return True
        geometry = feature.get("geometry")
        if isinstance(geometry, dict) and ("layer" in geometry or "extent" in geometry):
            return True
    return False


def read_ed318(document: JsonDocument, allow: Collection[str] = ()) -> ZoneReading:
    """The no-fly zones of an ED-318 file."""
    reader = _Reader(document, allow)
    for index in range(len(reader.entries(("features",), "the features"))):
        reader.read_zone(("features", index), index + 1)
    reader.geozone.finish()
    return reader.reading


class _Reader(GeometryReader):
    def __init__(self, document: JsonDocument, allow: Collection[str]) -> None:
        super().__init__(document, "ED-318")
        self.geozone = GeozoneReader(self, allow)

    def read_zone(self, keys: Keys, number: int) -> None:
        properties: Keys = (*keys, "properties")
        if not isinstance(self.at(*properties), dict):
            self.wrong(properties, "a zone's properties must be an object")
            return
        identifier = self._text((*properties, "identifier")) or f"zone {number}"
        restriction = self.at(*properties, "type")
        if not self.geozone.restricted((*properties, "type"), restriction, identifier):
            return
        words = (self._text((*properties, key)) for key in ("identifier", "name"))
        name = " ".join(filter(None, words)) or identifier
        validity = self.geozone.validity((*properties, "limitedApplicability"))
        parts = list(self._parts((*keys, "geometry")))
        for index, (part, altitudes) in enumerate(parts):
            suffix = f", volume {index + 1}" if len(parts) > 1 else ""
            shapes: Shapes = self.shapes(part)
            self.reading.add(name[:80] + suffix, shapes, altitudes=altitudes, validity=validity)

    def point(self, keys: Keys) -> MapCircle | None:
        return self.circle((*keys, "coordinates"), (*keys, "extent", "radius"))

    def _parts(self, keys: Keys) -> list[tuple[Keys, Altitudes | None]]:
        """The geometries of a zone, each with the altitudes of its own layer."""
        if self.at(*keys, "type") == "GeometryCollection":
            inner: Keys = (*keys, "geometries")
            count = len(self.entries(inner, "the geometries"))
            return [part for index in range(count) for part in self._parts((*inner, index))]
        layer: Keys = (*keys, "layer")
        if self.at(*layer) is None:
            return [(keys, None)]
        unit = 1.0  # metres, unless the layer says otherwise
        if self.at(*layer, "uom") is not None:
            unit = self.choice((*layer, "uom"), "the unit of a layer", METRES_PER_UNIT)
        altitudes = self.geozone.altitudes(
            layer, ("lower", "lowerReference"), ("upper", "upperReference"), unit or 1.0
        )
        return [(keys, altitudes)]

    def _text(self, keys: Keys) -> str:
        """A text, or the first of several translations."""
        value = self.at(*keys)
        if isinstance(value, list) and value:
            value = value[0]
        if isinstance(value, dict):
            value = value.get("text")
        return value.strip() if isinstance(value, str) else ""
