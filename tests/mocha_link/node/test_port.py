"""The port for a peer: what gets in, what gets out, and what happens when it has no reader."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace

import pytest
import zmq

from mocha_link.errors import ListenError, PortInUseError
from mocha_link.links.metrics import Direction, SyncEnded
from mocha_link.node import port as port_module
from mocha_link.node.curve import CurveUnavailableError
from mocha_link.node.kernel import DATAGRAM_BYTES
from mocha_link.node.port import (
    MAX_REQUEST_BYTES,
    QUEUE_REPLIES,
    QUEUE_REQUESTS,
    Port,
)
from mocha_link.store.config_hash import config_hash_of
from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.sync_messages import Have
from mocha_link.team.team import Robot
from tests.mocha_link.conftest import free_ports, own_host

WAIT_MS = 20_000
LARGE = bytes(1_000_000)


@pytest.fixture
def context() -> Iterator[zmq.Context]:
    context = zmq.Context()
    yield context
    context.destroy(0)


@pytest.fixture
def titan(team) -> Robot:
    host = own_host()
    return replace(team.robot("titan"), listen=host, address=host, base_port=free_ports(host, 2))


@pytest.fixture
def port(context, titan) -> Iterator[Port]:
    with contextlib.closing(Port(context, titan, "io", None)) as port:
        yield port


class Clients:
    """Those who connect to the port, with a context of their own."""

    def __init__(self) -> None:
        self._context = zmq.Context()
        self._sockets: list[zmq.Socket] = []

    def dial(self, titan: Robot, kind: int = zmq.DEALER, *, asleep: bool = False) -> zmq.Socket:
        client = self._context.socket(kind)
        self._sockets.append(client)
        client.setsockopt(zmq.LINGER, 0)
        if asleep:  # it takes little ahead of what is read
            client.setsockopt(zmq.RCVHWM, 1)
            client.setsockopt(zmq.RCVBUF, 65_536)
        client.connect(f"tcp://{titan.listen}:{titan.port_for('io')}")
        return client

    def close(self) -> None:
        for each in self._sockets:
            each.close(0)
        self._context.term()


@pytest.fixture
def clients() -> Iterator[Clients]:
    with contextlib.closing(Clients()) as clients:
        yield clients


def next_request(port: Port) -> tuple[tuple[bytes, ...], list[bytes]]:
    while (request := port.receive()) is None:
        assert port.socket.poll(WAIT_MS)
    return request


# --- requests and replies


@pytest.mark.parametrize("kind", [zmq.REQ, zmq.DEALER])
def test_a_request_and_its_reply(port, titan, clients, kind):
    client = clients.dial(titan, kind)
    envelope = [] if kind == zmq.REQ else [b""]
    client.send_multipart([*envelope, b"idididGHEAD"])
    route, parts = next_request(port)
    assert parts == [b"idididGHEAD"]
    assert port.receive() is None
    port.reply(route, b"idididlist")
    assert client.poll(WAIT_MS)
    assert client.recv_multipart() == [*envelope, b"idididlist"]


def test_what_has_no_envelope_is_ignored(port, titan, clients):
    """As REP ignores it; what has a longer one gets it back."""
    client = clients.dial(titan)
    client.send_multipart([b"no envelope"])
    client.send_multipart([b""])
    client.send_multipart([b"no", b"envelope"])
    client.send_multipart([b"hop", b"", b"one", b"", b"two"])
    route, parts = next_request(port)
    assert parts == [b"one", b"", b"two"]
    port.reply(route, b"reply")
    assert client.poll(WAIT_MS)
    assert client.recv_multipart() == [b"hop", b"", b"reply"]


def test_a_request_that_is_too_large_never_gets_in(port, titan, clients):
    client = clients.dial(titan)
    client.send_multipart([b"", bytes(MAX_REQUEST_BYTES)])
    assert next_request(port)[1] == [bytes(MAX_REQUEST_BYTES)]
    client.send_multipart([b"", bytes(MAX_REQUEST_BYTES + 1)])
    other = clients.dial(titan)
    other.send_multipart([b"", b"fits"])
    assert next_request(port)[1] == [b"fits"]


def test_a_reply_to_a_peer_that_is_gone_is_dropped(port, titan, clients):
    client = clients.dial(titan)
    client.send_multipart([b"", b"?"])
    route, _ = next_request(port)
    client.close(0)
    for _ in range(100):
        port.reply(route, LARGE)
    port.reply((b"absent", b""), b"reply")
    port.push((b"absent", b""), [b"frame"])
    assert port.flush((b"absent", b""))


def asleep(port: Port, titan: Robot, clients: Clients) -> tuple[zmq.Socket, tuple, int]:
    """A connection that asks and does not read: it, its route, and how many requests it sent."""
    client = clients.dial(titan, asleep=True)
    number = 0
    while not port.is_late:
        assert number < 1000, "it takes everything"
        client.send_multipart([b"", number.to_bytes(4)])
        route, (request,) = next_request(port)
        port.reply(route, request + LARGE)
        number += 1
    assert number > QUEUE_REPLIES
    return client, route, number


def test_replies_that_are_not_read_wait_in_order_and_the_requests_behind_them(port, titan, clients):
    """As with REP, whose turn does not come while its reply does not leave."""
    client, route, number = asleep(port, titan, clients)
    total = number + 50
    for each in range(number, total):
        client.send_multipart([b"", each.to_bytes(4)])
    other = clients.dial(titan)
    other.send_multipart([b"", b"?"])
    other_route, _ = next_request(port)  # when it is here the others are, too
    assert other_route != route
    while port.socket.poll(50):
        assert port.receive() is None
    for each in range(total):
        while not client.poll(5):
            for to, (request,) in port.resumed():
                assert to == route
                port.reply(to, request + LARGE)
        assert client.recv_multipart()[1][:4] == each.to_bytes(4)
    assert not port.is_late


def test_only_so_many_requests_wait(port, titan, clients):
    client, _, number = asleep(port, titan, clients)
    for each in range(number, number + QUEUE_REQUESTS + 50):
        client.send_multipart([b"", each.to_bytes(4)])
    while port.socket.poll(50):
        assert port.receive() is None
    waiting = [len(late.requests) for late in port._late.values()]
    assert waiting == [QUEUE_REQUESTS]


def test_a_connection_that_does_not_read_holds_up_no_other_and_goes_with_its_replies(
    port, titan, clients
):
    client, _, _ = asleep(port, titan, clients)
    other = clients.dial(titan)
    for number in range(5):
        other.send_multipart([b"", b"%d" % number])
        route, parts = next_request(port)
        port.reply(route, b"to " + parts[0])
        assert other.poll(WAIT_MS)
        assert other.recv_multipart() == [b"", b"to %d" % number]
        assert list(port.resumed()) == []
    client.close(0)
    poller = zmq.Poller()
    poller.register(other, zmq.POLLIN)
    for _ in range(1000):
        assert list(port.resumed()) == []
        assert port.receive() is None
        if not port.is_late:
            break
        poller.poll(10)
    assert not port.is_late


# --- frames of a sync


def stuck(port: Port, titan: Robot, clients: Clients) -> tuple[zmq.Socket, tuple, int]:
    """A connection that takes no more: it, its route, and how many frames went out."""
    client = clients.dial(titan, asleep=True)
    client.send_multipart([b"", b"?"])
    route, _ = next_request(port)
    sent = 0
    while port.flush(route):
        assert sent < 1000, "it takes everything"
        port.push(route, [sent.to_bytes(4) + LARGE])
        sent += 1
    assert sent > QUEUE_REPLIES
    return client, route, sent


def test_what_a_connection_does_not_take_waits_and_keeps_its_order(port, titan, clients):
    client, route, sent = stuck(port, titan, clients)
    assert not port.flush(route)
    for number in range(sent):
        while not client.poll(10):
            port.flush(route)
        assert client.recv_multipart()[1][:4] == number.to_bytes(4)
    assert port.flush(route)
    assert not client.poll(10)


@pytest.mark.parametrize("other", [None, (b"other", b"")])
def test_what_waits_for_another_connection_than_that_of_the_sync_goes(port, titan, clients, other):
    _, route, _ = stuck(port, titan, clients)
    assert not port.flush(route)
    assert port.flush(other)
    assert port.flush(route)


def test_replies_do_not_wait_for_frames_that_wait(port, titan, clients):
    """They belong to another connection."""
    stuck(port, titan, clients)
    other = clients.dial(titan)
    other.send_multipart([b"", b"?"])
    route, _ = next_request(port)
    port.reply(route, b"reply")
    assert other.poll(WAIT_MS)
    assert other.recv_multipart() == [b"", b"reply"]


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
    io, _, saw = field.node("io", datagrams=False)
    io.sync("titan")
    assert saw.wait(SyncEnded, peer="titan", direction=Direction.IN).messages == 1


# --- datagrams


@pytest.fixture
def sender(titan) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((titan.listen, 0))
        sender.connect((titan.listen, titan.port_for("io")))
        sender.settimeout(20)
        yield sender


def ready(port: Port) -> set[object]:
    poller = zmq.Poller()
    port.watch(poller)
    return {each for each, _ in poller.poll(WAIT_MS)}


def test_datagrams_come_to_the_same_number(port, sender):
    for number in range(5):
        sender.send(b"%d" % number)
    assert port.is_ready(ready(port))
    assert [packet for packet, _ in port.packets(3)] == [b"0", b"1", b"2"]
    got = list(port.packets(64))
    assert got == [(b"3", sender.getsockname()), (b"4", sender.getsockname())]
    assert list(port.packets(64)) == []


def test_datagrams_go_back_to_where_the_peer_was_seen(port, sender):
    port.send_datagram(b"to no peer yet")
    sender.send(b"hello")
    assert port.is_ready(ready(port))
    ((_, port.caller),) = port.packets(64)
    port.send_datagram(b"hello back")
    assert sender.recv(100) == b"hello back"


def test_a_caller_that_is_gone_stops_nothing(port, titan, sender):
    """The kernel may tell of it with the next datagram."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as gone:
        gone.bind((titan.listen, 0))
        port.caller = gone.getsockname()
    for _ in range(3):
        port.send_datagram(b"hello?")
    sender.send(b"absent")
    assert port.is_ready(ready(port))
    assert [packet for packet, _ in port.packets(64)] == [b"absent"]


