"""`air-router sim --px4`: a flight on a real PX4, and what is said where there is none."""

import json
import os
import signal
import sys
from pathlib import Path

import pytest

from sitl.process.px4_install import NoPx4Error, find_px4


def gone(process_id):
    try:
        os.kill(process_id, 0)
    except ProcessLookupError:
        return True
    return False


def test_without_a_px4_it_says_what_to_install(command, short_mission):
    flight = command("air_router.cli.cli", "sim", short_mission, "--px4", "/no/such/px4")
    code, out = flight.finish()
    assert (code, out) == (4, "")
    assert "Install one of these" in flight.said


@pytest.mark.skipif(sys.platform != "linux", reason="looks at processes as Linux has them")
def test_a_killed_flight_takes_its_world_with_it(command, short_mission, tmp_path):
    logs = tmp_path / "logs"
    flight = command("air_router.cli.cli", "sim", short_mission, "--speed=10", "--log-dir", logs)
    flight.wait_for("on board and read back")
    tasks = Path(f"/proc/{flight.process.pid}/task")
    children = [
        int(child) for task in tasks.iterdir() for child in (task / "children").read_text().split()
    ]
    assert len(children) == 2
    flight.process.send_signal(signal.SIGKILL)
    flight.process.wait()
    for child in children:
        while not gone(child):
            os.sched_yield()


@pytest.fixture
def real_px4():
    try:
        return find_px4()
    except NoPx4Error as error:
        return pytest.skip(str(error).splitlines()[0])


@pytest.mark.timeout(400)
@pytest.mark.usefixtures("real_px4")
def test_a_flight_on_a_real_px4(command, short_mission, tmp_path):
    flight = command(
        *("air_router.cli.cli", "sim", short_mission, "--px4", "--speed=5", "--duration=250"),
        *("--json", "--log-dir", tmp_path / "logs"),
    )
    code, out = flight.finish(300)
    assert code == 0, flight.said
    report = json.loads(out)
    assert report["outcome"] == "done"
    assert {"INIT", "SEARCH", "EXPL", "HOME", "LAND"} <= set(report["states_visited"])
    assert report["closest_approach_m"] >= report["clearance_m"]
