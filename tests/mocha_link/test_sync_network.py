"""Nodes that sync over a model of a network: cuts, reordering, repetition, messages replaced."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path
from unittest import mock

from hypothesis import given, settings
from hypothesis import strategies as st

from mocha_link import intake, payload, sync
from mocha_link.acquaintance import Acquaintance, record_id
from mocha_link.clock import Instant
from mocha_link.database import Database, Record
from mocha_link.document import Document
from mocha_link.feed import Feed
from mocha_link.header import Header
from mocha_link.intake import Intake
from mocha_link.shelf import Shelf
from mocha_link.team import Team

NOW = Instant(1_795_175_900.0, 1.0)
START_MS = 1_795_175_000_000
ROBOTS, TOPICS = 256, 256
KINDS = ", ".join(f"{{name: /t{topic}, type: a/B}}" for topic in range(TOPICS))
TEAM = Team.from_document(
    Document.from_text(
        "robots:\n"
        + "".join(
            f"  r{robot:03}: {{kind: k, address: a{robot}, base_port: 10, clients: []}}\n"
            for robot in range(ROBOTS)
        )
        + f"kinds: {{k: {{topics: [{KINDS}]}}}}\n",
        Path("team.yaml"),
    )
)


def history(robot_id: int, topic_id: int) -> int:
    return 3 if topic_id % 4 == 3 else 1


class Node:
    """A database with what belongs to it."""

    def __init__(self, name: str, seed: int = 0) -> None:
        self.name = name
        self.random = random.Random(f"{name} {seed}")
        self.published: dict[tuple[int, int], int] = {}
        self.start()

    def start(self) -> None:
        """Begin a new process with an empty memory."""
        self.database = Database(history)
        self.shelf = Shelf()
        self.peers: dict[str, Acquaintance] = {}

    def peer(self, name: str) -> Acquaintance:
        if name not in self.peers:
            self.peers[name] = Acquaintance(self.random.getrandbits(64), history)
        return self.peers[name]

    def store(
        self, robot_id: int, topic_id: int, stamp_ms: int, *, size: int = 20, priority: int = 0
    ) -> Record:
        data = random.Random(f"{robot_id} {topic_id} {stamp_ms}").randbytes(size)
        body = payload.pack(0, priority, data, stamp_ms=stamp_ms)
        header = Header.at(robot_id, topic_id, stamp_ms)
        record = Record(header, priority, body, stamp_ms, NOW.unix_s)
        self.database.insert(record, NOW.unix_s)
        return record

    @property
    def content(self) -> dict[int, bytes]:
        return {record_id(record): record.body for record in self.database.kept()}


class Pull:
    """One node's pull from another, frame by frame."""

    def __init__(self, asker: Node, server: Node, *, budget: int = 0, room: int = 1_100) -> None:
        self.feed = Feed(server.database, server.peer(asker.name))
        self.intake = Intake(
            server.name,
            team=TEAM,
            database=asker.database,
            shelf=asker.shelf,
            acquaintance=asker.peer(server.name),
            budget=budget,
            room=room,
        )
        self.up: list[bytes] = []
        self.down: list[bytes] = []
        self.events: list[object] = []
        self.refusals: list[str] = []
        self.bytes_up = self.bytes_down = self.data_down = 0
        self.seen: set[bytes] = set()
        self.arrived: Counter[int] = Counter()  # data bytes by long id
        self.take(self.intake.open(NOW))

    def take(self, step) -> None:
        self.up += step.frames
        self.bytes_up += sum(map(len, step.frames))
        self.events += step.events
        self.refusals += step.refusals

    def give(self, room: int = 1_100) -> bytes | None:
        """The next frame of the serving side, under way now."""
        frame = self.feed.next(room)
        if frame is not None:
            assert len(frame) <= room
            self.down.append(frame)
            self.bytes_down += len(frame)
            self.data_down += data_bytes(frame)
        return frame

    def ask(self, place: int = 0) -> None:
        """One frame of the asking side arrives."""
        self.feed.receive(self.up.pop(place))

    def deliver(self, place: int = 0) -> None:
        """One frame of the serving side arrives."""
        frame = self.down.pop(place)
        if frame[0] == sync.CHUNKS and frame not in self.seen:
            self.seen.add(frame)
            chunks = sync.read_chunks(frame)
            self.arrived.update(dict(chunks.wholes))
            for long, _, _, size in chunks.pieces:
                self.arrived[long] += size
        self.take(self.intake.receive(frame, NOW))

    def run(self, room: int = 65_536) -> Pull:
        """All of it, with nothing in its way."""
        for _ in range(1_000_000):
            if self.up:
                self.ask()
            elif self.down:
                self.deliver()
            elif self.give(room) is None:
                break
        return self

    def run_badly(self, rng: random.Random, *, ordered: bool, cut: int, meanwhile) -> None:
        """At most `cut` steps, with frames out of order and twice unless `ordered`."""
        window = rng.randint(1, 12)
        for _ in range(cut):
            choice = rng.random()
            if choice < 0.05:
                meanwhile()
            elif choice < 0.35 and len(self.down) < window:
                self.give(rng.choice((300, 500, 1_100, 5_000)))
            else:
                side, arrive = rng.choice(((self.up, self.ask), (self.down, self.deliver)))
                if side:
                    place = 0 if ordered else rng.randrange(len(side))
                    if not ordered and rng.random() < 0.1:
                        side.insert(rng.randrange(len(side)), side[place])
                        place = rng.randrange(len(side))
                    arrive(place)


