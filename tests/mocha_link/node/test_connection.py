"""Connections to real sockets: how they begin, which error they report, what they leave."""

import contextlib
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator

import pytest
import zmq
from zmq.utils import z85

from mocha_link.node import connection as module
from mocha_link.node.connection import SEND_BEFORE_READY_S, Connection
from mocha_link.node.kernel import Poller
from mocha_link.node.zmtp import ZmtpSession
from mocha_link.team.keys import SecretKey
from tests.mocha_link.conftest import own_host

WAIT_S = 60  # a limit against hangs
HOST = "127.0.0.1"
GREETING = bytes.fromhex("ff00000000000000017f03014e554c4c") + bytes(48)
READY = bytes.fromhex("04190552454144590b536f636b65742d5479706500000003524550")
HELLO_BYTES = len(ZmtpSession(1).hello)
BROKE = "the connection broke in the ZeroMQ handshake, or the peer wants a key"
RESET = struct.pack("ii", 1, 0)


class Peer:
    """The listener there: the test sends every byte of it."""

    def __init__(self) -> None:
        self._listener = socket.create_server((HOST, 0))
        self._listener.settimeout(WAIT_S)
        self.port = self._listener.getsockname()[1]
        self._connections: list[socket.socket] = []

    def accept(self) -> socket.socket:
        connection, _ = self._listener.accept()
        connection.settimeout(WAIT_S)
        self._connections.append(connection)
        return connection

    def close(self) -> None:
        for each in (*self._connections, self._listener):
            each.close()


@pytest.fixture
def peer() -> Iterator[Peer]:
    with contextlib.closing(Peer()) as peer:
        yield peer


@pytest.fixture
def line(peer) -> Iterator[Connection]:
    with contextlib.closing(Connection(HOST, peer.port)) as line:
        yield line


@pytest.fixture
def greeted(line, peer) -> socket.socket:
    """The peer's side of a connection on which its greeting was sent, perhaps not yet received."""
    line.turn(100.0)
    connection = peer.accept()
    connection.sendall(GREETING + READY)
    return connection


@pytest.fixture
def context() -> Iterator[zmq.Context]:
    context = zmq.Context()
    yield context
    context.destroy(0)


