"""ROS messages: the bytes of both versions, JSON, and bytes that are hostile."""

import json
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")

from mocha_link.ros import ros_store
from mocha_link.ros.ros import RosCodec, RosError
from tests.mocha_link.conftest import DATA
from tests.mocha_link.fuzz import EXPLORE

CAPTURED = json.loads((DATA / "ros_payloads.json").read_text())
CAPTURED_BYTES = {ros: bytes.fromhex(CAPTURED[f"ros{ros}"]) for ros in (1, 2)}
DEFINITIONS = {
    "field/Goal": "# where to\nint32 KIND_ANY=0\nHeader header\nPlace[] places\nstring[2] from\n",
    "field/Place": "geometry_msgs/Point at\nfloat32[] weights\nuint8[4] mark\nbool done\n",
}
TYPES = (
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/PoseArray",
    "nav_msgs/Path",
    "nav_msgs/OccupancyGrid",
    "nav_msgs/Odometry",
    "sensor_msgs/PointCloud2",
    "sensor_msgs/CameraInfo",
    "diagnostic_msgs/DiagnosticArray",
    "visualization_msgs/MarkerArray",
    "field/Goal",
)
GRID = "nav_msgs/OccupancyGrid"
GOAL = {
    "header": {"stamp": {"sec": 5, "nanosec": 7}, "frame_id": "map"},
    "places": [
        {"at": {"x": 1.5, "y": -2.0, "z": math.pi}, "weights": [0.5, 1.0], "mark": "AQIDBA=="},
        {"done": True},
    ],
    "from": ["here", "there"],
}


@pytest.fixture(scope="module")
def codec():
    return RosCodec(DEFINITIONS)


def test_the_captured_message_both_ways(codec):
    kind = CAPTURED["type"]
    for ros, other in ((1, 2), (2, 1)):
        message = codec.decode(kind, CAPTURED_BYTES[ros], ros)
        assert message.header.frame_id == "m0"
        assert message.pose.orientation.w == 1
        assert codec.encode(kind, message, ros) == CAPTURED_BYTES[ros]
        converted = codec.convert(kind, CAPTURED_BYTES[ros], from_ros=ros, to_ros=other)
        if other == 1:  # ROS 2 has no header.seq, so it is 0 and not 1
            converted = b"\x01" + converted[1:]
        assert converted == CAPTURED_BYTES[other]
    assert codec.to_json(kind, codec.decode(kind, CAPTURED_BYTES[1], 1))["header"] == {
        "seq": 1,
        "stamp": {"sec": 1795175897, "nanosec": 370494365},
        "frame_id": "m0",
    }


def test_types_of_the_team(codec):
    for ros in (1, 2):
        data = codec.encode("field/Goal", GOAL, ros)
        goal = codec.decode("field/Goal", data, ros)
        assert goal.places[0].at.z == math.pi
        assert goal.places[0].mark.tolist() == [1, 2, 3, 4]
        assert goal.from_ == ["here", "there"]  # a keyword of Python
        plain = codec.to_json("field/Goal", goal)
        assert plain["places"][0]["weights"] == [0.5, 1.0]
        assert plain["places"][1] == {
            "at": {"x": 0.0, "y": 0.0, "z": 0.0},
            "weights": [],
            "mark": "AAAAAA==",
            "done": True,
        }
        assert codec.encode("field/Goal", json.loads(json.dumps(plain)), ros) == data
    text, md5 = codec.definition("nav_msgs/Path")
    assert md5 == "6227e2b7e9cce15051f669a5e197bbf7"
    assert "MSG: geometry_msgs/Quaternion" in text
    assert not codec.knows("spomp/ClaimedGoalArray")


def test_types_that_the_two_versions_spell_differently(codec):
    values = {"K": [float(number) for number in range(9)], "D": [0.5], "roi": {"width": 7}}
    data = codec.encode("sensor_msgs/CameraInfo", values, 1)
    cdr = codec.convert("sensor_msgs/CameraInfo", data, from_ros=1, to_ros=2)
    info = codec.decode("sensor_msgs/CameraInfo", cdr, 2)
    assert info.k.tolist() == values["K"]
    assert info.roi.width == 7
    assert codec.convert("sensor_msgs/CameraInfo", cdr, from_ros=2, to_ros=1) == data


