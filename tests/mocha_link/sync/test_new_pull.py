"""A new pull begins where one has just broken off: nothing of the old one gets in its way."""

import contextlib
import os
import socket
import threading
from unittest import mock

import pytest
import zmq

from mocha_link.clock import Instant
from mocha_link.links.metrics import SyncTimedOut
from mocha_link.node.connection import Connection
from mocha_link.node.connector import Connector
from mocha_link.node.gossip import Gossip
from mocha_link.node.transport import Transport
from mocha_link.sync.protocol import Connect, Disconnect
from tests.mocha_link.node.test_connection import (
    GREETING,
    HELLO_BYTES,
    IO,
    READY,
    TITAN,
    Hall,
    Peer,
    greeted_by,
    turn_until,
)

WAIT_S = 60
SMALL = 4096


@pytest.fixture
def context():
    context = zmq.Context()
    yield context
    context.destroy(0)


def sleeping_peer(peer: Peer, line: Connection) -> socket.socket:
    """The peer reads nothing, and a lot is under way to it."""
    line.turn(100.0)
    connection = peer.accept()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL)
    connection.sendall(GREETING + READY)
    turn_until(line, greeted_by(line), 100.0)
    line.send(os.urandom(20_000_000))
    assert line._out
    return connection


def rest(connection: socket.socket) -> bytes:
    """All that comes until the connection is closed."""
    got = bytearray()
    while piece := connection.recv(1 << 20):
        got += piece
    return bytes(got)


def test_what_was_sent_and_is_not_out_does_not_come_late():
    with contextlib.closing(Peer()) as peer:
        line = Connection("127.0.0.1", peer.port)
        connection = sleeping_peer(peer, line)
        line.abort()
        with pytest.raises(ConnectionResetError):
            rest(connection)


def test_an_end_still_gets_out():
    with contextlib.closing(Peer()) as peer:
        line = Connection("127.0.0.1", peer.port)
        line.turn(100.0)
        connection = peer.accept()
        connection.sendall(GREETING + READY)
        turn_until(line, greeted_by(line), 100.0)
        line.send(b"the end")
        line.close()
        assert rest(connection)[HELLO_BYTES:] == b"\1\0\0\7the end"


def test_with_keys_it_is_reset_too(context):
    """Seen by a relay in the middle."""
    with contextlib.closing(Hall(context)) as hall, socket.create_server(("127.0.0.1", 0)) as relay:
        line = Connection("127.0.0.1", relay.getsockname()[1], keys=(IO, TITAN.public))
        near, _ = relay.accept()
        with near, socket.create_connection((hall.host, hall.port)) as far:
            resets: list[socket.socket] = []
            pumps = [
                threading.Thread(target=pump, args=(*pair, resets))
                for pair in ((near, far), (far, near))
            ]
            for each in pumps:
                each.start()
            line.send(b"one")
            served: list[object] = []

            def done() -> bool:
                hall.serve()
                served.extend(line.replies())
                return bool(served)

            turn_until(line, done)
            line.abort()
            for each in pumps:
                each.join(WAIT_S)
            assert near in resets


def pump(source: socket.socket, target: socket.socket, resets: list[socket.socket]) -> None:
    try:
        while data := source.recv(65536):
            target.sendall(data)
    except ConnectionResetError:
        resets.append(source)
    except OSError:
        pass
    with contextlib.suppress(OSError):
        target.shutdown(socket.SHUT_RDWR)


def test_what_came_on_the_old_connection_is_not_for_the_new_pull(team, monkeypatch):
    """The radio's thread has begun a pull, the transport's thread has not done it yet."""
    time_s = [0.0]

    def now() -> Instant:
        return Instant(1_795_175_900.0 + time_s[0], time_s[0])

    gossip = Gossip(team, "titan", by_timer=False, datagrams=False)
    events: list[object] = []
    lock = threading.Lock()
    transport = Transport(gossip, team, lock=lock, now=now, deliver=events.append)
    lines: list[mock.Mock] = []  # on which something of the pull before comes in

    def new_connection(*_: object) -> mock.Mock:
        line = mock.Mock(failure="the peer closed the connection", send_before_ready=True)
        line.rtt_s.return_value = None
        line.replies = lambda: [[line.send.call_args.args[0][:6] + b"SERRM"]]
        lines.append(line)
        return line

    monkeypatch.setattr(Connector, "connect", new_connection)
    gossip.signal_received("io", -50.0, now())
    transport._act()
    time_s[0] = 3.0  # nothing came for long
    gossip.signal_received("io", None, now())
    gossip.signal_received("io", -50.0, now())
    transport._attend(lines[0], "io", now())
    assert [e.reason for e in events if isinstance(e, SyncTimedOut)] == [
        "stalled, and a new contact began"
    ]
    lines[0].abort.assert_called_once_with()
    assert gossip.sync("io", now()) is False  # it is under way
    transport.close()


def test_the_connection_of_a_pull_that_broke_off_is_void(team):
    gossip = Gossip(team, "titan", by_timer=False, datagrams=False)
    gossip.sync("io", Instant(1_795_175_900.0, 0.0))
    gossip.tick(Instant(1_795_175_906.0, 6.0))
    actions, _ = gossip.take()
    assert actions[0] == Connect("io")
    assert actions[-1] == Disconnect("io", void=True)
