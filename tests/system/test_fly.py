"""`air-router fly` against a vehicle that another program started, and what goes wrong there."""

import fcntl
import json
import os
import pty
import socket
import subprocess
import termios

import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.control.control import ControlClient
from air_router.record.log import Log
from air_router.record.replay import replay_record
from mocha_link import Team
from tests.system.conftest import program

pytestmark = pytest.mark.xdist_group("flights 1")

HOLD, MISSION = 0x03040000, 0x04040000


class Watcher:
    """Sits on the vehicle's port once the flight has let go of it."""

    def __init__(self, port):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(20)
        self._mavlink = mavlink.MAVLink(None)
        self._mavlink.robust_parsing = True

    def next(self, name):
        while True:
            for message in self._mavlink.parse_buffer(self._socket.recv(4096)) or ():
                if message.get_type() == name and message.get_srcComponent() == 1:
                    return message

    def close(self):
        self._socket.close()


@pytest.fixture
def fly(command, udp_port, short_mission):
    def start(*more):
        return command(
            "air-router",
            "fly",
            short_mission,
            f"--connect=udpin://127.0.0.1:{udp_port}",
            "--json",
            *more,
        )

    return start


def test_a_node_without_keys_that_other_machines_can_reach_is_warned_of(fly, short_mission):
    path = short_mission.with_name("team.yaml")
    team = Team.load(path)
    path.write_text(team.with_robots({name: {"listen": "*"} for name in team.robots}).dump())
    flight = fly()
    flight.wait_for("NO KEYS: any machine that reaches these ports can read all messages")
    flight.interrupt()
    flight.finish()


def test_ctrl_c_in_flight_leaves_the_vehicle_holding(vehicle, fly, udp_port):
    vehicle(speed=15)
    flight = fly("--arm", "--yes")
    flight.wait_for("INIT -> SEARCH")
    flight.interrupt()
    code, out = flight.finish()
    assert code == 130
    assert json.loads(out)["outcome"] == "interrupted"
    assert "the vehicle holds" in flight.printed
    watcher = Watcher(udp_port)
    try:
        for _ in range(3):
            assert watcher.next("HEARTBEAT").custom_mode == HOLD
        assert watcher.next("EXTENDED_SYS_STATE").landed_state == 2
    finally:
        watcher.close()


def test_kill_9_in_flight_leaves_the_vehicle_on_its_checked_leg_and_a_record(
    vehicle, fly, udp_port, tmp_path
):
    vehicle(speed=15)
    flight = fly("--arm", "--yes", "--log-dir", tmp_path / "logs")
    flight.wait_for("SEARCH -> EXPL")  # for so long that the record has some of it
    flight.process.kill()
    flight.process.wait()
    watcher = Watcher(udp_port)
    try:
        items = {watcher.next("MISSION_CURRENT").seq for _ in range(20)}
        assert watcher.next("HEARTBEAT").custom_mode == MISSION
        assert len(items) == 1  # it hovers at the node that it was sent to
    finally:
        watcher.close()
    (path,) = (tmp_path / "logs").iterdir()
    log = Log(path)
    again = replay_record(log)  # up to its last second, it decided as we do
    assert log.ending.startswith("it was cut off")
    assert again.difference is None
    assert again.events > 10


def in_a_terminal():
    """The process that begins here gets its stdin as its terminal, as a login session does."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def test_a_flight_outlives_the_session_that_it_was_started_from(
    vehicle, short_mission, udp_port, tmp_path
):
    vehicle(speed=15)
    endpoint = f"ipc://{tmp_path}/control"
    master, slave = pty.openpty()
    flight = subprocess.Popen(
        [
            *(*program("air-router"), "fly", short_mission),
            *(f"--connect=udpin://127.0.0.1:{udp_port}", "--json", "--control", endpoint),
        ],
        stdin=slave,
        stdout=subprocess.PIPE,
        stderr=slave,
        start_new_session=True,
        preexec_fn=in_a_terminal,  # noqa: PLW1509 - no thread of ours holds a lock here
        cwd=tmp_path,
    )
    os.close(slave)
    with flight, ControlClient(endpoint, timeout_s=30) as uav:
        printed = b""
        while b"waiting for the pilot" not in printed:
            printed += os.read(master, 65536)
        os.close(master)  # the connection to the vehicle's computer is lost
        assert uav.status()["state"] == "READY"
        assert uav.home().accepted
        out, _ = flight.communicate(timeout=60)
    assert json.loads(out)["outcome"] == "ended: a program's request, before take-off"


def test_arm_wants_a_confirmation(answered, udp_port, short_mission):
    link = f"--connect=udpin://127.0.0.1:{udp_port}"
    code, out, err = answered("fly", short_mission, link, "--arm")
    assert (code, out) == (5, "")
    assert "not confirmed" in err


@pytest.mark.parametrize("shared", [False, True])
def test_a_port_in_use_is_one_clear_error(answered, udp_port, short_mission, shared):
    link = f"--connect=udpin://127.0.0.1:{udp_port}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, shared)
        other.bind(("127.0.0.1", udp_port))
        code, out, err = answered("fly", short_mission, link, "--arm", "--yes")
    assert (code, out) == (4, "")
    assert err.count("\n") == 1
    assert "is another program using it?" in err


def test_a_gossip_port_in_use_is_refused_before_anything_is_uploaded(
    vehicle, answered, udp_port, short_mission
):
    vehicle(speed=15)
    titan = Team.load(short_mission.with_name("team.yaml")).robot("titan")
    link = f"--connect=udpin://127.0.0.1:{udp_port}"
    with socket.socket() as other:
        other.bind((titan.listen, titan.base_port))
        other.listen()
        code, out, err = answered("fly", short_mission, link, "--arm", "--yes")
    assert (code, out) == (5, "")
    assert str(titan.base_port) in err
    assert "on board" not in err
