import json
import math

import pytest

from air_router.actions import FlyToNode, StateChanged
from air_router.behaviour import Signal, State
from air_router.events import Request
from air_router.recorder import Recorder, fields_of
from air_router.vehicle import FlightMode, Telemetry
from geo.frame import Point
from mocha_link.metrics import Direction, SyncStarted


def lines(path):
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_events_and_decisions_become_lines(tmp_path):
    with Recorder(tmp_path / "logs", "mission.yaml") as recorder:
        recorder.event(Telemetry(1.5, Point(1.0, 2.0), 40.0, mode=FlightMode.MISSION), 1.5)
        recorder.event(SyncStarted("io", 9.0, Direction.OUT), 1.6)
        recorder.event(Request.COME_HOME, 1.7)
        recorder.action(StateChanged(State.INIT, Signal.COME_HOME, State.HOME, None), 1.7)
        recorder.action(FlyToNode(3, Point(math.nan, 2.0)), 1.8)
        written = lines(recorder.path)  # readable while the flight goes on
    assert [line["kind"] for line in written] == ["flight"] + ["event"] * 3 + ["action"] * 2
    assert written[1]["position"] == [1.0, 2.0]
    assert written[1]["mode"] == "MISSION"
    assert written[2]["direction"] == "OUT"
    assert written[3] == {"t": 1.7, "kind": "event", "type": "Request", "name": "COME_HOME"}
    assert written[4]["target"] == "HOME"
    assert written[5]["position"] == [None, 2.0]


def test_two_flights_in_one_second_have_two_files(tmp_path):
    with Recorder(tmp_path, "m") as first, Recorder(tmp_path, "m") as second:
        assert first.path != second.path
    assert len(list(tmp_path.glob("flight-*.jsonl"))) == 2


def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Recorder(None, "m") as recorder:
        recorder.event(Request.COME_HOME, 0.0)
        assert recorder.path is None
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_event_is_refused():
    with pytest.raises(TypeError, match="cannot be recorded"):
        fields_of("text")
