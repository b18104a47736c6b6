"""What a peer may do to a connection of ours that is none of what a node does."""

from __future__ import annotations

import contextlib

from mocha_link.node.connection import TcpConnection
from tests.mocha_link.node.test_connection import GREETING, READY, Peer, turn_until

PINGS = (b"\4\x07\4PING\0\0" + b"") * 20_000


def test_answers_that_a_peer_does_not_read_do_not_fill_the_memory():
    """It asks for heartbeats as fast as it can, and never reads one."""
    with (
        contextlib.closing(Peer()) as peer,
        contextlib.closing(TcpConnection("127.0.0.1", peer.port)) as line,
    ):
        line.turn(100.0)
        connection = peer.accept()
        connection.sendall(GREETING + READY)
        connection.setblocking(False)
        unsent = memoryview(PINGS * 400)  # 72 MB

        def done() -> bool:
            nonlocal unsent
            with contextlib.suppress(BlockingIOError, ConnectionResetError):
                unsent = unsent[connection.send(unsent[: 1 << 20]) :]
            assert len(line._out) < 16_000_000
            return line.failure is not None

        turn_until(line, done, 100.0)
        assert line.failure == "the peer does not read the answers that it asks for"
