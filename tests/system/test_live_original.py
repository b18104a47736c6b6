"""Our node between two live, unmodified original MOCHA nodes under ROS 1.

Runs where MOCHA_WORKSPACE names a catkin workspace in which the original package `mocha_core` is
built (its folder with `devel/setup.bash`), ROS 1 is installed and this machine answers to pings.
"""

import base64
import contextlib
import json
import os
import random
import signal
import socket
import subprocess
import threading
import time
from pathlib import Path

import lz4.frame
import pytest

from air_router.sim.ports import free_port
from mocha_link import Node
from mocha_link.links.metrics import Direction, MessageStored, SyncTimedOut
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
TOPICS = {  # name -> type, size, priority; in the order in which they are exchanged
    "/pose": ("geometry_msgs/PoseStamped", 1, "HIGH_PRIORITY"),
    "/fix": ("sensor_msgs/NavSatFix", 90, "HIGH_PRIORITY"),
    "/path": ("nav_msgs/Path", 40, "MEDIUM_PRIORITY"),
    "/status": ("std_msgs/String", 20, "MEDIUM_PRIORITY"),
    "/map": ("nav_msgs/OccupancyGrid", 550, "LOW_PRIORITY"),
    "/image": ("sensor_msgs/Image", 300, "NO_PRIORITY"),
}
ARES, BOREAS, CERES = 0, 1, 2  # robot ids
HELD_BYTES = 60_000  # of the map; all before it together are less than a tenth
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
        self._processes = []
        master = f"\"import rosmaster; rosmaster.rosmaster_main(['', '--core', '-p', '{port}'])\""
        self._run("master", "exec", PYTHON, "-c", master)
        self.nodes = {}
        for node, script in NODES.items():
            found = f'"$(rospack find mocha_core)/{script}"'
            files = [f"_{each}_configs:={folder}/{each}_configs.yaml" for each in FILES]
            self.nodes[node] = self._run(
                node, "exec", PYTHON, found, f"__name:={node}", f"_robot_name:={name}", *files
            )
        self._robot = self._run("robot", "exec", PYTHON, f'"{HERE}/ros1_robot.py"', piped=True)

    def _run(self, what, *command, piped=False):
        script = f'source "{WORKSPACE}/devel/setup.bash"; '
        if what != "master":
            script += "until rostopic list >/dev/null 2>&1; do sleep 0.2; done; "
        pipe = subprocess.PIPE if piped else subprocess.DEVNULL
        log = self._stack.enter_context((self._folder / f"{self._name}-{what}.log").open("a"))
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
        self._processes.insert(0, process)
        return process

    def _end(self, process):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe:
                pipe.close()

    def kill(self):
        """End it without notice, with its translator, its program and its master."""
        for process in self._processes:  # the node first
            self._end(process)

    def publish_all(self):
        """A message of each topic; their data."""
        return {
            topic: base64.b64decode(self.call("publish", topic, kind, size))
            for topic, (kind, size, _) in TOPICS.items()
        }

    def holds(self, robot_id, data):
        """Wait until it has that much of a robot; whether it is just that."""
        got = self.call("database", robot_id, len(data))
        found = [lz4.frame.decompress(base64.b64decode(each)) for each in got.values()]
        return sorted(found) == sorted(data.values())

    def call(self, name, *arguments):
        self._robot.stdin.write(json.dumps([name, arguments]) + "\n")
        self._robot.stdin.flush()
        return json.loads(self._robot.stdout.readline())


FILES = ("robot", "topic", "radio")


def configure(folder, host):
    """The three files of an original team: boreas runs ours, between two originals."""
    base = free_ports("0.0.0.0", 4)
    address = {"ares": "127.0.0.1", "boreas": host, "ceres": "127.0.0.1"}
    clients = {"ares": ["boreas"], "boreas": ["ares", "ceres"], "ceres": ["boreas"]}
    first = {"ares": base, "boreas": base + 1, "ceres": base + 3}
    robots = {
        name: {
            "node-type": "rover",
            "IP-address": address[name],
            "using-radio": "one",
            "base-port": first[name],
            "clients": clients[name],
        }
        for name in clients
    }
    topics = [
        {"msg_topic": name, "msg_type": kind, "msg_priority": priority, "msg_history": "any"}
        for name, (kind, _, priority) in TOPICS.items()
    ]
    radios = {"one": {"MAC-address": ["02:00:00:00:00:01"]}}
    for each, content in zip(FILES, (robots, {"rover": topics}, radios), strict=True):
        (folder / f"{each}_configs.yaml").write_text(json.dumps(content))  # JSON is YAML


class Relay:
    """Carries connections, and holds what comes back on them after so many bytes of each."""

    def __init__(self, stack, listen, target):
        self.held = threading.Event()
        self.limit = None
        self._target = target
        self._ends = []
        self._listener = socket.create_server(listen)
        stack.callback(self.cut)
        stack.callback(self._listener.close)
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self):
        """End every connection."""
        self.limit = None
        self.held.clear()
        ends, self._ends = self._ends, []
        for end in ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                try:
                    far = socket.create_connection(self._target)
                except OSError:
                    near.close()
                    continue
                self._ends += [near, far]
                for pair, limited in (((near, far), False), ((far, near), True)):
                    threading.Thread(target=self._pump, args=(*pair, limited), daemon=True).start()

    def _pump(self, source, sink, limited):
        carried = 0
        with contextlib.suppress(OSError):
            while data := source.recv(4096):
                carried += len(data)
                if limited and self.limit is not None and carried > self.limit:
                    self.held.set()
                    return
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)


