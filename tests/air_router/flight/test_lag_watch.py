"""The event loop's own lag: what of it is reported, and how often."""

import pytest

from air_router.controller.model.events import CompanionLagged
from air_router.flight.lag_watch import LagWatch
from air_router.flight.limits import (
    LAG_CHECK_S,
    LAG_REPEATED_S,
    LAG_STARVED_S,
    LAG_STARVED_WITHIN_S,
)


def reported(watch, late_s, *, turns, from_s=0.0):
    """What is reported of so many turns that come so late."""
    found = []
    for turn in range(1, turns + 1):
        lagged = watch.take(late_s, from_s + turn * (LAG_CHECK_S + late_s))
        found += [lagged] if lagged is not None else []
    return found


def test_an_idle_program_reports_nothing():
    assert reported(LagWatch(), 0.002, turns=10_000) == []


def test_a_standstill_is_reported_at_once_and_not_again_for_a_while():
    watch = LagWatch()
    assert [watch.take(0.7, 10.0), watch.take(0.7, 12.0)] == [CompanionLagged(0.7), None]
    assert watch.take(0.7, 10.0 + LAG_REPEATED_S) == CompanionLagged(0.7)


def test_a_long_standstill_is_reported_each_time():
    watch = LagWatch()
    assert [watch.take(s, 10.0 + n).lag_s for n, s in enumerate((2.0, 15.0, 60.0))] == [2, 15, 60]


@pytest.mark.parametrize(("late_s", "starved"), [(0.02, False), (0.2, True)])
def test_starvation_is_reported_now_and_then(late_s, starved):
    found = reported(LagWatch(), late_s, turns=400)
    lasts_s = 400 * (LAG_CHECK_S + late_s)
    assert len(found) == (pytest.approx(lasts_s / LAG_REPEATED_S, abs=1.0) if starved else 0)
    assert all(LAG_STARVED_S <= lagged.lag_s <= LAG_STARVED_WITHIN_S for lagged in found)
    assert all(lagged.within_s == LAG_STARVED_WITHIN_S for lagged in found)  # none is one stall
