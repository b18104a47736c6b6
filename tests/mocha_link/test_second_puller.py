"""A program that was written from the pages alone pulls from a node of ours.

docs/sync-protocol.md and docs/protocol.md are enough for a second implementation: what
tests/mocha_link/second_puller.py pulls is what was published.
"""

import re
from pathlib import Path

import pytest
import yaml

from mocha_link.links.metrics import Direction, SyncEnded
from tests.mocha_link.conftest import noise
from tests.mocha_link.second_puller import (
    DIGEST,
    HAVE,
    SINCE,
    Configuration,
    Puller,
    Store,
)

TEAM = """
robots:
  a: {kind: rover, address: 127.0.0.1, base_port: 10, clients: [z]}
  z: {kind: rover, address: 127.0.0.1, base_port: 20, clients: [a]}
kinds:
  rover:
    topics:
      - {name: /pose, type: json/Pose, priority: high}
      - {name: /cloud, type: grid/Cloud, priority: low}
      - {name: /log, type: json/Log, history: 700}
trigger: {interval_s: 3600}
"""
A, POSE, CLOUD, LOG = 0, 0, 1, 2  # ids


class Served:
    """A node of ours, and second implementations that pull from it as robot z."""

    def __init__(self, field, stack):
        self.node, _, self.witness = field.node("a")
        robot = field.team.robot("a")
        self.endpoint = f"tcp://{robot.address}:{robot.port_for('z')}"
        self.configuration = Configuration(yaml.safe_load(field.team.dump()))
        self._stack = stack

    def puller(self, store, *, text=None, of=Puller, **options):
        """A puller with the node's team file, or one with another text."""
        configuration = Configuration(yaml.safe_load(text)) if text else self.configuration
        puller = of(configuration, store, self.endpoint, **options)
        self._stack.append(puller)
        return puller


@pytest.fixture
def served(field_of):
    pullers = []
    yield Served(field_of(TEAM), pullers)
    for puller in pullers:
        puller.close()


def test_it_uses_nothing_of_ours():
    source = (Path(__file__).parent / "second_puller.py").read_text()
    imports = set(re.findall(r"^(?:from|import) (\w+)", source, re.MULTILINE))
    assert not imports & {"mocha_link", "air_router", "sitl", "geo", "benchmarks", "tests"}


@pytest.mark.parametrize("form", [HAVE, DIGEST])
def test_whole_and_large_messages(served, form):
    cloud = noise(3_000_000)
    served.node.publish("/pose", b'{"x": 1}')
    served.node.publish("/cloud", cloud)
    store = Store()
    assert served.puller(store).pull(form)
    assert store.data(A, POSE) == [b'{"x": 1}']
    assert store.data(A, CLOUD) == [cloud]
    assert not store.partials
    ended = served.witness.wait(SyncEnded, direction=Direction.OUT)
    assert (ended.peer, ended.messages, ended.complete) == ("z", 2, True)


def test_small_frames_and_little_credit(served):
    cloud = noise(300_000)
    served.node.publish("/cloud", cloud)
    store = Store()
    assert served.puller(store, window_bytes=10_000, frame_bytes=3_000).pull(HAVE)
    assert store.data(A, CLOUD) == [cloud]


def test_since_brings_what_is_new(served):
    served.node.publish("/cloud", noise(300_000))
    store = Store()
    puller = served.puller(store)
    assert puller.pull(HAVE)
    served.node.publish("/pose", b"1")
    assert puller.pull(SINCE)
    assert puller.receptions == [0]
    assert puller.received < 1_000
    assert store.data(A, POSE) == [b"1"]


def test_a_place_that_the_node_does_not_know(served):
    served.node.publish("/pose", b"1")
    store = Store(place=bytes(16))
    puller = served.puller(store)
    assert puller.pull(SINCE)
    assert puller.receptions == [1, 0]
    assert store.data(A, POSE) == [b"1"]


