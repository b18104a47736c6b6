"""Whole runs, small ones: what they are made of, that they repeat, and that nothing is copied."""

import math
import os
import pickle
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from geo.frame import Geodetic, LocalFrame, Point
from sitl.experiment.engine import channel
from sitl.experiment.engine.ages import mean_age_s
from sitl.experiment.engine.channel import Stage
from sitl.experiment.engine.engine import Run, goal_bound_share
from sitl.experiment.engine.result import measured
from sitl.experiment.robots import uav
from sitl.experiment.settings import MissionTimers, PathLossModel, RunSettings
from sitl.world.explorers import explorer
from sitl.world.explorers.settings import ExplorerSettings
from sitl.world.towns import terrain
from sitl.world.towns.town_file import load_town

ROOT = Path(__file__).parents[4]
URBAN = ROOT / "missions" / "urban"
SMALL = RunSettings(
    town=URBAN / "town.yaml",
    mission=URBAN / "mission.yaml",
    uavs=2,
    ugvs=3,
    duration_s=200.0,
    timers=MissionTimers(init_s=60.0, explore_s=30.0),
)
SEED = 7


def but(settings=SMALL, **changes):
    """The settings with others in their place."""
    return settings.model_copy(update=changes)


def run(settings, seed=SEED):
    """A run that is over."""
    made = Run(settings, seed)
    made.finish()
    return made


def sent(made):
    """Its transmissions, a column for each field."""
    return np.rec.fromrecords(
        made.airtime.transmissions, names=list(made.airtime.transmissions[0]._fields)
    )


def states(made):
    return [(uav.name, *state) for uav in made.uavs for state in uav.states]


@pytest.fixture(scope="module")
def original():
    return run(SMALL)


@pytest.fixture(scope="module")
def ours():
    return run(but(protocol="ours"))


def test_a_run_shows_everything_that_it_promises(original):
    assert original.fleet.names == ("base", "uav01", "uav02", "ugv01", "ugv02", "ugv03")
    assert original.fleet.kinds == ("base", "uav", "uav", "ugv", "ugv", "ugv")
    made = {
        name: {pair[1:] for pair in original.held if pair[0] == name} for name in ("map", "claims")
    }
    assert made["map"] == {
        (uav, ugv) for uav in original.fleet.names[1:3] for ugv in original.fleet.names[3:]
    }
    assert len(made["claims"]) == 6
    assert original.uavs[0].painter.known_share > 0.1
    assert original.travelled_m[0] == 0.0
    assert all(10.0 < metres < 5 * 200 for metres in original.travelled_m[1:])
    assert {uav for uav, _, _ in states(original)} == {"uav01", "uav02"}
    assert original.log.actions > 20
    assert len(original.town.goals) == 15
    assert len({visit.goal for visit in original.goals}) == len(original.goals)


def test_only_one_robot_sends_at_a_time_and_what_it_sends_is_the_protocol_s(original):
    rows = sent(original)
    order = np.argsort(rows["start_s"], kind="stable")
    assert np.all(rows["start_s"][order][1:] >= rows["end_s"][order][:-1] - 1e-6)
    assert np.all(rows["ready_s"] <= rows["start_s"])
    for exchange in (
        rows[rows["complete"] & (rows["requesting"] == 1) & (rows["answering"] == 0)],
    ):
        assert exchange["stage"][0] == Stage.HEADER
        assert Stage.DATA in exchange["stage"]
    ends = rows["complete"] & (rows["stage"] == Stage.END)
    assert np.count_nonzero(ends) == original.airtime.complete > 4
    assert np.all(rows["messages"][rows["complete"]] == (rows["stage"][rows["complete"]] == 1))
    found = measured(original)
    data, headers = (
        rows["complete"] & (rows["stage"] == stage) for stage in (Stage.DATA, Stage.HEADER)
    )
    assert (found["data_waits"], found["header_waits"]) == (data.sum(), headers.sum())
    assert found["waits"] == data.sum() + headers.sum() + ends.sum()
    mean_s = (rows["start_s"] - rows["ready_s"])[headers].mean()
    assert found["header_wait_mean_s"] == pytest.approx(mean_s)