def read(connection: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        piece = connection.recv(size - len(data))
        assert piece, "closed"
        data += piece
    return data


def nothing_to_read(connection: socket.socket) -> bool:
    connection.setblocking(False)
    try:
        connection.recv(1, socket.MSG_PEEK)
    except BlockingIOError:
        return True
    finally:
        connection.settimeout(WAIT_S)
    return False


def greeted_by(line: Connection) -> Callable[[], bool]:
    """Whether the peer's side of the handshake has come."""
    return lambda: line._protocol is not None and line._protocol.ready


def turn_until(line: Connection, done: Callable[[], object], now_s: float | None = None) -> None:
    """What the transport does with it, by the real time or at a moment that stands still."""
    limit_s = time.monotonic() + WAIT_S
    with contextlib.closing(Poller()) as poller:
        while not done():
            assert time.monotonic() < limit_s, "hangs"
            line.watch(poller)
            ready = poller.poll(10)
            now = time.monotonic() if now_s is None else now_s
            if line.is_ready(ready, now):
                line.turn(now)
        line.forget(poller)


def replies_of(line: Connection, count: int) -> list[list[bytes]]:
    replies: list[list[bytes]] = []

    def done() -> bool:
        replies.extend(line.replies())
        return len(replies) >= count or line.failure is not None

    turn_until(line, done)
    return replies


def request(body: bytes) -> bytes:
    return b"\1\0\0" + bytes((len(body),)) + body


# --- without keys


def test_the_handshake_leaves_at_once_the_requests_a_moment_later(line, peer):
    """They need no reply of the peer, but must not be sent together with the handshake."""
    line.send(b"one")
    line.send(b"two")
    assert line.turn(100.0)  # it stands
    connection = peer.accept()
    read(connection, HELLO_BYTES)
    assert not line.is_ready(set(), 100.0 + SEND_BEFORE_READY_S / 2)
    assert not line.turn(100.0 + SEND_BEFORE_READY_S / 2)
    assert nothing_to_read(connection)
    assert line.is_ready(set(), 100.0 + SEND_BEFORE_READY_S)
    line.turn(100.0 + SEND_BEFORE_READY_S)
    both = request(b"one") + request(b"two")
    assert read(connection, len(both)) == both
    line.send(b"three")  # nothing more before the peer has sent anything
    assert not line.is_ready(set(), 200.0)
    line.turn(200.0)
    assert nothing_to_read(connection)
    connection.sendall(GREETING + READY)
    turn_until(line, greeted_by(line), 201.0)
    assert read(connection, len(request(b"three"))) == request(b"three")
    line.send(b"four")  # from now on at once
    assert read(connection, len(request(b"four"))) == request(b"four")


def test_requests_that_came_together_with_the_handshake_are_sent_again(line, peer):
    """A libzmq that reads them together closes; then they wait for it."""
    line.send(b"one")
    line.turn(100.0)
    first = peer.accept()
    line.turn(101.0)
    read(first, HELLO_BYTES + 7)
    line.send(b"two")
    first.close()
    turn_until(line, lambda: line._protocol is not None and not line._opened, 102.0)
    second = peer.accept()
    assert line.failure is None
    turn_until(line, lambda: not line._out, 103.0)
    read(second, HELLO_BYTES)
    assert not line.is_ready(set(), 500.0)
    line.turn(500.0)
    assert nothing_to_read(second)
    second.sendall(GREETING + READY)
    turn_until(line, greeted_by(line), 501.0)
    both = request(b"one") + request(b"two")
    assert read(second, len(both)) == both
    second.sendall(b"\1\0\0\5reply")
    assert replies_of(line, 1) == [[b"reply"]]


def test_a_second_connection_leaves_nothing_of_the_first_in_the_poller(line, peer, monkeypatch):
    """Its number is given to nothing else before it is out: the poller would take that for it."""
    poller = Poller()
    line.watch(poller)
    line.send(b"one")
    line.turn(100.0)
    line.turn(101.0)
    first = peer.accept()
    read(first, HELLO_BYTES + 7)
    before = line._socket.fileno()
    real, taken = socket.socket, []

    def make(*args: object) -> socket.socket:
        taken.append(os.dup(0))  # the number of one that was closed is in use again
        return real(*args)

    monkeypatch.setattr(module.socket, "socket", make)
    first.close()
    limit_s = time.monotonic() + WAIT_S
    while not taken:
        assert time.monotonic() < limit_s, "hangs"
        line.turn(102.0)
    monkeypatch.undo()
    assert before not in taken
    line.watch(poller)
    with pytest.raises(OSError, match="Bad file"):
        os.fstat(before)
    assert list(poller._selector.get_map()) == [line._socket.fileno()]
    line.forget(poller)
    assert not poller._selector.get_map()
    poller.close()
    os.close(taken[0])


@pytest.mark.parametrize("abruptly", [False, True])
@pytest.mark.parametrize(
    ("sent", "reason"),
    [
        (b"", BROKE),
        (GREETING, BROKE),
        (GREETING + READY, "the peer closed the connection"),
        (GREETING + READY + b"\1\0\0\5rep", "the peer closed the connection"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "what answers there is not a ZeroMQ socket"),
    ],
)
def test_a_closed_connection(line, peer, sent, reason, abruptly):
    line.turn(100.0)
    connection = peer.accept()
    read(connection, HELLO_BYTES)
    connection.sendall(sent)
    if sent:
        turn_until(line, lambda: line._protocol._buffer or line.failure or not sent[91:], 100.0)
    if abruptly:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
    connection.close()
    turn_until(line, lambda: line.failure is not None, 100.0)
    assert line.failure == reason
    assert list(line.replies()) == []


def test_a_reply_that_is_too_large_ends_it(line, greeted):
    greeted.sendall(b"\2" + (1 << 40).to_bytes(8))
    turn_until(line, lambda: line.failure is not None, 100.0)
    assert "1099511627776 bytes" in line.failure


def test_what_a_peer_does_not_read_waits(line, greeted):
    """A request larger than all buffers leaves as the peer reads it."""
    turn_until(line, greeted_by(line), 100.0)
    body = os.urandom(20_000_000)
    line.send(body)
    assert line._out
    got = bytearray()

    def done() -> bool:
        greeted.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            got.extend(greeted.recv(1 << 20))
        return len(got) >= HELLO_BYTES + 11 + len(body)

    turn_until(line, done, 100.0)
    assert got[HELLO_BYTES + 11 :] == body


PINGS = b"\4\x07\4PING\0\0" * 20_000


def test_answers_that_a_peer_does_not_read_do_not_fill_the_memory(line, greeted):
    """It requests heartbeats as fast as it can, and never reads one."""
    greeted.setblocking(False)
    unsent = memoryview(PINGS * 400)  # 72 MB

    def done() -> bool:
        nonlocal unsent
        with contextlib.suppress(BlockingIOError, ConnectionResetError):
            unsent = unsent[greeted.send(unsent[: 1 << 20]) :]
        assert len(line._out) < 16_000_000
        return line.failure is not None

    turn_until(line, done, 100.0)
    assert line.failure == "the peer does not read the replies that it requests"


# --- with keys

TITAN, IO, EUROPA, INTRUDER = (SecretKey(bytes([number]) * 32) for number in (1, 2, 3, 4))


ZAP = "inproc://zeromq.zap.01"  # where libzmq requests the authentication of a key


class Hall:
    """titan's port for io, of libzmq, as a node of before has it; it needs the key of io."""

    def __init__(self, context: zmq.Context, *, protect: bool = True) -> None:
        self.refused = 0
        self._gate = context.socket(zmq.REP)
        self._gate.bind(ZAP)
        self._door = context.socket(zmq.ROUTER)
        if protect:
            self._door.curve_server = True
            self._door.curve_secretkey = z85.encode(TITAN.curve)
            self._door.zap_domain = b"io"
        self.host = own_host()
        self.port = self._door.bind_to_random_port(f"tcp://{self.host}")

    def serve(self) -> None:
        while self._gate.poll(0):
            version, request, *_, key = self._gate.recv_multipart()
            allowed = key == IO.public.curve
            self.refused += not allowed
            status = [b"200", b"OK"] if allowed else [b"400", b"unknown key"]
            self._gate.send_multipart([version, request, *status, b"", b""])
        while self._door.poll(0):
            identity, _, body = self._door.recv_multipart()
            self._door.send_multipart([identity, b"", b"to " + body])

    def serve_until(self, line: Connection, done: Callable[[], object]) -> None:
        turn_until(line, lambda: self.serve() or done())

    def close(self) -> None:
        self._gate.close(0)
        self._door.close(0)


@pytest.fixture
def hall(context) -> Iterator[Hall]:
    with contextlib.closing(Hall(context)) as hall:
        yield hall


def curve_line(hall: Hall, own: SecretKey, peer: SecretKey) -> Connection:
    return Connection(hall.host, hall.port, keys=(own, peer.public))


def test_the_right_key(hall):
    with contextlib.closing(curve_line(hall, IO, TITAN)) as line:
        replies: list[list[bytes]] = []
        for number in range(20):
            line.send(b"%d" % number)

        def done() -> bool:
            hall.serve()
            replies.extend(line.replies())
            return len(replies) == 20 and line.rtt_s() is not None

        # The replies may all be there before the line has had its first turn.
        turn_until(line, done)
        assert replies == [[b"to %d" % number] for number in range(20)]
        assert line.failure is None
        assert 0 < line.rtt_s() < WAIT_S
        assert not hall.refused


@pytest.mark.parametrize(
    ("own", "peer", "reason"),
    [
        (INTRUDER, TITAN, "the peer refused our key"),
        (IO, INTRUDER, "the keys do not fit"),
    ],
)
def test_a_wrong_key(hall, own, peer, reason):
    """Ours, or the one that we take for the peer's."""
    with contextlib.closing(curve_line(hall, own, peer)) as line:
        line.send(b"let me in")
        hall.serve_until(line, lambda: line.failure)
        assert reason in line.failure
        assert list(line.replies()) == []
    assert hall.refused == (own is not IO)


def test_a_key_where_none_is_wanted(context):
    with (
        contextlib.closing(Hall(context, protect=False)) as hall,
        contextlib.closing(curve_line(hall, IO, TITAN)) as line,
    ):
        line.send(b"secret")
        hall.serve_until(line, lambda: line.failure)
        # It may close before we have read what it wants.
        assert "or it has none" in line.failure or "has no key" in line.failure
        assert list(line.replies()) == []


def test_no_key_where_one_is_wanted(hall):
    with contextlib.closing(Connection(hall.host, hall.port)) as line:
        line.send(b"idididGHEAD")
        hall.serve_until(line, lambda: line.failure)
        # As far as our handshake comes in one piece, it closes before READY.
        assert line.failure == BROKE or "the peer wants CURVE" in line.failure
