"""When geozones apply: periods, days, hours with an offset. Anything uncertain extends them."""

from collections.abc import Callable
from datetime import time, timedelta
from typing import Any

from air_router.files import Keys
from geo.validity import DAY_NUMBERS, DAYS, Hours, Period, Validity, moment_of

ReportDoubt = Callable[[Keys, ValueError], None]
"""Reports an entry that is not clear, and why."""

_DAY_MIN = 24 * 60
_ALL_DAYS = frozenset(range(len(DAYS)))
_DAY_NAMES: dict[str, frozenset[int]] = {
    **{name.upper(): frozenset({number}) for name, number in DAY_NUMBERS.items()},
    "ANY": _ALL_DAYS,
}


def validity_of(periods: Any, doubt: ReportDoubt) -> Validity | None:
    """When a zone with this list of periods applies; None: always."""
    if not isinstance(periods, list) or not periods:
        return None
    found = [_period(entry, (index,), doubt) for index, entry in enumerate(periods)]
    return None if Period() in found else Validity(tuple(found))


def _period(entry: Any, keys: Keys, doubt: ReportDoubt) -> Period:
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
        raise ValueError("a day's entry is no object")  # noqa: TRY004 - reported, not a fault of ours
    for event in ("startEvent", "endEvent"):
        if entry.get(event):
            raise ValueError(f"it depends on the sun ({entry[event]!s:.10})")
    start, end = entry.get("startTime") or None, entry.get("endTime") or None
    if start is None and end is None:
        start = end = "00:00Z"  # the whole day
    start_min, end_min = _minutes(start, up=False), _minutes(end, up=True)
    shift, start_min = divmod(start_min, _DAY_MIN)
    days = frozenset((day + shift) % len(DAYS) for day in _days(entry.get("day")))
    return Hours(days, time(*divmod(start_min, 60)), time(*divmod(end_min % _DAY_MIN, 60)))


def _days(names: Any) -> frozenset[int]:
    """The numbers of the days in a list of names like MON, monday or ANY; none means all."""
    days: set[int] = set()
    for name in names if isinstance(names, list) else [names]:
        if name is None:
            return _ALL_DAYS
        if not isinstance(name, str) or name.upper() not in _DAY_NAMES:
            raise ValueError(f"'{str(name)[:20]}' is no day")
        days |= _DAY_NAMES[name.upper()]
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
