"""Flights of a mission in its own world: what is counted of them."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from air_router.controller.model.actions import StateChanged
from air_router.controller.model.events import RobotPose
from air_router.controller.model.states import Signal, State
from air_router.errors import AirRouterError
from geo.frame import Point
from mocha_link.links.metrics import (
    ContactBegan,
    ContactEnded,
    Direction,
    SyncEnded,
    SyncStarted,
)
from sitl.experiment.campaign import running
from sitl.experiment.engine import flights
from sitl.experiment.engine.flights import Meter
from sitl.experiment.events import EventQueue
from sitl.experiment.plan_file import load_experiment

UNIX_S = 1_000_000.0  # when the flight's time began


def told(*changes):
    """A meter that was told of changes of state: seconds, from, to."""
    meter = Meter(EventQueue())
    for time_s, source, target in changes:
        meter.take(time_s, StateChanged(source, Signal.TIMER, target, None))
    return meter


def test_searches_waits_and_visits_are_counted_from_changes_of_state():
    meter = told(
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
    meter = told((10.0, State.READY, State.INIT), (110.0, State.INIT, State.HOME))
    meter.take(50.0, SyncStarted("io", UNIX_S + 50.0, Direction.IN))
    meter.take(50.0, RobotPose("io", Point(0, 0), UNIX_S + 40.0, "io"))  # ten seconds old
    meter.take(60.0, RobotPose("io", Point(0, 0), UNIX_S + 30.0, "europa"))  # older: no news
    for time_s, whole in ((60.0, True), (90.0, False), (120.0, True)):  # broken; after the flight
        meter.take(time_s, SyncEnded("io", 0.0, Direction.OUT, 1, 10, 0.1, complete=whole))
    found = meter.measures(["io"], [])
    assert found["pose_age_mean_s"] == pytest.approx((40**2 + 70**2 - 10**2) / 2 / 100)
    assert found["given_age_mean_s"] == pytest.approx((50**2 + 50**2) / 2 / 100)
    # A robot that is never met has the age of the flight.
    assert meter.measures(["io", "europa"], [])["given_age_mean_s"] == pytest.approx((25 + 50) / 2)


def test_the_columns_of_a_flight_are_told():
    meter = told((10.0, State.READY, State.INIT), (110.0, State.INIT, State.HOME))
    page = (Path(__file__).parents[4] / "docs" / "experiments.md").read_text(encoding="utf-8")
    _, part, *_ = re.split("### The columns of a flight|## Questions", page)
    heads = [line.split("|")[1] for line in part.splitlines() if line.startswith("| `")]
    columns = meter.measures(["io"], []).keys() | {"wall_s", "cpu_s", "speed_up"}
    assert set(re.findall(r"`(\w+)`", " ".join(heads))) == columns


def test_a_row_says_in_which_world_its_mission_is_flown(monkeypatch):
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


def test_a_flight_in_processes_that_fails_is_an_error_in_its_words(monkeypatch):
    failed = SimpleNamespace(returncode=3, stderr="no way home\n", stdout=json.dumps({}))
    monkeypatch.setattr(flights.subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(AirRouterError, match="seed 7: no way home"):
        flights.flown_in_processes(Path("mission.yaml"), 7, "round_robin")
