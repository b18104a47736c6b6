"""Messages between a node and a middleware that is none: what gets through, and what survives."""

import contextlib
import logging
import queue
import sqlite3
import struct
import threading
import time

import pytest

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")

from mocha_link.bridges.bridge import (
    MAX_QUEUED,
    MAX_QUEUED_BYTES,
    QUIET_TOPIC_S,
    Bridge,
    PublishQueue,
)
from mocha_link.bridges.progress import SPARE, Progress
from mocha_link.bridges.run import _state_file
from mocha_link.links.metrics import MessageStored
from mocha_link.ros import typed
from mocha_link.ros.ros import RosCodec
from mocha_link.service.endpoint import folder
from mocha_link.service.service import ServiceServer
from mocha_link.service.service_client import ServiceClient, ServiceUnreachableError

POSE = "geometry_msgs/PoseStamped"
CODEC = RosCodec()


NOT_BRIDGED = "grid/Map is not bridged: no type of ROS 1, nor one of the team's definitions"


def levels(caplog):
    return [(record.levelname, record.getMessage()) for record in caplog.records]


def pose(name, ros):
    return CODEC.encode(POSE, {"header": {"frame_id": name}}, ros)


class FakeMiddleware:
    """A middleware that keeps what is published, and passes on what a test publishes."""

    ros = 1

    def __init__(self):
        self.published = queue.SimpleQueue()
        self.takers = {}
        self.ready = threading.Event()

    def subscribe(self, topic, kind, history, take):
        if topic == "/own":
            raise RuntimeError("no such thing")
        self.takers[topic] = (kind, take)
        if topic == "/pose":
            self.ready.set()

    def publish(self, topic, kind, history, data):
        if b"breaks" in data:
            raise RuntimeError("broken")
        self.published.put((topic, kind, data))

    def text(self, data):
        return struct.pack("<I", len(data)) + data

    def from_text(self, data):
        if len(data) < 4:
            raise ValueError("too short")
        return data[4:]


@contextlib.contextmanager
def running(endpoint, progress, clock=time.monotonic):
    middleware = FakeMiddleware()
    bridge = Bridge(endpoint, middleware, progress, patience_s=0.3, clock=clock)
    thread = threading.Thread(target=bridge.run)
    thread.start()
    try:
        assert middleware.ready.wait(60)
        yield middleware
    finally:
        bridge.stop()
        thread.join(60)
        assert not thread.is_alive()


@pytest.fixture
def progress(tmp_path, monkeypatch):
    monkeypatch.setattr("mocha_link.bridges.bridge.WAIT_S", 0.1)  # ends sooner
    monkeypatch.setattr("mocha_link.bridges.bridge.PAUSE_S", 0.05)
    return Progress(tmp_path / "state")


@pytest.fixture
def stored(one):
    """What the node stores, as it does."""
    events = queue.SimpleQueue()
    one.subscribe(lambda event: isinstance(event, MessageStored) and events.put(event.topic))
    return events


def test_what_the_robot_publishes(server, one, stored, progress, caplog):
    with running(server.endpoint, progress) as middleware:
        kind, take = middleware.takers["/pose"]
        assert kind == POSE
        take(b"nonsense")
        take(pose("there", 1))
        assert stored.get(timeout=60) == "/pose"
        assert one.latest("one", "/pose").data == pose("there", 1)
        kind, take = middleware.takers["/goal"]
        assert kind == "std_msgs/String"
        take(b"")
        take(middleware.text(b"not JSON"))
        take(middleware.text(b"[5]"))
        assert stored.get(timeout=60) == "/goal"
        assert one.latest("one", "/goal").data == b"[5]"
        assert set(middleware.takers) == {"/pose", "/goal", "/log"}
    assert "/pose the node refused: not a geometry_msgs/msg/PoseStamped" in caplog.text
    assert "/goal not published: too short" in caplog.text
    assert ("WARNING", NOT_BRIDGED) in levels(caplog)
    assert "/own cannot be subscribed: no such thing" in caplog.text


def test_topics_without_messages_are_logged_once(server, progress, until_logged):
    now_s = 0.0
    with running(server.endpoint, progress, lambda: now_s) as middleware:
        until_logged("ready")
        middleware.takers["/pose"][1](pose("there", 1))
        now_s = QUIET_TOPIC_S
        until_logged("no message on /goal (std_msgs/String), /log (std_msgs/String) yet")


def test_what_the_robot_published_before_the_end_leaves(server, one, progress):
    with running(server.endpoint, progress) as middleware:
        for number in range(50):
            middleware.takers["/goal"][1](middleware.text(b"%d" % number))
    assert one.latest("one", "/goal").data == b"49"


