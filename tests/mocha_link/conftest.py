"""Teams on free ports, clocks that stand still, and waiting for events instead of sleeping."""

import contextlib
import itertools
import os
import queue
import random
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import pytest

from benchmarks.fleet.network_sim import team_of
from mocha_link.links.metrics import Direction, LinkEvent, SyncEnded
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio
from mocha_link.team.team import Team

E = TypeVar("E")
_hosts = itertools.count()

WAIT_S = 60  # a limit against hangs; nothing waits so long unless something is broken
DATA = Path(__file__).parents[1] / "data" / "mocha"
TEAM = (DATA / "three.yaml").read_text()


_chance = random.SystemRandom()


def own_host() -> str:
    """A loopback address that no other test uses, so that ports found free stay free."""
    number = next(_hosts)
    pid = os.getpid()
    return f"127.{pid // 254 % 254 + 1}.{pid % 254 + 1}.{number % 254 + 1}"


def free_ports(host: str, count: int) -> int:
    """The first of `count` ports in a row that are free on a host, TCP and UDP.

    Below the ephemeral ones, which the system gives to sockets of the same test.
    """
    while True:
        base = _chance.randrange(20_000, 32_000 - count)
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError):
            for port in range(base, base + count):
                for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
                    stack.enter_context(socket.socket(socket.AF_INET, kind)).bind((host, port))
            return base


@contextlib.contextmanager
def no_thread_left() -> Iterator[None]:
    """No thread can start in the block: the address space has no room for its stack."""
    before = threading.stack_size(1 << 47)
    try:
        yield
    finally:
        threading.stack_size(before)


def noise(size: int, seed: int = 1) -> bytes:
    """Data that cannot be packed, the same for the same seed."""
    return random.Random(seed).randbytes(size)


class ManualClock:
    """A clock that a test sets."""

    def __init__(self, now_s: float = 1_795_175_900.0) -> None:
        self.time_s = now_s

    def now_s(self) -> float:
        return self.time_s


class Witness:
    """Sees every event of a node, and waits for the one that a test needs."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.seen: list[LinkEvent] = []
        self._events: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()
        node.subscribe(self._events.put)

    def wait(self, kind: type[E], /, **fields: object) -> E:
        """The next event of that kind with these fields."""
        while True:
            event = self._events.get(timeout=WAIT_S)
            self.seen.append(event)
            if isinstance(event, kind) and all(
                getattr(event, name) == value for name, value in fields.items()
            ):
                return event

    def pull(self, peer: str) -> SyncEnded:
        """Let the node pull from a peer; how that ended well."""
        self.node.sync(peer)
        return self.wait(SyncEnded, peer=peer, direction=Direction.IN)


class Field:
    """Nodes of a team on loopback, each with a radio that the test reports through.

    Their clock stands still, so that no interval is over before a test has seen what it wants.
    """

    def __init__(self, stack: contextlib.ExitStack, text: str = TEAM) -> None:
        self._stack = stack
        self.clock = ManualClock()
        self.host = own_host()
        team = team_of(text)
        counts = [len(robot.clients) for robot in team.robots.values()]
        base = free_ports(self.host, sum(counts))
        firsts = [base, *(base + sum(counts[: index + 1]) for index in range(len(counts)))]
        self.team = team.with_robots(
            {
                name: {"base_port": first, "address": self.host, "listen": self.host}
                for name, first in zip(team.robots, firsts, strict=False)
            }
        )

    def node(self, name: str, **options: object) -> tuple[Node, ManualRadio, Witness]:
        """A started node, its radio, and the witness of its events."""
        radio = ManualRadio()
        node = Node(self.team, name, radio=radio, **{"clock": self.clock, **options})
        witness = Witness(node)
        self._stack.enter_context(node)
        return node, radio, witness


@pytest.fixture
def field() -> Iterator[Field]:
    """A field where nodes run until the test ends; they must leave no thread behind."""
    before = set(threading.enumerate())
    with contextlib.ExitStack() as stack:
        yield Field(stack)
    assert set(threading.enumerate()) <= before


@pytest.fixture
def field_of() -> Iterator[Callable[[str], Field]]:
    """Makes such a field of another team, from the text of its file."""
    before = set(threading.enumerate())
    with contextlib.ExitStack() as stack:
        yield lambda text: Field(stack, text)
    assert set(threading.enumerate()) <= before


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def team() -> Team:
    return team_of(TEAM)
