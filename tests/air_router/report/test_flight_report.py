"""A record becomes a page and a JSON object that say what happened, and nothing else."""

import dataclasses
import html.parser
import itertools
import json
import math
import re
import xml.etree.ElementTree as ET

import pytest

from air_router.cli.cli import main
from air_router.controller.model.actions import (
    Announce,
    CommandAck,
    Finish,
    FlyToNode,
    MissionWaits,
    Refusal,
    Seeking,
    StateChanged,
)
from air_router.controller.model.events import (
    AirspaceChanged,
    CommandFailed,
    PlanRenewed,
    RobotPose,
)
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.requests import ComeHome, GoTo, HoldNow, SeekNow
from air_router.controller.model.states import Signal, State
from air_router.record.log import Log, Note, RecordEntry
from air_router.record.recorder import Recorder
from air_router.report.charts import figures
from air_router.report.exchanges import Exchanges
from air_router.report.flight_page import page_of
from air_router.report.flight_summary import NothingFlownError, summary_of
from air_router.report.svg import WIDE, Plot, clock, nice, number, thinned
from air_router.report.track import track_figure
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from mocha_link.links.metrics import (
    ContactBegan,
    ContactEnded,
    Direction,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.links.reading import Reading, Unit
from mocha_link.store.wire import Header

UNIX_S = 1_700_000_000.0
MAP_S = UNIX_S + 31.0
HOSTILE = "<script>alert('io')</script>"


def along(t):
    """A flight to the west at 5 m/s, in the air from 10 to 70 s."""
    place = Point(-2.0 * max(0.0, min(t, 70.0) - 10.0), 0.0)
    return Telemetry(
        t, place, 40.0, armed=5 <= t < 72, in_air=10 <= t < 70, mode=FlightMode.MISSION,
        battery=1.0 - t / 200,
    )  # fmt: skip


def stored(t, robot, age_s, peer=None, topic="/pose"):
    stamp_ms = round((UNIX_S + t - age_s) * 1000)
    header = Header.at(1, 0, stamp_ms)
    return t, MessageStored(peer or robot, UNIX_S + t, robot, topic, header, 100)


def things(robot="io"):
    """What happens in it, in order."""
    told = [(float(t), along(float(t))) for t in range(81)]
    told += [
        (10.0, StateChanged(State.READY, Signal.AIRBORNE, State.INIT, None)),
        (20.0, RssiChanged(robot, UNIX_S + 20, -70.5)),
        (20.0, ContactBegan(robot, UNIX_S + 20, None)),
        (21.0, RssiChanged(robot, UNIX_S + 21, None, Reading(47.0, Unit.DEVICE, "rajant"))),
        (21.0, SyncStarted(robot, UNIX_S + 21, Direction.IN)),
        stored(22.0, robot, 1.0),
        (23.0, SyncEnded(robot, UNIX_S + 23, Direction.IN, 3, 4000, 0.1)),
        (24.0, SyncStarted(robot, UNIX_S + 24, Direction.OUT)),
        (25.0, SyncEnded(robot, UNIX_S + 25, Direction.OUT, 1, 90_000, 0.1)),
        (26.0, SyncStarted(robot, UNIX_S + 26, Direction.OUT)),
        (27.0, ContactEnded(robot, UNIX_S + 27, 7.0, "too weak")),
        (28.0, RobotPose(robot, Point(-10.0, 30.0), UNIX_S + 21, robot)),
        (30.0, StateChanged(State.INIT, Signal.TIMER, State.SEARCH, None)),
        (30.0, Announce(f"SEARCH {robot}: where its path ends")),
        (30.0, Seeking(robot)),
        (32.0, SeekNow(robot=robot, request_id="a", by="kim")),
        (32.0, CommandAck("a", "kim", accepted=True, why="seeking")),
        (33.0, GoTo(points=(Point(1.0, 2.0),), request_id="b", by="a base")),
        (33.0, CommandAck("b", "a base", accepted=False, why="in a zone", code=Refusal.NO_WAY)),
        (34.0, GoTo(points=(Point(3.0, 4.0),), request_id="1", by="a base", waits=True)),
        (35.0, HoldNow(request_id="1", by="kim")),
        (35.0, CommandAck("1", "kim", accepted=True, why="it stops")),
        (36.0, CommandAck("1", "a base", accepted=True, why="it flies")),
        (36.0, MissionWaits("INPUT_MISSING", "GPS has no fix", 36.0)),
        (38.5, MissionWaits("ZONE_UPDATE", "zones are being changed", 38.5)),
        (39.0, MissionWaits(None)),
        (79.0, MissionWaits("INPUT_MISSING", "GPS has no fix", 78.0)),
        (40.0, CommandFailed(FlyToNode(3, Point(0.0, 0.0)), "it was called off")),
        stored(42.0, robot, 15.0, peer="europa"),
        stored(21.0, "titan", 0.0, topic="/map"),
        stored(31.0, "titan", 0.0, topic="/map"),
        stored(41.0, "titan", 0.0, topic="/map"),
        (50.0, SyncTimedOut(robot, UNIX_S + 50, Direction.OUT, "silence")),
        (14.0, AirspaceChanged((), (Zone("new", Circle(Point(-90.0, 9.0), 5.0)),))),
        (14.0, PlanRenewed()),
        (55.0, ComeHome()),
        (60.0, StateChanged(State.SEARCH, Signal.COME_HOME, State.HOME, robot)),
        (70.0, Finish(landed_by_us=True, why="landed")),
    ]
    return sorted(told, key=lambda pair: pair[0])


def entries(mission, robot="io"):
    yield RecordEntry(0.0, "about", {"format": "1", "python": "3.11"})
    yield RecordEntry(0.0, "setup", FlightSetup(mission, (robot, "phantom"), name="titan"))
    yield RecordEntry(0.0, "note", Note("Vehicle", {"autopilot": "PX4", "version": "1.17.0"}))
    yield RecordEntry(0.0, "note", Note("Clock", {"unix_s": UNIX_S}))
    for t, value in things(robot):
        kind = (
            "action" if type(value).__module__ == "air_router.controller.model.actions" else "event"
        )
        yield RecordEntry(t, kind, value)
        if isinstance(value, Telemetry) and t > 12:
            if t % 10 == 0:
                yield RecordEntry(t, "note", Note("MapPublished", {"known_cells": int(100 * t)}))
            yield RecordEntry(t, "note", Note("Map", {"known_cells": int(100 * t)}))
    # It says that it has the second version, which another robot handed to it.
    yield RecordEntry(
        81.0, "note", Note("Held", {"peer": robot, "held": [["titan", "/map", MAP_S]]})
    )
    yield RecordEntry(81.0, "note", Note("Map", {"known_cells": 8000}))
    yield RecordEntry(
        80.0, "note", Note("Report", {"outcome": "done", "robots": {robot: {"found": 1}}})
    )


@pytest.fixture
def summary(pennovation):
    told = summary_of(entries(pennovation))
    told.end(None)
    return told


def test_the_facts(summary):
    facts = json.loads(json.dumps(summary.as_json(), allow_nan=False))
    assert (facts["mission"], facts["uav"], facts["outcome"]) == ("Pennovation", "titan", "done")
    assert facts["began_unix_s"] == UNIX_S
    assert facts["distance_m"] == pytest.approx(120.0, abs=3.0)
    assert facts["duration_s"] == 75.0  # from arming
    # Up to 14 s among the mission's zones, which it passes well; from then on among one other.
    assert (facts["closest_approach_m"], facts["closest_approach_to"]) == (4.0, "new")
    assert summary.mission.zones[0].name == "new"
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
    assert list(facts["robots"]) == ["io", "phantom"]  # our own news have no age
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
        ("go to 3 m east 4 m north", "a base", True),  # who asks counts the requests
        ("hold", "kim", True),
        ("home", "the operator", None),
    ]
    assert facts["not_followed"] == [{"t": 40.0, "text": "FlyToNode: it was called off"}]
    assert facts["battery"][0][1] == pytest.approx(0.95)


