"""Connections to real sockets: how they begin, what they say when they fail, what they leave."""

import contextlib
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator

import pytest
import zmq

from mocha_link.node import connection as module
from mocha_link.node import curve
from mocha_link.node.connection import EAGER_S, Connection, CurveConnection, TcpConnection
from mocha_link.node.curve import CurveUnavailableError, ZapHandler
from mocha_link.node.kernel import Poller
from mocha_link.node.zmtp import ZmtpSession
from mocha_link.team.keys import SecretKey
from tests.mocha_link.conftest import own_host

WAIT_S = 60  # a limit against hangs
HOST = "127.0.0.1"
GREETING = bytes.fromhex("ff00000000000000017f03014e554c4c") + bytes(48)
READY = bytes.fromhex("04190552454144590b536f636b65742d5479706500000003524550")
HELLO_BYTES = len(ZmtpSession.hello)
BROKE = "the connection broke in the ZeroMQ handshake, or the peer wants a key"
RESET = struct.pack("ii", 1, 0)


class Peer:
    """What listens there: the test says every byte of it."""

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
def line(peer) -> Iterator[TcpConnection]:
    with contextlib.closing(TcpConnection(HOST, peer.port)) as line:
        yield line


@pytest.fixture
def greeted(line, peer) -> socket.socket:
    """The peer's side of a connection on which it has said hello; the line may not know yet."""
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
    """They need no word of the other side, but must not come together with the handshake."""
    line.send(b"one")
    line.send(b"two")
    assert line.turn(100.0)  # it stands
    connection = peer.accept()
    read(connection, HELLO_BYTES)
    assert not line.is_ready(set(), 100.0 + EAGER_S / 2)
    assert not line.turn(100.0 + EAGER_S / 2)
    assert nothing_to_read(connection)
    assert line.is_ready(set(), 100.0 + EAGER_S)
    line.turn(100.0 + EAGER_S)
    both = request(b"one") + request(b"two")
    assert read(connection, len(both)) == both
    line.send(b"three")  # nothing more before the peer has said anything
    assert not line.is_ready(set(), 200.0)
    line.turn(200.0)
    assert nothing_to_read(connection)
    connection.sendall(GREETING + READY)
    turn_until(line, lambda: line._protocol.ready, 201.0)
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
    turn_until(line, lambda: line._protocol.ready, 501.0)
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
    ("said", "reason"),
    [
        (b"", BROKE),
        (GREETING, BROKE),
        (GREETING + READY, "the peer closed the connection"),
        (GREETING + READY + b"\1\0\0\5rep", "the peer closed the connection"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "what answers there does not speak ZeroMQ"),
    ],
)
def test_a_closed_connection(line, peer, said, reason, abruptly):
    line.turn(100.0)
    connection = peer.accept()
    read(connection, HELLO_BYTES)
    connection.sendall(said)
    if said:
        turn_until(line, lambda: line._protocol._buffer or line.failure or not said[91:], 100.0)
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
    turn_until(line, lambda: line._protocol.ready, 100.0)
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
    """It asks for heartbeats as fast as it can, and never reads one."""
    greeted.setblocking(False)
    unsent = memoryview(PINGS * 400)  # 72 MB

    def done() -> bool:
        nonlocal unsent
        with contextlib.suppress(BlockingIOError, ConnectionResetError):
            unsent = unsent[greeted.send(unsent[: 1 << 20]) :]
        assert len(line._out) < 16_000_000
        return line.failure is not None

    turn_until(line, done, 100.0)
    assert line.failure == "the peer does not read the answers that it asks for"


# --- with keys

TITAN, IO, EUROPA, INTRUDER = (SecretKey(bytes([number]) * 32) for number in (1, 2, 3, 4))


class Hall:
    """titan's port for a peer, which needs the key of that peer."""

    def __init__(self, context: zmq.Context, *, peer: str = "io", protect: bool = True) -> None:
        self.refusals: list[object] = []
        self.gate = ZapHandler(context, {"io": IO.public, "europa": EUROPA.public})
        self._door = context.socket(zmq.ROUTER)
        if protect:
            curve.protect_port(self._door, TITAN, peer)
            self.gate.watch(self._door, peer)
        self.host = own_host()
        self.port = self._door.bind_to_random_port(f"tcp://{self.host}")

    def serve(self) -> None:
        self.refusals += self.gate.serve(0.0)
        while self._door.poll(0):
            identity, _, body = self._door.recv_multipart()
            self._door.send_multipart([identity, b"", b"to " + body])

    def serve_until(self, line: Connection, done: Callable[[], object]) -> None:
        turn_until(line, lambda: self.serve() or done())

    def close(self) -> None:
        self.gate.close()
        self._door.close(0)


@pytest.fixture
def hall(context) -> Iterator[Hall]:
    with contextlib.closing(Hall(context)) as hall:
        yield hall


