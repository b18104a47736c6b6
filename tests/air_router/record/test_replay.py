"""A recorded flight decides the same again; one that would not is reported with where and how."""

import dataclasses
import itertools
import json
import math
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from air_router.cli.cli import main
from air_router.controller import Controller
from air_router.controller.model.actions import Announce, FlyToNode, RenewPlan
from air_router.controller.model.events import AirspaceChanged, CommandConfirmed, PlanRenewed
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.requests import ComeHome, GoOn
from air_router.controller.model.states import State
from air_router.controller.targets.seeking import RoundRobin
from air_router.gossip import RESOLUTION_M, Mapper
from air_router.record.log import Log, Note, RecordEntry
from air_router.record.recorder import Recorder
from air_router.record.recording import default_folder, record_of
from air_router.record.replay import CONTEXT, ReplayError, replay_record
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from geo.grid import GridPatch
from mocha_link.cli import Options

ROOT = Path(__file__).parents[3]


KINDS = {"event", "action"}
SETUP = {"seek": ("callisto", "io"), "name": "titan"}


RECORD = []

CHUNK, FOOTER = 0x06, 0x02  # opcodes of MCAP


@pytest.fixture
def flown(pretend, pennovation, tmp_path):
    """The record of a whole flight of the pure controller that meets robots; it flies once."""
    path = tmp_path / "flight.mcap"
    if not RECORD:
        RECORD.append(fly(pretend, pennovation, tmp_path).read_bytes())
    path.write_bytes(RECORD[0])
    return path


def fly(pretend, pennovation, folder):
    timers = dataclasses.replace(pennovation.timers, init_s=5.0, explore_s=10.0)
    flight = pretend(timers=timers, duration_s=60.0, radius_m=150.0, **SETUP)
    flight.robots = {"callisto": Point(-90.0, 60.0), "io": Point(30.0, 0.0)}
    handle = flight.controller.handle
    with Recorder(folder, "m", unix_s=lambda: 1.7e9) as recorder:
        recorder.begin(FlightSetup(flight.mission, **SETUP))

        def recorded(event, now_s):
            recorder.event(event, now_s)
            actions = handle(event, now_s)
            recorder.actions(actions, now_s)
            return actions

        flight.controller.handle = recorded
        flight.take_off()
        flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) > 30.0)
        drawn = Zone("new", Circle(Point(60.0, -40.0), 15.0))
        flight.give(AirspaceChanged(flight.mission.fences, (*flight.mission.zones, drawn)))
        flight.fly_until(lambda: any(isinstance(a, RenewPlan) for a in flight.actions))
        flight.give(PlanRenewed())
        recorder.patch(bytes(1 << 20), flight.now_s)  # which fills a chunk of the file
        flight.fly_until(lambda: flight.finished is not None, 400.0)
        recorder.note("LetGo", flight.now_s, {})
        recorder.event(GoOn(), flight.now_s)  # came too late to be decided on
    assert {State.SEARCH, State.COMM, State.HOME} <= set(flight.states)
    return recorder.path


def test_a_flight_decides_the_same_again_in_another_process(flown):
    """Python's hashes of text differ there: no decision may depend on the order of a set."""
    done = subprocess.run(
        [sys.executable, "-m", "air_router.cli.cli", "replay", flown, "--json"],
        capture_output=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "1"},
        check=True,
    )
    printed = json.loads(done.stdout)
    assert (printed["same"], printed["difference"], printed["ending"]) == (True, None, None)
    assert printed["actions"] > 20


class ByMap(RoundRobin):
    """Announces what is mapped so far."""

    def order(self, targets, context):
        mapped = f"{context.ground.known_cells} cells are mapped"
        return [dataclasses.replace(p, reason=mapped) for p in super().order(targets, context)]


def test_a_policy_that_reads_the_map_has_the_same_map_again(pretend, pennovation, tmp_path):
    timers = dataclasses.replace(pennovation.timers, init_s=5.0, explore_s=10.0, search_s=5.0)
    own = {"timers": timers, "duration_s": 90.0, "seek_policy": f"{__name__}:ByMap"}
    flight, mapper = pretend(**own, **SETUP), Mapper(pennovation)
    setup = FlightSetup(flight.mission, **SETUP)
    flight.controller = Controller(setup, flight.router, flight.plan, ground=mapper.grid)
    handle, seen = flight.controller.handle, itertools.count()
    with Recorder(tmp_path, "m", unix_s=lambda: 1.7e9) as recorder:
        recorder.begin(setup)

        def recorded(event, now_s):
            recorder.event(event, now_s)
            actions = handle(event, now_s)
            recorder.actions(actions, now_s)
            west_m = RESOLUTION_M * (next(seen) % 100)
            patch = GridPatch(west_m, 0.0, RESOLUTION_M, np.ones((1, 1), dtype=np.uint8)).encode()
            mapper.paint(patch)
            recorder.patch(patch, now_s)
            return actions

        flight.controller.handle = recorded
        flight.take_off()
        flight.fly_until(lambda: flight.finished is not None, 400.0)
        recorder.note("LetGo", flight.now_s, {})
    entries = list(Log(recorder.path))
    announced = [str(entry.value) for entry in entries if entry.kind == "action"]
    assert any("cells are mapped" in text for text in announced)
    assert replay_record(entries).difference is None
    blind = [entry for entry in entries if entry.kind != "patch"]
    assert replay_record(blind).difference is not None


