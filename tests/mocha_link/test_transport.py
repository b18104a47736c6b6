"""The shell of a node: what it leaves behind, whom it listens to, what it survives."""

from __future__ import annotations

import contextlib
import os
import random
import socket
import threading
import time
from pathlib import Path

import pytest
import zmq

from mocha_link.gossip import Gossip
from mocha_link.metrics import (
    Direction,
    LinkState,
    MessageStored,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.node import Node
from mocha_link.pull import LOOK_S
from mocha_link.radios import ManualRadio
from tests.mocha_link.conftest import WAIT_S, free_ports

IN, OUT = Direction.IN, Direction.OUT
FDS = Path("/proc/self/fd")


def descriptors() -> set[str]:
    return {f"{each.name} {each.readlink()}" for each in FDS.iterdir() if each.is_symlink()}


@pytest.mark.skipif(not FDS.is_dir(), reason="what is open can be listed on Linux only")
def test_no_descriptor_is_left(field, tmp_path):
    """Of nodes in the middle of everything: pulls that go on, that hang, that were refused."""
    field.node("callisto")  # libzmq keeps some things of the first context of a process
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


def test_every_pull_closes_its_connection(field):
    titan, _, _ = field.node("titan", datagrams=False)
    io, _, saw = field.node("io", datagrams=False)
    titan.publish("/map", b"grid")
    io.sync("titan")
    saw.wait(SyncEnded)
    for number in range(20):
        titan.publish("/map", b"grid %d" % number)
        io.sync("titan")
        assert saw.wait(SyncEnded, direction=IN).messages == 1
        assert not io._transport._lines
    assert len(io._transport._poller.sockets) == 2 * len(io.robot.peers) + 2


def test_datagrams_from_elsewhere_are_not_listened_to(field):
    """Without keys the address is all there is to tell the peer from others."""
    titan, _, saw = field.node("titan")
    port = titan.robot.port_for("io")
    io = Gossip(field.team, "io", by_timer=False)
    io.sync("titan", titan._now())
    io.measured("titan", 0.5)  # a far peer: datagrams at once
    io.tick(titan._now()._replace(steady_s=time.monotonic() + LOOK_S))
    packets = [action.packet for action in io.take()[0] if hasattr(action, "packet")]
    assert packets
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", 0))
        for packet in packets:
            stranger.sendto(packet, (field.host, port))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as friend:
            friend.bind((field.host, 0))
            friend.settimeout(WAIT_S)
            friend.sendto(packets[0], (field.host, port))
            assert friend.recv(2048)
            saw.wait(SyncStarted, peer="io", direction=OUT)
        stranger.setblocking(False)
        with pytest.raises(BlockingIOError):
            stranger.recv(2048)
    assert sum(isinstance(each, SyncStarted) for each in saw.seen) == 1


def test_noise_in_datagrams_is_no_sync(field):
    titan, _, titan_saw = field.node("titan")
    titan.publish("/map", b"grid")
    generator = random.Random(1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as noisy:
        noisy.bind((field.host, 0))
        for _ in range(300):
            noise = generator.randbytes(generator.choice((0, 1, 7, 20, 400, 1400)))
            head = generator.choice((b"", b"\x50", b"\x51ididid", b"\x57ididid"))
            noisy.sendto(head + noise, (field.host, titan.robot.port_for("io")))
        io, _, saw = field.node("io")
        noisy.sendto(b"\x51ididid", io._transport._caster.getsockname())
        io.sync("titan")
        assert saw.wait(SyncEnded, direction=IN).messages == 1
    titan_saw.wait(SyncEnded, direction=OUT)
    assert sum(isinstance(each, SyncStarted) for each in titan_saw.seen) == 1


def test_only_datagrams_get_through(field):
    """Something holds the TCP port and answers nothing: messages come all the same."""
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid" * 5_000)
    real = field.team.robot("titan").port_for("io")
    with (
        socket.create_server((field.host, 0)) as silent,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as near,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far,
    ):
        near.bind((field.host, silent.getsockname()[1]))
        far.bind((field.host, 0))
        index = field.team.robot("titan").clients.index("io")
        first = silent.getsockname()[1] - index
        field.team = field.team.with_robots({"titan": {"base_port": first}})
        io, _, saw = field.node("io")
        done = threading.Event()

        def carry() -> None:
            poller, caller = zmq.Poller(), None
            for each in (near, far):
                poller.register(each.fileno(), zmq.POLLIN)
            while not done.is_set():
                for fd, _ in poller.poll(20):
                    if fd == near.fileno():
                        packet, caller = near.recvfrom(2048)
                        far.sendto(packet, (field.host, real))
                    else:
                        near.sendto(far.recv(2048), caller)

        thread = threading.Thread(target=carry)
        thread.start()
        try:
            io.sync("titan")
            assert saw.wait(SyncEnded, direction=IN).messages == 1
        finally:
            done.set()
            thread.join()
        assert io.links()["titan"].path == "udp"
        assert io.latest("titan", "/map").data == b"grid" * 5_000


def test_without_datagrams_none_leave(field):
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    io, _, saw = field.node("io", datagrams=False)
    sent = []
    real = io._transport._cast
    io._transport._cast = lambda peer, packet: (sent.append(packet), real(peer, packet))
    io.sync("titan")
    assert saw.wait(SyncEnded, direction=IN).messages == 1
    assert not sent
    assert io.links()["titan"].path == "zmq"


def test_an_error_in_the_node_is_logged_and_not_its_end(field, caplog, monkeypatch):
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    io, _, saw = field.node("io")
    failed = threading.Event()
    tick = Gossip.tick

    def fail(gossip: Gossip, now: object) -> None:
        if gossip.me.name == "io" and not failed.is_set():
            failed.set()
            raise ValueError("oops")
        tick(gossip, now)

    monkeypatch.setattr(Gossip, "tick", fail)
    assert failed.wait(WAIT_S)
    io.sync("titan")
    assert saw.wait(SyncEnded, direction=IN).messages == 1
    assert "io: an error in the node" in caplog.text


def test_a_port_for_datagrams_that_is_taken(field, caplog):
    """All goes over connections then."""
    number = field.team.robot("titan").port_for("io")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((field.host, number))
        titan, _, _ = field.node("titan")
        assert f"no datagrams on port {number} of titan" in caplog.text
        titan.publish("/map", b"grid")
        io, _, saw = field.node("io")
        io.sync("titan")
        assert saw.wait(SyncEnded, direction=IN).messages == 1


def test_robots_with_several_addresses(field):
    """Their datagrams may come from another one than the team file says: then all goes over TCP."""
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
        io.sync("titan")
        assert saw.wait(SyncEnded, direction=IN).messages == 1
        assert io.links()["titan"].path == "zmq"
    assert io.links()["titan"].refused == titan.links()["io"].refused == 0


def test_many_pulls_at_once_end_with_the_node(field):
    """All of them hang, and nobody waits until they have timed out."""
    with contextlib.ExitStack() as stack:
        for peer in ("titan", "callisto"):
            port = field.team.robot(peer).port_for("io")
            stack.enter_context(socket.create_server((field.host, port)))
        io, _, saw = field.node("io")
        for peer in ("titan", "callisto"):
            io.sync(peer)
            saw.wait(SyncStarted, peer=peer)
        io.close()
        assert {io.links()[peer].state_in for peer in ("titan", "callisto")} == {LinkState.STARTED}


def test_a_peer_that_comes_late_is_reached(field):
    """Nobody is there at first; then the node starts, and the next pull finds it."""
    io, _, saw = field.node("io", timeout_s=60)
    io.sync("titan")
    assert "refused" in saw.wait(SyncTimedOut, peer="titan").reason
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    io.sync("titan")
    assert saw.wait(SyncEnded, peer="titan", direction=IN).messages == 1


def test_a_peer_that_restarts_is_reached_again(field):
    io, _, saw = field.node("io", timeout_s=60)
    for number in range(3):
        with Node(field.team, "titan", radio=ManualRadio()) as titan:
            titan.publish("/map", b"life %d" % number)
            io.sync("titan")
            saw.wait(SyncEnded, peer="titan", direction=IN)
        assert io.latest("titan", "/map").data == b"life %d" % number


def test_all_pull_from_all_at_the_same_time(field):
    """Both ways between three nodes, again and again: everybody has everything."""
    nodes = [field.node(name) for name in ("titan", "callisto", "io")]
    for round_ in range(3):
        field.clock.time_s += 10
        for node, _, _ in nodes:
            topic = field.team.topics_of(node.name)[0].name
            node.publish(topic, f"{node.name} {round_}".encode() * 5_000)
        for node, _, _ in nodes:
            for peer in node.robot.peers:
                assert node.sync(peer)
        for node, _, saw in nodes:
            waiting = set(node.robot.peers)
            while waiting:
                waiting.discard(saw.wait(SyncEnded, direction=IN).peer)
            held = {message.robot: message.data for message in node.messages()}
            assert held == {
                name: f"{name} {round_}".encode() * 5_000 for name in ("titan", "callisto", "io")
            }
    assert not any(link.timeouts for node, _, _ in nodes for link in node.links().values())
