"""Nodes over real sockets: exchanges, the data mule, a link cut in mid-sync, old and bad peers."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import gc
import math
import random
import socket
import threading

import pytest
import zmq

from mocha_link.errors import PortInUseError
from mocha_link.links.metrics import (
    Direction,
    LinkState,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.node import transport
from mocha_link.node.node import Node, NodeClosedError
from mocha_link.radios import ManualRadio, RadioError, UdpRadio
from mocha_link.team.team import UnknownRobotError, UnknownTopicError

IN, OUT = Direction.IN, Direction.OUT
WAIT_MS = 20_000


def test_two_nodes_exchange_both_ways(field):
    titan, _, titan_saw = field.node("titan")
    io, io_radio, io_saw = field.node("io")
    titan.publish("/map", b"grid " * 50_000)
    io.publish("/pose", b"here")
    io_radio.report("titan", -60.0)
    assert io_saw.wait(RssiChanged).rssi_dbm == -60.0
    ended = io_saw.wait(SyncEnded, peer="titan", direction=IN)
    assert ended.messages == 1
    assert titan_saw.wait(SyncEnded, peer="io", direction=OUT).messages == 1
    titan.sync("io")
    titan_saw.wait(SyncEnded, peer="io", direction=IN)

    message = io.latest("titan", "/map")
    assert message.data == b"grid " * 50_000
    assert (message.robot, message.topic, message.priority.name) == ("titan", "/map", "HIGH")
    assert message.stamp_s == message.received_s == field.clock.now_s()
    assert titan.latest("io", "/pose").data == b"here"
    assert titan.latest("io", "/path") is None
    assert titan.held("io") == {("io", "/pose"): titan.latest("io", "/pose").stamp_s}
    with pytest.raises(UnknownRobotError):
        titan.held("phantom")
    assert {(m.robot, m.topic) for m in titan.messages()} == {("titan", "/map"), ("io", "/pose")}

    link = io.links()["titan"]
    assert (link.state_in, link.syncs_in, link.rssi_dbm) == (LinkState.ENDED, 1, -60.0)
    assert link.rtt_s > 0
    assert link.bandwidth_bytes_s is None  # it was too little to say
    assert link.bytes_in >= ended.bytes
    assert link.newest_age_s == 0
    assert io.links()["callisto"].state is LinkState.IDLE


class CutRelay:
    """Carries bytes to a port; stops without a word after so many, until it heals."""

    def __init__(self, host: str, target: int, limit: int) -> None:
        self._listener = socket.create_server((host, 0))
        self.port = self._listener.getsockname()[1]
        self._target = (host, target)
        self.limit = limit
        self.cut = threading.Event()
        self._healed = threading.Event()
        self._sockets: list[socket.socket] = [self._listener]
        self._threads = [self._start(self._accept)]

    def _start(self, target, *args) -> threading.Thread:
        thread = threading.Thread(target=target, args=args, daemon=True)
        thread.start()
        return thread

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
                far = socket.create_connection(self._target)
            except OSError:
                return
            self._sockets += [near, far]
            self._threads += [
                self._start(self._carry, near, far, False),
                self._start(self._carry, far, near, True),
            ]

    def _carry(self, source, sink, counts) -> None:
        while True:
            try:
                data = source.recv(4096)
                if not data:
                    sink.shutdown(socket.SHUT_WR)
                    return
                if counts and not self._healed.is_set():
                    data = data[: self.limit]
                    self.limit -= len(data)
                    if not self.limit:
                        self.cut.set()
                        sink.sendall(data)
                        self._healed.wait()
                        return  # what was on its way is lost; this connection stays dead
                sink.sendall(data)
            except OSError:
                return

    def heal(self) -> None:
        self._healed.set()

    def close(self) -> None:
        self.heal()
        for each in self._sockets:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
        for thread in self._threads:
            thread.join()


def test_a_link_cut_in_mid_sync(field):
    titan, _, titan_saw = field.node("titan")
    whole = random.Random(1).randbytes(20_000)
    large = random.Random(2).randbytes(300_000)
    titan.publish("/map", whole)
    titan.publish("/slow", large)
    relay = CutRelay(field.host, field.team.robot("titan").port_for("io"), limit=120_000)
    try:
        index = field.team.robot("titan").clients.index("io")
        field.team = field.team.with_robots({"titan": {"base_port": relay.port - index}})
        io, _, io_saw = field.node("io", timeout_s=3.0)
        io.sync("titan")
        assert relay.cut.wait(60)
        broken = io_saw.wait(SyncTimedOut, peer="titan", direction=IN)
        assert "no byte for 3 s" in broken.reason
        # The message before the cut is there, of the one in mid-payload there is nothing.
        assert io.latest("titan", "/map").data == whole
        assert io.latest("titan", "/slow") is None
        relay.heal()
        io.sync("titan")
        assert io_saw.wait(SyncEnded, peer="titan", direction=IN).messages == 1
        assert io.latest("titan", "/slow").data == large
        assert io.links()["titan"].timeouts == 1
        titan_saw.wait(SyncEnded, peer="io", direction=OUT)
    finally:
        relay.close()


@pytest.fixture
def no_node(field):
    """What answers on titan's port where io asks."""
    with zmq.Context() as context, context.socket(zmq.ROUTER) as peer:
        peer.setsockopt(zmq.LINGER, 0)
        peer.bind(f"tcp://{field.host}:{field.team.robot('titan').port_for('io')}")
        yield peer


