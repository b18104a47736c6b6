"""Programs on the same machine send a node requests: answers, and what is none."""

import base64
import json
import threading
from dataclasses import replace

import pytest
import yaml
import zmq
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")

from mocha_link.node.node import Node
from mocha_link.ros.ros import RosCodec
from mocha_link.ros.typed import Typed, TypedError
from mocha_link.service.endpoint import connect
from mocha_link.service.service import Service, ServiceServer
from mocha_link.service.service_client import ServiceClient, ServiceError, ServiceUnreachableError
from tests.mocha_link.conftest import DATA
from tests.mocha_link.libzmq import bind

REFUSED = yaml.safe_load((DATA.parent / "refused" / "requests.yaml").read_text())
POSE = {"header": {"frame_id": "map"}}


def test_publish_and_read(client, one):
    header = client.publish("/raw", b"\0grid")
    assert one.latest("one", "/raw").data == b"\0grid"
    about, data = client.latest("one", "/raw")
    assert (about["header"], data) == (header, b"\0grid")
    assert about["type"] == "grid/Map"
    assert about["stamp_s"] == pytest.approx(1_795_175_900, abs=10)
    assert client.latest("two", "/pose") is None
    client.publish("/goal", b"{}")
    assert {m["topic"] for m in client.messages()} == {"/raw", "/goal"}
    assert client.messages("two") == []


def test_a_repeated_request_publishes_once(client, one):
    header = client.publish("/raw", b"1", key="a")
    assert client.publish("/raw", b"1", key="a") == header
    assert client.publish("/raw", b"2", key="b") != header
    assert client.since(own=True)[0][1] == 2


def test_what_is_new_since_the_last_time(client, one, pulled):
    place, messages = client.since()
    assert messages == []
    for number in range(3):
        pulled("/raw", bytes([number]))
    place, messages = client.since(place)
    assert [(about["robot"], data) for about, data in messages][-1] == ("two", b"\2")
    assert client.since(place)[1] == []
    one.publish("/goal", b"{}")
    assert client.since(place)[1] == []
    [(about, data)] = client.since(place, own=True)[1]
    assert (about["robot"], about["topic"], data) == ("one", "/goal", b"{}")
    # Another database, or this one before a restart: everything that is kept.
    assert len(client.since(("0123", 7), own=True)[1]) == 4


def test_much_comes_in_batches(client, one):
    for topic, size in (("/goal", 1), ("/pose", 9_000_000), ("/raw", 5_000_000)):
        one.publish(topic, bytes(size))
    place, batches = None, []
    while True:
        place, messages = client.since(place, own=True)
        if not messages:
            break
        batches.append([about["size"] for about, _ in messages])
    assert batches == [[1, 9_000_000], [5_000_000]]
    place = None
    for _ in range(3):
        place, messages = client.since(place, own=True, limit=1)
        assert len(messages) == 1
    assert client.since(place, own=True, limit=1)[1] == []


def test_waiting_for_a_message(client, pulled):
    place, _ = client.since()
    pulling = threading.Thread(target=pulled, args=("/goal", b"[1]"))
    pulling.start()
    _, [(about, data)] = client.since(place, wait_s=20.0)
    assert (about["topic"], data) == ("/goal", b"[1]")
    pulling.join()
    assert client.since(("", 0), wait_s=0.01, limit=1)[1]


def test_who_waits_is_answered_when_the_node_ends(client, server, monkeypatch):
    place, _ = client.since()
    take = server._service.request
    closing = threading.Thread(target=server.close)

    def taken(*arguments):
        take(*arguments)
        closing.start()

    monkeypatch.setattr(server._service, "request", taken)
    assert client.since(place, wait_s=20.0) == (place, [])
    closing.join()


def test_in_the_form_of_either_ros(client, one, two, pulled):
    codec = RosCodec()
    cdr = codec.encode("geometry_msgs/PoseStamped", POSE, 2)
    pulled("/pose", cdr)
    assert client.latest("two", "/pose")[1] == cdr
    ros1 = client.latest("two", "/pose", ros=1)[1]
    assert codec.decode("geometry_msgs/PoseStamped", ros1, 1).header.frame_id == "map"
    assert client.since(ros=1)[1][0][1] == ros1
    client.publish("/pose", cdr, ros=2)
    assert one.latest("one", "/pose").data == ros1  # as this robot has it
    with pytest.raises(ServiceError, match="not a geometry_msgs/msg/PoseStamped of ROS 1"):
        client.publish("/pose", cdr[:-1], ros=1)
    two.publish("/pose", b"nonsense")
    pulled("/goal", b"nonsense")
    errors = {about["topic"]: about["error"] for about, _ in client.since(ros=1)[1]}
    assert "not a geometry_msgs" in errors["/pose"]
    assert "not JSON" in errors["/goal"]


