"""When zones apply, as the formats write it: days, hours with an offset, sunrise.

Whatever is not certain makes the zone apply longer, never shorter.
"""

import re
from collections.abc import Iterable
from datetime import datetime, time
from typing import Any

from air_router.files.maps.reading import utc
from geo.validity import DAYS, Hours, Period

ALL_DAYS = frozenset(range(7))
_CLOCK = re.compile(
    r"(?P<hour>[01][0-9]|2[0-4]):(?P<minute>[0-5][0-9])(?::(?P<second>[0-5][0-9])(?:[.,][0-9]+)?)?"
    r"(?P<offset>Z|[-+][0-9]{2}:?[0-9]{2})?"
)
_SHORT_DAYS = {name[:3].upper(): frozenset({number}) for number, name in enumerate(DAYS)}
DAY_WORDS: dict[str, frozenset[int]] = {
    **_SHORT_DAYS,
    **{name.upper(): frozenset({number}) for number, name in enumerate(DAYS)},
    "ANY": ALL_DAYS,
}
"""Days of the week as files name them, in capitals."""


def days_of(words: Any) -> frozenset[int]:
    """The numbers of the days in a list of words like MON, monday or ANY; none means all.

    Raises:
        ValueError: a word is no day.
    """
    if words is None or words == []:
        return ALL_DAYS
    listed = words if isinstance(words, list) else [words]
    days: set[int] = set()
    for word in listed:
        if not isinstance(word, str) or word.upper() not in DAY_WORDS:
            raise ValueError(f"'{str(word)[:20]}' is no day; write {', '.join(_SHORT_DAYS)} or ANY")
        days |= DAY_WORDS[word.upper()]
    return frozenset(days)


def hours_of(days: Iterable[int], start: Any, end: Any) -> Hours:
    """Hours of the day like 08:00Z or 08:00+02:00, in UTC. Without an offset they are UTC.

    23:59 as an end is midnight: no zone has a gap of a minute there.

    Raises:
        ValueError: a text is no time of day.
    """
    start_min, end_min = _minutes(start, up=False), _minutes(end, up=True)
    if end_min % 1440 == 1439:
        end_min += 1
    shift, start_min = divmod(start_min, 1440)
    _, end_min = divmod(end_min, 1440)
    shifted = frozenset((day + shift) % 7 for day in days)
    return Hours(shifted, _time(start_min), _time(end_min))


def period_of(start: Any, end: Any, daily: tuple[Hours, ...]) -> Period:
    """A period between two moments as texts; None: without limit.

    Raises:
        ValueError: a text is no moment with a time zone, or the end is before the start.
    """
    moments: list[datetime | None] = [None if text is None else utc(text) for text in (start, end)]
    return Period(moments[0], moments[1], daily)


def _minutes(text: Any, *, up: bool) -> int:
    """Minutes of the day in UTC, perhaps of the day before or after; seconds widen."""
    match = _CLOCK.fullmatch(text) if isinstance(text, str) else None
    if match is None:
        raise ValueError(f"'{str(text)[:20]}' is no time of day like 08:00Z")
    minutes = int(match["hour"]) * 60 + int(match["minute"])
    if minutes > 1440:
        raise ValueError(f"'{text[:20]}' is no time of day like 08:00Z")
    if up and match["second"] is not None and int(match["second"]) > 0:
        minutes += 1
    offset = match["offset"]
    if offset not in (None, "Z"):
        sign = -1 if offset[0] == "-" else 1
        minutes -= sign * (int(offset[1:3]) * 60 + int(offset[-2:]))
    return minutes


def _time(minutes: int) -> time:
    return time(*divmod(minutes, 60))
