"""The link book keeps the state of every link from its events."""

from __future__ import annotations

import pytest

from mocha_link.header import Header
from mocha_link.metrics import (
    Direction,
    LinkBook,
    LinkState,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)

IN, OUT = Direction.IN, Direction.OUT


def test_states_of_both_directions():
    book = LinkBook(("io",))
    assert book.links()["io"].state is LinkState.IDLE
    book.note(SyncStarted("io", 1, IN))
    book.note(SyncStarted("io", 2, OUT))
    book.note(SyncEnded("io", 3, OUT, 4, 500, 1.0))
    link = book.links()["io"]
    assert (link.state, link.state_in, link.state_out) == (
        LinkState.STARTED,
        LinkState.STARTED,
        LinkState.ENDED,
    )
    assert (link.last_sync_in_s, link.last_sync_out_s) == (None, 3)
    book.note(SyncTimedOut("io", 4, IN, "silence"))
    link = book.links()["io"]
    assert (link.state, link.timeouts, link.syncs_in, link.syncs_out) == (
        LinkState.TIMED_OUT,
        1,
        0,
        1,
    )
    book.note(SyncEnded("io", 5, IN, 0, 0, 1.0))
    link = book.links()["io"]
    assert (link.state, link.last_sync_in_s, link.syncs_in) == (LinkState.ENDED, 5, 1)


def test_counters_and_measures():
    book = LinkBook(("io",))
    book.count("io", bytes_in=5, bytes_out=7, refused=1)
    book.count("io", bytes_in=5)
    book.measure("io", rtt_s=0.1, bandwidth_bytes_s=None)
    book.measure("io", rtt_s=0.9, bandwidth_bytes_s=1000.0)
    book.note(RssiChanged("io", 1, -60.0))
    link = book.links()["io"]
    assert (link.bytes_in, link.bytes_out, link.refused) == (10, 7, 1)
    assert (link.rtt_s, link.bandwidth_bytes_s, link.rssi_dbm) == (0.9, 1000.0, -60.0)
    assert link.rtt_smoothed_s == pytest.approx(0.2)


def test_own_messages_belong_to_no_link():
    book = LinkBook(("io",))
    before = book.links()
    book.note(MessageStored("titan", 1, "titan", "/map", Header(0, 0, 1, 0), 3))
    assert book.links() == before
