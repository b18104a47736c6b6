"""Our node beside a live, unmodified original MOCHA node under ROS 1.

Runs where MOCHA_WORKSPACE names a catkin workspace in which the original package `mocha_core` is
built (its folder with `devel/setup.bash`), ROS 1 is installed and this machine answers to pings.
"""

import base64
import contextlib
import json
import os
import signal
import socket
import subprocess
from pathlib import Path

import lz4.frame
import pytest

from air_router.sim.ports import free_port
from mocha_link import Node
from mocha_link.links.metrics import Direction, SyncEnded
from mocha_link.radios import ManualRadio
from mocha_link.team import upstream
from tests.mocha_link.conftest import Witness, free_ports, own_host

pytestmark = pytest.mark.foreign_process

WORKSPACE = os.environ.get("MOCHA_WORKSPACE")
PYTHON = os.environ.get("MOCHA_PYTHON", "/usr/bin/python3")  # the one that has rospy
NODES = {
    "integrate_database": "scripts/core/integrate_database.py",
    "topic_translator": "scripts/translators/translator.py",
}
TOPICS = {  # name -> type, size
    "/pose": ("geometry_msgs/PoseStamped", 1),
    "/path": ("nav_msgs/Path", 40),
    "/map": ("nav_msgs/OccupancyGrid", 550),
}
PRIORITIES = ("HIGH_PRIORITY", "MEDIUM_PRIORITY", "LOW_PRIORITY")
HERE = Path(__file__).parent

if not WORKSPACE:
    pytest.skip("MOCHA_WORKSPACE does not name a built original MOCHA", allow_module_level=True)


def has_rospy():
    try:
        return subprocess.run([PYTHON, "-c", "import rospy"], check=False).returncode == 0
    except OSError:
        return False


if not has_rospy():
    pytest.skip(f"{PYTHON} has no rospy", allow_module_level=True)


class Original:
    """A ROS master, an original node and a robot's program beside it, as processes."""

    def __init__(self, stack, folder, name):
        self._stack = stack
        self._folder = folder
        self._name = name
        port = free_port(socket.SOCK_STREAM)
        self._master = f"http://127.0.0.1:{port}"
        master = f"\"import rosmaster; rosmaster.rosmaster_main(['', '--core', '-p', '{port}'])\""
        self._run("master", "exec", PYTHON, "-c", master)
        for node, script in NODES.items():
            found = f'"$(rospack find mocha_core)/{script}"'
            files = [f"_{each}_configs:={folder}/{each}_configs.yaml" for each in FILES]
            self._run(
                node, "exec", PYTHON, found, f"__name:={node}", f"_robot_name:={name}", *files
            )
        self._robot = self._run("robot", "exec", PYTHON, f'"{HERE}/ros1_robot.py"', piped=True)

    def _run(self, what, *command, piped=False):
        script = f'source "{WORKSPACE}/devel/setup.bash"; '
        if what != "master":
            script += "until rostopic list >/dev/null 2>&1; do sleep 0.2; done; "
        pipe = subprocess.PIPE if piped else subprocess.DEVNULL
        log = self._stack.enter_context((self._folder / f"{what}.log").open("w"))
        process = subprocess.Popen(
            ["bash", "-c", script + " ".join(command)],
            stdin=pipe,
            stdout=pipe if piped else log,
            stderr=log,
            text=True,
            start_new_session=True,
            env={  # ROS's own Python, whatever environment the tests run in
                "PATH": "/usr/bin:/bin:/usr/sbin:/sbin",
                "HOME": str(self._folder),
                "ROS_MASTER_URI": self._master,
                "ROS_IP": "127.0.0.1",
            },
        )
        self._stack.callback(self._end, process)
        return process

    def _end(self, process):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe:
                pipe.close()

    def ask(self, name, *arguments):
        self._robot.stdin.write(json.dumps([name, arguments]) + "\n")
        self._robot.stdin.flush()
        return json.loads(self._robot.stdout.readline())


FILES = ("robot", "topic", "radio")


def configure(folder, host):
    """The three files of an original team: ares runs the original, boreas runs ours."""
    base = free_ports("0.0.0.0", 4)
    address = {"ares": "127.0.0.1", "boreas": host}
    robots = {
        name: {
            "node-type": "rover",
            "IP-address": address[name],
            "using-radio": "one",
            "base-port": str(base + 2 * number),
            "clients": [peer],
        }
        for number, (name, peer) in enumerate((("ares", "boreas"), ("boreas", "ares")))
    }
    topics = [
        {"msg_topic": name, "msg_type": kind, "msg_priority": priority, "msg_history": "any"}
        for (name, (kind, _)), priority in zip(TOPICS.items(), PRIORITIES, strict=True)
    ]
    radios = {"one": {"MAC-address": ["02:00:00:00:00:01"]}}
    for each, content in zip(FILES, (robots, {"rover": topics}, radios), strict=True):
        (folder / f"{each}_configs.yaml").write_text(json.dumps(content))  # JSON is YAML


@pytest.mark.timeout(180)
def test_pose_path_and_map_both_ways(tmp_path):
    host = own_host()
    configure(tmp_path, host)
    files = [tmp_path / f"{each}_configs.yaml" for each in FILES]
    team = upstream.load(*files, ours=["boreas"]).team.with_robots({"boreas": {"listen": host}})
    with contextlib.ExitStack() as stack:
        ares = Original(stack, tmp_path, "ares")
        assert ares.ask("ready", "boreas")
        node = Node(team, "boreas", radio=ManualRadio())
        saw = Witness(node)
        stack.enter_context(node)

        sent = {
            topic: base64.b64decode(ares.ask("publish", topic, kind, size))
            for topic, (kind, size) in TOPICS.items()
        }
        held = ares.ask("database", 0, len(TOPICS))
        node.sync("ares")
        ended = saw.wait(SyncEnded, peer="ares", direction=Direction.IN)
        assert ended.messages == len(TOPICS)
        for topic, data in sent.items():
            message = node.latest("ares", topic)
            assert message.data == data
            assert message.header.pack().hex() in held
        assert len(sent["/map"]) > 300_000

        ours = {
            topic: base64.b64decode(ares.ask("make", kind, size))
            for topic, (kind, size) in TOPICS.items()
        }
        headers = {topic: node.publish(topic, data).pack().hex() for topic, data in ours.items()}
        assert ares.ask("pull")
        got = ares.ask("database", 1, len(TOPICS))
        assert set(got) == set(headers.values())
        for topic, data in ours.items():
            assert lz4.frame.decompress(base64.b64decode(got[headers[topic]])) == data
        saw.wait(SyncEnded, peer="ares", direction=Direction.OUT, messages=len(TOPICS))
        assert node.links()["ares"].refused == 0
