"""Two nodes of a small team; they pull only when a test makes them. One of them is served."""

import threading

import pytest

from benchmarks.fleet.network_sim import team_of
from mocha_link.links.metrics import Direction, MessageStored, SyncEnded
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio
from mocha_link.service.service import ServiceServer
from mocha_link.service.service_client import ServiceClient
from tests.mocha_link.conftest import DATA

TEAM = (DATA / "ros_team.yaml").read_text()


@pytest.fixture
def team(field):
    ports = field.team.robot("titan").base_port
    place = {"address": field.host, "listen": field.host}
    plain = team_of(TEAM)
    return plain.with_robots(
        {"one": {"base_port": ports, **place}, "two": {"base_port": ports + 1, **place}}
    )


@pytest.fixture
def one(team, field):
    with Node(team, "one", clock=field.clock, radio=ManualRadio()) as node:
        yield node


@pytest.fixture
def two(team, field):
    with Node(team, "two", clock=field.clock, radio=ManualRadio()) as node:
        yield node


@pytest.fixture
def server(one):
    with ServiceServer(one, "tcp://127.0.0.1:*") as server:
        server.node = one
        yield server


@pytest.fixture
def client(server):
    with ServiceClient(server.endpoint, timeout_s=60) as client:
        yield client


@pytest.fixture
def pulled(one, two):
    """Lets `two` publish, and `one` pull it."""

    def pull(topic, data):
        stored, ended = threading.Event(), threading.Event()

        def seen(event):
            if isinstance(event, MessageStored) and (event.robot, event.topic) == ("two", topic):
                stored.set()
            elif isinstance(event, SyncEnded) and event.direction is Direction.IN:
                ended.set()

        unsubscribe = one.subscribe(seen)
        two.publish(topic, data)
        assert one.sync("two")
        assert stored.wait(60)
        assert ended.wait(60)
        unsubscribe()

    return pull
