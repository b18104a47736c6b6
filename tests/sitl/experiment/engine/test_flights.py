"""Flights of a mission in its own world: how they go, and what is counted of them."""

import itertools
import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from air_router.controller.model.actions import StateChanged
from air_router.controller.model.events import RobotPose
from air_router.controller.model.states import Signal, State
from air_router.errors import AirRouterError, UsageError
from air_router.gossip.mapper import Mapper
from air_router.mission.loading import load_mission
from air_router.seek_policies import TargetList, policy_of
from air_router.seek_policies.testing import SCENES
from air_router.vehicle import Telemetry
from geo.frame import Point
from mocha_link.links.metrics import (
    ContactBegan,
    ContactEnded,
    Direction,
    MessageStored,
    SyncEnded,
    SyncStarted,
)
from sitl.cli.cli import main
from sitl.experiment.campaign import running
from sitl.experiment.engine import flights
from sitl.experiment.engine.flights import WorldRun
from sitl.experiment.engine.meter import Goals, Meter
from sitl.experiment.events import EventLog, EventQueue
from sitl.experiment.plan_file import load_experiment

URBAN = Path(__file__).parents[4] / "missions" / "urban"
EXPLORERS = URBAN.with_name("explorers")
UNIX_S = 1_000_000.0  # when the flight's time began


def meter_of(*changes):
    """A meter of changes of state: seconds, from, to."""
    meter = Meter(EventQueue())
    for time_s, source, target in changes:
        meter.take(time_s, StateChanged(source, Signal.TIMER, target, None))
    return meter


def test_searches_waits_and_visits_are_counted_from_changes_of_state():
    meter = meter_of(
        (0.0, State.READY, State.INIT),
        (180.0, State.INIT, State.SEARCH),
        (200.0, State.SEARCH, State.COMM),
        (202.0, State.COMM, State.EXPL),
        (300.0, State.EXPL, State.SEARCH),
        (345.0, State.SEARCH, State.EXPL),  # in vain
        (400.0, State.EXPL, State.SEARCH),
        (410.0, State.SEARCH, State.COMM),
        (416.0, State.COMM, State.HOME),
    )
    meter.take(200.0, ContactBegan("io", 0.0, None))
    meter.take(230.0, ContactEnded("io", 0.0, 30.0, ""))
    meter.take(201.0, SyncEnded("io", 0.0, Direction.IN, 1, 10, 0.1))
    found = meter.measures(["io"], [1_500, 500])
    counted = ("searches", "found", "uav_contacts", "syncs", "uav_contact_s", "arrived_kB")
    assert [found[name] for name in counted] == [3, 2, 1, 1, 30.0, 2.0]
    assert (found["found_after_mean_s"], found["comm_mean_s"], found["mission_s"]) == (15, 4, 416)


def test_ages_are_areas_under_saw_teeth_from_init_to_the_way_home():
    meter = meter_of((10.0, State.READY, State.INIT), (110.0, State.INIT, State.HOME))
    meter.take(50.0, SyncStarted("io", UNIX_S + 50.0, Direction.IN))
    meter.take(50.0, RobotPose("io", Point(0, 0), UNIX_S + 40.0, "io"))  # ten seconds old
    meter.take(60.0, RobotPose("io", Point(0, 0), UNIX_S + 30.0, "europa"))  # older: no update
    for time_s, whole in ((60.0, True), (90.0, False), (120.0, True)):  # broken; after the flight
        meter.take(time_s, SyncEnded("io", 0.0, Direction.OUT, 1, 10, 0.1, complete=whole))
    found = meter.measures(["io"], [])
    assert found["pose_age_mean_s"] == pytest.approx((40**2 + 70**2 - 10**2) / 2 / 100)
    assert found["given_age_mean_s"] == pytest.approx((50**2 + 50**2) / 2 / 100)
    # A robot that is never met has the age of the flight.
    assert meter.measures(["io", "europa"], [])["given_age_mean_s"] == pytest.approx((25 + 50) / 2)


def test_goals_count_until_the_way_home_and_only_where_robots_look_for_some():
    meter = meter_of((10.0, State.READY, State.INIT), (110.0, State.INIT, State.HOME))
    meter.take(50.0, SyncStarted("io", UNIX_S + 50.0, Direction.IN))
    found = meter.measures(["io"], [], Goals(15, [UNIX_S + s for s in (20.0, 109.0, 111.0)]))
    assert (found["goals_found"], found["goals_total"]) == (2, 15)
    assert "goals_found" not in meter.measures(["io"], [])