class Field:
    """The originals ares and ceres, and the team of boreas between them, with relays to ares."""

    def __init__(self, stack, folder):
        self._stack, self.folder = stack, folder
        outside, inside, near_ares = own_host(), own_host(), own_host()
        configure(folder, outside)
        files = [folder / f"{each}_configs.yaml" for each in FILES]
        team = upstream.load(*files, ours=["boreas"]).team
        boreas, ares = team.robot("boreas"), team.robot("ares")
        number = free_ports(near_ares, 1)
        self.to_ares = Relay(stack, (near_ares, number), ("127.0.0.1", ares.port_for("boreas")))
        self.from_ares, _ = (
            Relay(stack, (outside, port), (inside, port))
            for port in map(boreas.port_for, ("ares", "ceres"))
        )
        self.team = team.with_robots(
            {
                "boreas": {"listen": inside},
                "ares": {"address": near_ares, "base_port": number},
            }
        )
        self.port = (inside, boreas.port_for("ares"))
        self.ares, self.ceres = self.original("ares"), self.original("ceres")

    def original(self, name):
        started = Original(self._stack, self.folder, name)
        assert started.call("ready", "boreas")
        return started

    def node(self):
        node = Node(self.team, "boreas", radio=ManualRadio(), storage=self.folder / "boreas.db")
        return node, Witness(node)


@pytest.fixture
def live(tmp_path):
    with contextlib.ExitStack() as stack:
        yield Field(stack, tmp_path)


def pulled(node, saw, peer, data, late=()):
    """Pull from a peer; what came is just that, in the order of priorities.

    `late`: topics at which a pull broke off before: they come in their turn, or last if
    bytes of them had come, as tests/mocha_link/sync/test_client.py decides in injected time.
    """
    seen = len(saw.seen)
    assert saw.pull(peer).messages == len(data)
    stored = [each for each in saw.seen[seen:] if isinstance(each, MessageStored)]
    came = [each.topic for each in stored if each.robot == peer]
    orders = [*TOPICS], [*(topic for topic in TOPICS if topic not in late), *late]
    priorities = [[TOPICS[topic][2] for topic in each] for each in (came, *orders)]
    assert priorities[0] in priorities[1:]
    assert {topic: node.latest(peer, topic).data for topic in data} == data


def wrong_bytes(place, count):
    """So many connections to a port, with bytes that no node sends."""
    noise = random.Random(1)
    for _ in range(count):
        with socket.create_connection(place) as client:
            client.sendall(noise.randbytes(noise.randrange(1, 2000)))


@pytest.mark.timeout(240)
def test_types_priorities_and_a_mule_that_is_restarted_among_wrong_bytes(live):
    """Ours takes the messages of each original to the other one, bit by bit as they were."""
    node, saw = live.node()
    with node:
        sent = live.ares.publish_all()
        assert live.ares.holds(ARES, sent)
        assert len(sent["/map"]) > 300_000
        pulled(node, saw, "ares", sent)
        assert live.ceres.call("pull")
        assert live.ceres.holds(ARES, sent)
    node, saw = live.node()  # of its file
    with node:
        assert {topic: node.latest("ares", topic).data for topic in sent} == sent
        wrong_bytes(live.port, 200)
        back = live.ceres.publish_all()
        assert live.ceres.holds(CERES, back)
        pulled(node, saw, "ceres", back)
        ours = {
            topic: base64.b64decode(live.ares.call("make", kind, size))
            for topic, (kind, size, _) in TOPICS.items()
        }
        for topic, data in ours.items():
            node.publish(topic, data)
        assert live.ares.call("pull")
        assert live.ares.holds(CERES, back)
        assert live.ares.holds(BOREAS, ours)
        while node.links()["ares"].refused < 200:  # counted once a second
            time.sleep(0.1)
        links = node.links()
        assert links["ceres"].refused == links["ceres"].timeouts == 0


@pytest.mark.timeout(240)
def test_an_original_is_killed_while_we_pull_from_it(live):
    """What had come is kept, the rest comes from the next process, and ceres notices nothing."""
    node, saw = live.node()
    with node:
        sent = live.ares.publish_all()
        assert live.ares.holds(ARES, sent)
        live.to_ares.limit = HELD_BYTES
        node.sync("ares")
        assert live.to_ares.held.wait(60)
        live.ares.kill()
        live.to_ares.cut()
        saw.wait(SyncTimedOut, peer="ares", direction=Direction.IN)
        for topic in ("/pose", "/fix", "/path", "/status"):
            assert node.latest("ares", topic).data == sent[topic]
        assert node.latest("ares", "/map") is None
        back = live.ceres.publish_all()
        assert live.ceres.holds(CERES, back)
        pulled(node, saw, "ceres", back)
        ares = live.original("ares")
        again = ares.publish_all()
        assert ares.holds(ARES, again)
        pulled(node, saw, "ares", again, late=["/map"])
        assert ares.call("pull")
        assert ares.holds(CERES, back)


@pytest.mark.timeout(240)
def test_an_original_is_killed_while_it_pulls_from_us(live):
    """Its next process pulls all of it, and ceres does meanwhile."""
    node, _ = live.node()
    with node:
        ours = {
            topic: base64.b64decode(live.ares.call("make", kind, size))
            for topic, (kind, size, _) in TOPICS.items()
        }
        for topic, data in ours.items():
            node.publish(topic, data)
        live.from_ares.limit = HELD_BYTES
        live.ares.call("trigger")
        assert live.from_ares.held.wait(60)
        live.ares.kill()
        live.from_ares.cut()
        assert live.ceres.call("pull")
        assert live.ceres.holds(BOREAS, ours)
        ares = live.original("ares")
        assert ares.call("pull")
        assert ares.holds(BOREAS, ours)
        assert node.links()["ceres"].timeouts == 0
