"""What comes late, twice, or from an older pull does not disturb the answering side."""

from __future__ import annotations

import pytest

from mocha_link.links.metrics import SyncEnded, SyncStarted
from mocha_link.sync.frames import END, message_frames
from mocha_link.sync.sync_messages import Reception
from tests.mocha_link.sync.test_server import (
    OTHER,
    ROUTE,
    Asker,
    all_of,
    at,
    database,
    reception,
    server,
    told_by,
)

__all__ = ["database", "server"]  # fixtures


def test_a_peer_that_is_gone_after_its_end_is_not_called_for_ever(server):
    """Its END was lost with the acknowledgement in it; what is repeated is the END alone."""
    io = Asker(server)
    lost: list[bytes] = []
    io.pass_on = lambda now: lost.extend(io.flow.transmit(now.steady_s))
    io.cast(at(0))
    for packet in lost:
        assert server.packet(packet, at(0))
    end_s = io.run(0, 0.05) + 1
    for packet in io.flow.transmit(at(end_s).steady_s):
        server.packet(packet, at(end_s))
    assert [type(event) for event in told_by(server)] == [SyncStarted, SyncEnded]
    for tenth in range(1, 100):
        server.transmit(at(end_s + tenth / 10))
        server.tick(at(end_s + tenth / 10))
    assert server.transmit(at(end_s + 30)) == []
    assert server.wake_s is None


def test_what_was_lost_with_a_connection_is_said_again_on_the_next(server, database):
    """The peer's first connection broke when we had sent something on it."""
    io = Asker(server)
    io.open(route=ROUTE)
    assert io.drain()
    io.open(route=OTHER)
    io.read()
    assert io.got == all_of(database)
    assert io.receiver.complete


@pytest.mark.parametrize("by_datagram", [False, True])
def test_only_an_opening_begins_a_sync(server, by_datagram):
    """An END of a pull that no node remembers."""
    io = Asker(server)
    (io.opening,) = message_frames(END, 0, b"", 1100)
    if by_datagram:
        (packet,) = io.openings(at(0))
        assert not server.packet(packet, at(0))
    else:
        assert reception(io.open()) is Reception.UNREADABLE
    assert told_by(server) == []