def curve_line(
    hall: Hall, context: zmq.Context, own: SecretKey, peer: SecretKey
) -> CurveConnection:
    return CurveConnection(context, hall.host, hall.port, own=own, peer=peer.public)


def test_the_right_key(hall, context):
    with contextlib.closing(curve_line(hall, context, IO, TITAN)) as line:
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
        assert not hall.refusals


@pytest.mark.parametrize(
    ("own", "peer", "reason"),
    [
        (INTRUDER, TITAN, "the peer refused our key"),
        (EUROPA, TITAN, "the peer refused our key"),  # of the team, but not for this port
        (IO, INTRUDER, "the keys do not fit"),
    ],
)
def test_a_wrong_key(  # noqa: PLR0913, PLR0917 - the columns of the table above
    hall, context, own, peer, reason, caplog
):
    """Ours, or the one that we take for the peer's. It is counted, and told once."""
    with contextlib.closing(curve_line(hall, context, own, peer)) as line:
        line.send(b"let me in")
        hall.serve_until(line, lambda: line.failure and hall.refusals)
        assert reason in line.failure
        assert list(line.replies()) == []
    if own is not IO:
        assert set(hall.refusals) == {("io", "with a wrong key")}
        told = "refused at the port for io: it came with a wrong key"
        assert [m for m in caplog.messages if m.startswith("refused")] == [told]


def test_a_port_whose_peer_has_no_key_stays_shut(context):
    with (
        contextlib.closing(Hall(context, peer="stranger")) as hall,
        contextlib.closing(curve_line(hall, context, IO, TITAN)) as line,
    ):
        line.send(b"let me in")
        hall.serve_until(line, lambda: hall.refusals)
        assert set(hall.refusals) == {("stranger", "with a wrong key")}


def silent(hall: Hall) -> socket.socket:
    """A connection that says nothing."""
    return socket.create_connection((hall.host, hall.port), timeout=WAIT_S)


def is_closed(connection: socket.socket) -> bool:
    """Whether it is, or comes to be, after our greeting."""
    with contextlib.suppress(ConnectionError):
        while connection.recv(1024):
            pass
    return True


def test_strangers_that_say_nothing_hold_few_descriptors(hall, context):
    with contextlib.ExitStack() as stack:
        early, *late = [stack.enter_context(silent(hall)) for _ in range(curve.MAX_STRANGERS + 3)]
        while len(hall.refusals) < 3:
            hall.serve()
        assert is_closed(early)
        late[-1].setblocking(False)
        with pytest.raises(BlockingIOError):
            is_closed(late[-1])
        line = stack.enter_context(contextlib.closing(curve_line(hall, context, IO, TITAN)))
        line.send(b"let me in")
        hall.serve_until(line, lambda: list(line.replies()))
        assert hall.refusals == [("io", "too often")] * 4  # the line is one more


def test_a_stranger_that_says_nothing_goes(context, monkeypatch):
    monkeypatch.setattr(curve, "HANDSHAKE_S", 0.05)
    with contextlib.closing(Hall(context)) as hall, silent(hall) as stranger:
        assert is_closed(stranger)


def test_a_libzmq_without_curve(context, monkeypatch):
    monkeypatch.setattr(zmq, "has", lambda _: False)
    with contextlib.closing(context.socket(zmq.ROUTER)) as door:
        with pytest.raises(CurveUnavailableError, match="built without CURVE"):
            curve.protect_port(door, TITAN, "io")
        with pytest.raises(CurveUnavailableError, match="built without CURVE"):
            curve.protect_contact(door, TITAN, IO.public)


def test_a_key_where_none_is_wanted(context):
    with (
        contextlib.closing(Hall(context, protect=False)) as hall,
        contextlib.closing(curve_line(hall, context, IO, TITAN)) as line,
    ):
        line.send(b"secret")
        hall.serve_until(line, lambda: line.failure)
        assert line.failure == "what answers there has no key, or does not speak ZeroMQ"
        assert list(line.replies()) == []


def test_a_connection_that_takes_nothing_is_a_failure_not_an_error(hall, context, monkeypatch):
    """libzmq may have given it up already; that is found out at the next turn."""
    with contextlib.closing(curve_line(hall, context, IO, TITAN)) as line:
        line._socket.setsockopt(zmq.SNDHWM, 1)
        line._socket.disconnect(line._socket.LAST_ENDPOINT)
        line.send(b"into nothing")
        assert line.failure is None
        assert line.is_ready(set(), 0.0)
        line.turn(0.0)
        # What libzmq told of it, if that was quicker, is the better reason.
        assert line.failure in ("the connection takes nothing more", "cannot connect")


def test_no_key_where_one_is_wanted(hall):
    with contextlib.closing(TcpConnection(hall.host, hall.port)) as line:
        line.send(b"idididGHEAD")
        hall.serve_until(line, lambda: line.failure)
        # As far as our handshake comes in one piece, it closes before it says what it wants.
        assert line.failure == BROKE or "the peer wants CURVE" in line.failure
