"""The whole world beside the autopilot, as a process; the vehicle is played by the test."""

import itertools
import json
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.messages import PoseMessage
from air_router.mission.loading import load_mission
from geo.frame import Point
from mocha_link.service.service_client import ServiceClient
from mocha_link.team.team import Team
from sitl.cli.cli import main
from sitl.team.derived_team import derive_team
from sitl.team.roles import roles_of
from sitl.team.team import TeamSimulation
from sitl.team.truth import VehicleState
from sitl.world.world_file import load_world

ROOT = Path(__file__).parents[3]
MISSION = ROOT / "missions" / "pennovation" / "mission.yaml"
EPOCH_S = 1_800_000_000
WAIT_S = 60.0


@pytest.fixture
def mission():
    return load_mission(MISSION)


def wait_until(condition) -> None:
    deadline_s = time.monotonic() + WAIT_S
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < deadline_s, "did not happen in time"
        pause.wait(0.02)


def run_team(*arguments: str) -> int:
    return main(["team", *arguments])


@pytest.mark.parametrize("option", ["--truth", "--camera"])
def test_a_port_that_is_taken_ends_it_with_advice(option, tmp_path, capsys):
    kind = {"--truth": socket.SOCK_DGRAM, "--camera": socket.SOCK_STREAM}[option]
    scheme = {"--truth": "udp", "--camera": "tcp"}[option]
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            taken.listen()
        urls = {"--truth": "udp://127.0.0.1:0", "--camera": "tcp://127.0.0.1:0"}
        urls[option] = f"{scheme}://127.0.0.1:{taken.getsockname()[1]}"
        places = [part for pair in urls.items() for part in pair]
        assert run_team(str(MISSION), *places, "--free-ports", str(tmp_path)) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert urls[option] in err
    assert "end the other simulation" in err
    assert option in err


@pytest.mark.parametrize(
    ("world", "problem"),
    [
        ("radio: {rate: 1}\n", "world.yaml:1:9: unknown key 'rate'"),
        ("robots: {titan: {patrol: [[39.942, -75.2]]}}\n", "no ground robot 'titan'"),
    ],
)
def test_a_wrong_world_file_ends_it_with_code_3(world, problem, tmp_path, capsys):
    path = tmp_path / "world.yaml"
    path.write_text(world)
    assert run_team(str(MISSION), "--world", str(path)) == 3
    assert problem in capsys.readouterr().err


def test_a_missing_mission_and_a_team_without_ground_robots_are_reported(tmp_path, capsys):
    assert run_team(str(tmp_path / "none.yaml")) == 3
    assert "none.yaml" in capsys.readouterr().err
    team = tmp_path / "team.yaml"
    team.write_text(
        "robots: {titan: {kind: aerial_robot, address: 127.0.0.1, base_port: 24000, clients: []}}\n"
        "kinds: {aerial_robot: {topics: []}}\n"
    )
    assert run_team(str(MISSION), "--team", str(team)) == 3
    assert "no robot drives" in capsys.readouterr().err


def test_a_program_plays_no_robot_that_does_not_drive(tmp_path, capsys):
    ports = ("--free-ports", str(tmp_path))
    assert run_team(str(MISSION), *ports, "--rover", f"titan=ipc://{tmp_path}/titan") == 3
    printed = capsys.readouterr().err
    assert "that drives on the ground is called 'titan'; use one of callisto, europa, io" in printed


def test_a_place_that_is_no_url_is_reported(tmp_path, capsys):
    ports = ("--free-ports", str(tmp_path))
    assert run_team(str(MISSION), *ports, "--truth", "127.0.0.1:19410") == 1
    assert "write udp://HOST:PORT" in capsys.readouterr().err


@pytest.fixture
def simulation(tmp_path, mission):
    team = derive_team(Team.load(mission.team), tmp_path)
    plan = load_world(mission.world, mission, roles_of(mission, team).ground, seed=1)
    with TeamSimulation(mission, team, plan, epoch_s=EPOCH_S) as simulation:
        yield simulation


def test_without_a_vehicle_it_waits_and_reports_it(simulation, monkeypatch, caplog):
    monkeypatch.setattr("sitl.team.team._SILENCE_NOTE_S", 0.0)
    stop = threading.Event()
    runner = threading.Thread(target=simulation.run, args=(stop.is_set,))
    with caplog.at_level("WARNING"):
        runner.start()
        wait_until(lambda: "waiting for the vehicle" in caplog.text)
        stop.set()
        runner.join(WAIT_S)
    content = simulation.report()
    assert content["simulated_s"] == 0
    assert content["ended_s"] == EPOCH_S
    assert content["carried"] == []
    assert content["robots"]["io"]["contacts"]["titan"]["closest_m"] is None
    json.dumps(content, allow_nan=False)