def test_the_columns_of_a_flight_are_documented():
    meter = meter_of((10.0, State.READY, State.INIT), (110.0, State.INIT, State.HOME))
    page = (Path(__file__).parents[4] / "docs" / "evidence" / "experiments.md").read_text(
        encoding="utf-8"
    )
    _, part, *_ = re.split("### The columns of a flight|## Questions", page)
    heads = [line.split("|")[1] for line in part.splitlines() if line.startswith("| `")]
    columns = meter.measures(["io"], [], Goals(1)).keys() | {"wall_s", "cpu_s", "speed_up"}
    assert set(re.findall(r"`(\w+)`", " ".join(heads))) == columns


def test_a_row_selects_the_world_in_which_its_mission_is_flown(monkeypatch):
    experiment, _ = load_experiment("fidelity")
    seen = []

    def fly(mission, seed, policy):
        seen.append((mission.parent.name, seed, policy))
        return flights.Flown({"searches": 1}, "a digest")

    monkeypatch.setattr(running, "flown_here", fly)
    tasks = [experiment.task(row, 0) for row in experiment.rows if row.label.endswith("mission")]
    records = [running.make_run(task) for task in tasks]
    assert [policy for _, _, policy in seen] == ["round_robin", "rendezvous"]
    assert len({(town, seed) for town, seed, _ in seen}) == 1  # paired
    assert {record["digest"] for record in records} == {"a digest"}


class GivesUp:
    """A policy of another package that fails after four minutes."""

    foresees = False

    def order(self, targets, context):
        if context.now_s > 240.0:
            raise ZeroDivisionError("no time left")
        return [self.place(name, targets, context) for name in targets.candidates(context.now_s)]

    def place(self, robot, targets, context):
        return targets.place(robot, context.now_s)


