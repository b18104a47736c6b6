"""A vehicle at a serial port, as a telemetry radio or a companion's UART has it."""

import contextlib
import json
import os
import socket
import subprocess
import sys

import pytest

from air_router.sim.ports import free_port
from sitl.process.px4_install import NoPx4Error, find_px4, named
from tests.system.conftest import answer, environment
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
            _, out, said = answer(tmp_path, *look)
    lines = {line["name"]: line["verdict"] for line in json.loads(out)["checks"]}, said
    assert lines[0]["vehicle"] == lines[0]["place"] == "ok", lines
    assert min(cable.carried) > 0


@pytest.fixture(params=named(os.environ) or [""], ids=lambda place: place or "PATH")
def real_px4(request):
    """Each PX4 that PX4_SITL names, where its `px4-mavlink` starts a link at a device."""
    try:
        install = find_px4(request.param or None)
    except NoPx4Error as error:
        pytest.skip(str(error).splitlines()[0])
    program = install.words.removesuffix("px4") + "px4-mavlink"
    if not os.access(program, os.X_OK):
        pytest.skip(f"{install.words} has no px4-mavlink beside it")
    return request.param, program


@contextlib.contextmanager
def started(folder, *words):
    """A process of `sitl`, and what it says when it is ready."""
    with (folder / "px4.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "sitl", *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=log,
            cwd=folder,
            env=environment(),
        )
        with process:
            try:
                yield json.loads(process.stdout.readline())
            finally:
                process.terminate()


@pytest.mark.timeout(600)
def test_a_real_px4_flies_by_a_noisy_serial_port(real_px4, tmp_path, short_mission):
    place, program = real_px4
    where = ["--px4", place] if place else []
    baud = 57_600
    with (
        contextlib.closing(SerialCable(baud, NOISE)) as cable,
        started(tmp_path, "px4", short_mission, *where) as ready,
    ):
        system = ready["system_id"]
        link = ["-d", cable.ends[0], "-b", str(baud), "-m", "onboard", "-r", str(baud // 12)]
        subprocess.run([program, "--instance", str(system - 1), "start", *link], check=True)
        flight = "fly", short_mission, f"--connect=serial://{cable.ends[1]}:{baud}"
        flight += f"--sysid={system}", "--arm", "--yes", "--duration=40", "--json", "--no-record"
        code, out, said = answer(tmp_path, *flight)
    report = json.loads(out)
    assert (code, report["outcome"]) == (0, "done"), said
    assert report["closest_approach_m"] >= report["clearance_m"], said


@pytest.mark.timeout(600)
def test_a_real_hexarotor_flies(real_px4, tmp_path, short_mission):
    place, _ = real_px4
    where = ["--px4", place] if place else []
    with contextlib.ExitStack() as stack:
        words = "px4", short_mission, *where, "--airframe=hex", "--speed=3"
        try:
            ready = stack.enter_context(started(tmp_path, *words))
        except json.JSONDecodeError:
            pytest.skip((tmp_path / "px4.log").read_text(encoding="utf-8").splitlines()[0])
        link = f"--connect={ready['mavlink']}", f"--sysid={ready['system_id']}", "--no-record"
        _, out, _ = answer(tmp_path, "preflight", short_mission, *link, "--look", "--json")
        found = {line["name"]: line["found"] for line in json.loads(out)["checks"]}["vehicle"]
        flight = "fly", short_mission, *link, "--arm", "--yes", "--duration=60", "--json"
        code, out, said = answer(tmp_path, *flight)
    report = json.loads(out)
    kind = "quadrotor" if "PX4 1.17" in found else "hexarotor"  # as 1.17 calls it (MAV_TYPE)
    assert found.startswith(f"{kind}, PX4 1."), found
    assert (code, report["outcome"]) == (0, "done"), said
    assert report["closest_approach_m"] >= report["clearance_m"], said
