"""Nodes with keys, over real sockets: who talks to whom, what crosses, whose message it is."""

import contextlib
import re
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq

from mocha_link.links.metrics import Direction, MessageStored, SyncEnded, SyncStarted
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio
from mocha_link.store import wire
from mocha_link.store.wire import Header
from mocha_link.team import keys
from mocha_link.team.keys import SecretKey
from tests.mocha_link.conftest import TEAM, WAIT_S, Field, Witness, noise

IN, OUT = Direction.IN, Direction.OUT
NAMES = ("callisto", "io", "titan")
SECRETS = {name: SecretKey(bytes([number]) * 32) for number, name in enumerate(NAMES, 1)}
SECRET_TEXT = b"no peer may read this " * 20


class Locked:
    """A field whose robots have keys, and the folder with their secrets."""

    def __init__(self, field: Field, folder: Path, *names: str) -> None:
        self.field = field
        self.folder = folder
        for name in names:
            keys.write(folder / f"{name}.key", name, SECRETS[name])
        field.team = field.team.with_robots(
            {name: {"key": SECRETS[name].public.text} for name in names}
        )

    def node(self, name: str, **options: object) -> tuple[Node, ManualRadio, Witness]:
        return self.field.node(name, **{"keys": self.folder, **options})


@pytest.fixture
def locked(field_of, tmp_path) -> Callable[..., Locked]:
    """Makes a field in which some robots have keys; `trust` as in the team file."""

    def make(*names: str, trust: str = "relays") -> Locked:
        return Locked(field_of(f"{TEAM}trust: {trust}\n"), tmp_path, *names)

    return make


def refusal(node: Node) -> threading.Event:
    """Set when the node has refused a client at a port: on its own thread, so maybe a bit later."""
    refused, count = threading.Event(), node._gossip.refused

    def counted(peer: str, reason: str) -> None:
        count(peer, reason)
        refused.set()

    node._gossip.refused = counted
    return refused


class Wire:
    """Between io and titan: carries TCP and UDP, and sees every byte of it."""

    def __init__(self, host: str, target: int, *, tcp: bool) -> None:
        self.seen = {"tcp": bytearray(), "udp": bytearray()}
        self._host, self._target = host, target
        self._listener = socket.create_server((host, 0))
        self.port = self._listener.getsockname()[1]
        self._tcp = tcp
        self._near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._near.bind((host, self.port))
        self._far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._far.bind((host, 0))
        self._caller: tuple[str, int] | None = None
        self._quit, self._quits = socket.socketpair()
        self._pairs: dict[int, tuple[socket.socket, socket.socket]] = {}
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        poller = zmq.Poller()
        for each in (self._listener, self._near, self._far, self._quits):
            poller.register(each.fileno(), zmq.POLLIN)
        while self._quits.fileno() not in (ready := dict(poller.poll())):
            for fd in ready:
                if fd == self._listener.fileno():
                    self._accept(poller)
                elif fd in (self._near.fileno(), self._far.fileno()):
                    self._datagram(fd == self._near.fileno())
                elif fd in self._pairs:
                    self._carry(fd, poller)

    def _accept(self, poller: zmq.Poller) -> None:
        near, _ = self._listener.accept()
        if not self._tcp:  # it stands, and nothing answers
            self._pairs[near.fileno()] = (near, near)
            return
        far = socket.create_connection((self._host, self._target))
        for source, sink in ((near, far), (far, near)):
            self._pairs[source.fileno()] = (source, sink)
            poller.register(source.fileno(), zmq.POLLIN)

    def _carry(self, fd: int, poller: zmq.Poller) -> None:
        source, sink = self._pairs[fd]
        try:
            data = source.recv(65536)
            self.seen["tcp"] += data  # before the other end can act on it
            sink.sendall(data)
        except OSError:
            data = b""
        if not data:
            for each in (source, sink):
                poller.unregister(each.fileno())
                del self._pairs[each.fileno()]
                each.close()

    def _datagram(self, up: bool) -> None:
        data, source = (self._near if up else self._far).recvfrom(2048)
        self.seen["udp"] += data
        if up:
            self._caller = source
            self._far.sendto(data, (self._host, self._target))
        elif self._caller:
            self._near.sendto(data, self._caller)

    def close(self) -> None:
        self._quit.send(b"\0")
        self._thread.join()
        for near, far in self._pairs.values():
            near.close()
            far.close()
        for each in (self._listener, self._near, self._far, self._quit, self._quits):
            each.close()


@contextlib.contextmanager
def tapped(locked: Locked, *, tcp: bool) -> Iterator[Wire]:
    """A wire before titan's port for io; in io's team file titan is there."""
    field = locked.field
    target = field.team.robot("titan").port_for("io")
    with contextlib.closing(Wire(field.host, target, tcp=tcp)) as between:
        index = field.team.robot("titan").clients.index("io")
        field.team = field.team.with_robots({"titan": {"base_port": between.port - index}})
        yield between


@pytest.mark.parametrize("datagrams", [True, False])
def test_all_have_keys(locked, datagrams):
    hall = locked(*NAMES)
    titan, _, titan_saw = hall.node("titan", datagrams=datagrams)
    io, _, saw = hall.node("io", datagrams=datagrams)
    titan.publish("/map", noise(300_000))
    io.publish("/pose", b"here")
    assert saw.pull("titan").messages == 1
    assert titan_saw.pull("io").messages == 1
    assert io.latest("titan", "/map").data == noise(300_000)
    assert titan.latest("io", "/pose").data == b"here"
    for node, peer in ((io, "titan"), (titan, "io")):
        link = node.links()[peer]
        assert link.protected
        assert (link.refused, link.timeouts) == (0, 0)
    assert all(link.protected for link in io.links().values())


