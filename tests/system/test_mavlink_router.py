"""A flight behind mavlink-router, which many companions run between the autopilot and programs."""

import contextlib
import json
import shutil
import subprocess

import pytest

from air_router.sim.ports import free_port
from tests.system.conftest import answer
from tests.system.real_px4 import PLACES, found, named_by, started
from tests.system.simulated import simulated_vehicle

ROUTER = shutil.which("mavlink-routerd")
pytestmark = pytest.mark.skipif(ROUTER is None, reason="no mavlink-routerd is on the PATH")


@contextlib.contextmanager
def routed(port):
    """What the vehicle sends to a port goes to another one, which it gives; and back."""
    to = free_port()
    command = [ROUTER, "-t", "0", "-e", f"127.0.0.1:{to}", f"0.0.0.0:{port}"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        try:
            yield to
        finally:
            process.terminate()


def flown(folder, mission, port, system):
    """Exit code and report of a short flight, and what it printed."""
    arguments = "fly", mission, f"--connect=udpin://127.0.0.1:{port}", f"--sysid={system}", "--arm"
    code, out, err = answer(folder, *arguments, "--yes", "--duration=40", "--json", "--no-record")
    return code, json.loads(out), err


def test_a_simulated_vehicle_flies_behind_it(tmp_path, short_mission):
    port = free_port()
    links = f"--api-to=127.0.0.1:{port}", f"--truth-to=127.0.0.1:{free_port()}", "--no-gcs"
    with routed(port) as to, simulated_vehicle(short_mission, "--speed=10", *links):
        code, report, err = flown(tmp_path, short_mission, to, 1)
    assert (code, report["outcome"]) == (0, "done"), err
    assert report["closest_approach_m"] >= report["clearance_m"], err


@pytest.mark.timeout(600)
@pytest.mark.parametrize("place", PLACES)
def test_a_real_px4_flies_behind_it(place, tmp_path, short_mission):
    found(place)
    with (
        started(tmp_path, "px4", short_mission, "--speed=3", *named_by(place)) as ready,
        routed(ready["mavlink"].rpartition(":")[2]) as to,
    ):
        code, report, err = flown(tmp_path, short_mission, to, ready["system_id"])
    assert (code, report["outcome"]) == (0, "done"), err
    assert report["closest_approach_m"] >= report["clearance_m"], err