def test_the_first_difference_is_reported_with_what_was_before(flown, capsys):
    entries = list(Log(flown))
    jumps = [i for i, entry in enumerate(entries) if isinstance(entry.value, FlyToNode)]
    changed = entries[jumps[3]].value
    entries[jumps[3]] = entries[jumps[3]]._replace(value=dataclasses.replace(changed, node=99))
    found = replay_record(entries).difference
    assert dataclasses.replace(changed, node=99) in found.recorded
    assert changed in found.replayed
    assert found.t == entries[jumps[3]].t
    lines = list(found.lines())
    assert lines[0].startswith(f"first difference at {found.t:.3f} s, in ")
    assert any("recorded: FlyToNode(node=99" in line for line in lines)
    assert 3 <= len(found.before) <= CONTEXT
    assert len(lines) < 3 * CONTEXT

    silent = [entry for entry in Log(flown) if not isinstance(entry.value, FlyToNode)]
    found = replay_record(silent).difference
    assert not any(isinstance(action, FlyToNode) for action in found.recorded)


def chunks_of(data):
    """Where the contents of an MCAP file's chunks are; what stands between them is its index."""
    at = 8
    while data[at] != FOOTER:
        length = int.from_bytes(data[at + 1 : at + 9], "little")
        if data[at] == CHUNK:
            yield at + 9, length
        at += 9 + length


def test_a_record_that_was_cut_off_replays_to_its_end(flown, capsys):
    data = flown.read_bytes()
    start, length = [*chunks_of(data)][-1]
    flown.write_bytes(data[: start + length // 2])
    log = Log(flown)
    result = replay_record(log)
    assert result.difference is None
    assert result.events > 100
    assert main(["replay", str(flown)]) == 0
    assert "note: the record is not whole: it was cut off" in capsys.readouterr().out


@pytest.mark.parametrize("which", [0, -1])
def test_a_damaged_record_is_never_the_same(flown, capsys, which):
    data = bytearray(flown.read_bytes())
    start, length = [*chunks_of(data)][which]
    at = start + length // 2
    data[at : at + 40] = bytes(40)
    flown.write_bytes(data)
    assert main(["replay", str(flown)]) == 3
    out, err = capsys.readouterr()
    assert "damaged" in out + err


def test_without_a_name_it_is_the_newest_flight(flown, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    assert main(["replay"]) == 2
    assert "has a record of a flight; name one" in capsys.readouterr().err
    default_folder().mkdir(parents=True)
    for name, age_s in (("flight-2.mcap", 0), ("flight-1.mcap", 60)):
        (default_folder() / name).write_bytes(flown.read_bytes())
        os.utime(default_folder() / name, (2e9 - age_s, 2e9 - age_s))
    assert main(["replay"]) == 0
    assert capsys.readouterr().out.startswith("flight-2.mcap: the same ")
    there = tmp_path / "logs" / "titan" / "sim-3.mcap"  # as `make sim` and several UAVs leave it
    there.parent.mkdir(parents=True)
    there.write_bytes(flown.read_bytes())
    os.utime(there, (2e9 + 1, 2e9 + 1))
    there.with_name("gone.mcap").symlink_to("elsewhere.mcap")
    there.with_name("folder.mcap").mkdir()
    assert record_of(Options(log=None)) == Path("logs/titan/sim-3.mcap")


def test_the_snippet_of_the_docs_runs(flown, capsys, monkeypatch):
    text = (ROOT / "docs" / "records.md").read_text(encoding="utf-8")
    (snippet,) = re.findall(r"## In Python\n\n((?:    .*\n|\n)+)", text)
    monkeypatch.chdir(flown.parent)
    (name,) = set(re.findall(r'"(flight-.*?)"', snippet))
    flown.rename(name)
    exec(textwrap.dedent(snippet), {})  # noqa: S102 - our own
    out = capsys.readouterr().out
    assert "Telemetry(" in out
    assert out.endswith("whole\n")


def test_of_two_motions_alike_the_right_one_is_confirmed(tmp_path):
    """The controller goes by the object; a record distinguishes them by their number."""
    first, second = FlyToNode(1, Point(1.0, 2.0)), FlyToNode(1, Point(1.0, 2.0))
    with Recorder(tmp_path, "m") as recorder:
        recorder.actions((first, second), 1.0)
        for motion in (first, second):
            recorder.event(CommandConfirmed(motion), 2.0)
    one, two, about_one, about_two = (e.value for e in Log(recorder.path) if e.kind in KINDS)
    assert one is about_one.action
    assert two is about_two.action
    assert one is not two


def test_an_exception_in_a_decision_is_a_difference(pennovation):
    setup = RecordEntry(0.0, "setup", FlightSetup(pennovation))
    broken = RecordEntry(1.0, "event", CommandConfirmed("nothing"))
    before = RecordEntry(0.5, "note", Note("Reaction", {"reaction_s": 2.0}))
    found = replay_record(
        [setup, before, broken, RecordEntry(1.0, "action", Announce("x"))]
    ).difference
    assert found.replayed != found.recorded


def test_without_a_setup_or_a_decision_there_is_nothing_to_replay(flown):
    for entries in ([], [RecordEntry(1.0, "event", ComeHome())]):
        with pytest.raises(ReplayError):
            replay_record(entries)
    entries = list(Log(flown))
    first = next(index for index, entry in enumerate(entries) if entry.kind == "action")
    with pytest.raises(ReplayError, match="no decision was recorded"):
        replay_record(entries[: first - 1])


def test_what_is_no_record_is_an_invalid_file(tmp_path, capsys):
    (tmp_path / "a.mcap").write_bytes(b"text")
    assert main(["replay", str(tmp_path / "a.mcap")]) == 3
    assert "not an MCAP file" in capsys.readouterr().err
    for path in (tmp_path / "none.mcap", tmp_path):  # 1 is for other decisions
        assert main(["replay", str(path)]) == 3
        assert main(["report", str(path)]) == 3