def test_a_sync_s_bytes_are_in_each_span_for_as_long_as_it_took():
    exchanges = Exchanges()
    for direction, size in ((Direction.IN, 1000), (Direction.OUT, 2500)):
        exchanges.take(0.75, SyncStarted("io", UNIX_S, direction))
        exchanges.take(3.25, SyncEnded("io", UNIX_S, direction, 1, size, 0.1))
    span_s, coming, going = exchanges.bandwidth(0.0, 3.5)
    assert span_s == 1.0
    assert coming == pytest.approx([100.0, 400.0, 400.0, 100.0])
    assert going == pytest.approx([250.0, 1000.0, 1000.0, 250.0])


class Page(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.tags, self.links = [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for name, value in attributes if name in {"src", "href", "action"}]


def test_the_page_needs_nothing_and_believes_nothing(pennovation):
    told = summary_of(entries(pennovation, HOSTILE))
    told.end("it was cut off")
    text = page_of(told, "a.mcap")
    page = Page(text)
    assert "script" not in page.tags
    assert page.links == []
    assert "url(" not in text
    assert "The record is incomplete: it was cut off." in text
    pictures = re.findall(r"<svg.*?</svg>", text, re.DOTALL)
    assert len(pictures) == 2 * 7
    for picture in pictures:
        assert "nan" not in picture
        assert "inf" not in re.sub(r"<title>.*?</title>|aria-label=\"[^\"]*\"", "", picture)
        ET.fromstring(picture)  # noqa: S314 - our own
    for heading in ("Track", "States, contacts and syncs", "Bandwidth", "Age of information"):
        assert f"<h2>{heading}" in text
    assert "refused: in a zone" in text


@pytest.mark.parametrize(
    ("away_m", "top_m"), [([7.0, 45.0], 45.0), ([7.0, 90.0], 60.0), ([95.0, 120.0], 120.0)]
)
def test_distances_are_drawn_as_they_are(summary, away_m, top_m):
    summary.distances = list(enumerate(away_m))
    (graph,) = (figure for figure in figures(summary) if figure.name == "distance")
    (line,) = re.findall(r'class="line own" d="M[\d.]+ ([\d.]+)L[\d.]+ ([\d.]+)', graph.pictures)[
        :1
    ]
    plot = Plot(WIDE, 180, 0.0, 1.0, top_m)
    assert [float(y) for y in line] == pytest.approx([plot.y(m) for m in away_m], abs=0.1)
    assert ("upper border" in graph.words) == (max(away_m) > top_m)


def test_the_legend_names_what_is_there(summary, pennovation):
    begun = itertools.islice(entries(dataclasses.replace(pennovation, zones=())), 5)
    for told, named in ((summary, "zonekey"), (summary_of([*begun]), "fencekey")):
        assert {css for css, _ in track_figure(told).legend} & {"zonekey", "fencekey"} == {named}


def test_a_record_without_a_flight_is_told(pennovation):
    with pytest.raises(NothingFlownError):
        summary_of([]).end(None)
    with pytest.raises(NothingFlownError):
        summary_of(itertools.islice(entries(pennovation), 3)).end(None)


def test_a_flight_of_one_moment_has_a_page(pennovation):
    told = summary_of([*itertools.islice(entries(pennovation), 5)])
    told.end("it was cut off")
    assert "<svg" in page_of(told, "a.mcap")


@pytest.fixture
def record(pennovation, tmp_path):
    with Recorder(tmp_path, "m", unix_s=lambda: UNIX_S) as recorder:
        recorder.begin(FlightSetup(pennovation, ("io",), name="titan"))
        for t, value in things():
            if type(value).__module__.endswith("actions"):
                recorder.actions((value,), t)
            else:
                recorder.event(value, t)
    return recorder.path


def test_the_command_writes_a_page_beside_the_record(record, capsys):
    assert main(["report", str(record)]) == 0
    page = record.with_suffix(".html")
    assert capsys.readouterr().err == f"the report: {page}\n"
    assert page.read_text("utf-8").startswith("<!doctype html>")
    page.unlink()
    before = record.read_bytes()
    assert main(["report", str(record), "-o", str(record)]) == 2
    assert "is the record itself" in capsys.readouterr().err
    assert record.read_bytes() == before
    assert main(["report", str(record), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["uav"] == "titan"
    assert not page.exists()


@pytest.mark.parametrize("armed", [False, True])
def test_a_vehicle_that_reboots_has_a_report_of_the_flight(pennovation, tmp_path, armed):
    """Its clock begins anew; before take-off nothing of the time before counts."""
    with Recorder(tmp_path, "m", unix_s=lambda: 1.7e9) as recorder:
        recorder.begin(FlightSetup(pennovation, ()))
        recorder.event(Telemetry(1000.0, Point(1.0, 2.0), 0.0, armed=armed), 1000.0)
        recorder.event(SyncStarted("io", 1.7e9, Direction.OUT), 1001.0)
        for t in (5.0, 15.0):
            place = Point(t, 2.0)
            recorder.event(Telemetry(t, place, 40.0, armed=True, in_air=True), t)
        recorder.event(SyncEnded("io", 1.7e9, Direction.OUT, 1, 10, 1.0, complete=True), 15.0)
    summary = summary_of(Log(recorder.path))
    summary.end(None)
    assert page_of(summary, "x").startswith("<!doctype html>")
    facts = summary.as_json()
    if not armed:
        assert (facts["from_s"], facts["to_s"], facts["duration_s"]) == (5.0, 15.0, 10.0)
        assert [(stay["from_s"], stay["to_s"]) for stay in facts["states"]] == [(5.0, 15.0)]


def test_a_record_with_any_name_has_a_page(record, tmp_path):
    odd = tmp_path / "b\udcff.mcap"  # bytes that are no UTF-8
    odd.write_bytes(record.read_bytes())
    assert main(["report", str(odd)]) == 0
    assert "Made from b?.mcap." in odd.with_suffix(".html").read_text("utf-8")


def test_numbers_on_axes():
    assert nice(0.0, 100.0) == [0, 20, 40, 60, 80, 100]
    assert nice(0.0, 0.0) == [0.0]
    assert nice(0.0, math.inf) == [0.0]
    assert [number(v) for v in (0.2, 47_322, 2e6, 1200)] == ["0.2", "47.3k", "2M", "1200"]
    for span_s in (0.0, 61.0, 2e5, 1e9):
        plot = Plot(WIDE, 100, 0.0, span_s)
        plot.times()
        assert 1 <= plot.svg("").count('class="tick"') <= 13
    assert [clock(s) for s in (0, 65, 3_725)] == ["0:00", "1:05", "1:02:05"]
    series = [(float(i), math.sin(i)) for i in range(10_000)]
    few = thinned(series, 100)
    assert len(few) <= 400
    assert max(v for _, v in few) == max(v for _, v in series)
