"""The gossip nodes of simulated ground robots: what reaches a robot."""

import threading
import time
from collections.abc import Callable, Iterator

import pytest

from benchmarks.fleet.network_sim import team_of
from mocha_link.node import Node
from mocha_link.radios import ManualRadio
from mocha_link.team.team import Team
from sitl.team.nodes import GroundNodes
from tests.mocha_link.conftest import TEAM, WAIT_S, ManualClock, free_ports, own_host

TRAILS = TEAM.replace("priority: medium}", "priority: medium, history: 3}")


def wait_until(condition: Callable[[], bool]) -> None:
    deadline_s, pause = time.monotonic() + WAIT_S, threading.Event()
    while not condition():
        assert time.monotonic() < deadline_s, "did not happen in time"
        pause.wait(0.01)


@pytest.fixture
def team() -> Team:
    host = own_host()
    team, base = team_of(TRAILS), free_ports(host, 6)
    return team.with_robots(
        {
            name: {"base_port": base + 2 * number, "address": host, "listen": host}
            for number, name in enumerate(team.robots)
        }
    )


def arrived(nodes: GroundNodes, last: bytes) -> Iterator[bytes]:
    """What has reached a robot, until a message that is the last."""
    while True:
        for _, message in nodes.arrived():
            yield message.data
            if message.data == last:
                return


def test_each_message_that_a_robot_holds_comes_once(team):
    """Two came between two looks; of a topic with `history` the first is still there."""
    clock = ManualClock()
    with (
        GroundNodes(team, ["callisto"], clock) as nodes,
        Node(team, "io", radio=ManualRadio(), clock=clock) as io,
    ):
        node = nodes.nodes["callisto"]
        for topic, data in (
            *(("/pose", b"here"), ("/pose", b"there")),
            *(("/path", b"one"), ("/path", b"two"), ("/cloud", b"last")),
        ):
            io.publish(topic, data)

            def holds(topic: str = topic, data: bytes = data) -> bool:
                node.sync("io")
                message = node.latest("io", topic)
                return message is not None and message.data == data

            wait_until(holds)
        assert list(arrived(nodes, b"last")) == [b"there", b"one", b"two", b"last"]
