"""When zones apply, by the judge's own reading of `active` in docs/mission-file.md: UTC."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any, Final

_DAYS: Final = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
_STEP: Final = timedelta(seconds=20)
"""The interval of checks of a period: hours are written in minutes."""


def meets(period: Mapping[str, Any], begin_s: float, end_s: float) -> bool:
    """Whether a period applies at some moment between two of Unix time."""
    at, end = (datetime.fromtimestamp(moment_s, UTC) for moment_s in (begin_s, end_s))
    while at <= end:
        if _applies(period, at):
            return True
        at += _STEP
    return False


def _applies(period: Mapping[str, Any], at: datetime) -> bool:
    if "from" in period and at < _moment(period["from"]):
        return False
    if "until" in period and at > _moment(period["until"]):
        return False
    days = {str(day).lower()[:3] for day in period.get("days") or _DAYS}
    if "between" not in period:
        return _DAYS[at.weekday()] in days
    first, last = (_minutes(text) for text in period["between"])
    now = at.hour * 60 + at.minute + at.second / 60
    today, yesterday = (_DAYS[(at.weekday() - ago) % 7] in days for ago in (0, 1))
    if first < last:
        return today and first <= now <= last
    # Over midnight: the part of today is of a day that is named, the rest of one before.
    return (today and now >= first) or (yesterday and now <= last)


def _moment(value: Any) -> datetime:
    moment = value if isinstance(value, datetime) else datetime.fromisoformat(str(value))
    return moment.astimezone(UTC) if moment.tzinfo else moment.replace(tzinfo=UTC)


def _minutes(text: str) -> int:
    hours, minutes = map(int, str(text).split(":"))
    return hours * 60 + minutes
