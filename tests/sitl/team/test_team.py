"""The whole world beside the autopilot, as a process; the vehicle is played by the test."""

import json
import queue
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
import zmq
from pymavlink.dialects.v20 import common as mavlink

from air_router.messages import PoseMessage
from air_router.mission.loading import load_mission
from geo.frame import Geodetic, LocalFrame, Point
from geo.grid import GridPatch, SemanticGrid, Terrain
from mocha_link.links.metrics import MessageStored
from mocha_link.node.node import Node
from mocha_link.service.service_client import ServiceClient
from mocha_link.team.team import Team
from sitl.cli.cli import main
from sitl.mavlink.truth import VehicleState
from sitl.team.free_ports import derive_team
from sitl.team.team import Places, TeamSimulation, roles_of
from sitl.world.world_file import load_world

ROOT = Path(__file__).parents[3]
MISSION = ROOT / "missions" / "pennovation" / "mission.yaml"
EPOCH_S = 1_800_000_000
WAIT_S = 60.0
HIGH_M = 40.0
WORLD = """\
coordinates: local
radio: {shadowing_db: 0}
robots:
  callisto: {patrol: [[-165, 60], [-165, 50]]}
  europa: {patrol: [[95, -40], [95, -50]]}
  io: {patrol: [[0, -125]]}
"""


class Vehicle(threading.Thread):
    """Plays the vehicle: sends its truth at ten times real time, wherever it is told to be."""

    def __init__(self, truth_url: str, frame: LocalFrame, altitude_amsl_m: float) -> None:
        super().__init__(daemon=True)
        host, _, port = truth_url.removeprefix("udp://").rpartition(":")
        self._to = (host, int(port))
        self._frame = frame
        self._altitude_amsl_m = altitude_amsl_m
        self._stopped = threading.Event()
        self.position = Point(0.0, 0.0)
        self.height_m = 0.0
        self.time_s = 0.0

    def now_s(self) -> float:
        return EPOCH_S + self.time_s

    def run(self) -> None:
        packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not self._stopped.wait(0.004):
                self.time_s += 0.04
                here = self._frame.to_geodetic(self.position)
                message = packer.hil_state_quaternion_encode(
                    int(self.time_s * 1e6),
                    [1.0, 0.0, 0.0, 0.0],
                    *(0.0, 0.0, 0.0),
                    int(here.latitude_deg * 1e7),
                    int(here.longitude_deg * 1e7),
                    int((self._altitude_amsl_m + self.height_m) * 1e3),
                    *(0, 0, 0, 0, 0, 0, 0, -1000),
                )
                out.sendto(message.pack(packer), self._to)

    def stop(self) -> None:
        self._stopped.set()
        self.join(WAIT_S)


class Arrivals:
    """Waits for messages that arrive at a node."""

    def __init__(self, node: Node) -> None:
        self._events: queue.SimpleQueue[MessageStored] = queue.SimpleQueue()
        node.subscribe(self._note)

    def _note(self, event) -> None:
        if isinstance(event, MessageStored):
            self._events.put(event)

    def wait(self, robot: str, topic: str, after_s: float = 0.0) -> None:
        deadline_s = time.monotonic() + WAIT_S
        while True:
            event = self._events.get(timeout=max(0.0, deadline_s - time.monotonic()))
            if (event.robot, event.topic) == (robot, topic) and event.at_s >= after_s:
                return


@contextmanager
def process(*arguments: str):
    command = [sys.executable, "-m", "sitl", "team", *arguments]
    child = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


def ready_line(child: subprocess.Popen) -> dict:
    readable, _, _ = select.select([child.stdout], [], [], WAIT_S)
    assert readable, "not ready in time"
    line = child.stdout.readline()
    assert line, child.stderr.read()
    return json.loads(line)


@pytest.fixture
def mission():
    return load_mission(MISSION)


def test_robots_that_never_meet_hold_each_others_data_through_the_vehicle(tmp_path, mission):
    world_file, report_file = tmp_path / "world.yaml", tmp_path / "out" / "report.json"
    world_file.write_text(WORLD)
    arguments = (
        *(str(MISSION), "--world", str(world_file), "--epoch", str(EPOCH_S)),
        *("--truth", "udp://127.0.0.1:0", "--camera", "tcp://127.0.0.1:0"),
        *("--free-ports", str(tmp_path / "ports"), "--report", str(report_file)),
    )
    with process(*arguments) as child:
        ready = ready_line(child)
        assert ready["ready"] is True
        assert ready["robots"] == ["callisto", "europa", "io"]
        assert ready["vehicle"] == "titan"
        team = Team.load(Path(ready["team"]))
        vehicle = Vehicle(ready["truth"], mission.frame, mission.home_altitude_amsl_m)
        vehicle.position = Point(-165, 55)
        vehicle.height_m = HIGH_M
        context = zmq.Context()
        camera = context.socket(zmq.SUB)
        camera.linger = 0
        camera.rcvtimeo = int(WAIT_S * 1000)
        camera.subscribe(b"")
        camera.connect(ready["camera"])
        with context, camera, Node(team, "titan", clock=vehicle) as titan:
            arrivals = Arrivals(titan)
            titan.publish("/map", small_map(mission.frame.origin))
            vehicle.start()
            arrivals.wait("callisto", "/pose")
            patch = GridPatch.decode(camera.recv())
            assert (patch.cells != Terrain.UNKNOWN).sum() > 2000
            vehicle.position = Point(95, -45)
            arrivals.wait("europa", "/pose")
            pose = PoseMessage.decode(titan.latest("europa", "/pose").data)
            here = mission.frame.to_local(pose.latitude_deg, pose.longitude_deg)
            assert here.east_m == pytest.approx(95, abs=0.5)
            assert EPOCH_S <= pose.stamp_s <= vehicle.now_s() + 0.1
            met_s = vehicle.now_s()
            wait_until(lambda: titan.links()["europa"].syncs_out >= 1)
            child.send_signal(signal.SIGTERM)
            out, err = child.communicate(timeout=WAIT_S)
            vehicle.stop()
    assert child.returncode == 0, err
    assert out == ""
    report = json.loads(report_file.read_text())
    check_report(report, met_s)