def test_a_vehicle_somewhere_else_is_noticed(simulation, caplog):
    simulation.follow(VehicleState(1.0, 47.397742, 8.545594, 489.4, 0.0))
    assert "km from the mission's home" in caplog.text
    assert simulation.report()["robots"]["io"]["contacts"]["titan"]["count"] == 0


def test_a_robot_that_a_program_plays_is_where_it_reports_and_no_more(tmp_path, mission):
    team = derive_team(Team.load(mission.team), tmp_path)
    plan = load_world(mission.world, mission, roles_of(mission, team).ground, seed=1)
    endpoint = f"ipc://{tmp_path}/io"
    rovers = {"io": endpoint}
    there = Point(-30.0, 20.0)
    latitude_deg, longitude_deg = mission.frame.to_geodetic(there)
    pose = PoseMessage(stamp_s=0.0, latitude_deg=latitude_deg, longitude_deg=longitude_deg)
    seconds = iter(range(1, 10))
    with (
        TeamSimulation(mission, team, plan, rovers=rovers, epoch_s=EPOCH_S) as simulation,
        ServiceClient(endpoint, timeout_s=WAIT_S) as program,
    ):
        io = simulation.world.robots["io"]

        def follow():
            home = mission.frame.to_geodetic(mission.home)
            simulation.follow(VehicleState(next(seconds), *home, 50.0, 0.0))
            return io.position

        at_first = follow()
        assert (follow(), program.latest("io", "/pose")) == (at_first, None)
        for data in (pose.encode(), b"junk"):
            program.publish("/pose", data, now=True)
            assert follow() == pytest.approx(there, abs=1e-3)


def test_exploring_robots_receive_over_their_nodes_what_others_publish(tmp_path):
    mission = load_mission(ROOT / "missions" / "explorers" / "mission.yaml")
    team = derive_team(Team.load(mission.team), tmp_path)
    plan = load_world(mission.world, mission, roles_of(mission, team).ground, seed=1)
    home, seconds = mission.frame.to_geodetic(mission.home), itertools.count()
    with TeamSimulation(mission, team, plan, epoch_s=EPOCH_S) as simulation:

        def knows_what_another_has_seen() -> bool:
            simulation.follow(VehicleState(next(seconds), *home, 610.0, 0.0))  # 60 m up
            minds = [robot.knowledge for robot in simulation.world.robots.values()]
            return any(np.count_nonzero(mind.cells) > mind.newly_seen for mind in minds)

        wait_until(knows_what_another_has_seen)
        content = simulation.report()
    assert content["goals"] == {"total": 15, "found": []}
    assert content["robots"]["ugv01"]["map"] is None  # what others have seen is no map of a UAV
    assert content["robots"]["ugv01"]["maps_refused"] == 0
    assert content["robots"]["ugv01"]["policy_fault"] is None


def test_a_moment_is_over_once_its_exchanges_are(tmp_path, mission, monkeypatch):
    monkeypatch.setattr("sitl.team.nodes.EXCHANGE_S", WAIT_S)
    team = derive_team(Team.load(mission.team), tmp_path)
    plan = load_world(mission.world, mission, roles_of(mission, team).ground, seed=1)
    titan, packer = team.robot("titan"), mavlink.MAVLink(None)
    over: list[float] = []
    stop = threading.Event()
    with (
        TeamSimulation(mission, team, plan, epoch_s=EPOCH_S) as simulation,
        socket.create_server((titan.listen, titan.port_for("io"))) as mute,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
    ):
        mute.settimeout(WAIT_S)
        port = int(simulation.ready()["truth"].rpartition(":")[2])
        io = mission.frame.to_geodetic(simulation.world.robots["io"].position)
        above = (int(io.latitude_deg * 1e7), int(io.longitude_deg * 1e7), 50_000)

        def fly_there(time_s: int) -> None:
            turned = (time_s * 1_000_000, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0)
            message = packer.hil_state_quaternion_encode(*turned, *above, *(0,) * 8)
            vehicle.sendto(message.pack(packer), ("127.0.0.1", port))
            wait_until(lambda: simulation.clock.elapsed_s == time_s)

        runner = threading.Thread(target=simulation.run, args=(stop.is_set, over.append))
        runner.start()
        try:
            fly_there(1)
            pulls, _ = mute.accept()
            with pulls:
                assert pulls.recv(1)  # io has begun to pull from titan
                fly_there(2)
                fly_there(3)
                assert all(time_s < 2 for time_s in over)
            mute.close()
            wait_until(lambda: over[-1:] == [3])
        finally:
            stop.set()
            runner.join(WAIT_S)


def test_closing_leaves_no_threads_and_frees_the_ports(tmp_path, mission):
    before = set(threading.enumerate())
    team = derive_team(Team.load(mission.team), tmp_path)
    plan = load_world(None, mission, ("callisto", "europa", "io"), seed=1)
    for _ in range(2):
        with TeamSimulation(mission, team, plan):
            pass
    assert set(threading.enumerate()) <= before