def test_ours_brings_more_messages_over_in_less_time_on_the_air(original, ours):
    def busy_per_message(result):
        rows = sent(result)
        return (rows["end_s"] - rows["start_s"]).sum() / rows["messages"].sum()

    assert busy_per_message(ours) < 0.7 * busy_per_message(original)
    assert not np.any(sent(ours)["stage"] == Stage.END)
    assert ours.airtime.complete > 4


def test_poses_and_maps_travel(original, ours):
    for result in (original, ours):
        updates = {
            name: [len(h) - 1 for pair, h in result.held.items() if pair[0] == name]
            for name in ("pose", "map")
        }
        # there is a map from the first picture on, long before a robot requests it
        assert result.held["map", "uav01", "ugv01"][0].tolist() == [0.0, 4.0]
        assert all(updates["pose"])
        assert any(updates["map"])
        assert any(mean_age_s(held, 200.0) < 150.0 for held in result.held.values())


def test_an_unchanged_map_does_not_grow_old():
    """Where all robots always receive each other, what they hold is true but for a moment."""
    radio = PathLossModel(trigger_dbm=-255.0, shadowing_db=0.0, pull_every_s=1.0, rate_bytes_s=1e8)
    settings = but(uavs=1, ugvs=2, channel="path_loss", path_loss=radio)
    settings = but(settings, duration_s=100.0, base_station=False)
    result = run(settings)
    ages_s = {pair: mean_age_s(held, 100.0) for pair, held in result.held.items()}
    assert all(0.4 < age_s < 2.0 for pair, age_s in ages_s.items() if pair[0] == "pose")
    # the map is published every 10 s at most while it grows
    assert all(0 < age_s < 10.0 for pair, age_s in ages_s.items() if pair[0] == "map")
    assert all(age_s < 2.0 for pair, age_s in ages_s.items() if pair[0] == "claims")


def test_the_first_uav_explores_and_the_second_only_searches(original):
    first, second = ([state for _, state in uav.states] for uav in original.uavs)
    assert first[0] == "INIT"
    assert "EXPL" in first
    assert set(second) <= {"SEARCH", "COMM"}


def comms_s(result):
    """How long each visit to a robot lasted."""
    return [b[1] - a[1] for a, b in pairwise(states(result)) if a[0] == b[0] and a[2] == "COMM"]


def test_uavs_that_seek_no_robot_go_round_and_talk_to_whom_they_pass():
    result = run(but(passive=True, uavs=1))
    assert {state for _, _, state in states(result)} == {"INIT"}
    assert result.airtime.complete > 0


def test_a_new_town_for_each_seed_takes_the_place_of_a_file_s():
    settings = but(blocks=(2, 3), vehicles_per_block=1.5, starts="seed", duration_s=100.0, uavs=1)
    one, other = run(settings, 1), run(settings, 2)
    assert one.town.bounds != other.town.bounds
    assert [len(each.town.goals) for each in (one, other)] == [9, 9]
    assert one.log.digest == run(settings, 1).log.digest
    assert 0 < one.map_known_share < one.uavs[0].painter.known_share


def test_a_linked_team_knows_all_that_is_known_and_no_policy_gives_it_more():
    settings = but(passive=True, uavs=1, duration_s=300.0, protocol="ours", base_station=False)
    linked, passing = run(but(settings, linked=True)), run(settings)
    assert all(mean_age_s(held, 300.0) < 20.0 for held in linked.held.values())
    values = [measured(each)["service_value_percent"] for each in (linked, passing)]
    assert values[0] > 95.0 > values[1]
    with pytest.raises(ValueError, match="first UAV"):
        Run(but(linked=True, uavs=0), 1)


def test_an_oracle_that_flies_tours_knows_where_robots_are():
    searching = but(uavs=1, duration_s=400.0, radius_m=10.0, protocol="ours", starts="seed")
    ages_s = [
        measured(run(but(searching, policy=policy)))["service_age_mean_s"]
        for policy in ("tour", "oracle_tour")
    ]
    assert ages_s[1] < ages_s[0]


@pytest.mark.parametrize("policy", ["nearest", "three_in_turn", "ferry", "tour_one_robot"])
def test_policies_for_comparison_fly_to_robots(policy):
    made = run(but(policy=policy, uavs=1, duration_s=300.0, radius_m=30.0))
    assert "COMM" in {state for _, _, state in states(made)}


