"""UAS geographical zones as authorities publish them: the JSON of ED-269, the GeoJSON of ED-318.

Both say the same under other names: a table has these. Geozones are published for whole countries,
and not always well: Spain nests what a zone is called and its limits in objects, others write the
words of ED-269 as properties of GeoJSON. Where a zone is in doubt it is read as the larger one, and
the operator is told.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from typing import Any, ClassVar, Final

from air_router.files import AltitudeLimit, Altitudes, JsonDocument, Keys, Reference, ZoneTerms
from air_router.files.maps.geojson import GeometryReader
from air_router.files.maps.geozone_hours import validity_of
from air_router.files.maps.limits import (
    METRES_PER_UNIT,
    Note,
    limits_in_properties,
    note_unread,
)
from air_router.files.maps.map_area import MapCircle
from air_router.files.maps.zone_reading import MAX_ALTITUDE_M, Shapes, ZoneChoice, ZoneReading
from air_router.words import counted
from geo.validity import Validity

NO_RESTRICTION: Final = "NO_RESTRICTION"
RESTRICTIONS: Final = (
    "PROHIBITED",
    "REQ_AUTHORISATION",
    "REQ_AUTHORIZATION",
    "CONDITIONAL",
    "USPACE",
    NO_RESTRICTION,
)
"""Each of them but the last one is a no-fly zone, unless the operator allows it by name."""

_NESTED: Final = "UASZone"
_OF_PROPERTIES: Final = frozenset({"zoneAuthority", "variant", _NESTED, "verticalLayer"})
_OF_GEOMETRY: Final = frozenset({"layer", "extent"})
"""What only features of ED-318 have."""

_RESTRICTION_KEYS: Final = ("restriction", "type")
"""Of ED-269, whose type is another thing, and of ED-318."""

_LAYER: Final = ("lower", "upper")
_REFERENCES: Final = {"AGL": Reference.GROUND, "AMSL": Reference.AMSL, "WGS84": None}


def read_geozones(document: JsonDocument, choice: ZoneChoice | None = None) -> ZoneReading | None:
    """The no-fly zones of an ED-269 or ED-318 file; None: it is neither.

    ED-269 is an object with `features`, or the bare list of them; older files call it
    `UASZoneList`, and the `schedule` in it `dailyPeriod`. Its geometries are lists of volumes.

    Args:
        document: The file.
        choice: Restrictions and identifiers of zones that the operator may fly in, or leaves out.
    """
    data = document.data
    if isinstance(data, list):
        return _Ed269(document, choice).read(())
    if isinstance(data, dict) and data.get("type") == "Feature" and _is_ed318(data):
        return _Ed318(document, choice).read(None)
    key = "UASZoneList" if isinstance(data, dict) and "UASZoneList" in data else "features"
    features = data.get(key) if isinstance(data, dict) else None
    if not isinstance(features, list):
        return None
    zones = [feature for feature in features if isinstance(feature, dict)]
    volumes = bool(zones) and isinstance(zones[0].get("geometry"), list)
    if volumes or data.get("type") != "FeatureCollection":
        return _Ed269(document, choice).read((key,))
    if any(map(_is_ed318, zones[:20])):
        return _Ed318(document, choice).read((key,))
    return None


def _is_ed318(feature: dict[str, Any]) -> bool:
    """Whether a feature of GeoJSON has what only those of geozones have."""
    properties, geometry = feature.get("properties"), feature.get("geometry")
    return any(
        isinstance(part, dict) and not names.isdisjoint(part)
        for part, names in ((properties, _OF_PROPERTIES), (geometry, _OF_GEOMETRY))
    ) or (
        isinstance(properties, dict)
        and any(properties.get(key) in RESTRICTIONS for key in _RESTRICTION_KEYS)
    )


class _GeozoneReader(GeometryReader, ABC):
    """Reads zones; its formats say where they have what: keys of a zone, of a volume's layer."""

    format: ClassVar[str]
    properties: ClassVar[Keys]  # of a zone
    periods: ClassVar[str]  # when it applies
    unit: ClassVar[str]  # of both limits
    unit_needed: ClassVar[bool]  # metres without one, where it is not
    lower: ClassVar[tuple[str, str]]  # value and reference
    upper: ClassVar[tuple[str, str]]

    def __init__(self, document: JsonDocument, choice: ZoneChoice | None) -> None:
        super().__init__(document, self.format, choice)
        self._unrestricted = 0  # zones that restrict nothing

    def read(self, features: Keys | None) -> ZoneReading:
        """All zones of the list at these keys; None: the file is one zone."""
        zones = [()] if features is None else self.entries(features, "the zones")
        for number, keys in enumerate(zones, start=1):
            with self.reading.area():
                self._zone(keys, number)
        if self._unrestricted:
            message = f"{counted(self._unrestricted, 'zones')} of type {NO_RESTRICTION}: left out"
            self.reading.note((), message, "no-restriction")
        words = "restriction or identifier"
        self.reading.choice.tell(self.reading, words, f"{words} or name")
        return self.reading

    @abstractmethod
    def volumes(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        """The volumes of a zone: where their limits stand, and their shapes."""

    @abstractmethod
    def altitudes(self, zone: Keys, layer: Keys) -> Altitudes | None:
        """The altitudes of one of a zone's volumes; None: without limits."""

    def about(self, keys: Keys) -> Keys:
        """Where a zone says what it is: identifier, name, restriction."""
        return (*keys, *self.properties)

    def _zone(self, keys: Keys, number: int) -> None:
        if not isinstance(self.at(*keys, *self.properties), dict):
            message = "what a zone says of itself must be an object"
            self.wrong((*keys, *self.properties), message)
            return
        about = self.about(keys)
        identifier = self._text((*about, "identifier")) or f"zone {number}"
        texts = (self._text((*about, key)) for key in ("identifier", "name"))
        name = " ".join(filter(None, texts)) or identifier
        if not self._restricted(about, identifier, name):
            return
        validity = self._validity((*keys, *self.properties, self.periods))
        volumes = list(self.volumes(keys))
        for index, (layer, shapes) in enumerate(volumes):
            suffix = f", volume {index + 1}" if len(volumes) > 1 else ""
            terms = ZoneTerms(altitudes=self.altitudes(keys, layer), validity=validity)
            self.reading.add(name[:80] + suffix, shapes, terms)

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
        said = [key for key in _RESTRICTION_KEYS if self.at(*about, key) is not None]
        known = [key for key in said if str(self.at(*about, key)).upper() in RESTRICTIONS]
        keys = (*about, next(iter(known or said), _RESTRICTION_KEYS[0]))
        restriction = self.at(*keys)
        word = restriction.upper() if isinstance(restriction, str) else ""
        if word == NO_RESTRICTION:
            self._unrestricted += 1
            self.reading.forget()
            return False
        if self.reading.skips(name, word, identifier):
            return False
        if word not in RESTRICTIONS:
            message = f"unknown restriction {str(restriction)[:30]!r}: read as a no-fly zone"
            self.reading.note(keys, message, "unknown-restriction")
        return not self.reading.choice.allow.takes(identifier, word, identifier)

    def in_layer(self, layer: Keys) -> Altitudes | None:
        """The altitudes between the limits of a layer; None: without limits."""
        self.note_others(layer, (*self.lower, *self.upper, self.unit))
        unit = 1.0
        if self.unit_needed or self.at(*layer, self.unit) is not None:
            unit = self.choice((*layer, self.unit), "the unit", METRES_PER_UNIT) or unit
        low, high = (
            self._limit((*layer, limit), (*layer, reference), unit)
            for limit, reference in (self.lower, self.upper)
        )
        if high is not None and high.reference is Reference.GROUND:
            least_m = low.metres if low is not None and low.reference is high.reference else 0.0
            if high.metres <= max(least_m, 0.0):
                message = f"it ends at {high.metres:g} m, where it begins: read as without end"
                self.reading.note((*layer, self.upper[0]), message, "no-height")
                if low is not None and high.metres < least_m:
                    low = high  # they may be exchanged
                high = None
        return Altitudes(low, high) if low or high else None

    def note_others(self, keys: Keys, read: Collection[str]) -> None:
        """Note what may be a limit in an object, but for what stands under the names here."""
        found = self.at(*keys)
        if isinstance(found, dict):
            rest = {name: value for name, value in found.items() if name not in read}
            note_unread(rest, (), self.noter(keys))

    def noter(self, keys: Keys) -> Note:
        """Takes notes on what stands in the object at these keys."""

        def note(way: Keys, message: str, code: str) -> None:
            self.reading.note((*keys, *way), message, code)

        return note

    def _limit(
        self, keys: Keys, reference_keys: Keys, metres_per_unit: float
    ) -> AltitudeLimit | None:
        if self.at(*keys) is None:
            return None
        value = self.number_within(keys, "an altitude", -1e6, 1e9, in_text=True)
        word = self.at(*reference_keys)
        if word is None:
            message = "an altitude that does not say from where it counts: read as without limit"
            self.reading.note(keys, message, "no-reference")
            return None
        reference = self.choice(reference_keys, "an altitude's reference", _REFERENCES)
        if reference is None and str(word).upper() == "WGS84":
            message = "an altitude above the ellipsoid: read as without limit"
            self.reading.note(keys, message, "no-reference")
        if value is None or reference is None or value * metres_per_unit > MAX_ALTITUDE_M:
            return None  # what ends beyond all flight has no end
        return AltitudeLimit(value * metres_per_unit, reference)

    def _validity(self, keys: Keys) -> Validity | None:
        """When a zone applies; None: always."""

        def doubt(entry: Keys, error: ValueError) -> None:
            message = f"when it applies is not clear ({error}): read as always"
            self.reading.note((*keys, *entry), message, "unclear-time")

        return validity_of(self.at(*keys), doubt)


class _Ed269(_GeozoneReader):
    format = "ED-269"
    properties = ()
    periods = "applicability"
    unit, unit_needed = "uomDimensions", True
    lower = ("lowerLimit", "lowerVerticalReference")
    upper = ("upperLimit", "upperVerticalReference")

    def volumes(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        for volume in self.pieces((*keys, "geometry"), "a zone's geometry"):
            yield volume, self.shapes((*volume, "horizontalProjection"))
        self.note_others(keys, ("geometry",))

    def altitudes(self, _zone: Keys, layer: Keys) -> Altitudes | None:
        return self.in_layer(layer)

    def shapes(self, keys: Keys) -> Shapes:
        kind = self.at(*keys, "type")
        if kind == "Circle":
            circle = self.circle((*keys, "center"), (*keys, "radius"))
            return [(keys, circle)] if circle else []
        if kind == "Polygon":
            return super().shapes(keys)
        self.wrong((*keys, "type"), "a horizontal projection is a Circle or a Polygon")
        return []


class _Ed318(_GeozoneReader):
    format = "ED-318"
    properties = ("properties",)
    periods = "limitedApplicability"
    unit, unit_needed = "uom", False
    lower = ("lower", "lowerReference")
    upper = ("upper", "upperReference")

    def about(self, keys: Keys) -> Keys:
        nested = (*keys, *self.properties, _NESTED)
        return nested if isinstance(self.at(*nested), dict) else nested[:-1]

    def altitudes(self, zone: Keys, layer: Keys) -> Altitudes | None:
        """The limits of the geometry's layer; or of the properties, wherever they have them."""
        properties = (*zone, *self.properties)
        found = self.at(*layer)
        if isinstance(found, dict) and any(found.get(key) is not None for key in _LAYER):
            self.note_others(properties, ())
            return self.in_layer(layer)
        if isinstance(found, dict):
            self.note_others(layer, ())
        return limits_in_properties(self.at(*properties), self.noter(properties))

    def volumes(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        yield from self._parts((*keys, "geometry"))

    def _parts(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        """The geometries of a zone, each with the layer of its own."""
        if self.at(*keys, "type") == "GeometryCollection":
            for piece in self.pieces((*keys, "geometries"), "the geometries"):
                yield from self._parts(piece)
        else:
            yield (*keys, "layer"), self.shapes(keys)

    def point(self, keys: Keys) -> MapCircle | None:
        return self.circle((*keys, "coordinates"), (*keys, "extent", "radius"))