def test_numbers_that_json_does_not_have(codec):
    values = {"pose": {"covariance": ["nan", "inf", "-inf"] + 33 * [0]}}
    kind = "geometry_msgs/PoseWithCovarianceStamped"
    message = codec.from_json(kind, values)
    assert np.isnan(message.pose.covariance[0])
    plain = codec.to_json(kind, message)
    assert json.loads(json.dumps(plain, allow_nan=False))["pose"]["covariance"][:4] == [
        "nan",
        "inf",
        "-inf",
        0,
    ]


@pytest.mark.parametrize("ros", [1, 2])
def test_numbers_of_numpy_are_numbers(codec, ros):
    cells = np.arange(12, dtype=np.int8)
    for data in (cells, cells.astype(np.int64), np.stack([cells, cells], axis=1)[:, 0]):
        values = {"info": {"resolution": np.float32(0.5), "width": np.int64(12)}, "data": data}
        grid = codec.decode(GRID, codec.encode(GRID, values, ros), ros)
        assert (grid.info.resolution, grid.info.width) == (0.5, 12)
        assert grid.data.tolist() == list(range(12))
    for wrong in (np.array([300]), np.array([0.5]), np.array([[1]]), np.array(1)):
        with pytest.raises(RosError, match="stands where a"):
            codec.encode(GRID, {"data": wrong}, ros)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"pose": {"positon": {}}}, "pose: geometry_msgs/msg/Pose has no field 'positon'"),
        ({"header": {"seq": -1}}, "header.seq: -1 stands where a uint32 is wanted"),
        ({"header": {"seq": True}}, "True stands where a uint32"),
        ({"header": {"stamp": 5}}, "header.stamp: 5 stands where an object"),
        ({"pose": {"position": {"x": "1"}}}, "pose.position.x: text '1' stands where a float64"),
        ({"header": {"frame_id": "\ud800"}}, "no geometry_msgs/msg/PoseStamped can be made"),
        ([], "a list stands where an object"),
    ],
)
def test_values_that_do_not_fit(codec, values, complaint):
    with pytest.raises(RosError, match=complaint):
        codec.encode("geometry_msgs/PoseStamped", codec.from_json(CAPTURED["type"], values), 1)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"places": [{"mark": "AA=="}]}, r"places\[0\].mark: 1 elements, not 4"),
        ({"places": [{"mark": "?"}]}, "not Base64"),
        ({"places": [{"weights": [1, None]}]}, r"weights\[1\]: None stands where a float32"),
        ({"places": [{"weights": [1e300]}]}, r"weights\[0\]: 1e\+300 stands where a float32"),
        ({"places": [{"at": {"x": 10**400}}]}, r"at\.x: 1000"),
        ({"places": {}}, "an object stands where a list"),
        ({"from": ["one"]}, "1 elements, not 2"),
    ],
)
def test_arrays_that_do_not_fit(codec, values, complaint):
    with pytest.raises(RosError, match=complaint):
        codec.encode("field/Goal", values, 1)


def test_objects_that_do_not_fit(codec):
    pose = codec.from_json("geometry_msgs/PoseStamped", {})
    for kind, message in (("nav_msgs/Path", pose), ("geometry_msgs/PoseStamped", 5)):
        for act in (lambda k, m: codec.encode(k, m, 2), codec.to_json):
            with pytest.raises(RosError, match="stands where a"):
                act(kind, message)
    pose.pose = None
    for ros in (1, 2):
        with pytest.raises(RosError):
            codec.encode("geometry_msgs/PoseStamped", pose, ros)
    with pytest.raises(RosError):
        codec.to_json("geometry_msgs/PoseStamped", pose)


