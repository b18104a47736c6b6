"""UAS geographical zones as authorities publish them: the JSON of ED-269, the GeoJSON of ED-318.

Both say the same under other names: a table has these. Geozones are published for whole countries,
and not always well. Where one is in doubt it is read as the larger zone, and the operator is told.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator
from datetime import time, timedelta
from typing import Any, ClassVar, Final

from air_router.files.json_document import JsonDocument
from air_router.files.maps.geojson import GeometryReader
from air_router.files.maps.limits import METRES_PER_UNIT
from air_router.files.maps.zone_reading import (
    MAX_ALTITUDE_M,
    AllowedZones,
    MapCircle,
    Shapes,
    ZoneReading,
)
from air_router.files.mission_document import Keys
from air_router.files.zone_terms import AltitudeLimit, Altitudes, Reference, ZoneTerms
from air_router.words import counted
from geo.validity import DAY_NUMBERS, DAYS, Hours, Period, Validity, moment_of

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

_OF_PROPERTIES: Final = frozenset({"zoneAuthority", "variant"})
_OF_GEOMETRY: Final = frozenset({"layer", "extent"})
"""What only features of ED-318 have."""

_REFERENCES: Final = {"AGL": Reference.GROUND, "AMSL": Reference.AMSL, "WGS84": None}


def read_geozones(document: JsonDocument, allow: Collection[str] = ()) -> ZoneReading | None:
    """The no-fly zones of an ED-269 or ED-318 file; None: it is neither.

    ED-269 is an object with `features`, or the bare list of them; older files call it
    `UASZoneList`, and the `schedule` in it `dailyPeriod`. Its geometries are lists of volumes.

    Args:
        document: The file.
        allow: Restrictions and identifiers of zones that the operator may fly in.
    """
    data = document.data
    if isinstance(data, list):
        return _Ed269(document, allow).read(())
    key = "UASZoneList" if isinstance(data, dict) and "UASZoneList" in data else "features"
    features = data.get(key) if isinstance(data, dict) else None
    if not isinstance(features, list):
        return None
    zones = [feature for feature in features if isinstance(feature, dict)]
    volumes = bool(zones) and isinstance(zones[0].get("geometry"), list)
    if volumes or data.get("type") != "FeatureCollection":
        return _Ed269(document, allow).read((key,))
    if any(map(_is_ed318, zones[:20])):
        return _Ed318(document, allow).read((key,))
    return None


def _is_ed318(feature: dict[str, Any]) -> bool:
    """Whether a feature of GeoJSON has what only those of geozones have."""
    properties, geometry = feature.get("properties"), feature.get("geometry")
    return any(
        isinstance(part, dict) and not names.isdisjoint(part)
        for part, names in ((properties, _OF_PROPERTIES), (geometry, _OF_GEOMETRY))
    )


class _GeozoneReader(GeometryReader, ABC):
    """Reads zones; its formats say where they have what: keys of a zone, of a volume's layer."""

    format: ClassVar[str]
    properties: ClassVar[Keys]  # of a zone
    restriction: ClassVar[str]
    periods: ClassVar[str]  # when it applies
    unit: ClassVar[str]  # of both limits
    unit_needed: ClassVar[bool]  # metres without one, where it is not
    lower: ClassVar[tuple[str, str]]  # value and reference
    upper: ClassVar[tuple[str, str]]

    def __init__(self, document: JsonDocument, allow: Collection[str]) -> None:
        super().__init__(document, self.format)
        self._allowed = AllowedZones(allow)
        self._unrestricted = 0  # zones that restrict nothing

    def read(self, features: Keys) -> ZoneReading:
        """All zones of the list at these keys."""
        for number, keys in enumerate(self.entries(features, "the zones"), start=1):
            self._zone(keys, number)
        if self._unrestricted:
            message = f"{counted(self._unrestricted, 'zones')} of type {NO_RESTRICTION}: left out"
            self.reading.note((), message, "no-restriction")
        self._allowed.tell(self.reading, "restriction or identifier")
        return self.reading

    @abstractmethod
    def volumes(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        """The volumes of a zone: where their limits stand, and their shapes."""

    def _zone(self, keys: Keys, number: int) -> None:
        properties: Keys = (*keys, *self.properties)
        if not isinstance(self.at(*properties), dict):
            self.wrong(properties, "what a zone says of itself must be an object")
            return
        identifier = self._text((*properties, "identifier")) or f"zone {number}"
        if not self._restricted((*properties, self.restriction), identifier):
            return
        words = (self._text((*properties, key)) for key in ("identifier", "name"))
        name = " ".join(filter(None, words)) or identifier
        validity = self._validity((*properties, self.periods))
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

    def _restricted(self, keys: Keys, identifier: str) -> bool:
        """Whether a zone is a no-fly zone; one of an unknown kind is, too."""
        restriction = self.at(*keys)
        word = restriction.upper() if isinstance(restriction, str) else ""
        if word == NO_RESTRICTION:
            self._unrestricted += 1
            return False
        if word not in RESTRICTIONS:
            message = f"unknown restriction {str(restriction)[:30]!r}: read as a no-fly zone"
            self.reading.note(keys, message, "unknown-restriction")
        return not self._allowed.takes(identifier, word, identifier)

    def _altitudes(self, layer: Keys) -> Altitudes | None:
        """The altitudes between the limits of a layer; None: without limits."""
        if self.at(*layer) is None:
            return None
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
    restriction = "restriction"
    periods = "applicability"
    unit, unit_needed = "uomDimensions", True
    lower = ("lowerLimit", "lowerVerticalReference")
    upper = ("upperLimit", "upperVerticalReference")

    def volumes(self, keys: Keys) -> Iterator[tuple[Keys, Shapes]]:
        for volume in self.pieces((*keys, "geometry"), "a zone's geometry"):
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
    properties = ("properties",)
    restriction = "type"
    periods = "limitedApplicability"
    unit, unit_needed = "uom", False
    lower = ("lower", "lowerReference")
    upper = ("upper", "upperReference")

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


# When they apply: periods, days, hours with an offset. What is not certain makes it longer.


Doubt = Callable[[Keys, ValueError], None]
"""Takes which entry is not clear, and why."""

_DAY_MIN = 24 * 60
_ALL_DAYS = frozenset(range(len(DAYS)))
_DAY_WORDS: dict[str, frozenset[int]] = {
    **{word.upper(): frozenset({number}) for word, number in DAY_NUMBERS.items()},
    "ANY": _ALL_DAYS,
}


def validity_of(periods: Any, doubt: Doubt) -> Validity | None:
    """When a zone with this list of periods applies; None: always."""
    if not isinstance(periods, list) or not periods:
        return None
    found = [_period(entry, (index,), doubt) for index, entry in enumerate(periods)]
    return None if Period() in found else Validity(tuple(found))


def _period(entry: Any, keys: Keys, doubt: Doubt) -> Period:
    if not isinstance(entry, dict):
        return Period()
    daily: list[Hours] = []
    schedule = entry.get("schedule") or entry.get("dailyPeriod")
    try:
        daily = [_hours(day) for day in schedule] if isinstance(schedule, list) else []
    except ValueError as error:
        doubt((*keys, "schedule"), error)
    bounds = [entry.get(name) or None for name in ("startDateTime", "endDateTime")]
    if str(entry.get("permanent")).upper() == "YES":
        bounds = [None, None]
    try:
        start, end = (None if text is None else moment_of(text) for text in bounds)
        return Period(start, end, tuple(daily))
    except ValueError as error:
        doubt(keys, error)
        return Period()


def _hours(entry: Any) -> Hours:
    """A day's entry in UTC. 23:59 as an end is midnight: no zone has a gap of a minute there."""
    if not isinstance(entry, dict):
        raise ValueError("a day's entry is no object")  # noqa: TRY004 - told, not a fault of ours
    for event in ("startEvent", "endEvent"):
        if entry.get(event) is not None:
            raise ValueError(f"it depends on the sun ({entry[event]!s:.10})")
    start, end = entry.get("startTime"), entry.get("endTime")
    if start is None and end is None:
        start = end = "00:00Z"  # the whole day
    start_min, end_min = _minutes(start, up=False), _minutes(end, up=True)
    shift, start_min = divmod(start_min, _DAY_MIN)
    days = frozenset((day + shift) % len(DAYS) for day in _days(entry.get("day")))
    return Hours(days, time(*divmod(start_min, 60)), time(*divmod(end_min % _DAY_MIN, 60)))


def _days(words: Any) -> frozenset[int]:
    """The numbers of the days in a list of words like MON, monday or ANY; none means all."""
    days: set[int] = set()
    for word in words if isinstance(words, list) else [words]:
        if word is None:
            return _ALL_DAYS
        if not isinstance(word, str) or word.upper() not in _DAY_WORDS:
            raise ValueError(f"'{str(word)[:20]}' is no day")
        days |= _DAY_WORDS[word.upper()]
    return frozenset(days) or _ALL_DAYS


def _minutes(text: Any, *, up: bool) -> int:
    """Minutes of the day in UTC, perhaps of the day before or after; seconds widen.

    Without an offset they are UTC.
    """
    midnight = str(text).startswith("24:00")  # the end of a day, which Python has not
    try:
        clock = time.fromisoformat(str(text).replace("24:00", "00:00", 1) if midnight else text)
    except (TypeError, ValueError):
        raise ValueError(f"'{str(text)[:20]}' is no time of day like 08:00Z") from None
    minutes = midnight * _DAY_MIN + clock.hour * 60 + clock.minute
    if up and (minutes == _DAY_MIN - 1 or clock.second > 0):
        minutes += 1
    return minutes - int((clock.utcoffset() or timedelta(0)).total_seconds() // 60)