def strings(*texts, ros=1):
    return [RosCodec().encode("std_msgs/String", {"data": text}, ros) for text in texts]


def test_a_damaged_batch(client, one, monkeypatch):
    for data in strings("a", "b"):
        one.publish("/log", data)
    one.flush("/log")
    message = replace(one.latest("one", "/log"), parts=())  # as of a team file without aggregate
    monkeypatch.setattr(one, "latest", lambda *_: message)
    about, data = client.latest("one", "/log")
    assert about["error"] == "not a batch of messages"
    assert data == b""
    with pytest.raises(TypedError, match="one /log: not a batch"):
        Typed(one.team).decode(message)


def test_values_in_place_of_bytes(client, one, two, pulled):
    client.request("publish", topic="/pose", value={"header": {"seq": 3}})
    assert one.latest("one", "/pose").data.startswith(b"\3\0\0\0")
    answer, data = client.request("latest", robot="one", topic="/pose", json=True)
    assert answer["message"]["value"]["header"]["seq"] == 3
    assert data == []
    grid = {"base64": base64.b64encode(b"grid").decode()}
    client.request("publish", topic="/raw", value=grid)
    assert one.latest("one", "/raw").data == b"grid"
    for data in strings("goes at once", "a", "bcd", ros=2):
        two.publish("/log", data)
    two.flush("/log")
    pulled("/goal", b"nonsense")
    answer, data = client.request("since", own=True, json=True)
    found = {(m["robot"], m["topic"]): m for m in answer["messages"]}
    assert found["one", "/raw"]["value"] == grid
    assert "not JSON" in found["two", "/goal"]["error"]
    assert found["two", "/log"]["values"] == [{"data": "a"}, {"data": "bcd"}]
    assert data == []


def test_what_the_team_is(client):
    team = client.team()
    assert team["robot"] == "one"
    assert team["robots"]["two"]["ros"] == 2
    assert team["robots"]["two"]["topics"][2] == {
        "name": "/raw",
        "type": "grid/Map",
        "priority": "none",
        "history": 3,
    }
    assert team["types"]["geometry_msgs/PoseStamped"]["md5"] == "d3812c3cbc69362b77dc0b19b345f8f5"
    assert team["types"]["grid/Map"] == {}
    assert team["definitions"] == {"field/Own": "uint16 count"}


@pytest.mark.parametrize(
    ("frames", "complaint"),
    [
        *((map(str.encode, frames), complaint) for frames, complaint in REFUSED),
        ([b" " * (8 * 1024 * 1024 + 1)], "of up to 8388608 bytes"),
        ([b"[" * 100_000], "begins with a JSON object"),
    ],
)
def test_what_is_no_request(one, frames, complaint):
    answers = []
    Service(one).request([*frames], answers.append, 0.0)
    [[answer]] = answers
    fields = json.loads(answer)
    assert fields["ok"] is False
    assert complaint in fields["error"]


def test_too_many_wait(one):
    service, answers = Service(one), []
    for _ in range(257):
        service.request([b'{"request": "since", "wait_s": 1, "id": 7}'], answers.append, 5.0)
    assert len(answers) == 1
    assert b"256 requests wait already" in answers[0][0]
    assert service.until_s == 6
    service.tick(5.9)
    assert len(answers) == 1
    service.tick(6.0)
    assert len(answers) == 257
    assert service.until_s is None
    assert json.loads(answers[-1][0])["id"] == 7


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=3,
)
KEYS = st.sampled_from(
    [
        *("request", "id", "robot", "topic", "ros", "key", "now", "epoch", "sequence"),
        *("limit", "wait_s", "json", "value"),
    ]
)
REQUESTS = st.dictionaries(KEYS, VALUES, max_size=4).flatmap(
    lambda fields: st.sampled_from(["publish", "latest", "list", "since", "team", "?"]).map(
        lambda name: json.dumps({"topic": "/goal", "robot": "one", **fields, "request": name})
    )
)
TOPICS = st.sampled_from(["/pose", "/goal", "/raw", "/own"])


@pytest.fixture
def still(team):
    """A service of a node that does not run."""
    return Service(Node(team, "one"))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(frames=st.lists(st.binary(max_size=30) | REQUESTS.map(str.encode), max_size=3))
