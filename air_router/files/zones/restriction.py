"""What geozones (ED-269, ED-318) have in common: restrictions, heights, applicability.

Geozones are published for whole countries, and not always well. Where one is in doubt it is read
as the larger zone, and the operator is told.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, Final

from air_router.counted import counted
from air_router.files.altitudes import AltitudeLimit, Altitudes, Reference
from air_router.files.mission_document import Keys
from air_router.files.zones.reading import MAX_ALTITUDE_M, JsonReader, ZoneReading
from air_router.files.zones.schedule import days_of, hours_of, period_of
from geo.validity import Hours, Period, Validity

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

METRES_PER_UNIT: Final = {"M": 1.0, "FT": 0.3048}
_REFERENCES: Final = {"AGL": Reference.GROUND, "AMSL": Reference.AMSL, "WGS84": None}


class GeozoneReader:
    """What readers of geozones share.

    Args:
        json: reads the document's values.
        allow: restrictions and identifiers of zones that the operator may fly in.
    """

    def __init__(self, json: JsonReader, allow: Collection[str]) -> None:
        self._json = json
        self._allow = {_british(word): word for word in allow}
        self._used: set[str] = set()
        self.unrestricted = 0
        self.allowed: list[str] = []

    @property
    def reading(self) -> ZoneReading:
        """What has been read so far."""
        return self._json.reading

    def restricted(self, keys: Keys, restriction: Any, identifier: str) -> bool:
        """Whether a zone is a no-fly zone; one of an unknown kind is, too."""
        word = restriction.upper() if isinstance(restriction, str) else ""
        if word == NO_RESTRICTION:
            self.unrestricted += 1
            return False
        matches = {_british(word), _british(identifier)} & self._allow.keys()
        if word not in RESTRICTIONS:
            message = f"unknown restriction {str(restriction)[:30]!r}: read as a no-fly zone"
            self.reading.note(keys, message, "unknown-restriction")
        if matches:
            self._used |= matches
            self.allowed.append(identifier)
            return False
        return True

    def finish(self) -> None:
        """Tell of the zones that were left out."""
        if self.unrestricted:
            count = self.unrestricted
            message = f"{counted(count, 'zones')} of type {NO_RESTRICTION}: left out"
            self.reading.note((), message, "no-restriction")
        if self.allowed:
            shown = ", ".join(self.allowed[:10]) + (" ..." if len(self.allowed) > 10 else "")
            message = f"{counted(len(self.allowed), 'zones')} that you allow: left out ({shown})"
            self.reading.note((), message, "zone-allowed")
        for unused in sorted(self._allow.keys() - self._used):
            message = f"no zone is of restriction or identifier '{self._allow[unused][:40]}'"
            self.reading.note((), message, "allow-unused")

    def altitudes(
        self, keys: Keys, lower: tuple[str, str], upper: tuple[str, str], metres_per_unit: float
    ) -> Altitudes | None:
        """The altitudes between two limits, each with the key of its reference."""
        low, high = (
            self._limit((*keys, limit), (*keys, reference), metres_per_unit)
            for limit, reference in (lower, upper)
        )
        if high is not None and (low is None or low.reference is high.reference):
            least_m = 0.0 if low is None else low.metres
            if high.reference is Reference.GROUND and high.metres <= max(least_m, 0.0):
                message = f"it ends at {high.metres:g} m, where it begins: read as without end"
                self.reading.note((*keys, upper[0]), message, "no-height")
                high = None
        return Altitudes(low, high) if low or high else None

    def _limit(
        self, keys: Keys, reference_keys: Keys, metres_per_unit: float
    ) -> AltitudeLimit | None:
        if self._json.at(*keys) is None:
            return None
        value = self._json.number(keys, "an altitude", -1e6, 1e9, in_text=True)
        word = self._json.at(*reference_keys)
        if word is None:
            message = "an altitude that does not say from where it counts: read as without limit"
            self.reading.note(keys, message, "no-reference")
            return None
        reference = self._json.choice(reference_keys, "an altitude's reference", _REFERENCES)
        if reference is None and str(word).upper() == "WGS84":
            message = "an altitude above the ellipsoid: read as without limit"
            self.reading.note(keys, message, "no-reference")
        if value is None or reference is None or value * metres_per_unit > MAX_ALTITUDE_M:
            return None  # what ends beyond all flight has no end
        return AltitudeLimit(value * metres_per_unit, reference)

    def validity(
        self, keys: Keys, always: Callable[[Keys], bool] = lambda _: False
    ) -> Validity | None:
        """When a zone applies, from a list of periods; None: always."""
        entries = self._json.at(*keys)
        if not isinstance(entries, list) or not entries:
            return None
        periods = [self._period((*keys, i), always((*keys, i))) for i in range(len(entries))]
        if any(period == Period() for period in periods):
            return None
        return Validity(tuple(periods))

    def _period(self, keys: Keys, permanent: bool) -> Period:
        daily: list[Hours] = []
        schedule = self._json.at(*keys, "schedule") or self._json.at(*keys, "dailyPeriod")
        bounds = [self._json.at(*keys, name) or None for name in ("startDateTime", "endDateTime")]
        start, end = (None, None) if permanent else bounds
        try:
            daily = [_hours(entry) for entry in schedule] if isinstance(schedule, list) else []
        except ValueError as error:
            self._doubt((*keys, "schedule"), error)
            daily = []
        try:
            return period_of(start, end, tuple(daily))
        except ValueError as error:
            self._doubt(keys, error)
            return Period()

    def _doubt(self, keys: Keys, error: ValueError) -> None:
        message = f"when it applies is not clear ({error}): read as always"
        self.reading.note(keys, message, "unclear-time")


def _british(word: str) -> str:
    """ED-269 writes AUTHORISATION, ED-318 AUTHORIZATION."""
    return word.upper().replace("AUTHORIZATION", "AUTHORISATION")


def _hours(entry: Any) -> Hours:
    if not isinstance(entry, dict):
        raise ValueError("a day's entry is no object")  # noqa: TRY004 - told, not a fault of ours
    for event in ("startEvent", "endEvent"):
        if entry.get(event) is not None:
            raise ValueError(f"it depends on the sun ({entry[event]!s:.10})")
    start, end = entry.get("startTime"), entry.get("endTime")
    if start is None and end is None:
        start = end = "00:00Z"  # the whole day
    return hours_of(days_of(entry.get("day")), start, end)
