"""Nodes that sync over a model of a network: cuts, reordering, repetition, messages replaced."""

import random
from collections import Counter
from unittest import mock

from hypothesis import example, given
from hypothesis import strategies as st

from mocha_link.store.reassembly_buffer import SLOW_S
from mocha_link.sync import holdings
from mocha_link.sync.frames import record_id
from mocha_link.sync.send_states import SendState
from tests.mocha_link.network import START_MS, TEAM, Node, Pull


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
        for message_id in sorted(held, reverse=True):
            versions.setdefault(message_id >> 48, []).append(message_id)
        return {
            message_id: self.bodies[message_id]
            for key, message_ids in versions.items()
            for message_id in message_ids[: TEAM.histories[key]]
        }

    def settle(self, *, clean: bool = True) -> None:
        """Every node pulls from every other one, uncut, until all must hold all; checks it.

        Unless `clean` there may be damaged parts in reassembly buffers.
        """
        expected = self.newest()
        for _ in self.nodes:
            for asker in self.nodes:
                for server in self.nodes:
                    if asker is not server:
                        Pull.steady_s += SLOW_S  # who was bringing a message is not any more
                        pull = Pull(asker, server).run()
                        assert pull.receiver.complete
                        assert pull.sender.state is SendState.OVER
                        assert pull.refusals == [] or not clean
                        self.arrived[asker.name] += pull.arrived
        for node in self.nodes:
            assert node.content == expected
            assert not {message_id for message_id, _ in node.reassembly.of("")} & expected.keys()
        for asker in self.nodes:  # nothing is left to send
            for server in self.nodes:
                if asker is not server:
                    assert Pull(asker, server).run().data_down == 0


@given(seed=st.integers(0, 2**32), nodes=st.integers(2, 4), ordered=st.booleans())
@example(seed=523, nodes=3, ordered=True)
@example(seed=2816, nodes=3, ordered=False)
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
        for message_id, count in counts.items():
            assert count <= len(world.bodies[message_id])


@given(
    seed=st.integers(0, 2**32),
    nodes=st.integers(2, 4),
    ordered=st.booleans(),
    listed=st.sampled_from((0, 2, 512)),
)
def test_pulls_at_once_and_restarts_lose_nothing(seed, nodes, ordered, listed):
    with mock.patch.multiple(holdings, MAX_LISTED=listed, SPARE_BYTES=listed * 64):
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
                pulls[asker.name, pull.peer.name] = pull
            elif pulls:
                pull = rng.choice(list(pulls.values()))
                pull.run_badly(rng, ordered=ordered, cut=rng.randint(0, 50), meanwhile=world.write)
                assert pull.refusals == []
        world.settle()


@given(seed=st.integers(0, 2**32), nodes=st.integers(2, 3), ordered=st.booleans())
def test_damage_on_the_way_is_never_kept(seed, nodes, ordered):
    world = World(seed, nodes)
    rng = world.random
    for _ in range(rng.randint(1, 20)):
        world.write()
    for _ in range(rng.randint(0, 15)):
        _, pull = world.pull()
        cut = rng.randint(0, 200)
        pull.run_badly(rng, ordered=ordered, cut=cut, meanwhile=world.write, damage=0.2)
        for node in world.nodes:
            assert node.content.items() <= world.bodies.items()
    world.settle(clean=False)


def test_a_message_written_during_a_pull_does_not_come_back_through_a_third_node():
    ugv, peer, uav = Node("ugv"), Node("peer"), Node("uav")
    pull = Pull(ugv, peer)
    pull.deliver_up()
    written = ugv.store(0, 0, START_MS, size=100_000)  # the peer cannot learn of it in this pull
    assert pull.run().receiver.complete
    Pull(uav, ugv).run()
    Pull(peer, uav).run()
    assert peer.content == {record_id(written): written.body}
    listing = Pull(ugv, peer).run()
    assert listing.data_down == 0
    assert Pull(ugv, peer).bytes_up < listing.bytes_up  # it is listed once


def test_an_urgent_message_is_in_the_very_next_frame():
    asker, server = Node("asker"), Node("server")
    server.store(0, 0, START_MS, size=5_000_000, priority=1)
    pull = Pull(asker, server)
    pull.deliver_up()
    for _ in range(100):
        assert pull.give()
    urgent = server.store(0, 1, START_MS + 1, size=200, priority=3)
    frame = pull.give()
    assert urgent.body in frame
    assert len(frame) > 1_000  # and the map goes on behind it
    while not pull.events:
        pull.deliver()
    assert pull.events[0].topic == "/t1"
    pull.run()
    assert asker.content == server.content
    assert pull.sender.messages == 2


FILLED = 4_096


def filled(name: str) -> Node:
    node = Node(name)
    for number in range(FILLED):
        node.store(number >> 8, number & 0xFF, START_MS + number)
    return node


def changes(node: Node, at_ms: int) -> list[int]:
    rng = random.Random(at_ms)
    return [
        record_id(node.store(rng.randrange(256), rng.randrange(256), at_ms + number))
        for number in range(10)
    ]


def headers_of(pull: Pull) -> int:
    return pull.bytes_up + pull.bytes_down - pull.data_down


def test_few_bytes_list_what_is_new():
    """4,096 entries, 10 of which differ: what the frames take beside the bodies, both ways."""
    asker, server = filled("asker"), filled("server")
    changed = changes(server, START_MS + 100_000)
    pull = Pull(asker, server, room=65_536).run()
    assert pull.arrived.keys() == set(changed)
    assert asker.content == server.content
    back = Pull(server, asker, room=65_536).run()  # as an unknown peer: it has never pulled before
    assert back.data_down == 0
    strangers = headers_of(pull) + headers_of(back)
    assert strangers < 5_000, strangers
    changed = changes(server, START_MS + 200_000)
    pull = Pull(asker, server, room=65_536).run()
    back = Pull(server, asker, room=65_536).run()
    assert pull.arrived.keys() == set(changed)
    assert back.data_down == 0
    met = headers_of(pull) + headers_of(back)
    assert met < 1_000, met


def test_a_small_budget_moves_something_though_unknown_peers_have_much_to_compare():
    asker, server = Node("a"), Node("b")
    for robot_id in range(30):
        for topic_id in range(20):
            for node in (asker, server):
                node.store(robot_id, topic_id, START_MS + 2_000)
        server.store(robot_id, 0, START_MS + 9_000)
    contacts = 0
    while not Pull(asker, server, budget=3_000).run().receiver.complete:
        contacts += 1
        assert contacts < 5
    assert asker.content == server.content