def test_empty_and_long_datagrams(port, sender):
    sender.send(b"")
    sender.send(bytes(DATAGRAM_BYTES + 500))
    sender.send(b"end")
    assert port.is_ready(ready(port))
    assert [len(packet) for packet, _ in port.packets(64)] == [0, DATAGRAM_BYTES, 3]
    port.caller = sender.getsockname()
    # More than the kernel takes: dropped like any other on the way.
    port.send_datagram(bytes(70_000))


def test_a_datagram_port_that_is_taken_is_done_without(context, titan, caplog):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((titan.listen, titan.port_for("io")))
        with contextlib.closing(Port(context, titan, "io", None)) as port:
            assert f"no datagrams on port {titan.port_for('io')} of titan" in caplog.text
            assert not port.is_ready(set())
            assert list(port.packets(64)) == []
            port.caller = other.getsockname()
            port.send_datagram(b"nothing")
            poller = zmq.Poller()
            port.watch(poller)
            assert [each for each, _ in poller.sockets] == [port.socket]


# --- beginning and end


def test_a_port_that_is_taken(context, titan):
    number = titan.port_for("io")
    with (
        socket.create_server((titan.listen, number)),
        pytest.raises(PortInUseError, match=f"titan cannot listen for io on tcp://.*:{number}"),
    ):
        Port(context, titan, "io", None)
    with contextlib.closing(Port(context, titan, "io", None)):
        pass


