"""When a geozone of ED-269 or ED-318 applies: periods, days, hours with an offset.

Whatever is not certain makes the zone apply longer, never shorter.
"""

import re
from collections.abc import Callable
from datetime import time
from typing import Any

from air_router.files.mission_document import Keys
from geo.validity import DAY_NUMBERS, DAYS, Hours, Period, Validity, moment_of

Doubt = Callable[[Keys, ValueError], None]
"""Takes which entry is not clear, and why."""

_DAY_MIN = 24 * 60
_CLOCK = re.compile(
    r"(?P<hour>[01][0-9]|2[0-4]):(?P<minute>[0-5][0-9])(?::(?P<second>[0-5][0-9])(?:[.,][0-9]+)?)?"
    r"(?:Z|(?P<sign>[-+])(?P<hours>[0-9]{2}):?(?P<minutes>[0-9]{2}))?"
)
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
    if end_min % _DAY_MIN == _DAY_MIN - 1:
        end_min += 1
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
    match = _CLOCK.fullmatch(text) if isinstance(text, str) else None
    minutes = _DAY_MIN + 1 if match is None else int(match["hour"]) * 60 + int(match["minute"])
    if match is None or minutes > _DAY_MIN:
        raise ValueError(f"'{str(text)[:20]}' is no time of day like 08:00Z")
    if up and int(match["second"] or 0) > 0:
        minutes += 1
    if match["sign"]:
        offset_min = int(match["hours"]) * 60 + int(match["minutes"])
        minutes += offset_min if match["sign"] == "-" else -offset_min
    return minutes
