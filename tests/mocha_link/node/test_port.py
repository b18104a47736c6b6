"""The port for a peer: what gets in, what gets out, and what happens when it has no reader."""

import contextlib
import os
import socket
import struct
import sys
import threading
from collections.abc import Hashable, Iterator

import pytest
import zmq

from mocha_link.errors import ListenError, PortInUseError
from mocha_link.node.curve import CurveClient
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.link_keys import LinkKeys
from mocha_link.node.port import MAX_REQUEST_BYTES, Port
from mocha_link.node.router import BURST, MAX_CONNECTIONS, ClientConnections
from mocha_link.node.zmtp import Null, ZmtpSession
from mocha_link.store.trust import config_hash_of
from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.sync_messages import Have
from mocha_link.team.keys import SecretKey
from mocha_link.team.team import Robot
from tests.mocha_link.conftest import free_ports, own_host
from tests.mocha_link.libzmq import protect

WAIT_MS = 20_000
LARGE = bytes(1_000_000)
OPEN, PROTECTED = False, True
OF_TITAN, OF_IO = SecretKey(b"t" * 32), SecretKey(b"i" * 32)


@pytest.fixture
def titan(team) -> Robot:
    host = own_host()
    return team.robot("titan").model_copy(
        update={"listen": host, "address": host, "base_port": free_ports(host, 2)}
    )


