"""A vehicle at a serial port, as a telemetry radio or a companion's UART has it."""

import contextlib
import json
import os
import socket
import subprocess
import sys

import pytest

from air_router.sim.ports import free_port
from tests.system.conftest import answer
from tests.system.real_px4 import PLACES, found, named_by, started
from tests.system.serial_cable import SerialCable, plugged_into
from tests.system.simulated import simulated_vehicle

NOISE = 0.02
ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals as Linux has them")
pytestmark = ON_LINUX


@pytest.mark.parametrize("baud", [57_600, 921_600])
def test_the_card_of_a_vehicle_at_a_noisy_serial_port(tmp_path, short_mission, baud):
    with (
        contextlib.closing(SerialCable(baud, NOISE)) as cable,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound,
    ):
        bound.bind(("127.0.0.1", 0))
        links = f"--api-to=127.0.0.1:{bound.getsockname()[1]}", "--no-gcs"
        truth = f"--truth-to=127.0.0.1:{free_port()}"
        with (
            simulated_vehicle(short_mission, *links, truth),
            plugged_into(bound, cable.ends[0]),
        ):
            connect = f"--connect=serial://{cable.ends[1]}:{baud}"
            look = "preflight", short_mission, "--look", "--json", "--no-record", connect
            _, out, err = answer(tmp_path, *look)
    lines = {line["name"]: line["verdict"] for line in json.loads(out)["checks"]}, err
    assert lines[0]["vehicle"] == lines[0]["place"] == "ok", lines
    assert min(cable.carried) > 0


def mavlink_program(place):
    """What starts a link of a real PX4 at a device; without it the test is skipped."""
    install = found(place)
    program = install.words.removesuffix("px4") + "px4-mavlink"
    if not os.access(program, os.X_OK):
        pytest.skip(f"{install.words} has no px4-mavlink beside it")
    return program


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.timeout(600)
def test_a_real_px4_flies_by_a_noisy_serial_port(place, tmp_path, short_mission):
    program = mavlink_program(place)
    baud = 57_600
    with (
        contextlib.closing(SerialCable(baud, NOISE)) as cable,
        started(tmp_path, "px4", short_mission, *named_by(place)) as ready,
    ):
        system = ready["system_id"]
        link = ["-d", cable.ends[0], "-b", str(baud), "-m", "onboard", "-r", str(baud // 12)]
        subprocess.run([program, "--instance", str(system - 1), "start", *link], check=True)
        flight = "fly", short_mission, f"--connect=serial://{cable.ends[1]}:{baud}"
        flight += f"--sysid={system}", "--arm", "--yes", "--duration=40", "--json", "--no-record"
        code, out, err = answer(tmp_path, *flight)
    report = json.loads(out)
    assert (code, report["outcome"]) == (0, "done"), err
    assert report["closest_approach_m"] >= report["clearance_m"], err


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.timeout(600)
def test_a_real_hexarotor_flies(place, tmp_path, short_mission):
    found(place)
    with contextlib.ExitStack() as stack:
        arguments = "px4", short_mission, *named_by(place), "--airframe=hex", "--speed=3"
        try:
            ready = stack.enter_context(started(tmp_path, *arguments))
        except json.JSONDecodeError:
            pytest.skip((tmp_path / "sitl.log").read_text(encoding="utf-8").splitlines()[0])
        link = f"--connect={ready['mavlink']}", f"--sysid={ready['system_id']}", "--no-record"
        _, out, _ = answer(tmp_path, "preflight", short_mission, *link, "--look", "--json")
        kind = {line["name"]: line["found"] for line in json.loads(out)["checks"]}["vehicle"]
        flight = "fly", short_mission, *link, "--arm", "--yes", "--duration=60", "--json"
        code, out, err = answer(tmp_path, *flight)
    report = json.loads(out)
    named = "quadrotor" if "PX4 1.17" in kind else "hexarotor"  # as 1.17 calls it (MAV_TYPE)
    assert kind.startswith(f"{named}, PX4 1."), kind
    assert (code, report["outcome"]) == (0, "done"), err
    assert report["closest_approach_m"] >= report["clearance_m"], err