@pytest.mark.parametrize("world", ["town", "mission"])
def test_a_policy_that_fails_is_in_the_record_of_its_run(world, tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(
        "name: own\ntitle: A policy of our own\n"
        f"rows: [{{world: {world}, policy: '{__name__}:GivesUp', mission: pennovation, "
        "town: pennovation, duration_s: 400}]\n"
    )
    experiment, _ = load_experiment(str(path))
    task = experiment.task(experiment.rows[0], 0)
    running.put_together(task)
    record = running.make_run(task)
    assert list(record["faults"].values()) == ["ZeroDivisionError: no time left"]


def test_an_announcement_of_a_failed_policy_is_recognised():
    robots = TargetList(("io", "europa"))
    guarded = policy_of(f"{__name__}:GivesUp")
    place = guarded.place("io", robots, SCENES[0].context())
    assert flights.fault_in(f"SEARCH io: {place.reason}") is None
    (place, _) = guarded.order(robots, SCENES[0].context())
    assert flights.fault_in(f"SEARCH io: {place.reason}") == "ZeroDivisionError: no time left"


def test_a_flight_in_processes_that_fails_is_an_error_with_its_message(monkeypatch):
    failed = SimpleNamespace(returncode=3, stderr="no way home\n", stdout=json.dumps({}))
    monkeypatch.setattr(flights.subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(AirRouterError, match="seed 7: no way home"):
        flights.flown_in_processes(Path("mission.yaml"), 7, "round_robin")


@pytest.mark.parametrize("world", ["processes", "px4"])
def test_only_the_row_of_a_real_px4_has_one(monkeypatch, world):
    commands = []

    def run(command, **_):
        commands.append(command)
        return SimpleNamespace(returncode=4, stderr="no vehicle", stdout="")

    monkeypatch.setattr(flights.subprocess, "run", run)
    experiment, _ = load_experiment("autopilot" if world == "px4" else "fidelity")
    row = next(row for row in experiment.rows if row.settings["world"] == world)
    with pytest.raises(AirRouterError, match="no vehicle"):
        running.make_run(experiment.task(row, 0))
    assert [("--px4" in command) for command in commands] == [world == "px4"]


class Kept(EventLog):
    """A log that keeps what the controller received and what it commanded."""

    def __init__(self, queue):
        super().__init__(queue)
        self.logged = []

    def event(self, uav, event):
        super().event(uav, event)
        self.logged.append((self._queue.now_s, event))

    def action(self, uav, action):
        super().action(uav, action)
        self.logged.append((self._queue.now_s, action))

    def of(self, kind):
        return [(time_s, what) for time_s, what in self.logged if isinstance(what, kind)]


def mission(folder, **keys):
    """The town's mission with other values, among its files."""
    for name in ("team.yaml", "world.yaml"):
        shutil.copy(URBAN / name, folder / name)
    text = (URBAN / "mission.yaml").read_text()
    for old, new in keys.values():
        assert text.count(old) == 1
        text = text.replace(old, new)
    (folder / "mission.yaml").write_text(text)
    return folder / "mission.yaml"


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Four minutes of the mission, which then comes home: the log, bytes, and the run."""
    path = mission(
        tmp_path_factory.mktemp("urban"),
        ends=("duration_s: 1800", "duration_s: 240"),
        first=("init_s: 180", "init_s: 150"),
        explores=("explore_s: 120", "explore_s: 30"),
    )
    queue = EventQueue()
    log = Kept(queue)
    run = WorldRun(path, 1, queue, log, "round_robin")
    return log, run.finish(), run


def test_a_mission_is_flown_to_its_end(short):
    log, arrived_bytes, run = short
    states = [(change.target.name, time_s) for time_s, change in log.of(StateChanged)]
    assert [name for name, _ in states][-3:] == ["HOME", "LAND", "DONE"]
    assert {"INIT", "SEARCH", "COMM", "EXPL"} < {name for name, _ in states}
    assert run.uav.flyer.landed
    assert all(size > 1_000 for size in arrived_bytes if size)
    assert sum(arrived_bytes) > 50_000


def test_its_battery_is_that_of_the_simulated_vehicle(short, capsys):
    """Flights by processes are compared with it, and come home by the battery."""
    assert main(["vehicle", "--help"]) == 0
    minutes = float(
        re.search(r"battery, in minutes\s+\(default ([\d.]+)\)", capsys.readouterr().out)[1]
    )
    log, _, _ = short
    flies = [each for _, each in log.of(Telemetry) if each.in_air]
    for each in (flies[0], flies[len(flies) // 2], flies[-1]):
        assert each.battery == pytest.approx(1.0 - each.time_s / (60.0 * minutes), abs=1e-4)


def test_its_nodes_pull_ever_less_often_and_comm_ends_by_its_exchange(short):
    log, _, run = short
    changes = [(time_s, change) for time_s, change in log.of(StateChanged)]
    comms_s = [
        after - time_s
        for (time_s, change), (after, _) in itertools.pairwise(changes)
        if change.target.name == "COMM"
    ]
    assert comms_s
    assert max(comms_s) < 5.0  # its timer: 20 s
    assert {contact.peer for _, contact in log.of(ContactBegan)} <= run.nodes.keys()
    (first_s, first), *_ = log.of(ContactBegan)
    synced_s = [t for t, sync in log.of(SyncEnded) if sync.peer == first.peer and t < first_s + 9.0]
    assert len(synced_s) == pytest.approx(2 * 3, abs=2)  # both directions, after 0, 2 and 6 s


class NoChoice:
    """A ground robot's policy that fails at once."""

    def choose(self, view):
        raise ZeroDivisionError("no choice")


def exploring(tmp_path, world):
    """The mission of robots that explore, for 200 s, in a world of this file."""
    text = (EXPLORERS / "mission.yaml").read_text()
    for old, new in (("duration_s: 900", "duration_s: 200"), (": team.", f": {EXPLORERS}/team.")):
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = tmp_path / "mission.yaml"
    path.write_text(text.replace("world: world.yaml", f"world: {world}"))
    return path


def test_a_world_s_robots_whose_policy_fails_are_named(tmp_path):
    world = tmp_path / "world.yaml"
    town = f"town: {URBAN}/town.yaml\n  policy: '{__name__}:NoChoice'\n"
    text = (EXPLORERS / "world.yaml").read_text()
    world.write_text(text.replace("town: ../urban/town.yaml\n", town))
    flown = flights.flown_here(exploring(tmp_path, world), 1, "round_robin")
    assert set(flown.faults.values()) == {"ZeroDivisionError: no choice"}
    assert "ugv01" in flown.faults


def test_robots_explore_with_the_maps_that_gossip_brings_them(tmp_path):
    """Until they have received the UAV's map they know of no goal that they have not seen."""
    path = exploring(tmp_path, EXPLORERS / "world.yaml")
    queue = EventQueue()
    log = Kept(queue)
    run = WorldRun(path, 1, queue, log, "tour")
    run.finish()
    topics = {stored.topic for _, stored in log.of(MessageStored) if stored.robot == "ugv01"}
    assert {"/pose", "/claimed_goals", "/path", "/reachability"} <= topics
    assert run.goals.total == 15
    assert run.goals.found_s


def test_its_map_has_the_cells_of_the_mapper_s(short):
    """The painter's raster is where the flight's mapper has its grid."""
    _, _, run = short
    mapper, painter = Mapper(load_mission(URBAN / "mission.yaml")).grid, run.uav.painter.grid
    assert painter.cells.shape == mapper.cells.shape
    assert (painter.west_m, painter.south_m) == (mapper.west_m, mapper.south_m)
    assert painter.resolution_m == mapper.resolution_m


def test_a_mission_without_a_team_is_reported(tmp_path):
    path = mission(
        tmp_path, team=("team: team.yaml\n", ""), uav=("uav: titan\n", ""), world=("world: w", "#w")
    )
    with pytest.raises(UsageError, match="names no team"):
        WorldRun(path, 1, EventQueue(), Kept(EventQueue()), "round_robin")
