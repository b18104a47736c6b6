"""UAS geographical zones as authorities publish them: the JSON of ED-269, the GeoJSON of ED-318.

Both say the same under other names: a table has these. Geozones are published for whole countries,
and not always well. Where one is in doubt it is read as the larger zone, and the operator is told.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from typing import Any, ClassVar, Final, NamedTuple

from air_router.counted import counted
from air_router.files.json_document import JsonDocument
from air_router.files.maps.geojson import GeometryReader
from air_router.files.maps.limits import METRES_PER_UNIT
from air_router.files.maps.schedule import validity_of
from air_router.files.maps.zone_reading import (
    MAX_ALTITUDE_M,
    AllowedZones,
    MapCircle,
    Shapes,
    ZoneReading,
)
from air_router.files.mission_document import Keys
from air_router.files.zone_terms import AltitudeLimit, Altitudes, Reference, ZoneTerms
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

_REFERENCES: Final = {"AGL": Reference.GROUND, "AMSL": Reference.AMSL, "WGS84": None}


class _Names(NamedTuple):
    """Where a format has what: keys of a zone, of its properties and of a volume's layer."""

    properties: Keys  # of a zone
    restriction: str
    periods: str  # when it applies
    unit: str  # of both limits
    unit_needed: bool  # metres without one, where it is not
    lower: tuple[str, str]  # value and reference
    upper: tuple[str, str]  # value and reference


def read_ed269(document: JsonDocument, allow: Collection[str] = ()) -> ZoneReading:
    """The no-fly zones of an ED-269 file: an object with `features`, or the bare list of them.

    Older files call it `UASZoneList`, and the `schedule` in it `dailyPeriod`.

    Args:
        document: The file.
        allow: Restrictions and identifiers of zones that the operator may fly in.
    """
    bare = isinstance(document.data, list)
    return _Ed269(document, allow).read(() if bare else (zones_key(document.data),))


def read_ed318(document: JsonDocument, allow: Collection[str] = ()) -> ZoneReading:
    """The no-fly zones of an ED-318 file; see `read_ed269`."""
    return _Ed318(document, allow).read(("features",))


def zones_key(data: dict[str, Any]) -> str:
    """The key of the list of zones in ED-269."""
    return "UASZoneList" if "UASZoneList" in data else "features"


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


class _GeozoneReader(GeometryReader, ABC):
    """Reads zones by the names of a format."""

    format: ClassVar[str]
    names: ClassVar[_Names]

    def __init__(self, document: JsonDocument, allow: Collection[str]) -> None:
        super().__init__(document, self.format)
        self._allowed = AllowedZones(allow)
        self._unrestricted = 0  # zones that restrict nothing

    def read(self, features: Keys) -> ZoneReading:
        """All zones of the list at these keys."""
        for index in range(len(self.entries(features, "the zones"))):
            self._zone((*features, index), index + 1)
        self._tell_what_was_left_out()
        return self.reading

    @abstractmethod
    def volumes(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        """The volumes of a zone: where their limits stand, and their shapes."""

    def _zone(self, keys: Keys, number: int) -> None:
        names = self.names
        properties: Keys = (*keys, *names.properties)
        if not isinstance(self.at(*properties), dict):
            self.wrong(properties, "what a zone says of itself must be an object")
            return
        identifier = self._text((*properties, "identifier")) or f"zone {number}"
        restriction: Keys = (*properties, names.restriction)
        if not self._restricted(restriction, self.at(*restriction), identifier):
            return
        words = (self._text((*properties, key)) for key in ("identifier", "name"))
        name = " ".join(filter(None, words)) or identifier
        validity = self._validity((*properties, names.periods))
        volumes = list(self.volumes(keys))
        for index, (layer, shapes) in enumerate(volumes):
            suffix = f", volume {index + 1}" if len(volumes) > 1 else ""
            terms = ZoneTerms(altitudes=self._altitudes(layer), validity=validity)
            self.reading.add(name[:80] + suffix, shapes, terms)

    def _text(self, keys: Keys) -> str:
        """A text, or the first of several translations."""
        value = self.at(*keys)
        if isinstance(value, list) and value:
            value = value[0]
        if isinstance(value, dict):
            value = value.get("text")
        return value.strip() if isinstance(value, str) else ""

    def _restricted(self, keys: Keys, restriction: Any, identifier: str) -> bool:
        """Whether a zone is a no-fly zone; one of an unknown kind is, too."""
        word = restriction.upper() if isinstance(restriction, str) else ""
        if word == NO_RESTRICTION:
            self._unrestricted += 1
            return False
        if word not in RESTRICTIONS:
            message = f"unknown restriction {str(restriction)[:30]!r}: read as a no-fly zone"
            self.reading.note(keys, message, "unknown-restriction")
        return not self._allowed.takes(identifier, word, identifier)

    def _tell_what_was_left_out(self) -> None:
        if self._unrestricted:
            message = f"{counted(self._unrestricted, 'zones')} of type {NO_RESTRICTION}: left out"
            self.reading.note((), message, "no-restriction")
        self._allowed.tell(self.reading, "restriction or identifier")

    def _altitudes(self, layer: Keys) -> Altitudes | None:
        """The altitudes between the limits of a layer; None: without limits."""
        if self.at(*layer) is None:
            return None
        names, unit = self.names, 1.0
        if names.unit_needed or self.at(*layer, names.unit) is not None:
            unit = self.choice((*layer, names.unit), "the unit", METRES_PER_UNIT) or unit
        low, high = (
            self._limit((*layer, limit), (*layer, reference), unit)
            for limit, reference in (names.lower, names.upper)
        )
        if high is not None and (low is None or low.reference is high.reference):
            least_m = 0.0 if low is None else low.metres
            if high.reference is Reference.GROUND and high.metres <= max(least_m, 0.0):
                message = f"it ends at {high.metres:g} m, where it begins: read as without end"
                self.reading.note((*layer, names.upper[0]), message, "no-height")
                high = None
        return Altitudes(low, high) if low or high else None

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
    names = _Names(
        (),
        "restriction",
        "applicability",
        "uomDimensions",
        unit_needed=True,
        lower=("lowerLimit", "lowerVerticalReference"),
        upper=("upperLimit", "upperVerticalReference"),
    )

    def volumes(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        for index in range(len(self.entries((*keys, "geometry"), "a zone's geometry"))):
            volume: Keys = (*keys, "geometry", index)
            yield volume, self.shapes((*volume, "horizontalProjection"))

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
    names = _Names(
        ("properties",),
        "type",
        "limitedApplicability",
        "uom",
        unit_needed=False,
        lower=("lower", "lowerReference"),
        upper=("upper", "upperReference"),
    )

    def volumes(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        yield from self._parts((*keys, "geometry"))

    def _parts(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        """The geometries of a zone, each with the layer of its own."""
        if self.at(*keys, "type") == "GeometryCollection":
            inner: Keys = (*keys, "geometries")
            for index in range(len(self.entries(inner, "the geometries"))):
                yield from self._parts((*inner, index))
        else:
            yield (*keys, "layer"), self.shapes(keys)

    def point(self, keys: Keys) -> MapCircle | None:
        return self.circle((*keys, "coordinates"), (*keys, "extent", "radius"))
