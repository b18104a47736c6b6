"""The shell of a node: what it leaves behind, whom it listens to, what it survives."""

import contextlib
import gc
import math
import os
import socket
import threading
import time
from collections.abc import Hashable, Iterator, Sequence
from pathlib import Path

import pytest

from mocha_link.clock import Instant, SystemClock
from mocha_link.errors import GUARD_LOG_S, Guard
from mocha_link.links.metrics import (
    Direction,
    MessageStored,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.node.connection import Connection
from mocha_link.node.gossip import Gossip
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.node import Node
from mocha_link.node.router import ClientConnection
from mocha_link.node.zmtp import Part
from mocha_link.radios import ManualRadio
from mocha_link.sync.pull import NEAR_CONNECT_S
from mocha_link.sync.session import Session
from tests.mocha_link.conftest import WAIT_S, Witness, free_ports

IN, OUT = Direction.IN, Direction.OUT
FDS = Path("/proc/self/fd")


def descriptors() -> set[str]:
    return {f"{each.name} {each.readlink()}" for each in FDS.iterdir() if each.is_symlink()}


@pytest.mark.skipif(not FDS.is_dir(), reason="what is open can be listed on Linux only")
def test_no_descriptor_is_left(field, tmp_path):
    """Of nodes in the middle of everything: pulls that go on, that hang, that were refused."""
    field.node("callisto")  # libzmq keeps some things of the first context of a process
    gc.collect()  # what tests before left to be collected would close during this one
    before = len(descriptors())
    for _ in range(3):
        with contextlib.ExitStack() as stack:
            titan = Node(field.team, "titan", radio=ManualRadio(), storage=tmp_path / "t.db")
            io = Node(field.team, "io", radio=ManualRadio())
            stored = threading.Event()
            io.subscribe(lambda e, s=stored: s.set() if isinstance(e, MessageStored) else None)
            stack.enter_context(titan)
            stack.enter_context(io)
            titan.publish("/slow", os.urandom(5_000_000))
            titan.publish("/map", b"grid")
            io.sync("titan")
            io.sync("callisto")
            titan.sync("callisto")
            assert stored.wait(WAIT_S)
    assert len(descriptors()) == before


def test_datagrams_from_elsewhere_are_not_listened_to(field):
    """Without keys only the address distinguishes the peer from others."""
    titan, _, saw = field.node("titan")
    port = titan.robot.port_for("io")
    io = Gossip(field.team, "io", by_timer=False)
    now = Instant(time.time(), time.monotonic())
    io.sync("titan", now)
    io.progress("titan", now, 0.5)  # a far peer: datagrams at once
    io.tick(now._replace(steady_s=now.steady_s + NEAR_CONNECT_S))
    packets = [action.packet for action in io.take()[0] if hasattr(action, "packet")]
    assert packets
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as intruder:
        intruder.bind(("127.0.0.1", 0))
        for packet in packets:
            intruder.sendto(packet, (field.host, port))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as friend:
            friend.bind((field.host, 0))
            friend.settimeout(WAIT_S)
            friend.sendto(packets[0], (field.host, port))
            assert friend.recv(2048)
            saw.wait(SyncStarted, peer="io", direction=OUT)
        intruder.setblocking(False)
        with pytest.raises(BlockingIOError):
            intruder.recv(2048)
    assert sum(isinstance(each, SyncStarted) for each in saw.seen) == 1


def test_an_error_in_the_node_is_logged_and_not_its_end(field, caplog, monkeypatch):
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    _, _, saw = field.node("io")
    failed = threading.Event()
    tick = Gossip.tick

    def fail(gossip: Gossip, now: object, *guard: object) -> set[str]:
        if gossip.me.name == "io" and not failed.is_set():
            failed.set()
            raise ValueError("oops")
        return tick(gossip, now, *guard)

    monkeypatch.setattr(Gossip, "tick", fail)
    assert failed.wait(WAIT_S)
    assert saw.pull("titan").messages == 1
    assert "io: an error in the node" in caplog.text


@pytest.mark.parametrize("does", ["tick", "serve", "supply", "request"])
def test_an_error_with_one_peer_does_not_stop_the_others(field, monkeypatch, does):
    titan, _, _ = field.node("titan")
    callisto, _, _ = field.node("callisto")  # the first peer of titan, so it is served first
    _, _, saw = field.node("io", timeout_s=WAIT_S)
    failed = threading.Event()
    real = getattr(Session, does)

    def fail(self: Session, *arguments: object) -> object:
        if self.peer.name == "callisto" and self.peer.node.name == "titan":
            failed.set()
            raise ValueError("oops")
        return real(self, *arguments)

    monkeypatch.setattr(Session, does, fail)
    titan.sync("callisto")
    callisto.sync("titan")
    assert failed.wait(WAIT_S)
    titan.publish("/map", b"grid")
    assert saw.pull("titan").messages == 1


def test_an_error_that_comes_again_and_again_is_logged_now_and_then(caplog):
    now_s = 7.0
    guard = Guard("io: an error", clock=lambda: now_s)
    for step_s in (0.0, 1.0, GUARD_LOG_S - 1.0, 0.5):
        now_s += step_s
        with guard:
            raise ValueError(f"at {now_s:g}")
    with pytest.raises(KeyboardInterrupt), guard:
        raise KeyboardInterrupt
    logged = [(entry.getMessage(), str(entry.exc_info[1])) for entry in caplog.records]
    assert logged == [("io: an error", "at 7"), ("io: an error (2 since the last one)", "at 17")]
    assert guard.errors == 4


def test_a_connection_that_was_replaced_is_not_looked_at(field, monkeypatch):
    """What is done for one peer may replace the connection to the next one of the same turn."""
    with contextlib.ExitStack() as stack:
        io, callisto = (stack.enter_context(socket.socket()) for _ in range(2))
        for listener, peer in ((io, "io"), (callisto, "callisto")):
            listener.bind((field.host, field.team.robot(peer).port_for("titan")))
            listener.listen()
        titan, _, saw = field.node("titan", timeout_s=WAIT_S)  # nothing ends but what is ended here
        lost = Gossip.lost

        def lose_both(gossip: Gossip, peer: str, reason: str, now: Instant) -> None:
            lost(gossip, peer, reason, now)
            if peer == "io":
                lost(gossip, "callisto", "a test", now)
                gossip.sync("callisto", now)

        monkeypatch.setattr(Gossip, "lost", lose_both)
        titan.sync("io")
        first, _ = io.accept()
        titan.sync("callisto")
        stack.enter_context(callisto.accept()[0])
        io.close()  # one that sent requests before the handshake was over dials once more
        first.close()
        saw.wait(SyncTimedOut, peer="io")
        saw.wait(SyncTimedOut, peer="callisto", reason="a test")
        again, _ = callisto.accept()
        again.close()
        reason = saw.wait(SyncTimedOut, peer="callisto").reason
        assert "broke in the ZeroMQ handshake" in reason


def test_robots_with_several_addresses(field):
    """Datagrams may come from another one than the team file has: then all goes over TCP."""
    first = free_ports("0.0.0.0", 6)
    field.team = field.team.with_robots(
        {
            name: {"listen": "*", "base_port": first + 2 * number}
            for number, name in enumerate(("titan", "callisto", "io"))
        }
    )
    titan, _, _ = field.node("titan")
    io, _, saw = field.node("io")
    for number in range(3):
        titan.publish("/map", b"grid %d" % number)
        saw.pull("titan")
        assert io.latest("titan", "/map").data == b"grid %d" % number
        assert io.links()["titan"].path == "zmq"
    assert io.links()["titan"].refused == titan.links()["io"].refused == 0


def test_a_node_at_rest_sleeps_and_looks_at_no_connection(field, monkeypatch):
    sleeps = threading.Event()
    poll = Poller.poll

    def noted(poller: Poller, wait_ms: int) -> dict[Polled, Hashable]:
        if wait_ms > 500:
            sleeps.set()
        return poll(poller, wait_ms)

    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    io, _, saw = field.node("io", clock=SystemClock())
    assert saw.pull("titan").messages == 1
    monkeypatch.setattr(Poller, "poll", noted)
    assert sleeps.wait(WAIT_S)
    looks: list[float] = []
    monkeypatch.setattr(Connection, "is_ready", lambda _, __, now_s: looks.append(now_s))
    dialer = io._transport._dialer
    assert dialer._connections["titan"]
    assert not list(dialer.ready({}, time.monotonic()))
    assert dialer.wait_s(time.monotonic()) == math.inf
    assert not looks


def test_what_is_sent_at_once_leaves_in_one_packet(field, monkeypatch):
    """Each packet wakes the peer, and the radios of both."""
    sent: list[int] = []
    flush = ClientConnection.flush

    def noted(client: ClientConnection) -> bool:
        sent.append(client.waiting_bytes)
        return flush(client)

    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    _, _, saw = field.node("io")
    saw.pull("titan")
    monkeypatch.setattr(ClientConnection, "flush", noted)
    assert saw.pull("titan").messages == 0
    assert len([size for size in sent if size]) == 1  # HELLO, and DONE


def test_who_publishes_does_not_wait_for_all_that_a_peer_has_sent_at_once(field, monkeypatch):
    """A flood of small messages may take seconds; a program that publishes is in between."""
    titan, _, _ = field.node("titan", datagrams=False)
    for number in range(3):
        titan.publish("/map", b"grid %d" % number)
    io, _, saw = field.node("io", datagrams=False)
    between: list[bool] = []
    replies = Connection.replies

    def noted(connection: Connection) -> Iterator[Sequence[Part]]:
        for parts in replies(connection):
            yield parts
            between.append(io._lock.locked())

    monkeypatch.setattr(Connection, "replies", noted)
    assert saw.pull("titan").messages == 1
    assert between
    assert not any(between)


def test_what_is_stored_after_a_follower_has_hung_up_is_not_sent(field):
    """Its links would count what gets to no robot, and the next contact as having moved it."""
    titan, _, witness = field.node("titan")
    titan.publish("/map", b"grid")
    with Node(field.team, "io", radio=ManualRadio()) as io:
        Witness(io).pull("titan")
        witness.wait(SyncEnded, peer="io", direction=OUT)
    sent = []
    for number in range(5):
        titan.publish("/map", b"grid %d" % number, now=True)
        witness.wait(MessageStored, topic="/map")  # emitted before the next turn supplies anything
        sent.append(titan.links()["io"].bytes_out)
    assert sent[2:] == [sent[2]] * 3  # two turns after, it has received that
