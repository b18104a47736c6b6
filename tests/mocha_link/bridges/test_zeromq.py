"""Programs in any language: requests with JSON or bytes, and a stream, through a bridge."""

from __future__ import annotations

import base64
import contextlib
import json
import subprocess
import sys

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")

from mocha_link.bridges.values import ValueTranslator
from mocha_link.bridges.zeromq import ZeroMqBridge
from mocha_link.ros import typed
from mocha_link.ros.ros import RosCodec
from mocha_link.service.endpoint import connect
from mocha_link.service.requests import RequestError
from mocha_link.service.service import ServiceServer
from mocha_link.service.service_client import ServiceClient

TEAM = {
    "robot": "one",
    "robots": {
        "one": {
            "ros": 2,
            "topics": [
                {"name": "/pose", "type": "geometry_msgs/Point"},
                {"name": "/goal", "type": "json/Goal"},
                {"name": "/raw", "type": "grid/Map"},
            ],
        },
        "two": {"ros": 1, "topics": []},
    },
    "definitions": {},
}
POINT = {"x": 1.0, "y": 2.0, "z": 3.0}


class Program:
    """What another program would do: one socket, JSON and bytes."""

    def __init__(self, context, endpoint, kind):
        self.socket = context.socket(kind)
        self.socket.setsockopt(zmq.LINGER, 0)
        assert connect(self.socket, endpoint)

    def ask(self, *data, **fields):
        self.socket.send_multipart([json.dumps(fields).encode(), *data])
        assert self.socket.poll(60_000), "no answer"
        answer, *parts = self.socket.recv_multipart()
        return json.loads(answer), parts


@pytest.fixture
def dial():
    """Makes programs."""
    with contextlib.ExitStack() as stack:
        context = stack.enter_context(zmq.Context())

        def made(endpoint, kind=zmq.REQ):
            program = Program(context, endpoint, kind)
            stack.callback(program.socket.close)
            return program

        yield made


@pytest.fixture
def bridge(server, monkeypatch):
    monkeypatch.setattr("mocha_link.bridges.zeromq.STREAM_WAIT_S", 0.1)  # ends sooner
    with ZeroMqBridge(
        server.endpoint, "tcp://127.0.0.1:*", stream="tcp://127.0.0.1:*", as_json=True
    ) as bridge:
        yield bridge


def test_values_in_place_of_bytes(bridge, dial, one, pulled):
    program = dial(bridge.endpoint)
    answer, _ = program.ask(request="publish", topic="/pose", id="a", value={"header": {"seq": 3}})
    assert answer["ok"], answer
    assert answer["id"] == "a"
    assert one.latest("one", "/pose").data.startswith(b"\3\0\0\0")
    answer, data = program.ask(request="latest", robot="one", topic="/pose", json=True)
    assert data == []
    assert answer["message"]["value"]["header"]["seq"] == 3
    answer, data = program.ask(request="latest", robot="one", topic="/pose")
    assert len(data) == 1
    assert "value" not in answer["message"]
    grid = {"base64": base64.b64encode(b"grid").decode()}
    program.ask(request="publish", topic="/raw", value=grid)
    assert one.latest("one", "/raw").data == b"grid"
    pulled("/goal", b"nonsense")
    answer, _ = program.ask(request="since", own=True, json=True)
    values = {(m["robot"], m["topic"]): m.get("value", "error") for m in answer["messages"]}
    assert values["one", "/raw"] == grid
    assert values["two", "/goal"] == "error"
    answer, _ = program.ask(b"[1]", request="publish", topic="/goal")
    assert one.latest("one", "/goal").data == b"[1]"


def test_one_who_waits_does_not_stop_the_others(bridge, dial, pulled):
    patient, quick = (dial(bridge.endpoint, kind) for kind in (zmq.DEALER, zmq.REQ))
    patient.socket.send(b'{"request": "since", "wait_s": 30, "id": 1}')
    assert quick.ask(request="team")[0]["robot"] == "one"
    pulled("/goal", b"5")
    assert patient.socket.poll(60_000)
    assert patient.socket.recv_multipart()[1] == b"5"


def test_what_is_refused(bridge, dial):
    program = dial(bridge.endpoint)
    for fields, complaint in (
        ({}, "no request 'None'"),
        ({"request": "publish", "topic": "/goal", "value": {"base64": "?"}}, "not Base64"),
        ({"request": "publish", "topic": "/pose", "value": {"x": 1}}, "has no field 'x'"),
        ({"request": "publish", "topic": "/none", "value": 1}, "one has no topic '/none'"),
        ({"request": "publish", "topic": [], "value": 1}, "has no topic"),
        ({"request": "latest", "robot": "one", "topic": "/none", "json": True}, "no topic"),
    ):
        answer, _ = program.ask(id=7, **fields)
        assert answer["ok"] is False
        assert answer["again"] is False
        assert answer["id"] == 7
        assert complaint in answer["error"]
    answer, _ = program.ask(b"x", request="publish", topic="/goal", value=1)
    assert "not both" in answer["error"]