@pytest.mark.parametrize(
    ("definitions", "complaint"),
    [
        ({"a/B": "int32"}, "definition of a/B is not a .msg text"),
        ({"a/B": "string[100000] x"}, "array x cannot have 100000 elements"),
        ({"a/B": "int8[0] x"}, "cannot have 0 elements"),
        ({"nav_msgs/Path": "int32 x"}, "has another type of this name"),
        ({"a/B": "float64 X=1e999"}, "definition of a/B cannot be used"),
        ({"a/B": "int32 from\nint32 from_"}, "definition of a/B"),
    ],
)
def test_definitions_that_are_none(definitions, complaint):
    with pytest.raises(RosError, match=complaint):
        RosCodec(definitions)


def test_types_that_are_not_there():
    codec = RosCodec({"a/B": "C c", "a/D": "D[] d"})
    for kind, complaint in (
        ("a/B", r"type a/msg/C \(within a/msg/B\) is not a standard one of ROS 1; add the text"),
        ("a/D", "holds itself"),
        ("foo", "type foo/msg/ is not"),
        ("spomp/X", "type spomp/msg/X is not"),
    ):
        with pytest.raises(RosError, match=complaint):
            codec.decode(kind, b"", 1)
        with pytest.raises(RosError):
            codec.encode(kind, {}, 2)
        with pytest.raises(RosError):
            codec.to_json(kind, {})


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("kind", TYPES)
def test_cut_and_grown_messages(codec, kind, ros):
    data = codec.encode(kind, GOAL if kind == "field/Goal" else {}, ros)
    assert codec.encode(kind, codec.decode(kind, data, ros), ros) == data
    for end in range(len(data)):
        with pytest.raises(RosError):
            codec.decode(kind, data[:end], ros)
    with pytest.raises(RosError):
        codec.decode(kind, data + bytes(4), ros)


@pytest.mark.parametrize("ros", [1, 2])
@settings(max_examples=5000 if EXPLORE else 75)
@given(kind=st.sampled_from(TYPES), data=st.data())
def test_hostile_bytes(codec, kind, ros, data):
    """Whatever comes is a message, which can be written and shown, or a RosError."""
    good = codec.encode(kind, GOAL if kind == "field/Goal" else {}, ros)
    raw = bytearray(good if data.draw(st.booleans()) else data.draw(st.binary(max_size=200)))
    for _ in range(data.draw(st.integers(0, 4)) if raw else 0):
        at = data.draw(st.integers(0, len(raw) - 1))
        piece = data.draw(st.sampled_from([b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0", b"\1"]))
        raw[at : at + len(piece)] = piece
    if ros == 2 and data.draw(st.booleans()):
        raw[:4] = bytes((0, 1, 0, 0))
    try:
        message = codec.decode(kind, bytes(raw), ros)
        json.dumps(codec.to_json(kind, message), allow_nan=False)
        codec.encode(kind, message, 1)
        codec.encode(kind, message, 2)
    except RosError:
        pass


def test_a_length_that_lies_costs_nothing(monkeypatch):
    monkeypatch.setattr(ros_store, "MAX_OBJECTS", 10_000)
    codec = RosCodec({"a/Bomb": "std_msgs/Empty[] nothing", "a/Dots": "std_msgs/UInt8[] dots"})
    cases = [(kind, ros) for kind in (*TYPES[:-1], "a/Bomb", "a/Dots") for ros in (1, 2)]
    for kind, ros in cases:
        codec.decode(kind, codec.encode(kind, {}, ros), ros)  # makes the code
    tracemalloc.start()
    for kind, ros in cases:
        for size in (b"\xff\xff\xff\x00", b"\xff\xff\xff\xff"):
            raw = (b"\0\1\0\0" if ros == 2 else b"") + 40 * size
            with pytest.raises(RosError):
                codec.decode(kind, raw, ros)
    with pytest.raises(RosError, match="more than 10000 messages within it"):
        codec.decode("a/Dots", (20_000).to_bytes(4, "little") + bytes(20_000), 1)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 20e6


def test_a_message_that_is_too_large(codec):
    with pytest.raises(RosError, match="at most 67108864"):
        codec.decode("sensor_msgs/PointCloud2", bytes(64 * 1024 * 1024 + 1), 1)
