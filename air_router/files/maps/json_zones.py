"""No-fly zones in JSON: GeoJSON of map programs, and the geozones of ED-269 and ED-318.

One reader for all: `property_names` has the names of the properties in each of them. Polygons and
points with a radius are read. Every area is a zone, unless its property `kind` makes it
something else: our files have a `kind` each, and their zones are read back. Where a
geozone is in doubt it is read as the larger one, and the operator gets a note.
"""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from air_router.files import (
    AltitudeLimit,
    Altitudes,
    JsonDocument,
    Keys,
    Reference,
    ZoneTerms,
    json_from_text,
)
from air_router.files.maps.geozone_hours import validity_of
from air_router.files.maps.json_geometry import GeometryReader
from air_router.files.maps.limits import Note, limits_in_properties, note_unread, terms_of
from air_router.files.maps.map_area import MapCircle
from air_router.files.maps.property_names import (
    ED269,
    ED318,
    GEOJSON,
    METRES_PER_UNIT,
    NO_RESTRICTION,
    REFERENCES,
    RESTRICTIONS,
    Dialect,
    dialect_of,
    is_zone,
)
from air_router.files.maps.zone_format import (
    MAX_ALTITUDE_M,
    Shapes,
    ZoneFeature,
    ZoneFeatures,
    short_name,
)
from air_router.words import counted
from geo.validity import Validity
from mocha_link.team import DocumentError, text_in

KNOWN: Final = "GeoJSON, KML, GPX, OpenAir, ArduPilot's fences and geozones (ED-269, ED-318)"
_WGS84_NAMES: Final = ("CRS84", "EPSG::4326", "EPSG:4326")


class JsonFormat:
    """GeoJSON, ED-269 and ED-318."""

    name: Final = "GeoJSON"
    suffixes: Final = (".geojson", ".json")

    def recognises(self, head: bytes) -> bool:
        """Whether it is JSON."""
        return head.startswith((b"{", b"["))

    def read(self, content: bytes, path: Path) -> ZoneFeatures:
        """The features. Raises DocumentError: it is no JSON, or has no zones."""
        return features_of(json_from_text(text_in(content, path), path))


JSON: Final = JsonFormat()


def features_of(document: JsonDocument) -> ZoneFeatures:
    """The features of a JSON document. Raises DocumentError: it is none of the three."""
    data = document.data
    message = ""
    if isinstance(data, dict) and data.get("fileType") == "Plan":
        message = "a QGroundControl plan is a mission; use it as one, or convert it to GeoJSON"
    found = dialect_of(data)
    if message or found is None:
        message = message or f"none of {KNOWN}; choose another file"
        raise DocumentError([document.problem((), message, "unknown-format")])
    dialect, zones = found
    reader = _Reader(document, dialect)
    return ZoneFeatures(reader.features(zones), dialect.name, dialect.allow, dialect.skip)


