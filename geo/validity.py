"""When a zone applies: periods, and within them days of the week and hours. All times are UTC."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from typing import Final, NamedTuple

DAYS = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")
"""The days of the week as files name them; a day's number is its place, Monday is 0."""

DAY_NUMBERS: Final = {text: number for number, name in enumerate(DAYS) for text in (name, name[:3])}
"""Number of the day by its name or abbreviation; Monday is 0."""

NO_MOMENT: Final = "not a time with its time zone; write it like 2026-11-20T08:00:00Z (Z is UTC)"

_MIDNIGHT = time(0, 0)
_WEEK = timedelta(days=8)
"""A span of time that has every hour of every day of the week in it."""


def moment_of(text: object) -> datetime:
    """A moment in UTC, from ISO 8601 text with a time zone.

    Raises:
        ValueError: the text is invalid; the message has the correct form.
    """
    try:
        moment = datetime.fromisoformat(text)  # type: ignore[arg-type] # checked below
        if moment.tzinfo is not None:
            return moment.astimezone(UTC)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ValueError(NO_MOMENT)


class Hours(NamedTuple):
    """Hours of some days of the week.

    `end` at or before `start` is on the next day; midnight to midnight is the whole day.
    """

    days: frozenset[int]  # 0: Monday
    start: time
    end: time


@dataclass(frozen=True, slots=True)
class Period:
    """From `start` to `end` (None: without limit), at the `daily` hours (none: at all hours).

    Raises:
        ValueError: a time has no time zone or one other than UTC, or the end is before the start.
    """

    start: datetime | None = None
    end: datetime | None = None
    daily: tuple[Hours, ...] = ()

    def __post_init__(self) -> None:
        for moment in (self.start, self.end):
            if moment is not None and moment.utcoffset() != timedelta(0):
                raise ValueError(f"{moment} is not in UTC")
        if self.start is not None and self.end is not None and self.end < self.start:
            raise ValueError(f"it ends at {self.end:%F %H:%M}, before it starts")

    def meets(self, start: datetime, end: datetime | None) -> bool:
        """Whether some moment of the period lies from `start` to `end`, both included."""
        first = start if self.start is None else max(start, self.start)
        ends = [moment for moment in (end, self.end) if moment is not None]
        last = min(ends, default=None)
        if last is not None and last < first:
            return False
        if not self.daily:
            return True
        if last is None or last - first >= _WEEK:
            return any(hours.days for hours in self.daily)
        ago = range(
            min((last.date() - first.date()).days + 2, last.toordinal())
        )  # days before last
        return any(
            _meets_on(last.date() - timedelta(days=n), hours, first, last)
            for n in ago
            for hours in self.daily
        )

    def __str__(self) -> str:
        ends = []
        if self.start is not None:
            ends.append(f"from {self.start:%Y-%m-%d %H:%M}")
        if self.end is not None:
            ends.append(f"until {self.end:%Y-%m-%d %H:%M}")
        hours = [_hours_text(hours) for hours in self.daily]
        return ", ".join([" ".join(ends), *hours] if ends else hours) or "always"


@dataclass(frozen=True, slots=True)
class Validity:
    """The periods during which a zone applies; it does when any of them does."""

    periods: tuple[Period, ...]

    def active_between(self, start: datetime, end: datetime | None) -> bool:
        """Whether the zone applies at any moment from `start` to `end` (None: without end).

        Cautious: a period that only touches the time counts.
        """
        return any(period.meets(start, end) for period in self.periods)

    def __str__(self) -> str:
        return "; ".join(map(str, self.periods)) + " UTC"


def _meets_on(day: date, hours: Hours, first: datetime, last: datetime) -> bool:
    if day.weekday() not in hours.days:
        return False
    start = datetime.combine(day, hours.start, UTC)
    end = datetime.combine(day, hours.end, UTC)
    # Hours may end on the next day, which does not exist after 9999-12-31.
    later = timedelta(days=1 if hours.end <= hours.start else 0)
    return start <= last and first - end <= later


def _hours_text(hours: Hours) -> str:
    names = [DAYS[day][:3] for day in sorted(hours.days)]
    days = "daily" if len(names) == len(DAYS) else " ".join(names)
    if hours.start == hours.end == _MIDNIGHT:
        return days
    end = "24:00" if hours.end == _MIDNIGHT else f"{hours.end:%H:%M}"
    return f"{days} {hours.start:%H:%M}-{end}"
