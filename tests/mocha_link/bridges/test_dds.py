"""ROS 2 topics through CycloneDDS: another participant, with types of its own, on loopback."""

import queue
import signal
import subprocess
import sys
from dataclasses import dataclass

import pytest

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")
pytest.importorskip("cyclonedds", reason="CycloneDDS has no wheel for this machine")

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl._support import Buffer
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from mocha_link.bridges.dds import Dds, DdsError, DdsTypes
from mocha_link.bridges.ros_clients import Cdr
from mocha_link.links.metrics import MessageStored
from mocha_link.ros.ros import RosCodec, RosError
from tests.loopback_dds import taken

POINT = "geometry_msgs/PointStamped"
VALUE = {
    "header": {"stamp": {"sec": 7, "nanosec": 8}, "frame_id": "map"},
    "point": {"x": 1.5, "y": 2.0, "z": -3.0},
}


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: types.int32
    nanosec: types.uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    x: types.float64
    y: types.float64
    z: types.float64


@dataclass
class PointStamped(IdlStruct, typename="geometry_msgs.msg.dds_.PointStamped_"):
    header: Header
    point: Point


SAMPLE = PointStamped(Header(Time(7, 8), "map"), Point(1.5, 2.0, -3.0))
RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
LASTING = Policy.Durability.TransientLocal


@pytest.fixture
def dds(domain):
    dds = Dds({"field/Own": "uint16 count"}, domain=domain)
    yield dds
    dds.close()


def writer(participant, topic, *policies):
    made = Topic(participant, topic, PointStamped)
    return DataWriter(participant, made, qos=Qos(*(policies or (RELIABLE, LASTING))))


def reader(participant, topic):
    made = Topic(participant, topic, PointStamped)
    return DataReader(participant, made, qos=Qos(RELIABLE, LASTING))


def test_another_participant_receives_and_is_received(dds, domain):
    other = DomainParticipant(domain)
    received = queue.SimpleQueue()
    dds.subscribe("/point", POINT, 1, received.put)
    writer(other, "rt/point").write(SAMPLE)
    data = received.get(timeout=60)
    assert RosCodec().to_json(POINT, RosCodec().decode(POINT, data, 2)) == VALUE
    dds.publish("/io/point", POINT, 1, data)
    assert taken(reader(other, "rt/io/point")) == SAMPLE


def test_a_publisher_that_is_not_reliable(domain):
    dds = Dds({}, domain=domain, best_effort=["/point"])
    received = queue.SimpleQueue()
    dds.subscribe("/point", POINT, 1, received.put)
    out = writer(DomainParticipant(domain), "rt/point", Policy.Reliability.BestEffort)
    out.write(SAMPLE)
    assert received.get(timeout=60)
    dds.close()


def test_a_publisher_that_is_not_reliable_is_logged_where_the_subscriber_is(
    dds, domain, monkeypatch
):
    logged = queue.SimpleQueue()
    monkeypatch.setattr("mocha_link.bridges.dds.LOG.warning", lambda *what: logged.put(what))
    dds.subscribe("/point", POINT, 1, logged.put)
    out = writer(DomainParticipant(domain), "rt/point", Policy.Reliability.BestEffort)
    text, *about = logged.get(timeout=60)
    wanted = "/point is not received: its publisher is not reliable; pass --best-effort /point"
    assert text % tuple(about) == wanted
    assert out.topic.name == "rt/point"  # it was there until now


def test_what_takes_a_message_may_fail(domain, caplog):
    """The thread goes on, to hand over the next one."""
    received = queue.SimpleQueue()

    def take(data):
        received.put(data)
        raise RosError("no position")

    with Dds({}, domain=domain) as dds:
        dds.subscribe("/point", POINT, 1, take)
        out = writer(DomainParticipant(domain), "rt/point")
        for _ in range(2):
            out.write(SAMPLE)
            assert received.get(timeout=60)
    dds.close()  # again
    assert "no position" in caplog.text