@pytest.mark.parametrize("way", ["tcp", "udp"])
def test_nothing_of_it_can_be_read_on_the_way(locked, way):
    """Datagrams are sealed for the peer, from whatever address they come."""
    datagrams = way == "udp"
    hall = locked(*NAMES)
    titan, _, _ = hall.node("titan", datagrams=datagrams)
    data = SECRET_TEXT + noise(5_000)
    titan.publish("/map", data)
    with tapped(hall, tcp=not datagrams) as between:
        io, _, saw = hall.node("io", datagrams=datagrams)
        assert saw.pull("titan").messages == 1
        assert io.latest("titan", "/map").data == data
        assert io.links()["titan"].path == ("udp" if datagrams else "zmq")
        assert len(between.seen[way]) > 5_000
        for text in (b"no peer", b"idid", b"SYNC1", b"GHEAD"):
            assert text not in between.seen[way]
        assert not datagrams or not between.seen["tcp"]


def test_datagrams_of_others_are_no_datagrams(locked):
    """Noise, what is not sealed, and what was sealed by another robot of the team."""
    hall = locked(*NAMES)
    titan, _, titan_saw = hall.node("titan")
    titan.publish("/map", b"grid")
    port = titan.robot.port_for("io")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as intruder:
        intruder.bind((hall.field.host, 0))
        for size in (0, 1, 39, 40, 41, 100, 1400):
            intruder.sendto(noise(size), (hall.field.host, port))
        intruder.sendto(b"\x51ididid" + bytes(60), (hall.field.host, port))
        _, _, saw = hall.node("io")
        assert saw.pull("titan").messages == 1
        titan_saw.wait(SyncEnded, direction=OUT)
        intruder.setblocking(False)
        with pytest.raises(BlockingIOError):
            intruder.recv(2048)
    started = [e for e in titan_saw.seen if isinstance(e, SyncStarted)]
    assert [e.peer for e in started] == ["io"]


@pytest.mark.parametrize("kind", [zmq.REQ, zmq.DEALER])
def test_a_client_without_encryption_is_refused_and_counted(locked, caplog, kind):
    """Like an original node; it hangs up once it sees that a key is required, or before."""
    titan, _, _ = locked(*NAMES).node("titan")
    refused = refusal(titan)
    titan.publish("/map", SECRET_TEXT)
    context = zmq.Context()
    with context, context.socket(kind) as client:
        client.setsockopt(zmq.LINGER, 0)
        client.connect(f"tcp://{titan.robot.listen}:{titan.robot.port_for('io')}")
        client.send_multipart([b"idididGHEAD"] if kind == zmq.REQ else [b"", b"idididGHEAD"])
        assert refused.wait(WAIT_S)
        assert not client.poll(0)
    assert titan.links()["io"].refused >= 1
    logged = "a client (used no encryption|left before it had shown a key)"
    assert re.search(f"refused from io: {logged}", caplog.text)


def test_a_mixed_team_reports_which_links_are_open(locked):
    hall = locked("titan", "io")
    titan, _, titan_saw = hall.node("titan")
    io, _, saw = hall.node("io")
    callisto, _, callisto_saw = hall.node("callisto", keys=None)
    callisto.publish("/pose", b"unprotected")
    titan.publish("/map", b"grid")
    assert titan_saw.pull("callisto").messages == 1
    assert saw.pull("titan").messages == 2
    assert callisto_saw.pull("titan").messages == 1
    assert io.latest("callisto", "/pose").data == b"unprotected"
    for node in (titan, io, callisto):
        for peer, link in node.links().items():
            assert link.protected == ("callisto" not in {node.name, peer})


def relayed(hall: Locked, *, forged: bytes | None = None) -> tuple[Node, Witness]:
    """callisto's message gets to io through titan, which may put one of its own in its place."""
    callisto, _, _ = hall.node("callisto")
    callisto.publish("/pose", b"of callisto")
    titan, _, titan_saw = hall.node("titan")
    assert titan_saw.pull("callisto").messages == 1
    if forged is not None:
        plant(titan, forged)
    io, _, saw = hall.node("io")
    saw.pull("titan")
    return io, saw


def plant(node: Node, data: bytes, *, sign: Callable[[bytes], bytes] | None = None) -> None:
    """A later message of callisto, made by this node."""
    robot, topic = node.team.robot("callisto"), node.team.topic("callisto", "/pose")
    database = node._gossip.database
    stamp_ms = database.newest(robot.robot_id, topic.topic_id).stamp_ms + 1
    body = wire.pack(topic.dtype, topic.priority, data, stamp_ms=stamp_ms, sign=sign)
    header = Header.at(robot.robot_id, topic.topic_id, stamp_ms)
    record = type(database.newest(robot.robot_id, topic.topic_id))(
        header, topic.priority, body, stamp_ms, node.clock.now_s()
    )
    assert database.insert(record, node.clock.now_s())


@pytest.mark.parametrize("trust", ["relays", "signed"])
def test_what_a_relay_makes_up(locked, trust):
    """Without a signature: taken where relays are trusted, refused and counted where not."""
    io, saw = relayed(locked(*NAMES, trust=trust), forged=b"of titan")
    if trust == "relays":
        assert io.latest("callisto", "/pose").data == b"of titan"
    else:
        assert io.latest("callisto", "/pose") is None
        assert io.links()["titan"].refused >= 1
        assert not [e for e in saw.seen if isinstance(e, MessageStored)]
