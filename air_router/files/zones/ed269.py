"""UAS geographical zones in the JSON of EUROCAE ED-269, as authorities publish them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from air_router.files.json_document import JsonDocument
from air_router.files.mission_document import Keys
from air_router.files.zones.geojson import Shapes
from air_router.files.zones.reading import JsonReader, ZoneReading
from air_router.files.zones.restriction import METRES_PER_UNIT, GeozoneReader


def read_ed269(document: JsonDocument, allow: Collection[str] = ()) -> ZoneReading:
    """The no-fly zones of an ED-269 file: an object with `features`, or the bare list of them.

    Older files call it `UASZoneList`, and the `schedule` in it `dailyPeriod`.
    """
    reader = _Reader(document, allow)
    features: Keys = () if isinstance(document.data, list) else (zones_key(document.data),)
    for index in range(len(reader.json.entries(features, "the zones"))):
        reader.read_zone((*features, index), index + 1)
    reader.geozone.finish()
    return reader.json.reading


def zones_key(data: dict[str, Any]) -> str:
    """The key of the list of zones."""
    return "UASZoneList" if "UASZoneList" in data else "features"


class _Reader:
    def __init__(self, document: JsonDocument, allow: Collection[str]) -> None:
        self.json = JsonReader(document, "ED-269")
        self.geozone = GeozoneReader(self.json, allow)

    def read_zone(self, keys: Keys, number: int) -> None:
        zone = self.json.at(*keys)
        if not isinstance(zone, dict):
            self.json.wrong(keys, "a zone must be an object")
            return
        identifier = _words(zone.get("identifier")) or f"zone {number}"
        if not self.geozone.restricted((*keys, "restriction"), zone.get("restriction"), identifier):
            return
        name = " ".join(filter(None, (_words(zone.get("identifier")), _words(zone.get("name")))))
        validity = self.geozone.validity((*keys, "applicability"), self._permanent)
        volumes = self.json.entries((*keys, "geometry"), "a zone's geometry")
        for index in range(len(volumes)):
            volume: Keys = (*keys, "geometry", index)
            suffix = f", volume {index + 1}" if len(volumes) > 1 else ""
            unit = self.json.choice((*volume, "uomDimensions"), "the unit", METRES_PER_UNIT)
            altitudes = self.geozone.altitudes(
                volume,
                ("lowerLimit", "lowerVerticalReference"),
                ("upperLimit", "upperVerticalReference"),
                unit or 1.0,
            )
            self.json.reading.add(
                (name or identifier)[:80] + suffix,
                self._shapes((*volume, "horizontalProjection")),
                altitudes=altitudes,
                validity=validity,
            )

    def _shapes(self, keys: Keys) -> Shapes:
        kind = self.json.at(*keys, "type")
        if kind == "Circle":
            circle = self.json.circle((*keys, "center"), (*keys, "radius"))
            return [(keys, circle)] if circle else []
        if kind == "Polygon":
            outline = self.json.outline((*keys, "coordinates"))
            return [(keys, outline)] if outline else []
        self.json.wrong((*keys, "type"), "a horizontal projection is a Circle or a Polygon")
        return []

    def _permanent(self, keys: Keys) -> bool:
        return str(self.json.at(*keys, "permanent")).upper() == "YES"


def _words(value: Any) -> str:
    return value.strip() if isinstance(value, str) else ""
