"""A live ROS 1: its master, a bridge in its Python, and a ROS node that talks and listens."""

import contextlib
import os
import queue
import subprocess
import sys
import threading

import pytest

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")

from mocha_link.links.metrics import MessageStored
from mocha_link.ros.ros import RosCodec
from tests.mocha_link.conftest import DATA

PYTHON = "/usr/bin/python3"
BRIDGE = [sys.executable, *["-m", "mocha_link.cli.cli", "bridge", "ros1", "--node"]]
POSE = "geometry_msgs/PoseStamped"
NODE = (DATA / "ros1_node.txt").read_text()


pytestmark = pytest.mark.foreign_process


@pytest.fixture(scope="module", autouse=True)
def _has_ros():
    """Called where these tests run: every worker collects them."""
    command = [PYTHON, "-c", "import rospy, zmq, geometry_msgs.msg, rosmaster"]
    try:
        subprocess.run(command, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip(f"{PYTHON} has no rospy and pyzmq")


@pytest.fixture
def ros(tmp_path, field):
    """The environment of a ROS master of our own; and what starts processes in it."""
    port = field.team.robot("io").base_port
    environment = {
        **os.environ,
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
        "ROS_IP": "127.0.0.1",
        "ROS_HOME": str(tmp_path / "ros"),
    }
    with contextlib.ExitStack() as stack:

        def start(*command, until=None):
            """Start a process; with `until`, wait for a line with it on stderr."""
            process = subprocess.Popen(
                command,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE if until else subprocess.DEVNULL,
                text=True,
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            if until:
                seen = []
                for line in process.stderr:
                    seen.append(line)
                    if until in line:
                        threading.Thread(target=process.stderr.read, daemon=True).start()
                        return process
                raise AssertionError(seen)
            return process

        start(
            PYTHON,
            "-c",
            f"import rosmaster; rosmaster.rosmaster_main(['x', '--core', '-p', '{port}'])",
        )
        yield start


def test_both_ways_and_a_restart(ros, server, one, pulled, tmp_path):
    bridge = [*BRIDGE, server.endpoint]
    bridge += ["--python", PYTHON, "--state", str(tmp_path / "state")]
    stored = queue.SimpleQueue()
    one.subscribe(lambda event: isinstance(event, MessageStored) and stored.put(event.topic))
    pulled("/pose", RosCodec().encode(POSE, {"header": {"frame_id": "from two"}}, 2))
    pulled("/own", b"\0\1\0\0\7\0")  # a type that ROS has no package of
    running = ros(*bridge, until="ready: the bridge of one")
    other = ros(PYTHON, "-c", NODE)
    assert next(other.stdout) == "pose from two\n"
    topics = set()
    while topics < {"/pose", "/goal"}:
        topics.add(stored.get(timeout=60))
    while one.latest("one", "/goal") is None or one.latest("one", "/pose") is None:
        stored.get(timeout=60)
    pose = RosCodec().decode(POSE, one.latest("one", "/pose").data, 1)
    assert pose.header.frame_id == "from ROS"
    assert one.latest("one", "/goal").data == b"[1, 2]"
    pulled("/goal", b"{}")
    assert next(other.stdout) == "goal {}\n"
    # It dies, comes back, and hands on what came meanwhile, but nothing twice.
    running.kill()
    running.wait(60)
    pulled("/goal", b"{ }")
    running = ros(*bridge, until="ready: the bridge of one")
    assert next(other.stdout) == "goal { }\n"
    running.terminate()
    assert running.wait(60) == 0
    assert one.latest("one", "/own") is None  # that was no field/Own


def test_without_ros(server):
    command = [*BRIDGE, server.endpoint]
    for python, complaint in (
        (sys.executable, "has no rospy; name one"),
        ("/no/python", "no program"),
    ):
        done = subprocess.run(
            [*command, "--python", python], capture_output=True, text=True, check=False
        )
        assert done.returncode == 1
        assert complaint in done.stderr
