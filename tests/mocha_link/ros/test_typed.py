"""What the data of messages mean, by the type of their topic."""

import json
import sys

import pytest

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")

from benchmarks.fleet.network_sim import team_of
from mocha_link.node.node import Node
from mocha_link.ros import typed
from mocha_link.ros.typed import Typed, TypedError
from tests.mocha_link.bridges.conftest import TEAM

POSE = {"header": {"frame_id": "map"}, "pose": {"position": {"x": 1.5}}}


@pytest.fixture
def team():
    return team_of(TEAM)


def message(team, robot, topic, data):
    node = Node(team, robot)
    node.publish(topic, data)
    return node.latest(robot, topic)


def test_by_type(team):
    types = Typed(team)
    for robot, size in (("one", 75), ("two", 76)):
        data = types.encode(robot, "/pose", POSE)
        assert len(data) == size  # ROS 1; CDR
        sent = message(team, robot, "/pose", data)
        pose = types.decode(sent)
        assert pose.pose.position.x == 1.5
        assert types.encode(robot, "/pose", pose) == data
        assert types.plain(sent)["header"]["frame_id"] == "map"
        sent = message(team, robot, "/goal", types.encode(robot, "/goal", {"at": [1, 2]}))
        assert sent.data == b'{"at":[1,2]}'
        assert types.decode(sent) == types.plain(sent) == {"at": [1, 2]}
        own = message(team, robot, "/own", types.encode(robot, "/own", {"count": 7}))
        assert types.decode(own).count == 7
        raw = message(team, robot, "/raw", types.encode(robot, "/raw", bytearray(b"\0\1")))
        assert types.decode(raw) == types.plain(raw) == b"\0\1"


def test_what_does_not_fit(team):
    types = Typed(team)
    for topic in ("/pose", "/goal", "/own"):
        for data in (b"\xff", b"{", b"[" * 100_000):
            with pytest.raises(TypedError, match=f"one {topic}: not "):
                types.decode(message(team, "one", topic, data))
    for topic, value in (("/pose", {"x": 1}), ("/goal", b""), ("/goal", float("nan")), ("/raw", 5)):
        with pytest.raises(TypedError, match=f"one {topic}"):
            types.encode("one", topic, value)


def test_without_the_extra(team, monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "rosbags.interfaces", None)
    monkeypatch.delitem(sys.modules, "mocha_link.ros.ros", raising=False)
    types = typed.Typed(team)
    assert "what reads ROS messages needs rosbags" in caplog.text
    sent = message(team, "one", "/pose", b"bytes")
    assert types.decode(sent) == types.plain(sent) == b"bytes"
    assert types.encode("one", "/pose", b"bytes") == b"bytes"
    assert types.decode(message(team, "one", "/goal", json.dumps([1]).encode())) == [1]
