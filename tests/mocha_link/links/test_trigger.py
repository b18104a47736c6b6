"""Contacts: thresholds by unit, hysteresis, interval, silence, clocks that jump."""

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.links.metrics import ContactBegan, ContactEnded, RssiChanged
from mocha_link.links.reading import Reading, Unit
from mocha_link.links.trigger import MAX_SOURCES, SyncTrigger
from mocha_link.team.team import Trigger

SETTINGS = Trigger(
    rssi_threshold_dbm=-75,
    snr_threshold_db=10,
    device_threshold=20,
    hysteresis_db=3,
    interval_s=2,
)
THRESHOLDS = {Unit.DBM: -75, Unit.SNR_DB: 10, Unit.DEVICE: 20}


def trigger(*, by_timer: bool = False) -> SyncTrigger:
    return SyncTrigger(("io", "europa"), SETTINGS, by_timer=by_timer)


def contacts(it: SyncTrigger) -> list[type]:
    """What began and ended since the last call."""
    return [type(event) for event in it.take_events() if not isinstance(event, RssiChanged)]


def test_a_sync_at_once_then_every_interval():
    it = trigger()
    assert it.signal_received("io", -75, 10)
    assert it.due(10) == ["io"]
    assert it.due(11.9) == []
    assert not it.signal_received("io", -60, 11.9)
    assert it.due(12) == ["io"]
    assert it.due(12) == []


def test_a_silent_radio_receives_no_peer():
    it = trigger()
    it.signal_received("io", -70, 0)
    it.expire_signals(6)
    assert it.reading("io")
    it.expire_signals(6.1)
    assert it.reading("io") is None
    it.expire_signals(20)
    assert it.due(20) == []
    assert [event for event in it.take_events() if isinstance(event, RssiChanged)] == [
        RssiChanged("io", 0, -70, Reading(-70, Unit.DBM, "radio")),
        RssiChanged("io", 6.1, None),
    ]


def test_a_crowd_that_pushes_is_pulled_from_less_often():
    """Who does not push is pulled from every interval all the same."""
    crowd = [f"rover{number}" for number in range(30)]
    it = SyncTrigger(["io", *crowd], SETTINGS, by_timer=True)
    it.follow(crowd)
    assert len(it.due(0)) == 31
    assert it.due(2) == ["io"]
    assert it.due(5.9) == ["io"]
    assert it.due(6) == crowd
    it.follow(crowd[:10])
    assert it.due(8) == ["io", *crowd[10:]]  # who does not push any more


def pulls(it: SyncTrigger, seconds: int) -> list[int]:
    return [at_s for at_s in range(seconds) if it.due(at_s)]


def test_a_peer_that_pushes_is_pulled_from_ever_less_often():
    it = trigger(by_timer=True)
    it.follow(["io", "europa"])
    assert pulls(it, 60) == [0, 2, 6, 14, 29, 44, 59]
    it.follow([])
    assert it.due(61) == ["io", "europa"]
    it.follow(["io", "europa"])
    assert it.due(63) == ["io", "europa"]


def test_a_peer_that_pulls_after_a_while_is_pulled_from_in_return():
    """It may be new, or back; two that pull from each other in return would never rest."""
    it = trigger(by_timer=True)
    it.follow(["io", "europa"])
    pulls(it, 20)
    it.peer_pulled("io", 15.9)  # soon after it was pulled from
    assert it.due(15.9) == []
    it.peer_pulled("io", 15.9, restarted=True)
    assert it.due(15.9) == ["io"]
    it.peer_pulled("io", 20)
    assert it.due_s == -inf
    assert it.due(20) == ["io"]
    assert it.due(34) == ["europa"]
    assert it.due(40) == ["io"]


def test_it_reports_when_something_is_due():
    it = trigger()
    assert it.due_s == inf
    it.signal_received("io", -75, 10)
    assert it.due_s == -inf
    it.due(10)
    assert it.due_s == 12
    it.signal_received("io", -80, 13)
    assert it.due_s == 19
    it.expire_signals(19.1)
    assert it.due_s == inf


def test_a_clock_set_back_stops_nothing():
    it = trigger()
    it.signal_received("io", -70, 1000)
    assert it.due(1000) == ["io"]
    it.expire_signals(10)
    assert it.due(10) == ["io"]
    it.expire_signals(16)
    assert it.reading("io")
    it.expire_signals(16.1)
    assert it.reading("io") is None