class Shell:
    """What drives a port: a poller, and the loop around `requests`."""

    def __init__(self, kind: bool, titan: Robot) -> None:
        self.poller = Poller()
        keys = LinkKeys(OF_TITAN, {"io": OF_IO.public}) if kind is PROTECTED else None
        self.port = Port(self.poller, ClientConnections(), titan, "io", keys=keys)
        self.port.watch(self.poller)

    def turn(self, wait_ms: int = 0) -> list[tuple[tuple[bytes, ...], list[bytes]]]:
        """The requests of one turn; none of them is answered in it."""
        ready = self.poller.poll(min(wait_ms, self.port.wait_ms))
        return list(self.port.requests(ready))

    def serve(self, answer: bytes) -> list[bytes]:
        """Answer what is requested in one turn; the requests."""
        ready = self.poller.poll(0)
        served = []
        for route, (request,) in self.port.requests(ready):
            served.append(request)
            self.port.reply(route, request + answer)
        return served

    def request(self) -> tuple[tuple[bytes, ...], list[bytes]]:
        """The next one, which comes alone."""
        for _ in range(WAIT_MS // 100):
            found = self.turn(100)
            if found:
                (request,) = found
                return request
        raise AssertionError("no request")

    def close(self) -> None:
        self.port.close()
        self.poller.close()


@pytest.fixture(params=[OPEN, PROTECTED], ids=["open", "protected"])
def kind(request) -> bool:
    return request.param


@pytest.fixture
def shell(kind, titan) -> Iterator[Shell]:
    with contextlib.closing(Shell(kind, titan)) as shell:
        yield shell


@pytest.fixture
def port(shell) -> Port:
    return shell.port


class Clients:
    """Those who connect to the port, with a context of their own."""

    def __init__(self, *, protected: bool) -> None:
        self._protected = protected
        self._context = zmq.Context()
        self._sockets: list[zmq.Socket] = []

    def dial(
        self,
        titan: Robot,
        kind: int = zmq.DEALER,
        *,
        asleep: bool = False,
        own: SecretKey | None = None,
    ) -> zmq.Socket:
        client = self._context.socket(kind)
        self._sockets.append(client)
        client.setsockopt(zmq.LINGER, 0)
        if asleep:  # it takes little ahead of what is read
            client.setsockopt(zmq.RCVHWM, 1)
            client.setsockopt(zmq.RCVBUF, 65_536)
        if self._protected or own:
            protect(client, own or OF_IO, OF_TITAN.public)
        client.connect(f"tcp://{titan.listen}:{titan.port_for('io')}")
        return client

    def close(self) -> None:
        for each in self._sockets:
            each.close(0)
        self._context.term()


@pytest.fixture
def clients(request) -> Iterator[Clients]:
    protected = "kind" in request.fixturenames and (request.getfixturevalue("kind") is PROTECTED)
    with contextlib.closing(Clients(protected=protected)) as clients:
        yield clients


# --- requests and replies


@pytest.mark.parametrize("client_type", [zmq.REQ, zmq.DEALER])
def test_a_request_and_its_reply(shell, titan, clients, client_type):
    client = clients.dial(titan, client_type)
    envelope = [] if client_type == zmq.REQ else [b""]
    client.send_multipart([*envelope, b"idididGHEAD"])
    route, parts = shell.request()
    assert parts == [b"idididGHEAD"]
    assert shell.turn() == []
    shell.port.reply(route, b"idididlist")
    assert client.poll(WAIT_MS)
    assert client.recv_multipart() == [*envelope, b"idididlist"]


def test_what_has_no_envelope_is_ignored(shell, titan, clients):
    """As REP ignores it; what has a longer one gets it back."""
    client = clients.dial(titan)
    client.send_multipart([b"no envelope"])
    client.send_multipart([b""])
    client.send_multipart([b"no", b"envelope"])
    client.send_multipart([b"hop", b"", b"one", b"", b"two"])
    route, parts = shell.request()
    assert parts == [b"one", b"", b"two"]
    shell.port.reply(route, b"reply")
    assert client.poll(WAIT_MS)
    assert client.recv_multipart() == [b"hop", b"", b"reply"]


def test_a_request_that_is_too_large_never_gets_in(shell, titan, clients):
    most = MAX_REQUEST_BYTES
    client = clients.dial(titan)
    client.send_multipart([b"", bytes(most)])
    assert shell.request()[1] == [bytes(most)]
    client.send_multipart([b"", bytes(most + 1)])
    other = clients.dial(titan)
    other.send_multipart([b"", b"fits"])
    assert shell.request()[1] == [b"fits"]


def raw_client(shell: Shell, kind: bool, titan: Robot) -> tuple[socket.socket, ZmtpSession]:
    """A client that may break every rule behind its handshake."""
    keys = (OF_IO.curve, OF_IO.public.curve, OF_TITAN.public.curve)
    mechanism = CurveClient(*keys) if kind is PROTECTED else Null(b"DEALER")
    session = ZmtpSession(MAX_REQUEST_BYTES, mechanism=mechanism)
    client = socket.create_connection((titan.listen, titan.port_for("io")), timeout=20)
    client.setblocking(False)
    client.sendall(session.hello)
    while not session.ready:
        assert shell.turn(1) == []
        with contextlib.suppress(BlockingIOError):
            client.sendall(session.receive(client.recv(1000)))
    return client, session


def test_a_message_whose_parts_never_end_never_gets_in(shell, kind, titan, clients):
    """Nor does it stay: each part is small. libzmq keeps them all, with keys, too."""
    hostile, session = raw_client(shell, kind, titan)
    unsent = memoryview(b"".join(session.encoded([b"", *[bytes(20_000)] * 200])))
    held: list[int] = []
    with hostile:
        while not (refused := shell.port.expire(0.0)):
            with contextlib.suppress(BlockingIOError):
                unsent = unsent[hostile.send(unsent) :] if unsent else unsent
            assert shell.turn() == []
            held += [client.holds_bytes for client in shell.port._router._inside.values()]
    assert refused[0].startswith("a client ")
    assert MAX_REQUEST_BYTES // 2 < max(held) < 2 * MAX_REQUEST_BYTES
    other = clients.dial(titan)
    other.send_multipart([b"", b"?"])
    assert shell.request()[1] == [b"?"]


def test_only_the_key_of_the_peer_opens_its_port(titan):
    with (
        contextlib.closing(Shell(PROTECTED, titan)) as shell,
        contextlib.closing(Clients(protected=False)) as clients,
    ):
        stranger = clients.dial(titan, own=SecretKey(b"x" * 32))
        stranger.send_multipart([b"", b"?"])
        while not (refused := shell.port.expire(0.0)):
            assert shell.turn(20) == []
        assert refused[0] == "a client used a wrong key"
        other = clients.dial(titan, own=OF_TITAN)  # of the team, but not of this port
        other.send_multipart([b"", b"?"])
        while not (refused := shell.port.expire(0.0)):
            assert shell.turn(20) == []
        assert refused[0] == "a client used a wrong key"
        friend = clients.dial(titan, own=OF_IO)
        friend.send_multipart([b"", b"?"])
        assert shell.request()[1] == [b"?"]


def test_strangers_do_not_push_out_who_has_the_key(titan):
    """However many connections they hold, and however long the peer has sent nothing."""
    with (
        contextlib.closing(Shell(PROTECTED, titan)) as shell,
        contextlib.closing(Clients(protected=True)) as clients,
        contextlib.ExitStack() as stack,
    ):
        friend = clients.dial(titan)
        friend.send_multipart([b"", b"?"])
        route, _ = shell.request()
        for _ in range(2 * MAX_CONNECTIONS):
            place = (titan.listen, titan.port_for("io"))
            stack.enter_context(socket.create_connection(place, timeout=20))
        refused: list[str] = []
        while len(refused) < MAX_CONNECTIONS:
            assert shell.turn(20) == []
            refused += shell.port.expire(0.0)
        assert set(refused) == {"a client connected too often"}
        shell.port.reply(route, b"!")
        assert friend.poll(WAIT_MS)
        assert friend.recv_multipart() == [b"", b"!"]


def asleep(shell: Shell, titan: Robot, clients: Clients) -> tuple[zmq.Socket, int, int]:
    """A client that sends and does not read: how many requests it sent, how many got in."""
    client = clients.dial(titan, asleep=True)
    served = sent = idle = 0
    while idle < 10:
        assert sent < 2000, "it takes everything"
        if sent < served + 3:
            client.send_multipart([b"", sent.to_bytes(4)])
            sent += 1
        count = len(shell.serve(LARGE))
        served += count
        idle = 0 if count else idle + 1
        if not count:
            shell.poller.poll(20)
    return client, sent, served


def test_replies_that_are_not_read_wait_in_order_and_the_requests_behind_them(
    shell, titan, clients
):
    """As with REP, whose turn does not come while its reply does not leave."""
    client, sent, served = asleep(shell, titan, clients)
    assert served < sent
    total = sent + 50
    for each in range(sent, total):
        client.send_multipart([b"", each.to_bytes(4)])
    other = clients.dial(titan)
    other.send_multipart([b"", b"?"])
    while b"?" not in (got := shell.serve(b"!")):
        assert got == []
    assert other.poll(WAIT_MS)
    assert other.recv_multipart() == [b"", b"?!"]
    for each in range(total):
        while not client.poll(5):
            shell.serve(LARGE)
        assert client.recv_multipart()[1][:4] == each.to_bytes(4)
    assert shell.port.wait_ms > 100


def test_a_connection_that_does_not_read_goes_with_its_replies(shell, titan, clients):
    client, _, _ = asleep(shell, titan, clients)
    client.close(0)
    for _ in range(WAIT_MS // 10):
        shell.turn(10)
        if shell.port.wait_ms > 100:
            break
    assert shell.port.wait_ms > 100


# --- frames of a sync


def test_a_connection_that_is_gone_is_known_to_be(shell, titan, clients):
    client = clients.dial(titan)
    client.send_multipart([b"", b"?"])
    route, _ = shell.request()
    port = shell.port
    assert port.standing(route)
    client.close(0)
    for _ in range(WAIT_MS // 10):
        shell.turn(10)
        port.push(route, [b"to whom"])
        if not port.standing(route):
            break
    assert not port.standing(route)
    assert port.flush(route)


def stuck(shell: Shell, titan: Robot, clients: Clients) -> tuple[zmq.Socket, tuple, int]:
    """A connection that takes no more: it, its route, and how many frames went out."""
    client = clients.dial(titan, asleep=True)
    client.send_multipart([b"", b"?"])
    route, _ = shell.request()
    sent, port = 0, shell.port

    def takes() -> bool:
        """At once, or when libzmq's thread at the other end has come to what is there."""
        if not port.flush(route):
            shell.poller.poll(100)
        return port.flush(route)

    while takes():
        assert sent < 1000, "it takes everything"
        port.push(route, [sent.to_bytes(4) + LARGE])
        sent += 1
    assert sent > 1
    return client, route, sent


def test_what_a_connection_does_not_take_waits_and_keeps_its_order(shell, titan, clients):
    client, route, sent = stuck(shell, titan, clients)
    port = shell.port
    assert not port.flush(route)
    for number in range(sent):
        while not client.poll(10):
            port.flush(route)
        assert client.recv_multipart()[1][:4] == number.to_bytes(4)
    assert port.flush(route)
    assert not client.poll(10)


@pytest.mark.parametrize("other", [None, (b"other", b"")])
def test_what_waits_does_not_hold_up_another_connection(shell, titan, clients, other):
    _, route, _ = stuck(shell, titan, clients)
    port = shell.port
    assert not port.flush(route)
    assert port.flush(other)
    assert not port.flush(route)


def test_a_connection_that_sleeps_does_not_hold_up_the_next_one(field, clients, monkeypatch):
    """The link broke in mid-sync, TCP has not noticed; the peer comes again and is served."""
    held_up, flush = threading.Event(), Port.flush

    def watched(port: Port, *args: object) -> bool:
        out = flush(port, *args)
        if not out:
            held_up.set()
        return out

    monkeypatch.setattr(Port, "flush", watched)
    titan, _, _ = field.node("titan", datagrams=False)
    titan.publish("/map", os.urandom(30_000_000))
    opening = sync_messages.Open(7, 0, Have(()), config_hash=config_hash_of(titan.team)).encode()
    (frame,) = sync.message_frames(sync.OPEN, 0, opening, 1100)
    grant = struct.pack(">QI", 1 << 40, 1_000_000)
    sleeper = clients.dial(titan.robot, asleep=True)
    sleeper.send_multipart([b"", b"ididid" + b"SYNC1" + grant + frame])
    assert held_up.wait(60)
    _, _, saw = field.node("io", datagrams=False)
    assert saw.pull("titan").messages == 1


# --- datagrams


@pytest.fixture
def sender(titan) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((titan.listen, 0))
        sender.connect((titan.listen, titan.port_for("io")))
        sender.settimeout(20)
        yield sender


def ready(port: Port) -> dict[Polled, Hashable]:
    with contextlib.closing(Poller()) as poller:
        port.watch(poller)
        return poller.poll(WAIT_MS)


def test_datagrams_go_back_to_where_the_peer_was_seen(kind, port, sender):
    io = LinkKeys(OF_IO, {"titan": OF_TITAN.public}) if kind is PROTECTED else LinkKeys()
    port.send_datagram(b"to no peer yet")
    sender.send(io.seal("titan", b"hello"))
    assert ready(port)
    ((packet, port.datagram_address),) = port.packets(64)
    assert packet == b"hello"
    port.send_datagram(b"hello back")
    assert io.open("titan", sender.recv(100)) == b"hello back"


def test_a_protected_port_drops_datagrams_that_the_peer_did_not_seal(kind, port, sender):
    sender.send(b"hello")
    assert ready(port)
    assert [packet for packet, _ in port.packets(64)] == ([] if kind is PROTECTED else [b"hello"])


def test_a_datagram_port_that_is_taken_is_done_without(kind, titan, caplog):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((titan.listen, titan.port_for("io")))
        with contextlib.closing(Shell(kind, titan)) as shell:
            port = shell.port
            assert f"no datagrams on port {titan.port_for('io')} of titan" in caplog.text
            assert list(port.packets(64)) == []
            port.datagram_address = other.getsockname()
            port.send_datagram(b"nothing")
            assert len(shell.poller._selector.get_map()) == 1


# --- beginning and end


def test_a_port_that_is_taken(kind, titan):
    number = titan.port_for("io")
    with (
        socket.create_server((titan.listen, number)),
        pytest.raises(PortInUseError, match=f"titan cannot listen for io on tcp://.*:{number}"),
    ):
        Shell(kind, titan)
    with contextlib.closing(Shell(kind, titan)):
        pass


def test_an_address_that_is_none(kind, titan):
    with pytest.raises(ListenError, match="set 'listen' of titan to"):
        Shell(kind, titan.model_copy(update={"listen": "not.an.address.invalid"}))


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux binds to what is not there yet")
def test_an_address_that_comes_later(kind, titan, caplog):
    away = titan.model_copy(update={"listen": "203.0.113.7"})
    with contextlib.closing(Shell(kind, away)):
        assert "203.0.113.7 is no address of this machine now" in caplog.text
        assert "no datagrams" not in caplog.text
        with pytest.raises(PortInUseError):
            Shell(kind, away)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as again:  # nothing is left there
        again.setsockopt(socket.IPPROTO_IP, 15, 1)
        again.bind((away.listen, away.port_for("io")))


def test_a_client_that_never_stops_does_not_keep_the_node(shell, titan, clients):
    """Messages without an envelope as fast as they are read, and requests."""
    flood = clients.dial(titan)
    other = clients.dial(titan)
    other.send_multipart([b"", b"?"])
    while not (found := shell.turn(20)):
        pass
    assert [request for _, request in found] == [[b"?"]]
    for number in range(300):
        flood.send_multipart([b"", b"%d" % number] if number % 2 else [b"nothing"])
    got: list[bytes] = []
    while len(got) < 150:
        turn = [request for _, (request,) in shell.turn(20)]
        assert len(turn) <= BURST
        got += turn
    assert got == [b"%d" % number for number in range(1, 300, 2)]
