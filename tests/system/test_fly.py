"""`air-router fly` against a vehicle that somebody else started, and what goes wrong there."""

import json
import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

from mocha_link import Team

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
            "air_router.cli",
            "fly",
            short_mission,
            f"--connect=udpin://127.0.0.1:{udp_port}",
            "--json",
            *more,
        )

    return start


def test_a_flight_that_meets_nobody_comes_home(vehicle, fly):
    vehicle(speed=25)
    flight = fly("--arm", "--yes", "--duration=45")
    code, out = flight.finish()
    assert code == 0, flight.said
    report = json.loads(out)
    assert report["outcome"] == "done"
    assert report["states_visited"][:2] == ["INIT", "SEARCH"]
    assert report["closest_approach_m"] >= 5.0
    assert report["interactions"]["started"] == 0


def test_ctrl_c_in_flight_leaves_the_vehicle_holding(vehicle, fly, udp_port):
    vehicle(speed=15)
    flight = fly("--arm", "--yes")
    flight.wait_for("READY -> INIT")
    flight.interrupt()
    code, out = flight.finish()
    assert code == 130
    assert json.loads(out)["outcome"] == "interrupted"
    assert "the vehicle holds" in flight.said
    watcher = Watcher(udp_port)
    try:
        for _ in range(3):
            assert watcher.next("HEARTBEAT").custom_mode == HOLD
        assert watcher.next("EXTENDED_SYS_STATE").landed_state == 2
    finally:
        watcher.close()


def test_kill_9_in_flight_leaves_the_vehicle_on_its_checked_leg(vehicle, fly, udp_port):
    vehicle(speed=15)
    flight = fly("--arm", "--yes")
    flight.wait_for("READY -> INIT")
    flight.process.kill()
    flight.process.wait()
    watcher = Watcher(udp_port)
    try:
        for _ in range(5):  # it may still have been climbing past the take-off item
            watcher.next("MISSION_CURRENT")
        items = {watcher.next("MISSION_CURRENT").seq for _ in range(20)}
        assert watcher.next("HEARTBEAT").custom_mode == MISSION
        assert len(items) == 1  # it hovers at the node that it was sent to
    finally:
        watcher.close()


def test_without_arm_it_waits_for_the_pilot(vehicle, fly):
    vehicle(speed=15)
    flight = fly()
    flight.wait_for("waiting for the pilot to arm and choose Mission mode")
    flight.interrupt()
    code, out = flight.finish()
    assert code == 130
    assert json.loads(out)["duration_s"] == 0


def test_arm_wants_a_confirmation(fly):
    flight = fly("--arm")
    code, out = flight.finish()
    assert (code, out) == (5, "")
    assert "not confirmed" in flight.said


@pytest.mark.parametrize("shared", [False, True])
def test_a_port_in_use_is_one_clear_error(fly, udp_port, shared):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, shared)
        other.bind(("127.0.0.1", udp_port))
        flight = fly("--arm", "--yes")
        code, out = flight.finish()
    assert (code, out) == (4, "")
    assert flight.said.count("\n") == 1
    assert "is another program using it?" in flight.said


def test_a_gossip_port_in_use_is_refused_before_anything_is_uploaded(vehicle, fly, short_mission):
    vehicle(speed=15)
    titan = Team.load(short_mission.with_name("team.yaml")).robot("titan")
    with socket.socket() as other:
        other.bind((titan.listen, titan.base_port))
        other.listen()
        flight = fly("--arm", "--yes")
        code, out = flight.finish()
    assert (code, out) == (5, "")
    assert str(titan.base_port) in flight.said
    assert "on board" not in flight.said
