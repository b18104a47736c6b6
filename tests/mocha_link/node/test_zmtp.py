"""Our own ZMTP: understood by libzmq and understanding it, however the bytes are cut."""

import contextlib
import functools
import socket
import tracemalloc
from collections.abc import Iterator

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.node.zmtp import ZmtpError, ZmtpSession

WAIT_MS = 20_000
LIMIT = 1024 * 1024
GREETING = bytes.fromhex("ff00000000000000017f03014e554c4c") + bytes(48)
READY = bytes.fromhex("04190552454144590b536f636b65742d5479706500000003524550")


def replies_to(connection: ZmtpSession, data: bytes) -> list[list[bytes]]:
    """What comes of some bytes."""
    connection.receive(data)
    return list(connection.replies())


def ready() -> ZmtpSession:
    """A connection on which the greeting of the other side was received."""
    connection = ZmtpSession(LIMIT)
    connection.receive(GREETING + READY)
    assert connection.ready
    return connection


class Peer:
    """A libzmq socket, and our connection to it through a plain one."""

    def __init__(self, kind: int, limit: int = LIMIT) -> None:
        self._context = zmq.Context()
        self.zmq = self._context.socket(kind)
        self.zmq.setsockopt(zmq.LINGER, 0)
        self.zmq.setsockopt(zmq.RCVTIMEO, WAIT_MS)
        port = self.zmq.bind_to_random_port("tcp://127.0.0.1")
        self.tcp = socket.create_connection(("127.0.0.1", port), timeout=60)
        self.connection = ZmtpSession(limit)
        self.received = b""

    def until(self, count: int) -> list[list[bytes]]:
        """Receive until so many replies are there."""
        replies: list[list[bytes]] = []
        while len(replies) < count:
            self._receive()
            replies += self.connection.replies()
        return replies

    def until_ready(self) -> None:
        while not self.connection.ready:
            self._receive()

    def _receive(self) -> None:
        data = self.tcp.recv(65536)
        assert data, "closed"
        self.received += data
        self.tcp.sendall(self.connection.receive(data))

    def close(self) -> None:
        self.tcp.close()
        self.zmq.close()
        self._context.term()


@contextlib.contextmanager
def peer(kind: int, **options: int) -> Iterator[Peer]:
    with contextlib.closing(Peer(kind, **options)) as each:
        yield each


@pytest.mark.parametrize("size", [0, 1, 255, 256, 65_536, 700_000])
def test_a_request_to_rep_and_its_reply(size):
    with peer(zmq.REP) as rep:
        rep.tcp.sendall(rep.connection.hello)
        rep.until_ready()
        body = bytes(range(256)) * (size // 256) + bytes(size % 256)
        for _ in range(2):
            rep.tcp.sendall(rep.connection.request(body))
            assert rep.zmq.recv() == body
            rep.zmq.send(body[::-1])
            assert rep.until(1) == [[body[::-1]]]


@functools.cache
def recorded() -> bytes:
    """All that a libzmq ROUTER sends: handshake, short and long replies, several parts."""
    with peer(zmq.ROUTER) as router:
        router.tcp.sendall(router.connection.hello)
        router.until_ready()
        router.tcp.sendall(router.connection.request(b"?"))
        identity = router.zmq.recv_multipart()[0]
        for reply in (b"short", b"", b"x" * 255, b"y" * 256, b"z" * 700):
            router.zmq.send_multipart([identity, b"", reply])
        router.zmq.send_multipart([identity, b"", b"a" * 300, b"", b"b"])
        router.until(6)
        return router.received


REPLIES = [[b"short"], [b""], [b"x" * 255], [b"y" * 256], [b"z" * 700], [b"a" * 300, b"", b"b"]]


def test_cut_anywhere_it_is_the_same():
    wire = recorded()
    for place in range(len(wire) + 1):
        connection = ZmtpSession(LIMIT)
        replies = replies_to(connection, wire[:place]) + replies_to(connection, wire[place:])
        assert replies == REPLIES


def test_libzmq_takes_our_answers_to_its_heartbeats():
    """Without them it would close the connection."""
    context = zmq.Context()
    with context.socket(zmq.ROUTER) as router:
        router.setsockopt(zmq.LINGER, 0)
        router.setsockopt(zmq.HEARTBEAT_IVL, 20)
        router.setsockopt(zmq.HEARTBEAT_TIMEOUT, 5_000)
        port = router.bind_to_random_port("tcp://127.0.0.1")
        connection = ZmtpSession(LIMIT)
        with socket.create_connection(("127.0.0.1", port), timeout=60) as tcp:
            tcp.sendall(connection.hello)
            answers = b""
            while answers.count(b"PONG") < 3:
                answer = connection.receive(tcp.recv(4096))
                answers += answer
                tcp.sendall(answer)
            tcp.sendall(connection.request(b"still here"))
            assert router.poll(WAIT_MS)
            assert router.recv_multipart()[1:] == [b"", b"still here"]
    context.term()


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"SSH-2.0-OpenSSH", "is not a ZeroMQ socket"),
        (b"\xff" + bytes(9), "is not a ZeroMQ socket"),  # ZMTP 1
        (GREETING[:10] + b"\1" + GREETING[11:], "uses ZMTP 1, too old"),
        (GREETING[:10] + b"\2" + GREETING[11:], "uses ZMTP 2, too old"),
        (GREETING[:12] + b"CURVE".ljust(20, b"\0") + bytes(32), "wants CURVE: it has a key"),
        (GREETING[:12] + b"\xff" * 20 + bytes(32), "give both the same team file"),
        (GREETING + b"\4\x09\5ERROR\3No!", "the peer refused us"),
        (GREETING + READY + b"\x08\0", "a frame with flags 0x8"),
        (GREETING + READY + b"\2" + (LIMIT + 1).to_bytes(8), f"{LIMIT + 1} bytes"),
        (GREETING + READY + b"\2" + b"\xff" * 8, "bytes"),
        (GREETING + READY + b"\1\1a" * 129, "too many parts"),
    ],
)
def test_what_is_no_node(data, why):
    with pytest.raises(ZmtpError, match=why):
        ZmtpSession(LIMIT).receive(data)
    connection = ZmtpSession(LIMIT)
    with pytest.raises(ZmtpError, match=why):  # noqa: PT012 - which byte it is does not matter
        for byte in data:
            connection.receive(bytes((byte,)))


