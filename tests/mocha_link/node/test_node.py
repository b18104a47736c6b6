"""Nodes over real sockets: exchanges, the data mule, a link cut in mid-sync, old and bad peers."""

import asyncio
import math
import threading

import pytest
import zmq

from mocha_link.errors import RadioError
from mocha_link.links.metrics import (
    Direction,
    LinkState,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncTimedOut,
)
from mocha_link.node import transport
from mocha_link.node.broadcast import Broadcast
from mocha_link.node.node import Node, NodeClosedError
from mocha_link.radios import ManualRadio
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
    titan_saw.pull("io")

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
    assert link.bandwidth_bytes_s is None  # it was too little to measure
    assert link.bytes_in >= ended.bytes
    assert link.newest_age_s == 0
    assert io.links()["callisto"].state is LinkState.IDLE


@pytest.fixture
def no_node(field):
    """What answers on titan's port for io."""
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
        while identity == before:  # what the last pull requested beside
            assert no_node.poll(WAIT_MS)
            identity = no_node.recv_multipart()[0]
        for _ in range(100):  # what comes after the first one is not even looked at
            no_node.send_multipart([identity, *frames])
        broken = io_saw.wait(SyncTimedOut, peer="titan", direction=IN)
        assert broken.reason == "the peer answered without a request"
    assert io.links()["titan"].refused == 3


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
        with pytest.raises(RadioError, match="a reading"):
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
    assert "a listener failed: test_a_listener_that_fails" in caplog.text
    assert "ValueError: oops" in caplog.text
    unsubscribe()
    unsubscribe()


def join_node(name: str) -> None:
    for thread in threading.enumerate():
        if thread.name == f"mocha-link {name}":
            thread.join(20)


async def later(_event: object) -> None:
    """It would never be awaited."""


@pytest.mark.parametrize("callback", [None, later])
def test_what_cannot_be_called_back_is_no_listener(field, callback):
    titan, _, _ = field.node("titan")
    with pytest.raises(TypeError, match=r"Node\.events"):
        titan.subscribe(callback)


def test_a_callback_may_close_its_node_and_no_event_follows(field):
    titan, radio, _ = field.node("titan")
    received = []
    closed = threading.Event()
    titan.subscribe(lambda event: (received.append(event), titan.close(), closed.set()))
    events = titan.events()
    radio.report("io", -50)  # emits an event, and begins a sync, which would emit another one
    assert closed.wait(60)
    join_node("titan")
    assert [type(event) for event in received] == [RssiChanged]

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


def test_a_slow_reader_loses_the_oldest():
    broadcast = Broadcast()
    stream = broadcast.stream(limit=3)
    for number in range(5):
        broadcast.send(RssiChanged("io", number, None))
    broadcast.close()

    async def read() -> list[float]:
        return [event.at_s async for event in stream]

    assert asyncio.run(read()) == [2, 3, 4]
    assert stream.dropped == 2


def test_a_closed_loop_is_no_error():
    broadcast = Broadcast()
    stream = broadcast.stream()

    async def read_one() -> None:
        broadcast.send(RssiChanged("io", 1, None))
        await anext(stream)

    asyncio.run(read_one())
    broadcast.send(RssiChanged("io", 2, None))
    broadcast.close()