@pytest.mark.parametrize("unit", list(Unit))
def test_each_unit_has_its_threshold(unit):
    it, threshold = trigger(), THRESHOLDS[unit]
    assert not it.signal_received("io", Reading(threshold - 0.1, unit, "x"), 0)
    assert it.signal_received("io", Reading(threshold, unit, "x"), 1)
    assert not it.signal_received("io", Reading(threshold - 3, unit, "x"), 2)
    assert contacts(it) == [ContactBegan]
    it.signal_received("io", Reading(threshold - 3.1, unit, "x"), 3)
    assert it.reading("io") == Reading(threshold - 3.1, unit, "x")
    changed, ended = it.take_events()
    assert changed.rssi_dbm == (pytest.approx(-78.1) if unit is Unit.DBM else None)
    assert isinstance(ended, ContactEnded)


def test_sources_are_not_compared():
    it = trigger()
    assert it.signal_received("io", Reading(40, Unit.DEVICE, "rajant"), 0)
    assert not it.signal_received(
        "io", Reading(-90, Unit.DBM, "wifi"), 0
    )  # is no reading of the other one
    assert contacts(it) == [ContactBegan]
    assert not it.signal_received("io", Reading(-77, Unit.DBM, "wifi"), 1)  # had no contact to hold
    it.signal_received("io", Reading(10, Unit.DEVICE, "rajant"), 1)
    assert contacts(it) == [ContactEnded]
    assert not it.signal_received("io", Reading(-74, Unit.SNR_DB, "wifi"), 2)
    assert it.signal_received("io", Reading(-74, Unit.DBM, "wifi"), 2)


def test_a_source_that_falls_silent_leaves_the_others():
    it = trigger()
    it.signal_received("io", Reading(40, Unit.DEVICE, "rajant"), 0)
    it.signal_received("io", Reading(-70, Unit.DBM, "wifi"), 4)
    it.expire_signals(7)
    assert contacts(it) == [ContactBegan]
    assert it.reading("io") == Reading(-70, Unit.DBM, "wifi")
    it.expire_signals(10.1)
    assert it.reading("io") is None
    assert contacts(it) == [ContactEnded]


def test_the_sources_of_a_peer_are_bounded():
    it = trigger()
    for number in range(100):
        it.signal_received("io", Reading(-70, Unit.DBM, f"x{number}"), number / 100)
    assert len(it._links["io"].signals) == MAX_SOURCES


def test_contacts_are_events():
    it = trigger()
    strong, weak = Reading(-70, Unit.DBM, "radio"), -90
    it.signal_received("io", weak, 0)
    it.signal_received("io", -70, 1)
    it.signal_received("io", weak, 3)
    it.signal_received("io", -70, 4)
    it.signal_received("io", None, 5)
    it.signal_received("io", -70, 6)
    it.expire_signals(20)
    assert [event for event in it.take_events() if not isinstance(event, RssiChanged)] == [
        ContactBegan("io", 1, strong),
        ContactEnded("io", 3, 2, "too weak"),
        ContactBegan("io", 4, strong),
        ContactEnded("io", 5, 1, "no signal"),
        ContactBegan("io", 6, strong),
        ContactEnded("io", 20, 14, "the radio is silent"),
    ]
    assert it.take_events() == []


@given(
    st.lists(
        st.tuples(
            st.none()
            | st.builds(
                Reading,
                st.floats(-100, 100),
                st.sampled_from(list(Unit)),
                st.sampled_from(["a", "b"]),
            ),
            st.floats(0, 8),
        ),
        max_size=30,
    )
)
def test_contacts_begin_and_end_in_turn(reports):
    it, now_s, expected = trigger(), 0.0, ContactBegan
    for reading, later_s in reports:
        now_s += later_s
        it.expire_signals(now_s)
        began = it.signal_received("io", reading, now_s)
        events = it.take_events()
        for event in events:
            if isinstance(event, RssiChanged):
                continue
            assert type(event) is expected
            expected = ContactEnded if expected is ContactBegan else ContactBegan
        assert began == (bool(events) and type(events[-1]) is ContactBegan)
        assert it.reading("io") == reading