def check_report(report: dict, met_s: float) -> None:
    robots = report["robots"]
    assert set(robots) == {"callisto", "europa", "io"}
    assert report["carried"] == [["europa", "callisto"]]
    assert report["ended_s"] >= met_s
    europa = robots["europa"]
    assert europa["contacts"]["titan"]["count"] == 1
    assert europa["contacts"]["titan"]["seconds"] > 0
    assert europa["contacts"]["callisto"] == {
        "count": 0,
        "seconds": 0.0,
        "last_s": None,
        "closest_m": pytest.approx(280, abs=20),
    }
    assert europa["syncs"]["titan"]["in"] >= 1
    assert europa["syncs"]["callisto"]["in"] == 0
    held = {(h["robot"], h["topic"]): h for h in europa["holds"]}
    carried_pose = held["callisto", "/pose"]
    assert EPOCH_S <= carried_pose["stamp_s"] <= report["ended_s"]
    assert carried_pose["age_s"] == pytest.approx(report["ended_s"] - carried_pose["stamp_s"])
    assert ("titan", "/map") in held
    assert europa["map"]["robot"] == "titan"
    assert europa["map"]["known_cells"] == 150
    assert [cells for _, cells in europa["map_history"]] == [150]
    assert europa["driven_m"] == pytest.approx(report["simulated_s"], rel=0.1, abs=1.0)
    io = robots["io"]
    assert io["contacts"]["titan"]["count"] == 0
    assert {h["robot"] for h in io["holds"]} == {"io"}
    assert io["map"] is None
    assert io["position"]["north_m"] == pytest.approx(-125, abs=0.2)


def small_map(origin: Geodetic) -> bytes:
    grid = SemanticGrid.blank(origin, 1.0, Point(0, 0), Point(20, 20))
    grid.cells[:10, :15] = Terrain.ROAD
    return grid.encode()


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
        places = [word for pair in urls.items() for word in pair]
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


def test_a_missing_mission_and_a_team_without_ground_robots_are_told(tmp_path, capsys):
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
    assert "no robot 'titan' drives on the ground for a program" in capsys.readouterr().err


def test_a_place_that_is_no_url_is_told(tmp_path, capsys):
    ports = ("--free-ports", str(tmp_path))
    assert run_team(str(MISSION), *ports, "--truth", "127.0.0.1:19410") == 1
    assert "write udp://HOST:PORT" in capsys.readouterr().err


@pytest.fixture
def simulation(tmp_path, mission):
    team = derive_team(Team.load(mission.team), tmp_path)
    plan = load_world(mission.world, mission, roles_of(mission, team).ground, seed=1)
    places = Places("udp://127.0.0.1:0", "tcp://127.0.0.1:0")
    with TeamSimulation(mission, team, plan, places, epoch_s=EPOCH_S) as simulation:
        yield simulation


def test_without_a_vehicle_it_waits_and_says_so(simulation, monkeypatch, caplog):
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


def test_a_robot_that_a_program_plays_is_where_it_says_and_says_nothing_else(tmp_path, mission):
    team = derive_team(Team.load(mission.team), tmp_path)
    plan = load_world(mission.world, mission, roles_of(mission, team).ground, seed=1)
    endpoint = f"ipc://{tmp_path}/io"
    places = Places("udp://127.0.0.1:0", "tcp://127.0.0.1:0", rovers={"io": endpoint})
    there = Point(-30.0, 20.0)
    latitude_deg, longitude_deg = mission.frame.to_geodetic(there)
    pose = PoseMessage(stamp_s=0.0, latitude_deg=latitude_deg, longitude_deg=longitude_deg)
    seconds = iter(range(1, 10))
    with (
        TeamSimulation(mission, team, plan, places, epoch_s=EPOCH_S) as simulation,
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


def test_closing_leaves_no_threads_and_frees_the_ports(tmp_path, mission):
    before = set(threading.enumerate())
    team = derive_team(Team.load(mission.team), tmp_path)
    plan = load_world(None, mission, ("callisto", "europa", "io"), seed=1)
    places = Places("udp://127.0.0.1:0", "tcp://127.0.0.1:0")
    for _ in range(2):
        with TeamSimulation(mission, team, plan, places):
            pass
    assert set(threading.enumerate()) == before
