"""The processes of `air-router sim`: stopped, killed; a real PX4, and the error without one."""

import json
import os
import signal
import sys
import time
from pathlib import Path

import pytest

from air_router.control.control import ControlClient
from air_router.vehicle.limits import PACE_ALLOWANCE_S
from sitl.process.pace import STALLED_SPEED
from tests.system.real_px4 import PLACES, found

pytestmark = pytest.mark.xdist_group("flights 1")

ON_LINUX = pytest.mark.skipif(
    sys.platform != "linux", reason="looks at processes as Linux has them"
)


def gone(process_id):
    try:
        os.kill(process_id, 0)
    except ProcessLookupError:
        return True
    return False


def test_without_a_px4_the_error_has_what_to_install(answered, short_mission):
    code, out, err = answered("sim", short_mission, "--px4", "/no/such/px4")
    assert (code, out) == (4, "")
    assert "Install one of these" in err


def children(pid):
    """Process ids by what they run."""
    threads = Path(f"/proc/{pid}/task").iterdir()
    found = [int(child) for t in threads for child in (t / "children").read_text().split()]
    lines = {child: Path(f"/proc/{child}/cmdline").read_text().split("\0") for child in found}
    return {"team" if "team" in line else "vehicle": child for child, line in lines.items()}


@pytest.fixture(scope="module")
def simulation(shared_command, shared_mission, shared_folder):
    """A flight that climbs, the processes of its world, and its control endpoint."""
    control = f"ipc://{shared_folder}/control"
    flight = shared_command(
        *("air-router", "sim", shared_mission, "--speed=5", f"--control={control}"),
        *("--log-dir", shared_folder / "logs", "--px4-version=1.16"),
    )
    flight.wait_for("READY -> INIT")
    return flight, children(flight.process.pid), control


def test_it_flies_the_version_of_px4_that_was_chosen(simulation):
    flight, _, _ = simulation
    assert "PX4 1.16.2, system 1" in flight.printed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--px4-version", "1.14"], "'1.14' is none of 1.15, 1.16, 1.17, 1.18"),
        (["--px4", "--px4-version", "1.17"], "--px4 and --px4-version contradict each other"),
    ],
)
def test_a_version_that_cannot_be_simulated_is_refused(answered, short_mission, options, message):
    code, out, err = answered("sim", short_mission, *options)
    assert (code, out) == (2, "")
    assert message in err


@ON_LINUX
def test_the_world_waits_for_a_process_that_is_stopped(simulation):
    """Else which robots a flight meets depends on how busy the machine is."""
    _, world, control = simulation
    with ControlClient(control, timeout_s=60) as uav:
        os.kill(world["team"], signal.SIGSTOP)
        try:
            began_s, from_s = time.monotonic(), uav.status()["time_s"]
            time.sleep(1.5)
            flown_s = uav.status()["time_s"] - from_s
            waited_s = time.monotonic() - began_s
        finally:
            os.kill(world["team"], signal.SIGCONT)
    assert flown_s < PACE_ALLOWANCE_S + waited_s * STALLED_SPEED


@ON_LINUX
def test_a_killed_team_is_reported_and_a_killed_flight_takes_its_world_with_it(simulation):
    """All robots, their gossip nodes and radios are one process."""
    flight, world, _ = simulation
    assert len(world) == 2
    os.kill(world["team"], signal.SIGKILL)
    flight.wait_for("sitl team was killed by signal 9: no robot, radio or camera")
    assert not gone(world["vehicle"])
    flight.process.send_signal(signal.SIGKILL)
    flight.process.wait()
    while not gone(world["vehicle"]):
        os.sched_yield()


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.timeout(400)
def test_a_flight_on_a_real_px4(command, short_mission, tmp_path, place):
    found(place)
    where = [place] if place else []
    flight = command(
        *("air-router", "sim", short_mission, "--speed=5", "--duration=250"),
        *("--json", "--log-dir", tmp_path / "logs", "--px4", *where),
    )
    code, out = flight.finish(300)
    assert code == 0, flight.printed[-3000:]
    report = json.loads(out)
    assert report["outcome"] == "done"
    assert {"INIT", "SEARCH", "EXPL", "HOME", "LAND"} <= set(report["states_visited"])
    assert report["closest_approach_m"] >= report["clearance_m"]
    assert "not reported" not in flight.printed
