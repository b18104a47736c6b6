"""What a map program's properties of an area say about a no-fly zone; in GeoJSON and in KML.

The names are those of the mission file: `clearance_m`, `lower_m`, `upper_m`, `reference`, `active`.
Altitude limits are also read as openAIP and the FAA name them.
"""

from collections.abc import Callable, Mapping
from typing import Any

from air_router.files.altitudes import AltitudeLimit, Altitudes, Reference
from air_router.files.maps.limits import limits_in_properties
from air_router.files.maps.reading import MAX_ALTITUDE_M, ZoneReading, ZoneTerms, is_number
from air_router.files.maps.schedule import days_of, hours_of, period_of
from air_router.files.mission_document import Keys
from geo.validity import Hours, Period, Validity

Report = Callable[[str, str, str], None]
"""Takes the property's name, the message and its code."""

_MAX_CLEARANCE_M = 1_000.0
_OWN_LIMITS = frozenset(
    f"{side}{end}" for side in ("lower", "upper") for end in ("", "_m", "_reference")
)


def terms_of(
    properties: Mapping[str, Any], reading: ZoneReading, place: Callable[[str], Keys]
) -> ZoneTerms:
    """The terms in these properties; what is wrong with one is complained of, doubts are noted.

    Args:
        properties: Of one zone.
        reading: Takes problems and notes.
        place: Where a property stands, by its name.
    """

    def report(name: str, message: str, code: str) -> None:
        reading.report(place(name), message, code)

    def note(name: str, message: str, code: str) -> None:
        reading.note(place(name), message, code)

    clearance_m = _number(properties, "clearance_m", 0.0, _MAX_CLEARANCE_M, report)
    limits = [
        _limit(properties, ("lower_m", "lower"), "lower_reference", report),
        _limit(properties, ("upper_m", "upper"), "upper_reference", report),
    ]
    if properties.keys() & _OWN_LIMITS:
        altitudes = Altitudes(*limits) if any(limits) else None
    else:
        altitudes = limits_in_properties(properties, note)
    return ZoneTerms(clearance_m, altitudes, _validity(properties.get("active"), report))


def active_of(validity: Validity | None) -> list[dict[str, Any]] | None:
    """A validity as the property `active`, which is also that of the mission file."""
    if validity is None:
        return None
    entries: list[dict[str, Any]] = []
    for period in validity.periods:
        bounds: dict[str, Any] = {}
        for name, moment in (("from", period.start), ("until", period.end)):
            if moment is not None:
                bounds[name] = moment.isoformat().replace("+00:00", "Z")
        for hours in period.daily:
            days = sorted(hours.days)
            daily = {"days": [_DAY_NAMES[day] for day in days]} if len(days) < 7 else {}
            between = [hours.start.strftime("%H:%M"), hours.end.strftime("%H:%M")]
            entries.append({**bounds, **daily, "between": between})
        if not period.daily:
            entries.append(bounds)
    return entries


_DAY_NAMES = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")


def _limit(
    properties: Mapping[str, Any], names: tuple[str, ...], own_reference: str, report: Report
) -> AltitudeLimit | None:
    name = next((name for name in names if properties.get(name) is not None), None)
    if name is None:
        return None
    metres = _number(properties, name, -MAX_ALTITUDE_M, MAX_ALTITUDE_M, report)
    key = own_reference if properties.get(own_reference) is not None else "reference"
    word = properties.get(key)
    try:
        reference = Reference(word) if word is not None else Reference.HOME
    except ValueError:
        choices = ", ".join(Reference)
        report(key, f"'{key}' must be one of {choices}, found {word!r}; correct it", "unknown-word")
        return None
    return None if metres is None else AltitudeLimit(metres, reference)


def _number(
    properties: Mapping[str, Any], name: str, lowest: float, highest: float, report: Report
) -> float | None:
    value = properties.get(name)
    if value is None:
        return None
    if not is_number(value):
        message = f"'{name}' must be a number, found {str(value)[:40]!r}; correct it"
        report(name, message, "wrong-type")
        return None
    if not lowest <= value <= highest:
        message = f"'{name}' must be from {lowest:g} to {highest:g}, found {value:g}; correct it"
        report(name, message, "out-of-range")
        return None
    return float(value)


def _validity(active: Any, report: Report) -> Validity | None:
    if active is None:
        return None
    entries = active if isinstance(active, list) else [active]
    periods: list[Period] = []
    for entry in entries:
        if not isinstance(entry, dict):
            message = "'active' must be a list of {from, until, days, between}; correct it"
            report("active", message, "wrong-type")
            return None
        try:
            periods.append(_period(entry))
        except ValueError as error:
            report("active", f"'active': {error}; correct it", "not-a-time")
    return Validity(tuple(periods)) if periods else None


def _period(entry: Mapping[str, Any]) -> Period:
    between = entry.get("between")
    daily: tuple[Hours, ...] = ()
    if between is not None or entry.get("days") is not None:
        if between is not None and (not isinstance(between, list) or len(between) != 2):
            raise ValueError("'between' must be two times of day")
        start, end = between or ("00:00", "00:00")
        daily = (hours_of(days_of(entry.get("days")), start, end),)
    return period_of(entry.get("from"), entry.get("until"), daily)