class _Reader(GeometryReader):
    def __init__(self, document: JsonDocument, dialect: Dialect) -> None:
        super().__init__(document)
        self._document, self._dialect = document, dialect
        self._zone: Keys = ()  # the entry that is read
        self._others = 0  # features that are no zones
        self._unrestricted = 0  # zones that restrict nothing
        if dialect is GEOJSON:
            self.advice = "draw a polygon, or give a point the property radius_m"

    def features(self, zones: Keys | None) -> Iterator[ZoneFeature]:
        """The file as a whole, then all zones of the list at these keys.

        Args:
            zones: None: the file is one zone.
        """
        published = self._dialect is not GEOJSON
        if not published:
            self._check_coordinates()
        entries: list[Keys] = [()] if zones is None else self._entries(zones)
        yield self.feature
        for number, keys in enumerate(entries, start=1):
            whole_file = zones is None and not published
            self.feature = ZoneFeature(self._document, whole_file=whole_file)
            self._zone = keys
            self._read(keys, number)
            yield self.feature
        self.feature = ZoneFeature(self._document)
        if self._others:
            message = f"{self._others} features are no zones, by their property 'kind': left out"
            self.feature.note((), message, "not-a-zone")
        if self._unrestricted:
            message = f"{counted(self._unrestricted, 'zones')} of type {NO_RESTRICTION}: left out"
            self.feature.note((), message, "no-restriction")
        yield self.feature

    def _entries(self, keys: Keys) -> list[Keys]:
        return self.entries(keys, "the features" if self._dialect is GEOJSON else "the zones")

    def _check_coordinates(self) -> None:
        """Report coordinates that are no degrees of WGS-84."""
        crs, name = self.at("crs"), self.at("crs", "properties", "name")
        if crs is None or str(name).endswith(_WGS84_NAMES):
            return
        message = (
            f"coordinates are in {str(name or crs)[:60]!r}, not in WGS-84 degrees; export again"
        )
        self.feature.report(("crs",), message, "other-coordinates")

    def _read(self, keys: Keys, number: int) -> None:
        if self._dialect is not GEOJSON:
            self._published(keys, number)
        elif keys or self.at("type") == "Feature":
            self._drawn(keys, number)
        else:  # a bare geometry
            self.feature.name = short_name("", self._document.path, 1)
            self.feature.add(self.shapes(()))

    # Zones that a map program has drawn

    def _drawn(self, keys: Keys, number: int) -> None:
        where, feature = (*keys, *self._dialect.properties), self.feature
        properties = self.at(*where) or {}
        if self.at(*keys, "type") != "Feature":
            self.wrong((*keys, "type"), 'an entry of "features" has the type Feature')
        elif not isinstance(properties, dict):
            self.wrong(where, "the properties must be an object")
        elif not is_zone(properties):
            self._others += 1
        elif self.at(*keys, "geometry") is None:
            feature.note(keys, "a feature without a geometry: left out", "no-area")
        else:
            names = (*(properties.get(key) for key in self._dialect.names), self.at(*keys, "id"))
            given = next((str(name) for name in names if name not in (None, "")), "")
            feature.name = short_name(given, self._document.path, number)
            kinds = (properties.get(key) for key in self._dialect.kinds)
            feature.kinds = [str(kind) for kind in kinds if kind is not None]
            shapes = self.shapes((*keys, "geometry"))
            if shapes:
                feature.add(shapes, terms_of(properties, feature, lambda way: (*where, *way)))

    # Zones that an authority has published

    def _published(self, keys: Keys, number: int) -> None:
        dialect, properties = self._dialect, (*keys, *self._dialect.properties)
        if not isinstance(self.at(*properties), dict):
            self.wrong(properties, "the properties of a zone must be an object")
            return
        nested = (*properties, dialect.nested)
        about = nested if isinstance(self.at(*nested), dict) else properties
        identifier = self._text((*about, dialect.names[0])) or f"zone {number}"
        texts = (self._text((*about, key)) for key in dialect.names)
        name = " ".join(filter(None, texts)) or identifier
        if not self._restricted(about, identifier, name):
            return
        validity = self._validity((*properties, dialect.periods))
        volumes = list(self._volumes(keys))
        for index, (layer, shapes) in enumerate(volumes):
            suffix = f", volume {index + 1}" if len(volumes) > 1 else ""
            terms = ZoneTerms(altitudes=self._altitudes(properties, layer), validity=validity)
            self.feature.add(shapes, terms, name[:80] + suffix)

    def _text(self, keys: Keys) -> str:
        """A text, or the first of several translations."""
        value = self.at(*keys)
        if isinstance(value, list) and value:
            value = value[0]
        if isinstance(value, dict):
            value = value.get("text")
        return value.strip() if isinstance(value, str) else ""

    def _restricted(self, about: Keys, identifier: str, name: str) -> bool:
        """Whether a zone is a no-fly zone; one of an unknown kind is, too."""
        names = self._dialect.restriction
        given = [key for key in names if self.at(*about, key) is not None]
        known = [key for key in given if str(self.at(*about, key)).upper() in RESTRICTIONS]
        keys = (*about, next(iter(known or given), names[0]))
        restriction = self.at(*keys)
        value = restriction.upper() if isinstance(restriction, str) else ""
        if value == NO_RESTRICTION:
            self._unrestricted += 1
            return False
        feature = self.feature
        feature.name, feature.kinds = name, (value, identifier)
        feature.allowed_as = (value, identifier)
        if value not in RESTRICTIONS:
            message = f"unknown restriction {str(restriction)[:30]!r}: read as a no-fly zone"
            feature.note(keys, message, "unknown-restriction")
        return True

    def _volumes(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        """The volumes of a zone: where their limits stand, and their shapes."""
        geometry = (*keys, "geometry")
        if not self._dialect.volumes:
            yield from self._parts(geometry)
            return
        for volume in self.pieces(geometry, "a zone's geometry"):
            yield volume, self._projection((*volume, self._dialect.volumes))
        self._note_others(keys, ("geometry",))

    def _parts(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        """The geometries of a zone, each with the layer of its own."""
        if self.at(*keys, "type") == "GeometryCollection":
            for piece in self.pieces((*keys, "geometries"), "the geometries"):
                yield from self._parts(piece)
        else:
            yield (*keys, self._dialect.layer), self.shapes(keys)

    def _projection(self, keys: Keys) -> Shapes:
        kind = self.at(*keys, "type")
        if kind == "Circle":
            circle = self.circle((*keys, "center"), (*keys, *self._dialect.radius))
            return [(keys, circle)] if circle else []
        if kind == "Polygon":
            return self.shapes(keys)
        self.wrong((*keys, "type"), "a horizontal projection is a Circle or a Polygon")
        return []

    def point(self, keys: Keys) -> MapCircle | None:
        """A point as a circle: with the radius that the dialect has in properties or geometry."""
        dialect, centre = self._dialect, (*keys, "coordinates")
        if dialect is ED318:
            return self.circle(centre, (*keys, *dialect.radius))
        properties = (*self._zone, *dialect.properties)
        is_feature = bool(self._zone) or self.at("type") == "Feature"
        for name in dialect.radius if is_feature and dialect is not ED269 else ():
            if self.at(*properties, name) is not None:
                return self.circle(centre, (*properties, name))
        return super().point(keys)

    def _altitudes(self, properties: Keys, layer: Keys) -> Altitudes | None:
        """The limits of a volume's layer; or of the properties, wherever they have them."""
        if self._dialect.unit_needed:
            return self._in_layer(layer)
        found = self.at(*layer)
        values = (self._dialect.lower[0], self._dialect.upper[0])
        if isinstance(found, dict) and any(found.get(key) is not None for key in values):
            self._note_others(properties, ())
            return self._in_layer(layer)
        if isinstance(found, dict):
            self._note_others(layer, ())
        return limits_in_properties(self.at(*properties), self._noter(properties))

    def _in_layer(self, layer: Keys) -> Altitudes | None:
        """The altitudes between the limits of a layer; None: without limits."""
        dialect = self._dialect
        self._note_others(layer, (*dialect.lower, *dialect.upper, dialect.unit))
        unit = 1.0
        if dialect.unit_needed or self.at(*layer, dialect.unit) is not None:
            unit = self.choice((*layer, dialect.unit), "the unit", METRES_PER_UNIT) or unit
        low, high = (
            self._limit((*layer, limit), (*layer, reference), unit)
            for limit, reference in (dialect.lower, dialect.upper)
        )
        if high is not None and high.reference is Reference.GROUND:
            least_m = low.metres if low is not None and low.reference is high.reference else 0.0
            if high.metres <= max(least_m, 0.0):
                message = f"it ends at {high.metres:g} m, where it begins: read as without end"
                self.feature.note((*layer, dialect.upper[0]), message, "no-height")
                if low is not None and high.metres < least_m:
                    low = high  # they may be exchanged
                high = None
        return Altitudes(low, high) if low or high else None

    def _note_others(self, keys: Keys, read: Collection[str]) -> None:
        """Note what may be a limit in an object, but for what stands under the names here."""
        found = self.at(*keys)
        if isinstance(found, dict):
            rest = {name: value for name, value in found.items() if name not in read}
            note_unread(rest, (), self._noter(keys))

    def _noter(self, keys: Keys) -> Note:
        """Takes notes on what stands in the object at these keys."""

        def note(way: Keys, message: str, code: str) -> None:
            self.feature.note((*keys, *way), message, code)

        return note

    def _limit(
        self, keys: Keys, reference_keys: Keys, metres_per_unit: float
    ) -> AltitudeLimit | None:
        if self.at(*keys) is None:
            return None
        value = self.number_within(keys, "an altitude", -1e6, 1e9, in_text=True)
        written = self.at(*reference_keys)
        if written is None:
            message = "an altitude without its reference: read as without limit"
            self.feature.note(keys, message, "no-reference")
            return None
        reference = self.choice(reference_keys, "an altitude's reference", REFERENCES)
        if reference is None and str(written).upper() == "WGS84":
            message = "an altitude above the ellipsoid: read as without limit"
            self.feature.note(keys, message, "no-reference")
        if value is None or reference is None or value * metres_per_unit > MAX_ALTITUDE_M:
            return None  # what ends beyond all flight has no end
        return AltitudeLimit(value * metres_per_unit, reference)

    def _validity(self, keys: Keys) -> Validity | None:
        """When a zone applies; None: always."""

        def doubt(entry: Keys, error: ValueError) -> None:
            message = f"when it applies is not clear ({error}): read as always"
            self.feature.note((*keys, *entry), message, "unclear-time")

        return validity_of(self.at(*keys), doubt)
