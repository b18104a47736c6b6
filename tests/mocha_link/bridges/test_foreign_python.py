"""The bridges to ROS run in the Python of a ROS installation: an old one, with little in it."""

import ast
import builtins
import logging
import subprocess
import sys
import types
from pathlib import Path
from unittest import mock

import pytest

import mocha_link
from mocha_link.bridges import ros_clients, run
from mocha_link.bridges.bridge import channel
from mocha_link.bridges.ros_clients import Rcl, Ros1
from mocha_link.cli.cli import main

PACKAGE = Path(mocha_link.__file__).parent
FOREIGN = {
    "mocha_link",
    "mocha_link.bridges",
    "mocha_link.bridges.__main__",
    "mocha_link.bridges.bridge",
    "mocha_link.bridges.progress",
    "mocha_link.bridges.ros_clients",
    "mocha_link.bridges.run",
    "mocha_link.service",
    "mocha_link.service.endpoint",
    "mocha_link.errors",
    "mocha_link.forks",
    "mocha_link.lazy",
    "mocha_link.loopback",
    "mocha_link.path_safety",
    "mocha_link.lifetime",
    "mocha_link.service.service_client",
}
TYPING = {"IO", "Any", "ClassVar", "Final", "Protocol", "TypeVar"}
NEWER = {"cache", "removeprefix", "removesuffix", "is_relative_to", "pairwise", "randbytes"}


def imported(tree):
    """Modules that are imported when a file is, not those of its functions or for types."""
    for node in tree.body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