def test_a_peer_that_is_no_node(field, no_node):
    """What answers on the peer's port talks nonsense: the pull breaks off, the node goes on."""
    io, _, io_saw = field.node("io", timeout_s=60)
    identity = b""
    for frames in ([b"", b"wrong id", b"and parts"], [b"no envelope"], [b""]):
        io.sync("titan")
        before = identity
        while identity == before:  # what the last pull asked beside
            assert no_node.poll(WAIT_MS)
            identity = no_node.recv_multipart()[0]
        for _ in range(100):  # what comes after the first one is not even looked at
            no_node.send_multipart([identity, *frames])
        broken = io_saw.wait(SyncTimedOut, peer="titan", direction=IN)
        assert broken.reason == "the peer answered what was not asked"
    assert io.links()["titan"].refused == 3


def test_no_socket_left(field, monkeypatch):
    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    io, _, io_saw = field.node("io")
    monkeypatch.setattr(transport, "TcpConnection", fail)
    io.sync("titan")
    broken = io_saw.wait(SyncTimedOut, peer="titan", direction=IN)
    port = field.team.robot("titan").port_for("io")
    assert broken.reason.startswith(f"cannot connect to {field.host}:{port}: ")
    assert "Too many open files" in broken.reason
    assert [type(event) for event in io_saw.seen] == [SyncStarted, SyncTimedOut]


def test_a_port_in_use_is_named(field):
    port = field.team.robot("titan").port_for("io")
    with socket.create_server((field.host, port)):
        node = Node(field.team, "titan", radio=ManualRadio())
        with pytest.raises(PortInUseError, match=rf"titan cannot listen for io .* port {port} is "):
            node.start()
        node.close()
    with Node(field.team, "titan", radio=ManualRadio()):  # and it is free again
        pass
    gc.collect()  # an unclosed socket would warn, and warnings are errors


def test_a_radio_that_fails_to_start_leaves_nothing_behind(field):
    class Broken(ManualRadio):
        def start(self, report: object) -> None:
            raise ValueError("no such device")

    with pytest.raises(ValueError, match="no such device"):
        Node(field.team, "titan", radio=Broken()).start()
    assert "mocha-link titan" not in [thread.name for thread in threading.enumerate()]
    with Node(field.team, "titan", radio=ManualRadio()):  # its ports are free
        pass


def test_wrong_names_and_times(field):
    with pytest.raises(UnknownRobotError, match=r"no robot 'mars' in team.yaml; use one of"):
        Node(field.team, "mars")
    titan, radio, _ = field.node("titan")
    with pytest.raises(UnknownTopicError, match="has no topic '/pose'"):
        titan.publish("/pose", b"")
    with pytest.raises(UnknownTopicError):
        titan.flush("/pose")
    with pytest.raises(UnknownTopicError):
        titan.latest("io", "/map")
    with pytest.raises(UnknownRobotError):
        titan.sync("titan")
    with pytest.raises(UnknownRobotError):
        radio.report("mars", -50)
    for nonsense in (math.nan, math.inf, 10**400, "-50", True):
        with pytest.raises(RadioError, match="rssi_dbm must be"):
            radio.report("io", nonsense)
    with pytest.raises(
        TypeError, match=r"the data of /map must be bytes, not str; e.g. json.dumps"
    ):
        titan.publish("/map", "text")
    with pytest.raises(NodeClosedError, match="runs once"):
        titan.start()
    titan.close()
    titan.close()
    with pytest.raises(NodeClosedError, match="the node of titan is closed"):
        titan.publish("/map", b"")
    with pytest.raises(NodeClosedError):
        titan.sync("io")