def test_an_address_that_is_none(context, titan):
    with pytest.raises(ListenError, match="set 'listen' of titan to"):
        Port(context, replace(titan, listen="not.an.address.invalid"), "io", None)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux binds to what is not there yet")
def test_an_address_that_comes_later(context, titan, caplog):
    away = replace(titan, listen="203.0.113.7")
    with contextlib.closing(Port(context, away, "io", None)):
        assert "203.0.113.7 is no address of this machine now" in caplog.text
        assert "no datagrams" not in caplog.text
        with pytest.raises(PortInUseError):
            Port(context, away, "io", None)
    context.destroy(0)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as again:  # nothing is left there
        again.setsockopt(socket.IPPROTO_IP, 15, 1)
        again.bind((away.listen, away.port_for("io")))


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux binds to what is not there yet")
def test_another_system_says_that_an_address_is_not_there(context, titan, monkeypatch):
    monkeypatch.setattr("mocha_link.node.kernel._IP_FREEBIND", 9999)  # unknown, as there
    with pytest.raises(ListenError, match="set 'listen' of titan to"):
        Port(context, replace(titan, listen="203.0.113.7"), "io", None)


def test_every_address_of_the_machine(context, titan, clients):
    everywhere = replace(titan, listen="*", base_port=free_ports("0.0.0.0", 2))
    titan = replace(everywhere, listen=titan.listen)
    with contextlib.closing(Port(context, everywhere, "io", None)) as port:
        client = clients.dial(titan)
        client.send_multipart([b"", b"?"])
        assert next_request(port)[1] == [b"?"]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"!", (titan.listen, titan.port_for("io")))
            assert port.is_ready(ready(port))
            assert [packet for packet, _ in port.packets(64)] == [b"!"]


def test_a_closed_port_is_free_when_its_context_is_gone(titan, clients):
    """Also in the middle of something."""
    for _ in range(3):
        context = zmq.Context()
        with contextlib.closing(Port(context, titan, "io", None)) as port:
            client = clients.dial(titan)
            client.send_multipart([b"", b"?"])
            route, _ = next_request(port)
            for _ in range(50):
                port.push(route, [LARGE])
        context.term()
        client.close(0)


def test_a_client_that_never_stops_does_not_keep_the_node(port, monkeypatch):
    """Messages without an envelope, faster than they are read."""

    class Flood:
        left = 10_000

        def recv_multipart(self, _flags: int) -> list[bytes]:
            assert self.left, "it goes on and on"
            self.left -= 1
            return [b"absent", b""]

        def close(self, _linger: int) -> None:
            pass

    with contextlib.closing(port.socket):
        monkeypatch.setattr(port, "socket", Flood())
        assert port.receive() is None


def test_a_port_that_cannot_be_protected_leaves_no_socket(titan, monkeypatch):
    """An open socket would keep the context from its end for ever."""
    context = zmq.Context()

    def refuse(*_: object) -> None:
        raise CurveUnavailableError("built without CURVE")

    monkeypatch.setattr(port_module, "protect_port", refuse)
    with pytest.raises(CurveUnavailableError) as _kept_with_its_traceback:
        Port(context, titan, "io", object())
    ending = threading.Thread(target=context.term, daemon=True)
    ending.start()
    ending.join(WAIT_MS / 1000)
    assert not ending.is_alive()