def test_the_stream(bridge, dial, pulled):
    subscriber = dial(bridge.stream, zmq.SUB).socket
    subscriber.setsockopt(zmq.SUBSCRIBE, b"/two/")
    number = 0
    while not subscriber.poll(100):  # until the subscription has arrived there
        number += 1
        pulled("/goal", str(number).encode())
    topic, about = subscriber.recv_multipart()
    assert topic == b"/two/goal"
    fields = json.loads(about)
    assert fields["robot"] == "two"
    assert fields["value"] in range(1, number + 1)


def test_a_node_that_is_away(one, server, dial, monkeypatch):
    monkeypatch.setattr("mocha_link.bridges.zeromq.PATIENCE_S", 0.1)
    with ZeroMqBridge(server.endpoint, "tcp://127.0.0.1:*") as bridge:
        program = dial(bridge.endpoint)
        server.close()
        answer, _ = program.ask(request="team", id=4)
        assert answer == {"ok": False, "id": 4, "error": "the node does not answer", "again": True}
        with ServiceServer(one, server.endpoint):
            while not answer["ok"]:
                answer, _ = program.ask(request="team")


@pytest.fixture(scope="module")
def values():
    return ValueTranslator(TEAM)


def test_without_the_extra_for_ros(monkeypatch):
    monkeypatch.setattr(typed, "_codec", lambda _definitions: None)
    request = {"request": "publish", "topic": "/pose", "value": {"x": 1}}
    with pytest.raises(RequestError, match="ROS messages need the extra 'ros' here"):
        ValueTranslator(TEAM).request(request, [])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=4,
)


@given(topic=st.sampled_from(["/pose", "/goal", "/raw", "/x"]), value=JSON, data=st.binary())
def test_any_value_is_sent_or_refused(values, topic, value, data):
    request = {"request": "publish", "topic": topic, "value": value}
    with contextlib.suppress(RequestError):
        fields, [sent], _ = values.request(json.loads(json.dumps(request)), [])
        assert "value" not in fields
        about = {"robot": "one", "type": values._kinds[topic]}
        assert "error" not in values.value(about, sent)
    for robot in ("one", "two"):
        for kind in ("geometry_msgs/Point", "json/Goal", "grid/Map"):
            shown = values.value({"robot": robot, "type": kind}, data)
            assert len(shown) == 1
            json.dumps(shown, allow_nan=False)


def test_several_messages_in_one(values):
    data = [RosCodec().encode("geometry_msgs/Point", {"x": x}, 1) for x in (1, 2)]
    about = {"robot": "two", "type": "geometry_msgs/Point", "parts": [24, 24]}
    shown = values.value(about, b"".join(data))
    assert [value["x"] for value in shown["values"]] == [1, 2]
    assert values.value({**about, "type": "json/X", "parts": []}, b"") == {"values": []}


def test_real_processes(team, tmp_path, dial):
    """Node and bridge as a user starts them; the bridge dies and comes back."""
    path = tmp_path / "team.yaml"
    path.write_text(team.dump())
    node, door = f"ipc://{tmp_path}/node", f"ipc://{tmp_path}/door"
    with contextlib.ExitStack() as stack:

        def started(*command):
            process = subprocess.Popen(
                [sys.executable, "-m", "mocha_link.cli.cli", *command],
                stderr=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                text=True,
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            for line in process.stderr:
                if line.startswith("ready"):
                    return process
            raise AssertionError(process.wait(60))

        started("node", str(path), "--robot", "one", "--serve", node)
        bridge = started("bridge", "zmq", "--node", node, "--serve", door)
        program = dial(door)
        assert program.ask(request="publish", topic="/goal", value=[1])[0]["ok"]
        answer, _ = program.ask(request="since", own=True, json=True)
        assert answer["messages"][0]["value"] == [1]
        bridge.kill()
        bridge.wait(60)
        with ServiceClient(node, timeout_s=60) as client:
            client.publish("/goal", b"[2]")
        bridge = started("bridge", "zmq", "--node", node, "--serve", door, "--stream", f"{door}2")
        place = {"epoch": answer["epoch"], "sequence": answer["sequence"]}
        answer, _ = program.ask(request="since", own=True, json=True, **place)
        assert [message["value"] for message in answer["messages"]] == [[2]]
        bridge.terminate()
        assert bridge.wait(60) == 0
