"""A mission in its own world, flown by what experiments are made of."""

import itertools
import shutil
from pathlib import Path

import pytest

from air_router.controller.model.actions import StateChanged
from air_router.errors import UsageError
from air_router.gossip.mapper import Mapper
from air_router.mission.loading import load_mission
from mocha_link.links.metrics import ContactBegan, SyncEnded
from sitl.experiment.engine.world_run import WorldRun
from sitl.experiment.events import EventLog, EventQueue

URBAN = Path(__file__).parents[4] / "missions" / "urban"


class Kept(EventLog):
    """A log that keeps what the controller was told and what it asked for."""

    def __init__(self, queue):
        super().__init__(queue)
        self.told = []

    def event(self, uav, event):
        super().event(uav, event)
        self.told.append((self._queue.now_s, event))

    def action(self, uav, action):
        super().action(uav, action)
        self.told.append((self._queue.now_s, action))

    def of(self, kind):
        return [(time_s, what) for time_s, what in self.told if isinstance(what, kind)]


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
    """Four minutes of the mission, which then comes home: what was told, bytes, and the run."""
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


def test_its_map_has_the_cells_of_the_mapper_s(short):
    """The painter's raster is where the flight's mapper has its grid."""
    _, _, run = short
    mapper, painter = Mapper(load_mission(URBAN / "mission.yaml")).grid, run.uav.painter.grid
    assert painter.cells.shape == mapper.cells.shape
    assert (painter.west_m, painter.south_m) == (mapper.west_m, mapper.south_m)
    assert painter.resolution_m == mapper.resolution_m


def test_a_mission_without_a_team_is_told(tmp_path):
    path = mission(
        tmp_path, team=("team: team.yaml\n", ""), uav=("uav: titan\n", ""), world=("world: w", "#w")
    )
    with pytest.raises(UsageError, match="names no team"):
        WorldRun(path, 1, EventQueue(), Kept(EventQueue()), "round_robin")
