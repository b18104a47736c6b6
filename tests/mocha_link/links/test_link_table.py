"""The link table keeps the state of every link from its events."""

import pytest

from mocha_link.clock import Instant
from mocha_link.links import link_table as links_table
from mocha_link.links.link_table import LinkTable, throughput_bytes_s
from mocha_link.links.metrics import (
    Contact,
    ContactBegan,
    ContactEnded,
    Direction,
    LinkState,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.links.reading import Reading, Unit
from mocha_link.store.wire import Header

IN, OUT = Direction.IN, Direction.OUT


@pytest.mark.parametrize(
    ("size", "taken_s", "rtt_s", "rate"),
    [
        (16_384, 1.0, 0.1, 16_384.0),
        (16_383, 1.0, 0.1, None),
        (141, 0.0003, 0.0002, None),
        (50_000, 0.2, 0.1, 250_000.0),
        (50_000, 0.19, 0.1, None),
        (50_000, 0.5, None, 100_000.0),
        (50_000, 0.0, None, None),
        (50_000, -0.1, 0.1, None),
    ],
)
def test_what_measures_the_link(size, taken_s, rtt_s, rate):
    assert throughput_bytes_s(size, taken_s, rtt_s) == rate


def test_the_bandwidth_of_what_the_peer_pulls():
    """A round trip passes before its first message and after the last."""
    link_table = LinkTable(("io",))
    link_table.measure("io", rtt_s=0.5)
    link_table.update(SyncEnded("io", 3, OUT, 4, 500, 1.0))
    assert link_table.links()["io"].bandwidth_bytes_s is None
    link_table.update(SyncEnded("io", 3, OUT, 4, 200_000, 2.5))
    assert link_table.links()["io"].bandwidth_bytes_s == 100_000
    link_table.update(SyncEnded("io", 4, OUT, 1, 500, 1.0))  # measures nothing new
    assert link_table.links()["io"].bandwidth_bytes_s == 100_000


def test_states_of_both_directions():
    link_table = LinkTable(("io",))
    assert link_table.links()["io"].state is LinkState.IDLE
    link_table.update(SyncStarted("io", 1, IN))
    link_table.update(SyncStarted("io", 2, OUT))
    link_table.update(SyncEnded("io", 3, OUT, 4, 500, 1.0))
    link = link_table.links()["io"]
    assert (link.state, link.state_in, link.state_out) == (
        LinkState.STARTED,
        LinkState.STARTED,
        LinkState.ENDED,
    )
    assert (link.last_sync_in_s, link.last_sync_out_s) == (None, 3)
    link_table.update(SyncTimedOut("io", 4, IN, "silence"))
    link = link_table.links()["io"]
    assert (link.state, link.timeouts, link.syncs_in, link.syncs_out) == (
        LinkState.TIMED_OUT,
        1,
        0,
        1,
    )
    link_table.update(SyncEnded("io", 5, IN, 0, 0, 1.0))
    link = link_table.links()["io"]
    assert (link.state, link.last_sync_in_s, link.syncs_in) == (LinkState.ENDED, 5, 1)


def test_counters_and_measures():
    link_table = LinkTable(("io",))
    link_table.count("io", bytes_in=5, bytes_out=7)
    link_table.refuse("io", "no header")
    link_table.count("io", bytes_in=5)
    link_table.measure("io", rtt_s=0.1, bandwidth_bytes_s=None)
    link_table.measure("io", rtt_s=0.9, bandwidth_bytes_s=1000.0)
    link_table.update(RssiChanged("io", 1, -60.0))
    link = link_table.links()["io"]
    assert (link.bytes_in, link.bytes_out, link.refused) == (10, 7, 1)
    assert (link.rtt_s, link.bandwidth_bytes_s, link.rssi_dbm) == (0.9, 1000.0, -60.0)
    assert link.rtt_smoothed_s == pytest.approx(0.2)


def test_many_refusals_are_counted_without_a_copy_of_all_metrics(monkeypatch):
    """A peer can have thousands of headers refused with one reply; meanwhile the node stands."""
    link_table = LinkTable(("io",))
    monkeypatch.delattr(links_table, "replace")
    for number in range(1_000):
        link_table.refuse("io", f"header {number}")
    monkeypatch.undo()
    assert link_table.links()["io"].refused == 1_000


def test_the_signal_keeps_its_unit_and_source():
    link_table = LinkTable(("io",))
    snr = Reading(14.0, Unit.SNR_DB, "silvus")
    link_table.update(RssiChanged("io", 1, None, snr))
    link = link_table.links()["io"]
    assert (link.signal, link.rssi_dbm) == (snr, None)
    link_table.update(RssiChanged("io", 2, -60.0))
    link = link_table.links()["io"]
    assert (link.signal, link.rssi_dbm) == (Reading(-60.0, Unit.DBM, "radio"), -60.0)
    link_table.update(RssiChanged("io", 3, None))
    assert link_table.links()["io"].signal is None


def test_ages_by_topic():
    link_table = LinkTable(("io", "titan"))
    links = link_table.links(5.0, {"io": {"/pose": 3.0, "/path": 1.5}, "mars": {"/x": 1.0}})
    assert links["io"].topic_ages_s == {"/pose": 3.0, "/path": 1.5}
    assert links["io"].newest_age_s == 1.5
    assert links["titan"].topic_ages_s == {}
    assert links["titan"].newest_age_s is None
    assert hash(links["io"]) != hash(links["titan"])


def stored(at_s):
    return MessageStored("io", at_s, "io", "/pose", Header(0, 0, 1, 0), 3)


def test_a_contact_of_the_radio():
    link_table = LinkTable(("io",))
    link_table.update(ContactBegan("io", 10, None))
    assert link_table.links()["io"].contacts == (Contact(10, None, 0, 0, 0, 0, ""),)
    link_table.update(SyncStarted("io", 10, IN))
    link_table.count("io", bytes_in=500)
    link_table.update(stored(11))
    link_table.update(SyncEnded("io", 11, IN, 1, 500, 1.0))
    link_table.update(SyncStarted("io", 12, OUT))
    link_table.count("io", bytes_out=70)
    link_table.update(SyncEnded("io", 12.5, OUT, 2, 70, 0.5))
    link_table.update(SyncTimedOut("io", 13, OUT, "silence"))  # the radio reports when it is over
    assert link_table.links(500.0)["io"].contacts == (Contact(10, None, 1, 2, 500, 70, ""),)
    link_table.update(ContactEnded("io", 14, 4, "too weak"))
    link = link_table.links()["io"]
    assert link.contacts == (Contact(10, 14, 1, 2, 500, 70, "too weak"),)
    assert link.contacts_begun == 1


def test_a_contact_without_a_radio():
    link_table = LinkTable(("io",))
    for number in range(3):  # tries that bring nothing are none
        link_table.update(SyncStarted("io", number, IN))
        assert link_table.links()["io"].contacts == ()
        link_table.update(SyncTimedOut("io", number + 0.5, IN, "silence"))
    assert link_table.links()["io"].contacts_begun == 0
    for number in (10, 12):
        link_table.update(SyncStarted("io", number, IN))
        link_table.count("io", bytes_in=6)
        link_table.update(SyncEnded("io", number + 0.5, IN, 0, 6, 0.5))
    link_table.update(SyncStarted("io", 14, IN))
    link_table.count("io", bytes_in=3)
    link_table.update(SyncTimedOut("io", 19, IN, "silence"))
    assert link_table.links()["io"].contacts == (Contact(10, 19, 0, 0, 15, 0, "timed out"),)


def test_a_contact_that_becomes_quiet():
    link_table = LinkTable(("io",), quiet_s=10.0)
    link_table.update(SyncStarted("io", 10, OUT))
    link_table.count("io", bytes_out=6)
    link_table.update(SyncEnded("io", 11, OUT, 0, 6, 1.0))
    assert link_table.links(20.9)["io"].contacts == (Contact(10, None, 0, 0, 0, 6, ""),)
    link_table.count("io", bytes_out=5)
    link_table.update(SyncStarted("io", 30, OUT))
    assert link_table.links(60)["io"].contacts == (
        Contact(10, 11, 0, 0, 0, 11, "quiet"),
    )  # the second has brought nothing so far, and lasts as long as its sync
    link_table.count("io", bytes_out=1)
    link_table.update(SyncEnded("io", 60, OUT, 0, 6, 1.0))
    assert link_table.links(61)["io"].contacts[1:] == (Contact(30, None, 0, 0, 0, 1, ""),)
    assert link_table.links(61)["io"].contacts_begun == 2


def test_what_is_pushed_keeps_a_contact():
    """Of many peers each is pulled from rarely."""
    link_table = LinkTable(("io",), quiet_s=10.0)
    link_table.update(SyncStarted("io", 10, IN))
    link_table.update(SyncEnded("io", 10, IN, 0, 6, 1.0))
    for at_s in range(11, 60):
        link_table.update(stored(at_s))
        (contact,) = link_table.links(at_s + 0.5)["io"].contacts
        assert (contact.began_s, contact.ended_s) == (10, None)


@pytest.mark.parametrize("step_s", [3600, -3600])
def test_a_contact_lasts_as_long_however_the_clock_is_set(step_s):
    link_table = LinkTable(("io", "titan"), quiet_s=10.0)
    link_table.keep_clock(Instant(5000, 7, may_step=True))
    link_table.update(SyncStarted("io", 5000, IN))
    link_table.update(stored(5000))
    link_table.update(SyncEnded("io", 5001, IN, 1, 6, 1.0))
    link_table.keep_clock(Instant(5002 + step_s, 9, may_step=True))
    began_s, lasting = 5000 + step_s, (1, 0, 0, 0, "")
    assert link_table.links(began_s + 9)["io"].contacts == (Contact(began_s, None, *lasting),)
    link_table.links(began_s + 12)
    (contact,) = link_table.links()["io"].contacts
    assert (contact.began_s, contact.ended_s, contact.ending) == (began_s, began_s + 1, "quiet")


def test_no_contact_ends_before_it_began():
    """The clock was set back while it lasted."""
    link_table = LinkTable(("io",))
    link_table.update(ContactBegan("io", 1000, None))
    link_table.update(ContactEnded("io", 500, 0.0, "too weak"))
    assert link_table.links()["io"].contacts == (Contact(500, 500, 0, 0, 0, 0, "too weak"),)