def test_the_clock_of_the_robot_counts(field, clock):
    titan, radio, saw = field.node("titan", clock=clock)
    header = titan.publish("/slow", b"1")
    assert header.stamp_s(clock.now_s()) == clock.time_s
    assert saw.wait(MessageStored).at_s == clock.time_s
    titan.publish("/slow", b"2")
    assert titan.latest("titan", "/slow").data == b"1"
    clock.time_s += 5
    saw.wait(MessageStored)
    assert titan.latest("titan", "/slow").data == b"2"
    titan.publish("/slow", b"3", now=True)
    saw.wait(MessageStored)
    titan.publish("/slow", b"4")
    titan.flush("/slow")
    saw.wait(MessageStored)
    assert titan.latest("titan", "/slow").data == b"4"
    radio.report("io", -90)
    saw.wait(RssiChanged)
    clock.time_s += 7
    assert saw.wait(RssiChanged).rssi_dbm is None


def test_a_radio_over_udp(field):
    port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with port:
        port.bind((field.host, 0))
        address = port.getsockname()
        field.team = field.team.with_robots({"io": {"radio": f"udp://{field.host}:{address[1]}"}})
        node = Node(field.team, "io")
        with pytest.raises(RadioError, match="Address already in use; end the process"):
            node.start()
    radio = UdpRadio(f"udp://{field.host}:0")
    heard = []
    with Node(field.team, "io", radio=radio) as io:
        told = threading.Event()
        io.subscribe(lambda e: (heard.append(e), told.set()))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            huge = b'{"peer": "titan", "rssi_dbm": ' + b"9" * 400 + b"}"
            for raw in (b"nonsense", b'{"peer": "mars", "rssi_dbm": -50}', b"[]", b"\xff", huge):
                sender.sendto(raw, (field.host, radio.port))
            sender.sendto(b'{"peer": "titan", "rssi_dbm": -90.5}', (field.host, radio.port))
            assert told.wait(60)
    assert [(e.peer, e.rssi_dbm) for e in heard] == [("titan", -90.5)]
    assert radio.refused == 5


def test_a_listener_that_fails_stops_nothing(field, caplog):
    titan, radio, _ = field.node("titan")

    def fail(_event: object) -> None:
        raise ValueError("oops")

    unsubscribe = titan.subscribe(fail)
    saw = []
    later = threading.Event()
    titan.subscribe(lambda event: (saw.append(event), later.set()))
    radio.report("io", -90)
    assert later.wait(60)
    assert "a listener failed on RssiChanged" in caplog.text
    unsubscribe()
    unsubscribe()


def join_node(name: str) -> None:
    for thread in threading.enumerate():
        if thread.name == f"mocha-link {name}":
            thread.join(20)


def test_a_callback_may_close_its_node_and_nothing_is_told_after(field):
    titan, radio, _ = field.node("titan")
    heard = []
    closed = threading.Event()
    titan.subscribe(lambda event: (heard.append(event), titan.close(), closed.set()))
    events = titan.events()
    radio.report("io", -50)  # is told, and begins a sync, which would be told, too
    assert closed.wait(60)
    join_node("titan")
    assert [type(event) for event in heard] == [RssiChanged]

    async def read() -> list[object]:
        return [event async for event in events]

    assert asyncio.run(read()) == []


def test_a_callback_that_hangs_does_not_hang_close(field, caplog, monkeypatch):
    monkeypatch.setattr(transport, "CLOSE_S", 0.05)
    titan, radio, _ = field.node("titan")
    called, release = threading.Event(), threading.Event()
    titan.subscribe(lambda _event: (called.set(), release.wait(60)))
    radio.report("io", -90)
    assert called.wait(60)
    titan.close()
    assert "titan: a listener has not returned for 0.05 s" in caplog.text
    release.set()
    join_node("titan")
    with Node(field.team, "titan", radio=ManualRadio()):  # its ports are free
        pass


def test_events_for_asyncio(field):
    titan, radio, _ = field.node("titan")

    async def watch() -> list[float | None]:
        events = titan.events()
        radio.report("io", -90)
        seen = [(await anext(events)).rssi_dbm]
        waiting = asyncio.ensure_future(anext(events))
        await asyncio.sleep(0)
        radio.report("io", -91)
        seen.append((await waiting).rssi_dbm)
        titan.close()
        seen += [event.rssi_dbm async for event in events]
        assert [event async for event in titan.events()] == []
        return seen

    assert asyncio.run(watch()) == [-90, -91]


def test_closing_does_not_wait_for_a_sync(field):
    io, _, io_saw = field.node("io")
    with socket.create_server((field.host, field.team.robot("titan").port_for("io"))):
        io.sync("titan")  # no node answers there
        io_saw.wait(SyncStarted, peer="titan")
        io.close()  # does not wait for the pull to time out: it has not ended
    assert io.links()["titan"].state is LinkState.STARTED
    gc.collect()