@pytest.mark.parametrize("number", ["abc", "233", "-1"])
def test_a_domain_that_is_none(number, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", number)
    with pytest.raises(DdsError, match=f"{number} is no DDS domain, 0 to 232"):
        Dds({})


def test_a_domain_that_cannot_be_joined(domain, monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Domain><Wrong/></Domain></CycloneDDS>")
    with pytest.raises(DdsError, match="is CYCLONEDDS_URI right"):
        Dds({}, domain=domain)


def test_types_of_the_team(dds):
    received = queue.SimpleQueue()
    dds.subscribe("/own", "field/Own", 1, received.put)
    dds.publish("/own", "field/Own", 1, b"\0\1\0\0\7\0\0\0")
    assert received.get(timeout=60) == b"\0\1\0\0\7\0\0\0"
    with pytest.raises(RosError, match="field/msg/Other is not a standard one of ROS 2"):
        dds.publish("/other", "field/Other", 1, b"")


@pytest.mark.parametrize(
    "kind",
    [
        "nav_msgs/OccupancyGrid",
        "sensor_msgs/PointCloud2",
        "geometry_msgs/PoseWithCovarianceStamped",
        "visualization_msgs/MarkerArray",
        "std_msgs/Empty",
        "std_msgs/Byte",
        "std_msgs/Char",
        "field/Odd",
    ],
)
def test_what_dds_gets_of_a_type(kind):
    """Its own serializer agrees with the one of `RosCodec` on an empty message."""
    odd = {"field/Odd": "string<=5 a\nint8[<=3] b\nstd_msgs/Byte[2] c\nbool[] d\nuint64 class\n"}
    types_made = DdsTypes(odd)
    made = types_made.of(kind)
    made.__idl__.populate()
    data = RosCodec(odd).encode(kind, {}, 2)
    assert made.deserialize(data).data == data
    package, name = kind.split("/")
    assert made.__idl_typename__ == f"{package}.msg.dds_.{name}_"
    assert made.__idl__.keyless

    def ignore(_self, **_fields):
        pass

    for struct in (made, *types_made._structs.values()):
        struct.__init__ = ignore
    buffer = Buffer(data[4:])
    made.__idl__.v1_machine.deserialize(buffer)
    assert buffer.tell() == len(data) - 4


@pytest.mark.parametrize("text", [b"", b"a", "\u00e9".encode(), b'{"a": [1]}'])
def test_text(text):
    data = Cdr().text(text)
    message = RosCodec().decode("std_msgs/String", data, 2)
    assert message.data == text.decode()
    assert Cdr().from_text(data) == text
    assert Cdr().from_text(data + bytes(-len(data) % 4)) == text
    big = b"\0\0\0\0" + data[4:8][::-1] + data[8:]
    assert Cdr().from_text(big) == text


@pytest.mark.parametrize(
    "data",
    [b"", b"\0\1\0\0", b"\0\1\0\0\0\0\0\0\0", b"\1\1\0\0\1\0\0\0\0", b"\0\1\0\0\xff\xff\xff\xff\0"],
)
def test_text_that_is_none(data):
    with pytest.raises(ValueError, match="not a std_msgs/String"):
        Cdr().from_text(data)


def test_a_bridge_in_its_own_process(server, one, pulled, domain, tmp_path):
    command = [sys.executable, "-m", "mocha_link.cli.cli", "bridge", "ros2", "--dds"]
    options = ["--node", server.endpoint, "--domain", str(domain), "--state", str(tmp_path / "s")]
    stored = queue.SimpleQueue()
    one.subscribe(lambda event: isinstance(event, MessageStored) and stored.put(event.topic))
    other = DomainParticipant(domain)
    pulled(
        "/pose", RosCodec().encode("geometry_msgs/PoseStamped", {"header": {"frame_id": "x"}}, 2)
    )
    with subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True) as process:
        try:
            for line in process.stderr:
                if "ready" in line:
                    break
            poses = DdsTypes({}).of("geometry_msgs/PoseStamped")
            made = Topic(other, "rt/two/pose", poses)
            sample = taken(DataReader(other, made, qos=Qos(RELIABLE, LASTING)))
            pose = RosCodec().decode("geometry_msgs/PoseStamped", sample.data, 2)
            assert pose.header.frame_id == "x"
            DataWriter(other, Topic(other, "rt/pose", poses), qos=Qos(RELIABLE, LASTING)).write(
                sample
            )
            while stored.get(timeout=60) != "/pose" or not one.latest("one", "/pose"):
                pass
            message = one.latest("one", "/pose")
            assert RosCodec().decode("geometry_msgs/PoseStamped", message.data, 1) is not None
        finally:
            process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
