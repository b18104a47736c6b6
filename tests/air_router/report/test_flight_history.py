"""A record becomes a history of its flight, and that a JSON object: what happened, nothing else."""

import dataclasses
import itertools
import json

import pytest

from air_router.controller.model.flight_setup import FlightSetup
from air_router.record.log import Log
from air_router.record.recorder import Recorder
from air_router.report.flight_history import NothingFlownError, history_of
from air_router.report.link_history import LinkFold
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted
from tests.air_router.report.flown import UNIX_S, entries, recorded


@pytest.fixture
def history(pennovation):
    return recorded(entries(pennovation))


def test_the_facts(history):
    facts = json.loads(json.dumps(history.as_json(), allow_nan=False))
    assert (facts["mission"], facts["uav"], facts["outcome"]) == ("Pennovation", "titan", "done")
    assert facts["began_unix_s"] == UNIX_S
    assert facts["distance_m"] == pytest.approx(120.0, abs=3.0)
    assert facts["duration_s"] == 75.0  # from arming
    # Up to 14 s among the mission's zones, which it passes well; from then on among one other.
    assert (facts["closest_approach_m"], facts["closest_approach_to"]) == (4.0, "new")
    assert history.mission.zones[0].name == "new"
    states = [(s["state"], s["from_s"], s["to_s"], s["robot"]) for s in facts["states"]]
    assert states == [
        ("READY", 0, 10, None),
        ("INIT", 10, 30, None),
        ("SEARCH", 30, 60, "io"),
        ("HOME", 60, 80, None),  # the robot that was sought before
    ]
    waits = [(w["interlock"], w["from_s"], w["to_s"]) for w in facts["waits"]]
    assert waits == [
        ("INPUT_MISSING", 36.0, 38.5),
        ("ZONE_UPDATE", 38.5, 39.0),
        ("INPUT_MISSING", 78.0, 80.0),  # to the end
    ]
    assert facts["interactions"] == {
        "started": 3,
        "completed": 2,
        "partial": 0,
        "timed_out": 1,
        "share_completed": pytest.approx(2 / 3),
        "bytes_in": 4000,
        "bytes_out": 90_000,
    }
    assert list(facts["robots"]) == ["io", "phantom"]  # our own messages have no age
    phantom = facts["robots"]["phantom"]  # was sought, and never met
    assert not any(values for name, values in phantom.items() if name != "map_share")
    io = facts["robots"]["io"]
    assert io["contacts"] == [{"robot": "io", "from_s": 20.0, "to_s": 27.0}]
    broken = io["syncs"][-1]
    # Silence was noticed long after the robot had been out of reach.
    assert (broken["outcome"], broken["from_s"], broken["to_s"]) == ("broken off", 26.0, 27.0)
    ages = [(22.0, 1.0), (42.0, 21.0), (42.0, 15.0), (80.0, 53.0)]
    assert [(t, round(age, 1)) for t, age in io["age_s"]] == ages
    assert io["map_share"][-2:] == [[80.0, 2000 / 8000], [81.0, 3000 / 8000]]
    assert io["signal"] == [[20.0, -70.5, "dBm"], [21.0, 47.0, "device"]]
    wishes = [(w["what"], w["by"], w["accepted"]) for w in facts["requests"]]
    assert wishes == [
        ("seek io", "kim", True),
        ("go to 1 m east 2 m north", "a base", False),
        ("go to 3 m east 4 m north", "a base", True),  # the client counts its requests
        ("hold", "kim", True),
        ("home", "the operator", None),
    ]
    assert facts["not_followed"] == [{"t": 40.0, "text": "FlyToNode: it was canceled"}]
    assert facts["battery"][0][1] == pytest.approx(0.95)


def test_a_sync_s_bytes_are_in_each_span_for_as_long_as_it_took():
    fold = LinkFold()
    for direction, size in ((Direction.IN, 1000), (Direction.OUT, 2500)):
        fold.take(0.75, SyncStarted("io", UNIX_S, direction))
        fold.take(3.25, SyncEnded("io", UNIX_S, direction, 1, size, 0.1))
    span_s, coming, going = fold.end(3.5, ()).bandwidth(0.0, 3.5)
    assert span_s == 1.0
    assert coming == pytest.approx([100.0, 400.0, 400.0, 100.0])
    assert going == pytest.approx([250.0, 1000.0, 1000.0, 250.0])


def test_a_history_does_not_change(history):
    with pytest.raises(dataclasses.FrozenInstanceError):
        history.ending = "later"
    with pytest.raises(dataclasses.FrozenInstanceError):
        history.states[0].to_s = 99.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        history.links.names = ()


def test_the_closest_approach_is_where_it_was_closest(history):
    away_m, east_m, north_m = history.closest_at
    assert history.closest == (pytest.approx(4.0, abs=0.01), "new")
    assert away_m == pytest.approx(4.0, abs=0.1)
    assert (east_m, north_m) == (pytest.approx(-90.0, abs=1.0), 0.0)  # south of its middle


def test_a_record_has_how_it_ends(pennovation):
    history = recorded(entries(pennovation), "it was cut off")
    assert history.as_json()["ending"] == "it was cut off"
    early = recorded([e for e in entries(pennovation) if e.t < 50.0])
    assert early.outcome == "the record ends in flight"


def test_a_record_without_a_flight_is_reported(pennovation):
    with pytest.raises(NothingFlownError):
        recorded([])
    with pytest.raises(NothingFlownError):
        recorded(itertools.islice(entries(pennovation), 3))


@pytest.mark.parametrize("armed", [False, True])
def test_a_vehicle_that_reboots_has_a_history_of_the_flight(pennovation, tmp_path, armed):
    """Its clock begins anew; before take-off nothing of the time before counts."""
    with Recorder(tmp_path, "m", unix_s=lambda: 1.7e9) as recorder:
        recorder.begin(FlightSetup(pennovation, ()))
        recorder.event(Telemetry(1000.0, Point(1.0, 2.0), 0.0, armed=armed), 1000.0)
        recorder.event(SyncStarted("io", 1.7e9, Direction.OUT), 1001.0)
        for t in (5.0, 15.0):
            place = Point(t, 2.0)
            recorder.event(Telemetry(t, place, 40.0, armed=True, in_air=True), t)
        recorder.event(SyncEnded("io", 1.7e9, Direction.OUT, 1, 10, 1.0, complete=True), 15.0)
    facts = history_of(Log(recorder.path)).as_json()
    begins_s = 1000.0 if armed else 5.0
    assert facts["from_s"] == begins_s
    if not armed:
        assert (facts["to_s"], facts["duration_s"]) == (15.0, 10.0)
        assert [(stay["from_s"], stay["to_s"]) for stay in facts["states"]] == [(5.0, 15.0)]
