"""Real sockets: who gets in at a protected port, who does not, and what is told of it."""

from __future__ import annotations

import contextlib
import logging
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest
import zmq
from zmq.utils.monitor import parse_monitor_message

from mocha_link import curve
from mocha_link.curve import CurveUnavailableError, Gatekeeper, Refusal
from mocha_link.keys import SecretKey
from mocha_link.zmtp import Connection

WAIT_S = 60  # a limit against hangs
TITAN, IO, EUROPA = (SecretKey(bytes([number]) * 32) for number in (1, 2, 3))
FAILURES = (
    zmq.Event.HANDSHAKE_FAILED_AUTH
    | zmq.Event.HANDSHAKE_FAILED_PROTOCOL
    | zmq.Event.HANDSHAKE_FAILED_NO_DETAIL
    | zmq.Event.DISCONNECTED
)

Setting = Callable[[zmq.Socket[bytes]], None]


@dataclass
class Hall:
    """titan's ports, served by one poller, and clients in a context of their own."""

    context: zmq.Context = field(default_factory=zmq.Context)
    clients: zmq.Context = field(default_factory=zmq.Context)
    poller: zmq.Poller = field(default_factory=zmq.Poller)
    doors: dict = field(default_factory=dict)
    refusals: list = field(default_factory=list)

    def __post_init__(self) -> None:
        allowed = {"io": IO.public, "europa": EUROPA.public}
        self.gatekeeper = Gatekeeper(self.context, allowed)

    def open(self, peer: str, *, protect: bool = True) -> int:
        door = self.context.socket(zmq.ROUTER)
        if protect:
            curve.protect_port(door, TITAN, peer)
            self.gatekeeper.watch(door, peer)
        self.doors[door] = peer
        self.poller.register(door, zmq.POLLIN)
        for each in self.gatekeeper.sockets:
            self.poller.register(each, zmq.POLLIN)
        return door.bind_to_random_port("tcp://127.0.0.1")

    def dial(self, port: int, *settings: Setting) -> zmq.Socket[bytes]:
        client = self.clients.socket(zmq.DEALER)
        client.setsockopt(zmq.LINGER, 0)
        for setting in settings:
            setting(client)
        self.poller.register(client.get_monitor_socket(FAILURES), zmq.POLLIN)
        client.connect(f"tcp://127.0.0.1:{port}")
        self.poller.register(client, zmq.POLLIN)
        return client

    def serve_until(self, done: Callable[[], bool]) -> None:
        """Echo every request as the port's peer until `done`."""
        limit_s = time.monotonic() + WAIT_S
        while not done():
            assert time.monotonic() < limit_s, "hangs"
            ready = {each for each, _ in self.poller.poll(100)}
            if ready.intersection(self.gatekeeper.sockets):
                self.refusals += self.gatekeeper.serve()
            for door, peer in self.doors.items():
                if door in ready:
                    identity, body = door.recv_multipart(zmq.NOBLOCK)
                    door.send_multipart([identity, peer.encode() + body], zmq.NOBLOCK)

    def ask(self, client: zmq.Socket[bytes]) -> bytes:
        client.send(b" hears you")
        self.serve_until(lambda: bool(client.poll(0)))
        return client.recv(zmq.NOBLOCK)

    def refused(self, client: zmq.Socket[bytes]) -> list[int]:
        """Serve until the client knows that it failed and we know it, too; how it failed."""
        monitor = client.get_monitor_socket()
        before = len(self.refusals)
        self.serve_until(lambda: bool(monitor.poll(0)) and len(self.refusals) > before)
        assert not client.poll(0)
        events = []
        while monitor.poll(0):
            events.append(parse_monitor_message(monitor.recv_multipart())["event"])
        return events

    def close(self) -> None:
        self.gatekeeper.close()
        self.context.destroy(0)
        self.clients.destroy(0)


@pytest.fixture
def hall() -> Iterator[Hall]:
    with contextlib.closing(Hall()) as hall:
        yield hall


def holding(own: SecretKey, server: SecretKey = TITAN) -> Setting:
    return lambda client: curve.protect_contact(client, own, server.public)


def test_the_right_key_enters(hall):
    assert hall.ask(hall.dial(hall.open("io"), holding(IO))) == b"io hears you"
    assert hall.ask(hall.dial(hall.open("europa"), holding(EUROPA))) == b"europa hears you"
    assert not hall.refusals


def test_each_port_has_its_own_key(hall, caplog):
    port = hall.open("io")
    with caplog.at_level(logging.WARNING):
        events = hall.refused(hall.dial(port, holding(EUROPA)))  # of the team, but not for here
    assert zmq.Event.HANDSHAKE_FAILED_AUTH in events
    assert set(hall.refusals) == {Refusal("io", "with a wrong key")}
    assert hall.gatekeeper.refused["io"] == len(hall.refusals)
    assert "refused at the port for io: it came with a wrong key" in caplog.messages
    assert hall.ask(hall.dial(port, holding(IO))) == b"io hears you"
    assert len([m for m in caplog.messages if m.startswith("refused")]) == 1  # told once


