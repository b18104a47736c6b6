"""Two nodes whose radio is a real babeld, each in a network namespace; a relay comes and goes.

Node a (10.9.0.1) and node b (10.9.0.2) have a cable each to a relay (10.9.0.3), which runs babeld
and no node. babeld treats the cables as wireless links: a link without loss costs 256.
"""

import contextlib
import itertools
import json
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from mocha_link import ServiceClient, Team
from mocha_link.radios import open_radio

WAIT_S = 90
TEAM = """\
robots:
  a: {{kind: rover, address: 10.9.0.1, base_port: 24100, clients: [b], radio: "babel:{0}/a.sock"}}
  b: {{kind: rover, address: 10.9.0.2, base_port: 24200, clients: [a], radio: "babel:{0}/b.sock"}}
kinds: {{rover: {{topics: [{{name: /pose, type: json/Pose}}]}}}}
trigger: {{interval_s: 1}}
"""
CONFIG = """\
default type wireless hello-interval 0.5 update-interval 2
redistribute local ip 10.9.0.0/16 allow
redistribute local ip fd00:9::/32 allow
redistribute local deny
"""


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def lacking() -> str:
    """What this machine lacks for the test; empty: nothing."""
    for program in ("babeld", "ip"):
        if shutil.which(program, path=f"{os.environ.get('PATH', '')}:/usr/sbin") is None:
            return f"needs {program} (Debian: babeld, iproute2)"
    probe = f"mocha{os.getpid()}"
    if subprocess.run(["ip", "netns", "add", probe], check=False, capture_output=True).returncode:
        return "needs the right to make network namespaces (root)"
    run("ip", "netns", "del", probe)
    return ""


LACKING = lacking()
pytestmark = [
    pytest.mark.skipif(bool(LACKING), reason=LACKING),
    pytest.mark.foreign_process,
    pytest.mark.long,
]
_numbers = itertools.count()