def test_every_request_is_answered_once(still, frames):
    answers = []
    still.request(frames, answers.append, 0.0)
    still.tick(1e9)
    [answer] = answers
    assert json.loads(answer[0])["ok"] in (True, False)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(topic=TOPICS, value=VALUES, data=st.binary())
def test_any_value_or_data_becomes_json(one, topic, value, data):
    """What is published as a value comes back as one; data that are none come back as an error."""
    service, answers = Service(one), []
    shown = json.dumps({"request": "latest", "robot": "one", "topic": topic, "json": True}).encode()
    publish = json.dumps({"request": "publish", "topic": topic, "value": value}).encode()
    service.request([publish], answers.append, 0.0)
    service.request([shown], answers.append, 0.0)
    published, read = (json.loads(answer[0], parse_constant=pytest.fail) for answer in answers)
    assert not published["ok"] or "error" not in read["message"]
    one.publish(topic, data)
    service.request([shown], answers.append, 0.0)
    message = json.loads(answers[-1][0], parse_constant=pytest.fail)["message"]
    assert ("value" in message) != ("error" in message)


def test_a_value_that_is_nested_too_deeply_costs_only_itself(one, monkeypatch):
    """From Python 3.12 on more can be read than written: a peer would stop all requests."""
    service, answers = Service(one), []
    one.publish("/goal", b"0")
    for depth in range(850, 1000):
        nested = []
        for _ in range(depth):
            nested = [nested]
        monkeypatch.setattr(service._typed, "plain", lambda _, nested=nested: nested)
        service.request([b'{"request": "since", "own": true, "json": true}'], answers.append, 0.0)
    assert all(answer[0].startswith(b'{"ok":true') for answer in answers)
    assert b"recursion" in answers[-1][0]


def test_a_mistake_of_ours_costs_only_one_of_those_who_wait(one, monkeypatch, caplog):
    service, answers = Service(one), []
    for number in (1, 2):
        request = b'{"request": "since", "wait_s": 9, "sequence": 5, "id": %d}' % number
        service.request([request], answers.append, 0.0)
    monkeypatch.setattr(one, "stored_since", lambda *_: 1 / 0)
    service.tick(1.0)
    assert [json.loads(answer[0])["id"] for answer in answers] == [1, 2]
    assert b"the node failed at this" in answers[0][0]
    assert "ZeroDivisionError" in caplog.text


def test_any_socket_may_send_requests(server):
    with zmq.Context() as context:
        for kind, empty in ((zmq.REQ, []), (zmq.DEALER, [b""]), (zmq.DEALER, [])):
            with context.socket(kind) as requester:
                requester.setsockopt(zmq.LINGER, 0)
                connect(requester, server.endpoint)
                requester.send_multipart([*empty, b'{"request": "team", "id": "x"}'])
                assert requester.poll(60_000)
                answer = requester.recv_multipart()
                assert answer[:-1] == empty
                assert json.loads(answer[-1])["id"] == "x"


def test_the_time_that_is_reported_is_that_of_the_whole_wait(server):
    with ServiceClient(server.endpoint, timeout_s=0.1) as client:
        place, _ = client.since(own=True)
        server.close()
        with pytest.raises(ServiceUnreachableError, match=r"within 0\.3 s"):
            client.since(place, own=True, wait_s=0.2)


def test_a_node_that_comes_back(one, server):
    with (
        ServiceClient(server.endpoint, timeout_s=60) as patient,
        ServiceClient(server.endpoint, timeout_s=0.3) as hasty,
    ):
        patient.publish("/goal", b"1")
        place, _ = patient.since(own=True)
        server.close()
        with pytest.raises(ServiceUnreachableError, match="no answer from"):
            hasty.team()
        with ServiceServer(one, server.endpoint):
            again, messages = patient.since(place, own=True)
        assert again != place
        assert len(messages) == 1


@pytest.mark.parametrize(
    "answer", [b"x", b"[]", b'{"id": 1}', b'{"id": 1, "ok": true}', b"[" * 9999]
)
def test_something_else_there(answer):
    with zmq.Context() as context, context.socket(zmq.ROUTER) as other:
        other.setsockopt(zmq.LINGER, 0)
        endpoint = bind(other, "tcp://127.0.0.1:*")

        def reply():
            sender, *_ = other.recv_multipart()
            other.send_multipart([sender, answer])

        thread = threading.Thread(target=reply)
        thread.start()
        with (
            ServiceClient(endpoint, timeout_s=60) as client,
            pytest.raises(ServiceUnreachableError, match="is not a node"),
        ):
            client.since()
        thread.join()
