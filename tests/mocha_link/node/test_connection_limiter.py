"""A client that fills the memory of a node at an open port is sent away; no other is."""

from __future__ import annotations

import contextlib
import socket
import struct

import pytest
import zmq

from mocha_link.node import connection_limiter as module
from mocha_link.node.port import MAX_REQUEST_BYTES, Port
from mocha_link.node.zmtp import ZmtpSession
from mocha_link.team.team import Robot
from tests.mocha_link.node.test_port import WAIT_MS, clients, context, port, titan

__all__ = ["clients", "context", "port", "titan"]  # fixtures

PART = struct.pack(">BQ", 0b011, 60_000) + bytes(60_000)  # more parts follow, and a long size


def dial(titan: Robot) -> socket.socket:
    connection = socket.socket()
    # Segments of 64 KB, as on loopback, can wait minutes for a window of that size under load.
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG, 1400)
    connection.settimeout(20)
    connection.connect((titan.listen, titan.port_for("io")))
    connection.sendall(ZmtpSession.hello)
    zmtp = ZmtpSession(1000)
    while not zmtp.ready:
        zmtp.receive(connection.recv(1000))
    return connection


def closed(connection: socket.socket) -> bool:
    """Whether the port has closed it; what it still says is of no interest."""
    connection.setblocking(False)
    try:
        while connection.recv(1 << 16):
            pass
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def test_a_message_whose_parts_never_end(port, titan, monkeypatch):
    """Each is small enough, and libzmq waits for the last one."""
    monkeypatch.setattr(module, "MAX_BYTES", 2_000_000)
    with dial(titan) as attacker:
        sent, rest = 0, memoryview(b"")
        attacker.settimeout(0.01)
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            while sent < 20 * module.MAX_BYTES:
                rest = rest or memoryview(PART)
                with contextlib.suppress(TimeoutError):
                    count = attacker.send(rest)
                    sent, rest = sent + count, rest[count:]
                port.look()
        assert module.MAX_BYTES <= sent < 10 * module.MAX_BYTES  # a part is still under way
        assert port.receive() is None


def test_who_asks_a_lot_in_a_pull_stays(port, titan, clients):
    """Many requests on one connection, and one of the largest size."""
    client = clients.dial(titan)
    for size in (*[17] * 200, MAX_REQUEST_BYTES):
        client.send_multipart([b"", bytes(size)])
        assert port.socket.poll(WAIT_MS)
        route, _ = port.receive()
        port.reply(route, b"done")
        assert client.recv_multipart() == [b"", b"done"]
    assert port.look() == 0


def test_the_oldest_of_too_many_connections_goes(port, titan, monkeypatch):
    monkeypatch.setattr(module, "MAX_CONNECTIONS", 3)
    with contextlib.ExitStack() as stack:
        inside = [stack.enter_context(dial(titan)) for _ in range(5)]
        assert port.look() == 2
        while not all(closed(each) for each in inside[:2]):
            pass
        assert not any(closed(each) for each in inside[2:])
        inside[2].close()
        while len(port._limiter._inside) == 3:
            port.look()
        assert port.look() == 0


@pytest.mark.parametrize("kind", [zmq.REQ, zmq.DEALER])
def test_who_comes_and_goes_leaves_nothing(port, titan, clients, kind):
    for _ in range(5):
        client = clients.dial(titan, kind)
        client.send_multipart([b"one"] if kind == zmq.REQ else [b"", b"one"])
        assert port.socket.poll(WAIT_MS)
        route, _ = port.receive()
        port.reply(route, b"done")
        client.recv_multipart()
        client.close(0)
    while port._limiter._inside:
        assert port.look() == 0


def test_a_node_counts_whom_it_sent_away(field, monkeypatch):
    monkeypatch.setattr(module, "MAX_CONNECTIONS", 1)
    node, _, _ = field.node("titan")
    with dial(node.robot), dial(node.robot):
        while not node.links()["io"].refused:
            pass


def test_a_port_with_a_limiter_closes(titan):
    context = zmq.Context()
    port = Port(context, titan, "io", None)
    with dial(titan):
        port.look()
        port.close()
        context.term()
