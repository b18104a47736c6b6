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


def test_without_a_px4_it_says_what_to_install(answered, short_mission):
    code, out, said = answered("sim", short_mission, "--px4", "/no/such/px4")
    assert (code, out) == (4, "")
    assert "Install one of these" in said


def children(pid):
    """Process ids by what they run."""
    threads = Path(f"/proc/{pid}/task").iterdir()
    found = [int(child) for t in threads for child in (t / "children").read_text().split()]
    words = {child: Path(f"/proc/{child}/cmdline").read_text().split("\0") for child in found}
    return {"team" if "team" in said else "vehicle": child for child, said in words.items()}


@pytest.mark.skipif(sys.platform != "linux", reason="looks at processes as Linux has them")
def test_a_killed_team_is_told_and_a_killed_flight_takes_its_world_with_it(
    command, short_mission, tmp_path
):
    """All robots, their gossip nodes and radios are one process."""
    logs = tmp_path / "logs"
    flight = command("air-router", "sim", short_mission, "--speed=10", "--log-dir", logs)
    flight.wait_for("on board and read back")
    world = children(flight.process.pid)
    assert len(world) == 2
    os.kill(world["team"], signal.SIGKILL)
    flight.wait_for("sitl team was killed by signal 9: no robot, radio or camera")
    assert not gone(world["vehicle"])
    flight.process.send_signal(signal.SIGKILL)
    flight.process.wait()
    while not gone(world["vehicle"]):
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
        *("air-router", "sim", short_mission, "--px4", "--speed=5", "--duration=250"),
        *("--json", "--log-dir", tmp_path / "logs"),
    )
    code, out = flight.finish(300)
    assert code == 0, flight.said[-3000:]
    report = json.loads(out)
    assert report["outcome"] == "done"
    assert {"INIT", "SEARCH", "EXPL", "HOME", "LAND"} <= set(report["states_visited"])
    assert report["closest_approach_m"] >= report["clearance_m"]