def test_an_oracle_finds_whom_it_seeks_and_seeks_the_worthy():
    searching = but(
        uavs=1,
        duration_s=500.0,
        radius_m=10.0,
        protocol="ours",
        starts="seed",
        base_station=False,
    )

    def found(result):
        found = [state for _, _, state in states(result)]
        return found.count("COMM"), found.count("SEARCH")

    blind = run(searching)
    oracle = run(but(searching, policy="oracle", values=(1.0, 1.0, 99.0)))
    comms, searches = found(oracle)
    assert comms >= searches - 1 > 0
    assert found(blind)[0] < found(blind)[1] - 1
    pose_s = [
        mean_age_s(oracle.held["pose", name, "uav01"], 500.0) for name in oracle.fleet.names[1:]
    ]
    map_s = [
        mean_age_s(oracle.held["map", "uav01", name], 500.0) for name in oracle.fleet.names[1:]
    ]
    assert pose_s[2] < min(pose_s[:2])
    assert pose_s[2] < mean_age_s(blind.held["pose", "ugv03", "uav01"], 500.0)
    columns = measured(oracle)
    weighted_s = np.average(np.add(pose_s, map_s) / 2, weights=(1, 1, 99))
    assert columns["service_age_mean_s"] == pytest.approx(weighted_s)
    assert columns["goal_bound_gap_percent"] > 0


def test_comm_ends_by_its_exchange_where_nodes_pull_and_by_its_timer_where_contacts_do(ours):
    """And an empty battery brings a UAV home and down."""
    flown = but(protocol="ours", pulls="node", channel="path_loss", uavs=1)
    flown = but(flown, ugvs=1, battery=2.6, airframe="px4")
    home = run(flown)
    assert max(comms_s(home)) < 5.0
    assert min(comms_s(ours)) >= SMALL.timers.communicate_s
    assert [state for _, _, state in states(home)][-3:] == ["HOME", "LAND", "DONE"]
    (due_s,) = [time_s for _, time_s, state in states(home) if state == "HOME"]
    assert due_s == pytest.approx(0.75 * 2.6 * 60.0, abs=1.0)  # the mission's reserve is 25 %
    assert "HOME" not in {state for _, _, state in states(ours)}


def test_the_same_seed_gives_the_same_log_in_another_process(original):
    program = (
        "import pickle, sys; from sitl.experiment.engine.engine import Run;"
        "run = Run(pickle.loads(bytes.fromhex(sys.argv[1])), int(sys.argv[2]));"
        "run.finish(); print(run.log.digest)"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program, pickle.dumps(SMALL).hex(), str(SEED)],
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": "12345"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stdout.strip() == original.log.digest


class OtherLibrary:
    """Mathematics as another C library may have it: off in the last bit, but for square roots."""

    def __getattr__(self, name):
        function = getattr(math, name)
        if name not in {"log", "log10", "sin", "cos", "tan", "atan2", "degrees", "radians"}:
            return function
        return lambda *values: math.nextafter(function(*values), math.inf)


def test_the_last_digits_of_another_machine_change_nothing(original, monkeypatch):
    for module in (channel, uav, explorer, terrain):
        monkeypatch.setattr(module, "math", OtherLibrary())
    to_local, to_geodetic = LocalFrame.to_local, LocalFrame.to_geodetic

    def other_to_local(frame, *degrees):
        place = to_local(frame, *degrees)
        return Point(place.east_m + 1e-10, place.north_m - 1e-10)

    def other_to_geodetic(frame, place):
        there = to_geodetic(frame, place)
        return Geodetic(there.latitude_deg - 1e-14, there.longitude_deg + 1e-14)

    monkeypatch.setattr(LocalFrame, "to_local", other_to_local)
    monkeypatch.setattr(LocalFrame, "to_geodetic", other_to_geodetic)
    assert run(SMALL).log.digest == original.log.digest


def test_what_no_run_can_be_made_of_is_refused():
    alone = but(uavs=0, ugvs=0, duration_s=60.0)
    assert run(alone).airtime.complete == 0
    with pytest.raises(ValueError, match="no robot takes part"):
        run(but(alone, base_station=False))
    with pytest.raises(ValueError, match="telemetry_s"):
        run(but(telemetry_s=1.0))
    with pytest.raises(ValueError, match="up to 300 m"):
        run(but(uav_altitude_m=301.0, path_loss=PathLossModel(air="umi_av")))