def runs(tree):
    """What of a file is evaluated: no annotation is."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            node.returns = None
        elif isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(None)
    return ast.walk(tree)


@pytest.mark.parametrize("module", sorted(FOREIGN))
def test_it_is_python_3_8_and_needs_little(module):
    path = PACKAGE.parent / Path(*module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    tree = ast.parse(path.read_text(), feature_version=(3, 8))
    for name in imported(tree):
        package = name.split(".")[0]
        assert name in FOREIGN or package in sys.stdlib_module_names or package == "zmq", name
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module == "typing":
            assert {alias.name for alias in node.names} <= TYPING
    for node in runs(tree):
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            assert node.value.id not in dir(builtins), ast.unparse(node)
        elif isinstance(node, ast.Attribute):
            assert node.attr not in NEWER, ast.unparse(node)


def test_a_python_that_has_not_even_pyzmq():
    command = [sys.executable, "-S", str(PACKAGE / "bridges"), "ros1", "--node", "tcp://x:1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "has no zmq; install it there" in done.stderr


def test_the_options_get_there(monkeypatch):
    seen, options_there, levels = [], [], []
    monkeypatch.setattr("os.execv", lambda _, arguments: options_there.extend(arguments[2:]))
    monkeypatch.setattr(run, "run", lambda *given: seen.append(given) or 0)
    monkeypatch.setattr(logging, "basicConfig", lambda **options: levels.append(options["level"]))
    options = ["--domain", "7", "--best-effort", "scan", "/front-camera"]
    here = ["--log-level", "error", "bridge", "ros2", "--node", "ipc://x", "--python", "python3"]
    assert main([*here, *options]) == run.main(options_there) == 0
    assert [(kind, given.domain, list(given.best_effort)) for kind, given in seen] == [
        ("ros2", 7, ["/scan", "/front_camera"])
    ] * 2
    assert levels == [logging.ERROR, logging.ERROR]


@pytest.fixture
def rospy(monkeypatch):
    """As much of rospy as the bridge uses; it is of an installation with other message types."""
    fake, installed = types.ModuleType("rospy"), types.ModuleType("roslib.message")
    fake.init_node = fake.publish = lambda *_, **__: None
    fake.AnyMsg = object
    installed.get_message_class = lambda _: types.SimpleNamespace(_md5sum="34cd", _full_text="")
    for name, module in {"rospy": fake, "roslib": fake, "roslib.message": installed}.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(ros_clients, "LOG", logging.getLogger("of the bridge"))
    return fake


def test_what_is_published_by_another_definition_of_the_type_is_not_received(rospy):
    """Its bytes may well be read by ours, and mean something else."""
    taken, subscribed = [], []
    rospy.Subscriber = lambda _topic, _kind, callback, **_: subscribed.append(callback)
    bridge = Ros1("bridge", {"field/Own": {"md5": "12ab", "text": "uint16 count"}})
    bridge.subscribe("/own", "field/Own", 1, taken.append)
    for md5 in ("34cd", "12ab"):
        header = {"type": "field/Own", "md5sum": md5}
        subscribed[0](types.SimpleNamespace(_connection_header=header, _buff=md5.encode()))
    assert taken == [b"12ab"]


def test_what_is_published_is_announced_as_the_node_has_the_type(rospy):
    """It has made the bytes."""
    announced = []
    rospy.Publisher = lambda _topic, kind, **_: announced.append(kind) or rospy
    own = {"md5": "12ab", "text": "uint16 count"}
    bridge = Ros1("bridge", {"field/Own": own, "std_msgs/String": {}})
    bridge.publish("/two/own", "field/Own", 1, b"\7\0")
    bridge.publish("/two/goal", "std_msgs/String", 1, bridge.text(b"{}"))
    assert [(kind._type, kind._md5sum) for kind in announced] == [
        ("field/Own", "12ab"),
        ("std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1"),
    ]


@pytest.fixture
def rclpy(monkeypatch):
    """All modules of it in one, which records its calls."""
    fake = mock.MagicMock(ExternalShutdownException=KeyError)
    fake.qos = fake
    fake.spin.side_effect = KeyError
    fake.get_message = lambda name: name
    fake.QoSProfile = lambda **fields: tuple(fields.values())
    names = ("rclpy", "rclpy.executors", "rclpy.signals", "rosidl_runtime_py.utilities")
    for name in (*names, "rosidl_runtime_py"):
        monkeypatch.setitem(sys.modules, name, fake)
    return fake


def test_bytes_are_requested_of_rclpy(rclpy):
    hand, call, node = object(), mock.call, rclpy.create_node.return_value
    reliable, best_effort = rclpy.ReliabilityPolicy.RELIABLE, rclpy.ReliabilityPolicy.BEST_EFFORT
    lasting, volatile = rclpy.DurabilityPolicy.TRANSIENT_LOCAL, rclpy.DurabilityPolicy.VOLATILE
    rcl = Rcl("bridge", best_effort=["/scan"])
    rcl.subscribe("/pose", "geometry_msgs/Pose", 1, hand)
    rcl.subscribe("/scan", "sensor_msgs/LaserScan", 50, hand)
    rcl.publish("/io/pose", "geometry_msgs/Pose", 3, b"cdr")
    rcl.publish("/io/pose", "geometry_msgs/Pose", 3, b"cdr2")
    rcl.close()
    rclpy.init.assert_called_once_with(signal_handler_options=rclpy.SignalHandlerOptions.NO)
    rclpy.create_node.assert_called_once_with("bridge")
    assert node.create_subscription.mock_calls == [
        call("geometry_msgs/msg/Pose", "/pose", hand, (10, reliable, volatile), raw=True),
        call("sensor_msgs/msg/LaserScan", "/scan", hand, (50, best_effort, volatile), raw=True),
    ]
    assert node.create_publisher.mock_calls == [
        call("geometry_msgs/msg/Pose", "/io/pose", (3, reliable, lasting)),
        call().publish(b"cdr"),
        call().publish(b"cdr2"),
    ]
    rclpy.shutdown.assert_called_once_with()


@pytest.mark.parametrize(
    ("name", "channel_name"),
    [
        ("/io//pose", "/io/pose"),
        ("pose", "/pose"),
        ("/rover-1//a b/c", "/rover_1/a_b/c"),
        ("/3d/1", "/_3d/_1"),
        ("", "/"),
    ],
)
def test_names_that_ros_allows(name, channel_name):
    assert channel(name) == channel_name