def test_a_later_version_may_add_commands():
    connection = ready()
    assert replies_to(connection, b"\4\6\5OTHER" + b"\0\2ok") == [[b"ok"]]


def outcome(connection: ZmtpSession, pieces: list[bytes]) -> tuple[list[list[bytes]], str]:
    """The replies in some bytes, and what was wrong with them."""
    replies: list[list[bytes]] = []
    try:
        for piece in pieces:
            connection.receive(piece)
            replies += connection.replies()
    except ZmtpError as error:
        return [*replies, *connection.replies()], str(error)
    return replies, ""


@given(
    st.lists(
        st.one_of(
            st.binary(max_size=80),
            st.sampled_from([GREETING, READY, b"\1\0", b"\0\4body", b"\4\5\4PING", b"\2"]),
            st.integers(0, LIMIT + 2).map(lambda size: b"\2" + size.to_bytes(8)),
            st.integers(0, 7).map(lambda flags: bytes((flags, 5)) + b"hello"),
        ),
        max_size=30,
    ),
    st.booleans(),
)
def test_any_bytes_are_replies_or_a_zmtp_error(pieces, greeted):
    connection = ready() if greeted else ZmtpSession(LIMIT)
    whole = ready() if greeted else ZmtpSession(LIMIT)
    results = [outcome(connection, pieces), outcome(whole, [b"".join(pieces)])]
    assert results[0] == results[1]
    assert all(len(part) <= LIMIT for parts in results[0][0] for part in parts)


def memory_bytes(act) -> tuple[int, int]:
    """What is held after something, and the most that was held in between."""
    tracemalloc.start()
    try:
        act()
        return tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()


def test_what_is_announced_takes_no_memory():
    connections = [ready() for _ in range(100)]

    def announce() -> None:
        for connection in connections:
            connection.receive(b"\2" + LIMIT.to_bytes(8) + b"begin")

    held, most = memory_bytes(announce)
    assert held < 200_000
    assert most < 300_000


def test_parts_are_bounded_together():
    """Not each part by itself: nine of the largest would be nine times the limit."""
    connection = ready()
    part = b"\3" + LIMIT.to_bytes(8) + bytes(LIMIT)
    pieces = [part[start : start + 65_536] for start in range(0, len(part), 65_536)]
    results = []
    _, most = memory_bytes(lambda: results.append(outcome(connection, pieces * 9)))
    assert results == [([], "a message of too many parts")]
    assert most < 3.5 * LIMIT


def test_empty_replies_do_not_fill_the_memory():
    """Two bytes each: a few megabytes that came in one turn would be millions of them."""
    connection = ready()
    noise = bytes(2 * 1_000_000)
    results = []
    _, most = memory_bytes(lambda: results.append(outcome(connection, [noise])[1]))
    assert results == ["more messages at once than can be meant"]
    assert most < 16_000_000


def test_a_large_body_is_received_where_it_stays():
    """In a buffer of its own, as soon as a sixteenth of it has come."""
    connection, body, at = ready(), bytes(range(256)) * 4096, 65_535
    connection.receive(b"\2" + len(body).to_bytes(8) + body[:at])
    assert connection.room() is None
    connection.receive(body[at : at + 1])
    at += 1
    while (room := connection.room()) is not None:
        assert len(room) == len(body) - at
        count = min(len(room), 100_000)
        room[:count] = body[at : at + count]
        assert connection.filled(count) == b""
        at += count
    ((reply,),) = connection.replies()
    assert reply == body
    assert reply.readonly
    assert len(reply.obj) == len(body)
    assert connection.receive(b"\0\3end") == b""
    assert list(connection.replies()) == [[b"end"]]