def test_a_stranger_does_not_enter(hall):
    port = hall.open("io")
    hall.refused(hall.dial(port, holding(SecretKey.generate())))
    assert hall.ask(hall.dial(port, holding(IO))) == b"io hears you"


def test_whoever_takes_us_for_another_does_not_talk_to_us(hall):
    port = hall.open("io")
    hall.refused(hall.dial(port, holding(IO, server=EUROPA)))
    assert set(hall.refusals) == {Refusal("io", "with a wrong key")}


def test_an_original_node_does_not_enter(hall):
    """It says all that it would say, and waits.

    (A socket of libzmq sees by itself that the port wants a key, and hangs up. If that is first,
    the port sees a connection that was reset, and nobody comes again.)
    """
    port = hall.open("io")
    with socket.create_connection(("127.0.0.1", port), timeout=WAIT_S) as connection:
        connection.sendall(Connection.hello + Connection.request(b"idididGHEAD"))
        connection.setblocking(False)
        said = bytearray()

        def closed() -> bool:
            try:
                data = connection.recv(4096)
            except BlockingIOError:
                return False
            except ConnectionError:
                return True
            said.extend(data)
            return not data

        hall.serve_until(lambda: closed() and bool(hall.refusals))
    assert b"ididid" not in said
    assert set(hall.refusals) == {Refusal("io", "without encryption")}
    assert hall.ask(hall.dial(port, holding(IO))) == b"io hears you"


def test_noise_does_not_enter(hall):
    port = hall.open("io")
    for noise in (
        b"GET / HTTP/1.1\r\n\r\n" * 10,
        bytes(200),
        b"\xff" * 9 + b"\x7f\x03" + bytes(99),
    ):
        with socket.create_connection(("127.0.0.1", port), timeout=WAIT_S) as connection:
            with contextlib.suppress(OSError):  # it may be thrown out in the middle
                connection.sendall(noise)
                connection.shutdown(socket.SHUT_WR)
            connection.setblocking(False)

            def closed(connection: socket.socket = connection) -> bool:
                try:
                    return not connection.recv(4096)
                except BlockingIOError:
                    return False
                except ConnectionError:
                    return True

            hall.serve_until(closed)
    assert hall.ask(hall.dial(port, holding(IO))) == b"io hears you"


def test_links_without_keys_stay_as_they_are(hall):
    hall.open("io")
    assert hall.ask(hall.dial(hall.open("callisto", protect=False))) == b"callisto hears you"
    assert not hall.refusals


def test_a_protected_client_does_not_talk_to_an_unprotected_port(hall):
    client = hall.dial(hall.open("callisto", protect=False), holding(IO))
    client.send(b"secret")
    monitor = client.get_monitor_socket()
    hall.serve_until(lambda: bool(monitor.poll(0)))
    assert not client.poll(0)


def test_a_port_whose_peer_the_gatekeeper_does_not_know_stays_shut(hall):
    hall.refused(hall.dial(hall.open("stranger"), holding(IO)))
    assert set(hall.refusals) == {Refusal("stranger", "with a wrong key")}


def test_many_at_once_with_wrong_keys(hall):
    port = hall.open("io")
    for _ in range(40):
        hall.dial(port, holding(SecretKey.generate()))
    client = hall.dial(port, holding(IO))
    assert hall.ask(client) == b"io hears you"
    hall.serve_until(lambda: hall.gatekeeper.refused["io"] >= 40)
    assert hall.ask(client) == b"io hears you"


def test_what_crosses_is_not_readable(hall):
    port = hall.open("io")
    seen = bytearray()
    with socket.create_server(("127.0.0.1", 0)) as listener, contextlib.ExitStack() as stack:
        client = hall.dial(listener.getsockname()[1], holding(IO))
        near = stack.enter_context(listener.accept()[0])
        far = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
        for end in (near, far):
            end.setblocking(False)
            hall.poller.register(end, zmq.POLLIN)

        def relayed() -> bool:
            for source, sink in ((near, far), (far, near)):
                with contextlib.suppress(BlockingIOError):
                    data = source.recv(65536)
                    seen.extend(data)
                    sink.send(data)
            return bool(client.poll(0))

        client.send(b" hears you")
        hall.serve_until(relayed)
    assert client.recv() == b"io hears you"
    assert b"hears" not in seen
    assert len(seen) > 200


def test_a_context_has_one_gatekeeper(hall):
    with pytest.raises(zmq.ZMQError):
        Gatekeeper(hall.context, {})


def test_closing_in_either_order():
    for first in ("gatekeeper", "door"):
        with contextlib.closing(Hall()) as hall:
            hall.open("io")
            if first == "door":
                for door in hall.doors:
                    door.close(0)
    assert hall.context.closed


def test_a_libzmq_without_curve(hall, monkeypatch):
    monkeypatch.setattr(zmq, "has", lambda _: False)
    with contextlib.closing(hall.context.socket(zmq.ROUTER)) as door:
        with pytest.raises(CurveUnavailableError, match="built without CURVE"):
            curve.protect_port(door, TITAN, "io")
        with pytest.raises(CurveUnavailableError, match="built without CURVE"):
            curve.protect_contact(door, TITAN, IO.public)