def test_a_bridge_ends_while_the_robot_goes_on_talking(server, progress, monkeypatch):
    monkeypatch.setattr("mocha_link.bridges.bridge.DRAIN_S", 600.0)
    publish, talking, over = ServiceClient.publish, threading.Event(), threading.Event()
    try:
        with running(server.endpoint, progress) as middleware:
            take = middleware.takers["/goal"][1]

            def answer(*arguments, **options):
                if not over.is_set():
                    take(middleware.text(b"2"))  # before this one has left
                talking.set()
                return publish(*arguments, **options)

            monkeypatch.setattr(ServiceClient, "publish", answer)
            take(middleware.text(b"1"))
            assert talking.wait(60)
    finally:
        over.set()


def test_a_node_without_the_extra_for_ros(two, progress, caplog, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(typed, "_codec", lambda _definitions: None)
        bare = ServiceServer(two, "tcp://127.0.0.1:*")
    with bare, ServiceClient(bare.endpoint) as client:
        team = client.team()
    middleware = FakeMiddleware()
    Bridge(bare.endpoint, middleware, progress)._subscribe(team)
    assert set(middleware.takers) == {"/goal"}
    assert "geometry_msgs/PoseStamped is unknown to the node: it needs the extra" in caplog.text


@pytest.fixture
def until_logged(monkeypatch, caplog):
    """Waits until the bridge logs a text; what was logged before that is gone."""
    caplog.set_level(logging.DEBUG)
    logged: queue.SimpleQueue[str] = queue.SimpleQueue()

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            logged.put(record.getMessage())

    def until_logged(text: str) -> None:
        while text not in logged.get(timeout=60):
            pass

    logger = logging.getLogger("mocha_link")
    monkeypatch.setattr(logger, "handlers", [*logger.handlers, Listener()])
    return until_logged


def test_what_others_publish(server, two, pulled, progress, until_logged):
    """One after another: only the newest of a topic is kept, and a slow bridge may miss others."""
    with running(server.endpoint, progress) as middleware:
        pulled("/pose", b"nonsense")
        until_logged("/two/pose skipped: not a geometry_msgs/msg/PoseStamped")
        pulled("/pose", pose("breaks", 2))
        until_logged("/two/pose skipped: broken")
        pulled("/pose", pose("here", 2))
        two.publish("/raw", b"grid")
        two.publish("/own", b"\0\1\0\0\7\0")
        pulled("/goal", b"{}")
        published = [middleware.published.get(timeout=60) for _ in range(3)]
        assert published[0] == ("/two/pose", POSE, pose("here", 1))
        assert sorted(published[1:]) == [
            ("/two/goal", "std_msgs/String", b"\2\0\0\0{}"),
            ("/two/own", "field/Own", b"\7\0"),
        ]


def test_what_others_publish_to_programs_is_no_fault(progress, caplog):
    caplog.set_level(logging.INFO)
    about = {"robot": "two", "topic": "/raw", "type": "grid/Map", "header": "00"}
    Bridge("ipc://unused", FakeMiddleware(), progress)._publish(about, b"", 1, {"types": {}})
    assert levels(caplog) == [("INFO", NOT_BRIDGED)]


def test_several_messages_in_one(server, two, pulled, progress):
    texts = [CODEC.encode("std_msgs/String", {"data": text}, 2) for text in ("first", "a", "b")]
    for text in texts:
        two.publish("/log", text)
    two.flush("/log")
    with running(server.endpoint, progress) as middleware:
        pulled("/goal", b"1")
        published = [middleware.published.get(timeout=60)[2] for _ in range(3)]
        assert [middleware.from_text(data) for data in published] == [b"a", b"b", b"1"]


def test_a_bridge_that_restarts(server, pulled, progress):
    pulled("/pose", pose("1", 2))
    with running(server.endpoint, progress) as middleware:
        assert middleware.published.get(timeout=60)[2] == pose("1", 1)
    pulled("/pose", pose("2", 2))
    with running(server.endpoint, progress) as middleware:
        pulled("/goal", b"3")
        assert middleware.published.get(timeout=60)[2] == pose("2", 1)
        assert middleware.published.get(timeout=60)[2] == middleware.text(b"3")


def test_a_node_that_restarts(server, pulled, stored, progress, until_logged):
    pulled("/pose", pose("1", 2))
    stored.get(timeout=60)
    with running(server.endpoint, progress) as middleware:
        assert middleware.published.get(timeout=60)[2] == pose("1", 1)
        server.close()
        middleware.takers["/pose"][1](pose("a", 1))
        middleware.takers["/pose"][1](pose("b", 1))
        pulled("/goal", b"2")
        assert stored.get(timeout=60) == "/goal"
        until_logged("waiting for the node")
        with ServiceServer(server.node, server.endpoint):
            assert [stored.get(timeout=60) for _ in range(2)] == ["/pose", "/pose"]
            assert server.node.latest("one", "/pose").data == pose("b", 1)
            # Numbers begin anew with the service, but nothing is published twice.
            assert middleware.published.get(timeout=60)[2] == middleware.text(b"2")
            assert middleware.published.empty()


def test_an_outage_of_one_direction_is_logged_once(server, stored, progress, caplog, monkeypatch):
    """The node answers requests for messages of others, and none to publish."""
    publish, left = ServiceClient.publish, iter(range(20))

    def unanswered(*arguments, **options):
        if next(left, None) is not None:
            raise ServiceUnreachableError("no answer")
        return publish(*arguments, **options)

    monkeypatch.setattr(ServiceClient, "publish", unanswered)
    with running(server.endpoint, progress) as middleware:
        middleware.takers["/pose"][1](pose("there", 1))
        assert stored.get(timeout=60) == "/pose"
    assert caplog.text.count("waiting for the node: no answer") == 1
    assert caplog.text.count("the node answers again") == 1


def test_a_bridge_whose_node_is_away_ends_at_once(server, progress, until_logged, monkeypatch):
    requested, over = threading.Event(), threading.Event()

    def publish(*_, **__):
        requested.set()
        over.wait()
        raise ServiceUnreachableError("no answer")

    monkeypatch.setattr("mocha_link.bridges.bridge.DRAIN_S", 600.0)
    monkeypatch.setattr(ServiceClient, "publish", publish)
    try:
        with running(server.endpoint, progress) as middleware:
            middleware.takers["/goal"][1](middleware.text(b"1"))
            assert requested.wait(60)
            server.close()
            until_logged("waiting for the node")
    finally:
        over.set()
        for thread in threading.enumerate():
            if thread.name == "bridge out":
                thread.join()


def test_the_outbox_is_bounded(caplog):
    queue = PublishQueue()
    for number in range(MAX_QUEUED + 5):
        queue.put("/a", str(number).encode())
    assert queue.dropped == 5
    assert caplog.text.count("the oldest are given up") == 1
    first = queue.first(0)
    assert first == ("/a", b"5")
    queue.done(first)
    assert queue.first(0) == ("/a", b"6")
    queue.put("/b", bytes(MAX_QUEUED_BYTES))
    assert queue.first(0)[0] == "/b"
    queue.done(first)
    assert queue.first(0)[0] == "/b"


# What a bridge remembers over a restart.


def test_it_survives_a_restart(tmp_path):
    path = tmp_path / "new" / "state"
    progress = Progress(path)
    assert progress.place is None
    progress.move(("a-1", 5))
    progress.note("/io/pose", "0011")
    progress.close()
    again = Progress(path)
    assert again.place == ("a-1", 5)
    assert again.published("/io/pose", "0011")
    assert not again.published("/io/pose", "0012")
    assert not again.published("/io/path", "0011")
    again.close()


def test_it_forgets_what_is_long_past():
    progress = Progress()
    for number in range(100):
        progress.note("/a", str(number), history=3)
        progress.note("/a", str(number), history=3)
        progress.note("/b", "x")
    known = [number for number in range(100) if progress.published("/a", str(number))]
    assert known == list(range(100 - 3 - SPARE, 100))
    assert progress.published("/b", "x")
    progress.close()


def test_a_file_that_is_none(tmp_path, caplog):
    path = tmp_path / "state"
    path.write_bytes(b"not a database" * 100)
    for bad in (path, tmp_path, path / "below"):
        progress = Progress(bad)
        progress.move(("a", 1))
        assert progress.place == ("a", 1)
        progress.close()
        assert f"cannot keep state in {bad}" in caplog.text
    assert path.read_bytes() == b"not a database" * 100


def test_a_database_of_another_program(tmp_path, caplog):
    path = tmp_path / "state"
    with contextlib.closing(sqlite3.connect(path)) as other:
        other.execute("CREATE TABLE place (x)")
    progress = Progress(path)
    assert progress.place is None
    progress.move(("a", 1))
    assert progress.place == ("a", 1)
    progress.close()
    assert caplog.text.count("cannot use state: no such column: epoch") == 1


def test_its_folder_is_that_of_the_keys(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    Progress(_state_file("io-ros1")).close()
    assert [path.name for path in folder().iterdir()] == ["io-ros1"]
    folder().chmod(0o755)
    assert _state_file("io-ros1") is None
    assert "is not a folder that only you may use" in caplog.text


def test_a_disk_that_becomes_full(tmp_path, caplog):
    progress = Progress(tmp_path / "state")
    progress.move(("a", 1))
    progress._file.execute("PRAGMA max_page_count = 1")  # no more than it has
    for number in range(200):
        progress.note(f"/{number}", "h" * 200)
    progress.move(("a", 2))
    assert progress.place == ("a", 2)
    assert all(progress.published(f"/{number}", "h" * 200) for number in range(200))
    progress.close()
    assert caplog.text.count("cannot use state: database or disk is full") == 1
    again = Progress(tmp_path / "state")
    assert again.place == ("a", 1)
    again.close()