def test_places_are_the_town_s_or_the_seed_s():
    brief = but(duration_s=1.0)
    drawn = but(brief, goals="seed", starts="seed")
    first, again, other = (Run(drawn, seed) for seed in (1, 1, 2))
    fixed = Run(brief, 1), Run(brief, 2)

    def places(run):
        return [robot.position for robot in run.robots.values()]

    assert places(fixed[0]) == places(fixed[1]) == list(fixed[0].town.starts[:3])
    assert places(first) == places(again) != places(other)
    assert first.town.goals == again.town.goals != other.town.goals
    assert len(first.town.goals) == len(fixed[0].town.goals)


STREET = """\
name: Street
frame: {origin: [38.5, -98.5]}
home: [0, 0]
bounds: {west_m: -100, south_m: -20, east_m: 100, north_m: 20}
outline: [[-98, -18], [98, -18], [98, 18], [-98, 18]]
roads:
  - {width_m: 8, points: [[-96, 0], [96, 0]]}
goals: {a: [53, 0], b: [-53, 0]}
starts: [[1, 1]]
"""
AT_ONE_M_S = ExplorerSettings(speed_m_s=1.0, progress=1.0)
REACH_M = 13.0  # of arrival, and by which a vehicle may be taken for beside where it is


@pytest.fixture
def street(tmp_path):
    path = tmp_path / "town.yaml"
    path.write_text(STREET, encoding="utf-8")
    return load_town(path)


def test_robots_share_goals_and_one_alone_has_a_way_between_them(street):
    alone, both = [Point(1.0, 1.0)], [Point(1.0, 1.0), Point(-53.0, 1.0)]
    first_m = 53.0 - REACH_M - 2.0
    second_m = first_m + 106.0 - 2 * REACH_M
    share = (2 - (first_m + second_m) / 400.0) / 2
    assert goal_bound_share(street, alone, AT_ONE_M_S, 400.0) == pytest.approx(share, abs=0.01)
    assert goal_bound_share(street, both, AT_ONE_M_S, 400.0) == pytest.approx(
        (2 - first_m / 400.0) / 2, abs=0.01
    )
    assert goal_bound_share(street, alone, AT_ONE_M_S, first_m + 20.0) == pytest.approx(
        20.0 / (first_m + 20.0) / 2, abs=0.03
    )
    assert goal_bound_share(street, [], AT_ONE_M_S, 400.0) == 0.0


class TestLinkScores:
    SETTINGS = RunSettings(
        blocks=(3, 3),
        ugvs=3,
        base_station=False,
        protocol="ours",
        channel="path_loss",
        path_loss=PathLossModel(air="obstacles", trigger_dbm=-62.0),
        uav_altitude_m=40.0,
        duration_s=400.0,
        link_scores=True,
        policy="link_tour",
    )

    def test_models_are_judged_by_links_that_they_have_not_seen(self):
        made = run(self.SETTINGS)
        found = measured(made)
        names = ("constant", "distance", "path_loss", "semantic_map")
        times = (400 - 120) // 5
        assert found["links_scored"] == 3 * times
        assert 0 < found["linked_percent"] < 100
        for name in names:
            assert 0 < found[f"brier_{name}"] < 1
            assert 0 < found[f"log_loss_{name}"] < 7
        assert found["brier_semantic_map"] < found["brier_constant"]
        bins = made.link_scores.bins()
        for rows in bins.values():
            assert sum(count for count, _, _ in rows) == found["links_scored"]
            assert all(seen <= count for count, _, seen in rows)

    def test_judging_changes_nothing_else_of_a_run(self):
        with_scores, without = (
            measured(run(but(self.SETTINGS, link_scores=each))) for each in (True, False)
        )
        assert "brier_constant" not in without
        kept = {"sent_MB", "contacts", "goals_found", "delivered_MB", "decisions"}
        assert {key: with_scores[key] for key in kept} == {key: without[key] for key in kept}
        assert 0 < without["delivered_MB"] <= without["sent_MB"]

    def test_a_town_s_obstacles_are_in_the_channel(self):
        hidden, free = (
            measured(run(but(self.SETTINGS, path_loss=PathLossModel(air=air, trigger_dbm=-62.0))))
            for air in ("obstacles", "log_distance")
        )
        assert hidden["linked_percent"] != free["linked_percent"]
