"""A live node with a friend, and a peer that is not what it should be."""

import contextlib
import gc
import os
import queue
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from benchmarks.fleet.network_sim import pulling
from mocha_link.links.metrics import Direction, LinkEvent, SyncEnded, SyncTimedOut
from mocha_link.node import zmtp
from mocha_link.node.gossip import Gossip
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio
from mocha_link.sync.protocol import ID_BYTES

WAIT_S = 60.0  # a limit against hangs
TIMEOUT_S = 3.0
GROWTH_BYTES = 20_000_000
WARM = 3  # checks
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


class NodeUnderLoad:
    """titan is alive, callisto is its friend, and io is hostile.

    Attributes:
        frames: of io that titan has dealt with, as far as the test has counted them.
    """

    def __init__(self, field, monkeypatch) -> None:
        self.field = field
        self.frames = 0
        self._handled = 0
        self._enough = threading.Condition()
        for name in ("request", "packet_in", "reply", "packet_back"):
            self._count(monkeypatch, name)
        self.nodes: dict[str, Node] = {}
        self._ends: dict[str, queue.SimpleQueue[LinkEvent]] = {}
        for name in ("titan", "callisto"):
            node = Node(
                field.team, name, clock=field.clock, radio=ManualRadio(), timeout_s=TIMEOUT_S
            )
            ends: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()
            node.subscribe(lambda event, ends=ends: self._note(event, ends))
            self.nodes[name], self._ends[name] = node, ends
        self.titan = self.nodes["titan"]
        self._memory = 0
        self._checks = 0

    def _count(self, monkeypatch, name: str) -> None:
        """Signal when titan's engine has dealt with something that io sent."""
        original = getattr(Gossip, name)

        def counting(engine, peer, *arguments):
            # What comes when the pull is over is not looked at.
            counts = name in ("request", "packet_in") or peer in pulling(engine)
            try:
                return original(engine, peer, *arguments)
            finally:
                if peer == "io" and engine.me.name == "titan" and counts:
                    with self._enough:
                        self._handled += 1
                        if self._handled == self.frames:  # wakes no thread before
                            self._enough.notify_all()

        monkeypatch.setattr(Gossip, name, counting)

    @staticmethod
    def _note(event: LinkEvent, ends: queue.SimpleQueue[LinkEvent]) -> None:
        if isinstance(event, SyncEnded | SyncTimedOut) and event.direction is Direction.IN:
            ends.put(event)

    @property
    def place(self) -> tuple[str, int]:
        """Where titan answers io."""
        return self.field.host, self.titan.robot.port_for("io")

    def wait(self, count: int) -> None:
        """Until so many frames more were dealt with; they count."""
        with self._enough:
            self.frames += count
            assert self._enough.wait_for(lambda: self._handled >= self.frames, WAIT_S), "hangs"

    def count(self) -> None:
        """Count what has been dealt with."""
        with self._enough:
            self.frames = max(self.frames, self._handled)

    def end(self, name: str, peer: str) -> LinkEvent:
        """How the pull of a node ends that is under way."""
        while True:
            end = self._ends[name].get(timeout=WAIT_S)
            if end.peer == peer:  # others may have been pulled from in return
                return end

    def check(self) -> None:
        """titan and its friend still get on with each other; memory does not grow."""
        self._checks += 1
        self.field.clock.time_s += 1
        ours, theirs = b"map %d" % self._checks, b"pose %d" % self._checks
        callisto = self.nodes["callisto"]
        self.titan.publish("/map", ours)
        callisto.publish("/pose", theirs)
        for name, peer in (("callisto", "titan"), ("titan", "callisto")):
            assert self.nodes[name].sync(peer)
            end = self.end(name, peer)
            assert isinstance(end, SyncEnded), end
            assert end.complete
        assert callisto.latest("titan", "/map").data == ours
        assert self.titan.latest("callisto", "/pose").data == theirs
        if self._checks == WARM:
            self._memory = resident_bytes()
        if self._checks > WARM:
            assert resident_bytes() - self._memory < GROWTH_BYTES


def resident_bytes() -> int:
    """The memory of this process."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES


class Liar:
    """io as a server that titan pulls from; what it answers is up to the test."""

    def __init__(self, loaded: NodeUnderLoad) -> None:
        self.end: LinkEvent | None = None  # how titan's pull ended
        self._besieged = loaded
        robot = loaded.field.team.robot("io")
        self._place = loaded.field.host, robot.port_for("titan")
        self._listener = socket.create_server(self._place)
        self._listener.settimeout(WAIT_S)
        self.caster = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.caster.bind(self._place)
        self.caster.settimeout(WAIT_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self.caster.close()

    @contextlib.contextmanager
    def pulled(self) -> Iterator[tuple[socket.socket, zmtp.ZmtpSession]]:
        """titan pulls: the connection of its requests. Then the pull has to come to an end."""
        assert self._besieged.titan.sync("io")
        connection, _ = self._listener.accept()
        with connection:
            connection.settimeout(WAIT_S)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            yield connection, zmtp.ZmtpSession(100_000)
        self.end = self._besieged.end("titan", "io")
        self._besieged.count()

    def called(self, token: bytes) -> tuple[str, int]:
        """Where titan's datagrams of that pull come from."""
        while True:
            packet, source = self.caster.recvfrom(2000)
            if packet[1 : 1 + ID_BYTES] == token:
                return source


def requests(connection: socket.socket, parser: zmtp.ZmtpSession) -> list[bytes]:
    """The next requests; none when titan has hung up."""
    while True:
        try:
            data = connection.recv(65_536)
        except ConnectionError:
            return []
        if not data:
            return []
        parser.receive(data)
        found = [parts[0] for parts in parser.replies()]
        if found:
            return found


def message(body: bytes) -> bytes:
    """A request or reply as it stands on a ZeroMQ connection."""
    return zmtp.ZmtpSession(1).request(body)


HANDSHAKE_OF_ROUTER = zmtp.ZmtpSession(1, mechanism=zmtp.Null(b"ROUTER")).hello


def send(connection: socket.socket, data: bytes) -> None:
    """Send, if a peer is there to receive it; but it must not be silent for ever."""
    try:
        connection.sendall(data)
    except TimeoutError:
        raise
    except OSError:
        pass
