"""Real sockets: who gets in at a protected port, who does not, and what is told of it."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest
import zmq
from zmq.utils.monitor import parse_monitor_message

from mocha_link.node import curve
from mocha_link.node.curve import CurveUnavailableError, Refusal, ZapHandler
from mocha_link.team.keys import SecretKey

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
        self.zap_handler = ZapHandler(self.context, allowed)

    def open(self, peer: str, *, protect: bool = True) -> int:
        door = self.context.socket(zmq.ROUTER)
        if protect:
            curve.protect_port(door, TITAN, peer)
            self.zap_handler.watch(door, peer)
        self.doors[door] = peer
        self.poller.register(door, zmq.POLLIN)
        for each in self.zap_handler.sockets:
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
            if ready.intersection(self.zap_handler.sockets):
                self.refusals += self.zap_handler.serve()
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
        self.zap_handler.close()
        self.context.destroy(0)
        self.clients.destroy(0)


@pytest.fixture
def hall() -> Iterator[Hall]:
    with contextlib.closing(Hall()) as hall:
        yield hall


def holding(own: SecretKey, server: SecretKey = TITAN) -> Setting:
    return lambda client: curve.protect_contact(client, own, server.public)


def test_each_port_has_its_own_key(hall, caplog):
    port = hall.open("io")
    with caplog.at_level(logging.WARNING):
        events = hall.refused(hall.dial(port, holding(EUROPA)))  # of the team, but not for here
    assert zmq.Event.HANDSHAKE_FAILED_AUTH in events
    assert set(hall.refusals) == {Refusal("io", "with a wrong key")}
    assert hall.zap_handler.refused["io"] == len(hall.refusals)
    assert "refused at the port for io: it came with a wrong key" in caplog.messages
    assert hall.ask(hall.dial(port, holding(IO))) == b"io hears you"
    assert len([m for m in caplog.messages if m.startswith("refused")]) == 1  # told once


def test_a_port_whose_peer_the_zap_handler_does_not_know_stays_shut(hall):
    hall.refused(hall.dial(hall.open("intruder"), holding(IO)))
    assert set(hall.refusals) == {Refusal("intruder", "with a wrong key")}


def test_a_context_has_one_zap_handler(hall):
    with pytest.raises(zmq.ZMQError):
        ZapHandler(hall.context, {})


def test_closing_in_either_order():
    for first in ("handler", "door"):
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
