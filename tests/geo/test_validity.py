"""When zones apply: periods, days of the week, nights, and the cautious answer."""

from datetime import UTC, datetime, time, timedelta, timezone

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from geo.validity import Hours, Period, Validity

EVERY_DAY = frozenset(range(7))
FRIDAY = datetime(2026, 11, 20, tzinfo=UTC)


def at(hour, minute=0, *, days=0):
    return FRIDAY + timedelta(days=days, hours=hour, minutes=minute)


def weekly(days, start, end):
    return Period(daily=(Hours(frozenset(days), time(*start), time(*end)),))


def test_a_period_counts_from_its_first_to_its_last_moment():
    validity = Validity((Period(at(8), at(18)),))
    assert validity.active_between(at(7), at(8))
    assert validity.active_between(at(18), at(19))
    assert validity.active_between(at(9), at(10))
    assert validity.active_between(at(0), at(23))
    assert validity.active_between(at(7), None)
    assert not validity.active_between(at(6), at(7, 59))
    assert not validity.active_between(at(18, 1), None)


def test_open_ends():
    assert Validity((Period(end=at(8)),)).active_between(at(-9999), at(-9998))
    assert not Validity((Period(end=at(8)),)).active_between(at(9), None)
    assert Validity((Period(start=at(8)),)).active_between(at(9999), None)
    assert Validity((Period(),)).active_between(at(1), at(1))
    assert not Validity(()).active_between(at(1), None)
    office = weekly((0, 1, 2, 3, 4), (8, 0), (17, 0))
    assert office.meets(at(18), None)
    assert office.meets(at(18), at(18, days=30))


def test_hours_count_within_the_period_only():
    summer = Period(at(12), at(20), (Hours(EVERY_DAY, time(8), time(11)),))
    assert not summer.meets(at(0), None)
    spring = Period(at(10), at(20), (Hours(EVERY_DAY, time(8), time(11)),))
    assert spring.meets(at(0), None)
    assert not spring.meets(at(11, 1), None)


def test_times_are_utc_and_in_order():
    with pytest.raises(ValueError, match="before it starts"):
        Period(at(9), at(8))
    with pytest.raises(ValueError, match="not in UTC"):
        Period(FRIDAY.replace(tzinfo=None))
    with pytest.raises(ValueError, match="not in UTC"):
        Period(None, FRIDAY.astimezone(timezone(timedelta(hours=1))))


def test_in_words():
    assert str(Validity((Period(),))) == "always UTC"
    assert str(Period(at(8), None)) == "from 2026-11-20 08:00"
    period = Period(None, at(8), (Hours(frozenset({6, 5}), time(8), time(17, 30)),))
    assert str(period) == "until 2026-11-20 08:00, sat sun 08:00-17:30"
    assert str(weekly(range(7), (0, 0), (0, 0))) == "daily"
    assert str(weekly(range(7), (8, 0), (0, 0))) == "daily 08:00-24:00"


minutes = st.integers(0, 14 * 24 * 60).map(lambda m: FRIDAY + timedelta(minutes=m))
hours = st.builds(
    Hours,
    st.frozensets(st.integers(0, 6), max_size=3),
    st.times(timezones=st.none()).map(lambda t: t.replace(second=0, microsecond=0)),
    st.times(timezones=st.none()).map(lambda t: t.replace(second=0, microsecond=0)),
)


def hourly(daily, moment):
    """Whether a moment lies in the hours of its day or of the day before: by definition."""
    for back in (0, 1):
        day = (moment - timedelta(days=back)).replace(hour=0, minute=0)
        for days, start, end in daily:
            begin = day + timedelta(hours=start.hour, minutes=start.minute)
            close = day + timedelta(hours=end.hour, minutes=end.minute)
            close += timedelta(days=1) if end <= start else timedelta(0)
            if day.weekday() in days and begin <= moment <= close:
                return True
    return False


@example([Hours(frozenset({4}), time(0), time(0))], FRIDAY, 0)  # midnight to midnight
@example([Hours(frozenset({4}), time(0), time(0))], FRIDAY + timedelta(days=1, minutes=1), 700)
@example([Hours(frozenset({4}), time(22), time(4))], FRIDAY + timedelta(hours=3), 30)
@example([Hours(frozenset({4}), time(22), time(4))], FRIDAY + timedelta(hours=27), 30)
@given(st.lists(hours, min_size=1, max_size=2), minutes, st.integers(0, 3000))
def test_no_moment_of_the_hours_is_missed(daily, start, length):
    period = Period(daily=tuple(daily))
    end = start + timedelta(minutes=length)
    moments = (start + timedelta(minutes=m) for m in range(length + 1))
    assert period.meets(start, end) == any(hourly(daily, moment) for moment in moments)


def test_nights_until_the_last_day_that_there_is():
    nights = (Hours(EVERY_DAY, time(22), time(4)),)
    last = datetime(9999, 12, 31, 21, tzinfo=UTC)
    assert Period(last - timedelta(hours=18), last, nights).meets(FRIDAY, None)
    assert not Period(last - timedelta(hours=16), last, nights).meets(FRIDAY, None)


def test_nights_from_the_first_day_that_there_is():
    nights = Period(daily=(Hours(EVERY_DAY, time(22), time(4)),))
    first = datetime(1, 1, 1, tzinfo=UTC)
    assert nights.meets(first, first + timedelta(hours=22))
    assert not nights.meets(first + timedelta(hours=5), first + timedelta(hours=21))