class World:
    """Three namespaces a, b, r with a cable each from a and b to r."""

    def __init__(self, folder, stack):
        self.folder = folder
        self._stack = stack
        self._prefix = f"m{os.getpid()}x{next(_numbers)}"
        self._babelds = {}
        for name in "abr":
            run("ip", "netns", "add", self.space(name))
            stack.callback(run, "ip", "netns", "del", self.space(name))
            self.ip(name, "link", "set", "dev", "lo", "up")
            forward = ["net.ipv4.ip_forward=1", "net.ipv6.conf.all.forwarding=1"]
            run("ip", "netns", "exec", self.space(name), "sysctl", "-qw", *forward)
        for end in "ab":
            there = ["peer", "name", f"to-{end}", "netns", self.space("r")]
            self.ip(end, "link", "add", "name", "to-r", "type", "veth", *there)
            self.ip(end, "link", "set", "dev", "to-r", "up")
            self.ip("r", "link", "set", "dev", f"to-{end}", "up")
        for name, number in {"a": 1, "b": 2, "r": 3}.items():
            self.ip(name, "addr", "add", f"10.9.0.{number}/32", "dev", "lo")
            self.ip(name, "addr", "add", f"fd00:9::{number}/128", "dev", "lo")

    def space(self, name):
        return self._prefix + name

    def ip(self, name, *arguments):
        return run("ip", "-n", self.space(name), *arguments)

    def inside(self, name, *command, **options):
        """A program in a namespace, which ends with the test."""
        command = ["ip", "netns", "exec", self.space(name), *map(str, command)]
        process = self._stack.enter_context(subprocess.Popen(command, **options))
        self._stack.callback(process.kill)
        return process

    def start_babeld(self, name, *, port=None):
        config = self.folder / f"{name}.conf"
        where = f"local-port {port}" if port else f"local-path {self.folder / f'{name}.sock'}"
        config.write_text(f"{where}\n{CONFIG}")
        (self.folder / f"{name}.sock").unlink(missing_ok=True)
        interfaces = ["to-a", "to-b"] if name == "r" else ["to-r"]
        with (self.folder / f"{name}.log").open("ab") as log:
            self._babelds[name] = self.inside(
                name, "babeld", "-S", "", "-I", "", "-c", config, *interfaces, stderr=log
            )

    def kill_babeld(self, name):
        self._babelds[name].kill()
        self._babelds[name].wait()

    def start_node(self, name, team):
        command = [sys.executable, "-m", "mocha_link", "node", team, "--robot", name, "--json"]
        serve = f"ipc://{self.folder}/{name}.node"
        process = self.inside(
            name, *command, "--serve", serve, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        events = queue.SimpleQueue()

        def read():
            for line in process.stdout:
                events.put(json.loads(line))

        for line in process.stderr:
            if line.startswith(b"ready"):
                break
        reader = threading.Thread(target=read)
        reader.start()
        self._stack.callback(reader.join)
        self._stack.callback(process.send_signal, signal.SIGKILL)
        return events, serve

    def mac(self, name, interface):
        shown = self.ip(name, "link", "show", "dev", interface)
        return re.search(r"link/ether (\S+)", shown)[1]


@pytest.fixture
def world(tmp_path):
    with contextlib.ExitStack() as stack:
        yield World(tmp_path, stack)


def wait(events, kind, **fields):
    while True:
        event = events.get(timeout=WAIT_S)
        if event["event"] == kind and all(event[name] == each for name, each in fields.items()):
            return event


def following(radio):
    """Starts a radio; a function that waits until its latest reports are these values."""
    reports, latest = queue.SimpleQueue(), {}
    radio.start(lambda peer, reading: reports.put((peer, reading and reading.value)))

    def until(expected):
        while latest != expected:
            peer, value = reports.get(timeout=WAIT_S)
            latest[peer] = value

    return until


def test_nodes_exchange_over_a_relay_while_babel_has_a_route(world, tmp_path):
    team = tmp_path / "team.yaml"
    team.write_text(TEAM.format(tmp_path))
    for name in "abr":
        world.start_babeld(name)
    a, serve = world.start_node("a", team)
    b, _ = world.start_node("b", team)
    for events, peer in ((a, "b"), (b, "a")):
        signal_ = wait(events, "ContactBegan", peer=peer)["signal"]
        assert 20 <= signal_["value"] <= 50  # two transmissions or more
        assert (signal_["unit"], signal_["source"]) == ("device", "babel")
    with ServiceClient(serve) as client:
        client.publish("/pose", b"1")
        wait(b, "MessageStored", peer="a", robot="a")
        world.kill_babeld("r")
        for events, peer in ((a, "b"), (b, "a")):
            wait(events, "ContactEnded", peer=peer)
        client.publish("/pose", b"2")
        world.start_babeld("r")
        wait(a, "ContactBegan", peer="b")
        wait(b, "MessageStored", peer="a", robot="a")
        world.kill_babeld("a")  # only our own: nobody knows the links
        wait(a, "ContactEnded", peer="b")
        world.start_babeld("a")
        wait(a, "ContactBegan", peer="b")
        client.publish("/pose", b"3")
        wait(b, "MessageStored", peer="a", robot="a")


def test_peers_are_known_by_addresses_of_either_family_and_by_mac(world, tmp_path):
    for name in "abr":
        world.start_babeld(name)
    text = TEAM.format(tmp_path).replace("[b]", "[b, by6, relay]")
    text = text.replace(
        "kinds:",
        "  by6: {kind: rover, address: host, base_port: 1, clients: [a], radio_id: 'fd00:9::2'}\n"
        f"  relay: {{kind: rover, address: host, base_port: 9, clients: [a], "
        f"radio_id: '{world.mac('r', 'to-a')}'}}\nkinds:",
    )
    path = tmp_path / "team.yaml"
    path.write_text(text)
    team = Team.load(path)
    radio = open_radio(team.robot("a").radio, team, "a")
    with contextlib.closing(radio):
        until = following(radio)
        until({"b": 50.0, "by6": 50.0, "relay": 100.0})
        world.ip("r", "link", "set", "dev", "to-a", "down")
        until({"b": None, "by6": None, "relay": None})


def test_a_babeld_at_a_port_serves_programs_of_its_machine(world, tmp_path):
    world.start_babeld("a")
    world.start_babeld("r", port=33123)
    path = tmp_path / "team.yaml"
    text = TEAM.format(tmp_path).replace("clients: [a]", "clients: [a, r]").replace("[b]", "[b, r]")
    robot = "  r: {kind: rover, address: 10.9.0.3, base_port: 24300, clients: [a, b], radio: "
    path.write_text(text.replace("kinds:", f"{robot}'babel://localhost:33123'}}\nkinds:"))
    program = (
        "import sys, threading\nfrom mocha_link import Team\n"
        "from mocha_link.radios import open_radio\n"
        "received = threading.Event()\nteam = Team.load(sys.argv[1])\n"
        "radio = open_radio(team.robot('r').radio, team, 'r')\n"
        "radio.start(lambda peer, reading: reading and received.set())\n"
        f"sys.exit(not received.wait({WAIT_S}))\n"
    )
    process = world.inside("r", sys.executable, "-c", program, path, cwd=Path(__file__).parents[2])
    assert process.wait(WAIT_S + 30) == 0
