"""Contacts: threshold, hysteresis, interval, silence, clocks that jump."""

from __future__ import annotations

from mocha_link.team import Trigger
from mocha_link.trigger import SyncTrigger

SETTINGS = Trigger(rssi_threshold_dbm=-75, hysteresis_db=3, interval_s=2)


def trigger(*, by_timer: bool = False) -> SyncTrigger:
    return SyncTrigger(("io", "europa"), SETTINGS, by_timer=by_timer)


def test_nothing_is_due_without_a_contact():
    it = trigger()
    assert it.due(0) == []
    assert not it.heard("io", -75.1, 1)
    assert it.due(1) == []


def test_a_sync_at_once_then_every_interval():
    it = trigger()
    assert it.heard("io", -75, 10)
    assert it.due(10) == ["io"]
    assert it.due(11.9) == []
    assert not it.heard("io", -60, 11.9)
    assert it.due(12) == ["io"]
    assert it.due(12) == []


def test_hysteresis_holds_the_contact():
    it = trigger()
    it.heard("io", -70, 0)
    it.due(0)
    assert not it.heard("io", -78, 1)  # still in contact: threshold - hysteresis
    assert it.due(2) == ["io"]
    assert not it.heard("io", -78.1, 3)
    assert it.due(4) == []
    assert not it.heard("io", -77, 4)
    assert it.due(4) == []
    assert it.heard("io", -74, 4.5)
    assert it.due(4.5) == ["io"]


def test_a_new_contact_does_not_wait_for_the_interval():
    it = trigger()
    it.heard("io", -70, 0)
    assert it.due(0) == ["io"]
    it.heard("io", None, 0.5)
    it.heard("io", -70, 0.6)
    assert it.due(0.6) == ["io"]


def test_a_silent_radio_hears_nobody():
    it = trigger()
    it.heard("io", -70, 0)
    assert it.silenced(6) == []
    assert it.silenced(6.1) == ["io"]
    assert it.rssi_dbm("io") is None
    assert it.silenced(20) == []
    assert it.due(20) == []


def test_the_timer_needs_no_radio():
    it = trigger(by_timer=True)
    assert it.due(5) == ["io", "europa"]
    assert it.due(6) == []
    assert it.due(7) == ["io", "europa"]


def test_a_clock_set_back_stops_nothing():
    it = trigger()
    it.heard("io", -70, 1000)
    assert it.due(1000) == ["io"]
    assert it.silenced(10) == []
    assert it.due(10) == ["io"]
    assert it.silenced(16.1) == ["io"]
