"""`air-router preflight` against vehicles that are, and that are not, what they should be.

Each answer is due within ten seconds of wall-clock time; the slowest takes eight where the machine
has nothing else to do.
"""

import json
import socket
import threading
import time

import pytest
from pymavlink.dialects.v20 import common as mavlink

from mocha_link import Team

WITHIN_S = 60.0  # the machine that tests may be very busy
PX4 = 12
MULTIROTOR = 2


class Stranger:
    """Something that talks MAVLink to a port and answers nothing."""

    def __init__(self, port, *, system_id=1, component_id=1, kind=MULTIROTOR, autopilot=PX4):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._stop = threading.Event()
        sender = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

        def send():
            while not self._stop.wait(0.1):
                frame = sender.heartbeat_encode(kind, autopilot, 0, 0, 3).pack(sender)
                self._socket.sendto(frame, ("127.0.0.1", port))

        self._thread = threading.Thread(target=send)
        self._thread.start()

    def close(self):
        self._stop.set()
        self._thread.join()
        self._socket.close()


@pytest.fixture
def vehicle(command, udp_port, free_udp_port, short_mission):
    def start(*more, speed=10):
        process = command(
            "sitl",
            "vehicle",
            *(more or (short_mission,)),
            f"--speed={speed}",
            f"--api-to=127.0.0.1:{udp_port}",
            "--no-gcs",
            f"--truth-to=127.0.0.1:{free_udp_port()}",
        )
        process.ready()
        return process

    return start


@pytest.fixture
def preflight(command, udp_port, short_mission):
    def start(*more, mission=short_mission):
        return command(
            "air_router.cli",
            "preflight",
            mission,
            f"--connect=udpin://127.0.0.1:{udp_port}",
            *more,
        )

    return start


def test_the_card_of_a_vehicle_that_is_ready(vehicle, preflight, tmp_path):
    vehicle()
    looked = preflight("--json", f"--log-dir={tmp_path}")
    code, out = looked.finish()
    assert code == 0, (out, looked.said)
    card = json.loads(out)
    lines = {check["name"]: check for check in card["checks"]}
    assert card["ready"]
    for name in ("vehicle", "state", "place", "health", "GPS", "disk", "plan"):
        assert lines[name]["verdict"] == "ok", lines[name]
    assert lines["vehicle"]["found"] == "PX4 1.17.0, system 1"
    assert "read back, equal, can be flown" in lines["plan"]["found"]
    assert "not reachable now" in lines["team"]["found"]
    assert int(lines["parameters"]["found"].split()[0]) >= 12


def test_peers_that_listen_are_reachable_and_looking_changes_nothing(
    vehicle, preflight, short_mission
):
    vehicle()
    team = Team.load(short_mission.with_name("team.yaml"))
    io = team.robot("io")
    with socket.create_server((io.address, io.port_for("titan"))):
        code, out = preflight("--look").finish()
    assert code == 0
    text = out.replace("\n", " ")
    assert "callisto, europa: not reachable now" in text
    assert "another one is on board" in text
    assert "\x1b[" not in out


STRANGERS = (  # the others: tests/system/test_px4.py
    (None, "nothing heard within 5 s"),
    ({}, "no positions"),
)


def test_whoever_is_no_px4_of_ours_is_named_in_time(command, free_udp_port, short_mission):
    looked, strangers = [], []
    began_s = time.monotonic()
    try:
        for what, said in STRANGERS:
            port = free_udp_port()
            if what is not None:
                strangers.append(Stranger(port, **what))
            url = f"--connect=udpin://127.0.0.1:{port}"
            looked.append((command("air_router.cli", "preflight", short_mission, url), said))
        for process, said in looked:
            assert process.finish()[0] == 4
            assert said in process.said
        assert time.monotonic() - began_s < WITHIN_S
    finally:
        for each in strangers:
            each.close()


def test_another_place_s_vehicle_is_refused_in_time(vehicle, preflight):
    vehicle("--home=47.397742,8.545594,489.4")
    began_s = time.monotonic()
    code, out = preflight().finish()
    assert time.monotonic() - began_s < WITHIN_S
    assert code == 5
    assert "km from the mission's home" in out