def data_bytes(frame: bytes) -> int:
    return len(sync.read_chunks(frame).data) if frame[0] == sync.CHUNKS else 0


class World:
    """Some nodes that write while they sync."""

    def __init__(self, seed: int, nodes: int) -> None:
        self.random = random.Random(seed)
        self.nodes = [Node(f"n{index}", seed) for index in range(nodes)]
        self.clock_ms = START_MS
        self.bodies: dict[int, bytes] = {}
        self.arrived: dict[str, Counter[int]] = {node.name: Counter() for node in self.nodes}

    def write(self, sizes: tuple[int, ...] = (0, 20, 100, 2_000, 20_000)) -> None:
        rng = self.random
        self.clock_ms += rng.randint(1, 3)
        index, topic_id = rng.randrange(len(self.nodes)), rng.randrange(6)
        size, priority = rng.choice(sizes), rng.randrange(4)
        node = self.nodes[index]
        record = node.store(index, topic_id, self.clock_ms, size=size, priority=priority)
        self.bodies[record_id(record)] = record.body

    def pull(self) -> tuple[Node, Pull]:
        asker, server = self.random.sample(self.nodes, 2)
        return asker, Pull(asker, server, budget=self.random.choice((0, 0, 0, 3_000)))

    def newest(self) -> dict[int, bytes]:
        """What all of them should hold in the end, from what any of them holds."""
        versions: dict[int, list[int]] = {}
        held = set().union(*(node.content for node in self.nodes))
        for long in sorted(held, reverse=True):
            versions.setdefault(long >> 48, []).append(long)
        return {
            long: self.bodies[long]
            for key, longs in versions.items()
            for long in longs[: history(key >> 8, key & 0xFF)]
        }

    def settle(self) -> None:
        """Every node pulls from every other one, uncut, until all must hold all; checks it."""
        expected = self.newest()
        for _ in self.nodes:
            for asker in self.nodes:
                for server in self.nodes:
                    if asker is not server:
                        pull = Pull(asker, server).run()
                        assert pull.intake.complete
                        assert pull.feed.over
                        assert pull.refusals == []
                        self.arrived[asker.name] += pull.arrived
        for node in self.nodes:
            assert node.content == expected
            assert not {long for long, _ in node.shelf} & expected.keys()
        for asker in self.nodes:  # nothing is left to say
            for server in self.nodes:
                if asker is not server:
                    assert Pull(asker, server).run().data_down == 0


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32), nodes=st.integers(2, 4), ordered=st.booleans())
def test_every_node_ends_with_the_newest_and_gets_no_byte_twice(seed, nodes, ordered):
    world = World(seed, nodes)
    rng = world.random
    for _ in range(rng.randint(0, 40)):
        world.write()
    for _ in range(rng.randint(0, 25)):
        asker, pull = world.pull()
        cut = rng.randint(0, 150)
        pull.run_badly(rng, ordered=ordered, cut=cut, meanwhile=world.write)
        assert pull.refusals == []
        world.arrived[asker.name] += pull.arrived
        for _ in range(rng.randint(0, 2)):
            world.write()
    world.settle()
    for counts in world.arrived.values():
        for long, count in counts.items():
            assert count <= len(world.bodies[long])


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32),
    nodes=st.integers(2, 4),
    ordered=st.booleans(),
    listed=st.sampled_from((0, 2, 512)),
)
def test_pulls_at_once_and_restarts_lose_nothing(seed, nodes, ordered, listed):
    with mock.patch.multiple(intake, MAX_LISTED=listed, SPARE_BYTES=listed * 64):
        world = World(seed, nodes)
        rng = world.random
        pulls: dict[tuple[str, str], Pull] = {}
        for _ in range(rng.randint(0, 60)):
            choice = rng.random()
            if choice < 0.4:
                world.write()
            elif choice < 0.43:
                node = rng.choice(world.nodes)
                node.start()
                pulls = {pair: pull for pair, pull in pulls.items() if node.name not in pair}
            elif choice < 0.6:
                asker, pull = world.pull()
                pulls[asker.name, pull.intake.peer] = pull
            elif pulls:
                pull = rng.choice(list(pulls.values()))
                pull.run_badly(rng, ordered=ordered, cut=rng.randint(0, 50), meanwhile=world.write)
                assert pull.refusals == []
        world.settle()