def test_digests_that_differ_in_some_groups(served):
    for number in range(600):
        served.node.publish("/log", b"%d" % number)
    served.node.publish("/pose", b"1")
    store = Store()
    puller = served.puller(store, frame_bytes=2_816)  # its ANSWER takes several frames
    assert puller.pull(DIGEST)
    assert len(store.data(A, LOG)) == 600
    assert puller.compared == 0  # it had nothing to compare
    served.node.publish("/log", b"600")
    assert puller.pull(DIGEST)
    assert puller.compared == 1
    assert puller.received < 1_000
    assert store.data(A, LOG)[-2:] == [b"599", b"600"]
    assert puller.pull(DIGEST)
    assert puller.compared == 1  # nothing differed


@pytest.mark.parametrize("cut_bytes", [1_000_000, 2_900_000])
def test_a_cut_is_resumed_where_it_was(served, cut_bytes):
    cloud = noise(3_000_000)
    served.node.publish("/cloud", cloud)
    store = Store()
    assert not served.puller(store).pull(HAVE, cut_bytes=cut_bytes)
    assert store.partials
    puller = served.puller(store)
    assert puller.pull(HAVE)
    assert puller.received < 3_000_000 - cut_bytes + 100_000
    assert store.data(A, CLOUD) == [cloud]


def test_a_budget_takes_several_pulls(served):
    cloud = noise(300_000)
    served.node.publish("/cloud", cloud)
    store = Store()
    puller = served.puller(store)
    complete = []
    while not store.data(A, CLOUD):
        complete.append(puller.pull(HAVE, budget=100_000))
        assert puller.received < 101_000
    assert complete == [False, False, False, True]
    assert store.data(A, CLOUD) == [cloud]


class Damaging(Puller):
    """Damages a byte of the first message that comes."""

    damaged = 0

    def take(self, frame):
        if frame[0] == 8 and not self.damaged:
            self.damaged = 1
            frame = frame[:-40] + bytes((frame[-40] ^ 1,)) + frame[-39:]
        super().take(frame)


@pytest.mark.parametrize("size", [100, 200_000])
def test_a_damaged_message_is_requested_again(served, size):
    cloud = noise(size)
    served.node.publish("/cloud", cloud)
    store = Store()
    puller = served.puller(store, of=Damaging)
    assert puller.pull(HAVE)
    assert puller.receptions == [0, 0]
    assert store.data(A, CLOUD) == [cloud]


def test_a_follower_gets_what_is_published(served):
    store = Store()
    puller = served.puller(store)
    assert puller.pull(HAVE, follow=True)
    served.witness.wait(SyncEnded, direction=Direction.OUT)
    served.node.publish("/pose", b"1")
    cloud = noise(40_000)
    served.node.publish("/cloud", cloud)
    puller.follow(lambda: bool(store.data(A, POSE) and store.data(A, CLOUD)))
    assert store.data(A, CLOUD) == [cloud]
    large = noise(100_000)  # is announced
    served.node.publish("/cloud", large)
    puller.follow(lambda: bool(puller.announced))
    (message,) = puller.announced
    assert (message.robot, message.topic) == (A, CLOUD)
    assert puller.pull(SINCE)
    assert store.data(A, CLOUD) == [cloud, large]


def test_teams_that_differ_share_what_both_define_alike(served):
    text = TEAM.replace("grid/Cloud", "grid/Other")
    assert text != TEAM
    served.node.publish("/pose", b"1")
    served.node.publish("/cloud", noise(1_000))
    store = Store()
    puller = served.puller(store, text=text)
    assert puller.pull(DIGEST)
    assert puller.receptions == [2, 0]
    assert store.shared == {(robot, topic) for robot in (0, 1) for topic in (POSE, LOG)}
    assert store.data(A, POSE) == [b"1"]
    assert not store.data(A, CLOUD)
    served.node.publish("/pose", b"2")
    assert puller.pull(HAVE)
    assert puller.receptions == [0]  # each knows what ids mean to the other
    assert store.data(A, POSE) == [b"1", b"2"]
