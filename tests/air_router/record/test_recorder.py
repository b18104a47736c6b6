"""What a flight leaves behind, also when its program or its disk does not last."""

import contextlib
import dataclasses
import importlib.util
import json
import math
import os
import re
import signal
import struct
import subprocess
import sys
import threading
from pathlib import Path

import jsonschema
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from air_router.controller import Controller, FlightStatus
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.requests import ComeHome
from air_router.errors import UsageError
from air_router.record import record_file
from air_router.record.log import Log, LogError
from air_router.record.recorder import Recorder
from air_router.record.recording import default_folder
from air_router.record.serialization import json_schema
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point
from geo.grid import GridPatch
from tests.air_router.record.conftest import DRAWN, LINK, UNIX_S

ROOT = Path(__file__).parents[3]


def telemetry(t, east_m=1.0):
    return Telemetry(t, Point(east_m, 2.0), 40.0, mode=FlightMode.MISSION)


@pytest.fixture
def flown(record, tmp_path):
    """A record of its own for each test."""
    path = tmp_path / record.name
    path.write_bytes(record.read_bytes())
    return path


def test_everything_comes_back_in_its_order_and_in_every_bit(flown, pennovation):
    entries = list(Log(flown))
    clocks = [entry for entry in entries if entry.value == ("Clock", {"unix_s": UNIX_S})]
    assert [entry.t for entry in clocks] == [1.0, 11.0, 21.0]
    others = [entry for entry in entries if entry not in clocks]
    assert [entry.kind for entry in others] == [
        *("about", "setup", "note", "file"), *["event"] * 22, *("action", "action", "event"),
        *("action", "link", "note", "patch", "note", "note", "note"),
    ]  # fmt: skip
    about, setup, options, file, first = others[:5]
    assert about.value["mission"] == "mission.yaml"
    assert about.value["numpy"]
    assert setup.value.mission.waypoints == pennovation.waypoints
    assert (setup.value.seek, setup.value.name) == (("io",), "titan")
    assert options.value == ("Options", {"arm": True})
    assert file.value == (pennovation.path.name, pennovation.path.read_bytes())
    assert first.value == dataclasses.replace(telemetry(1.0), battery=0.75)
    home, _, link, held, patch, published, grown, report = others[28:]
    assert (home.t, home.value) == (22.1 + 0.2, ComeHome())
    assert link.value == LINK
    assert held.value.fields == {"peer": "io", "held": (("titan", "/map", 8.5),)}
    assert GridPatch.decode(patch.value).cells.shape == (2, 3)
    assert published.value == ("MapPublished", {"known_cells": 6})
    assert grown.value == ("Map", {"known_cells": 6})
    assert report.value.fields == {"outcome": "done", "distance_m": None}


def test_the_public_reader_opens_it_and_viewers_understand_its_schemas(flown):
    with flown.open("rb") as file:
        reader = make_reader(file)
        messages = {}
        for schema, channel, message in reader.iter_messages():
            messages.setdefault(channel.topic, (schema, message))
        names = [attachment.name for attachment in reader.iter_attachments()]
    assert names == ["mission.yaml"]
    drawn = {topic for topic, (schema, _) in messages.items() if schema.encoding == "protobuf"}
    assert drawn == {*DRAWN} or importlib.util.find_spec("foxglove") is None
    for topic, (schema, message) in messages.items():
        if topic in drawn:
            continue
        assert schema.encoding == "jsonschema"
        assert not re.search(rb'"(oneOf|anyOf|prefixItems)"|"type": \[', schema.data)
        properties = json.loads(schema.data)["properties"]
        fields = json.loads(message.data).keys()
        assert fields >= properties.keys() if "/flight/" in topic else fields <= properties.keys()


def test_a_vehicle_whose_clock_is_behind_ours_has_its_times_in_their_distances(tmp_path):
    """The record begins before the vehicle is received: viewers go by the log time of messages."""
    unix_s = iter([UNIX_S, UNIX_S - 86_400.0])
    with Recorder(tmp_path, "m", unix_s=lambda: next(unix_s, UNIX_S - 86_400.0)) as recorder:
        recorder.note("Setup", 0.0, {})
        for t in (5.0, 6.0, 9.0):
            recorder.event(ComeHome(), t)
    with recorder.path.open("rb") as file:
        messages = [(c.topic, m.log_time / 1e9) for _, c, m in make_reader(file).iter_messages()]
    times = [t - UNIX_S for topic, t in messages if topic == "/event/ComeHome"]
    assert times == pytest.approx([0.0, 1.0, 4.0], abs=1e-3)


@pytest.mark.parametrize("unix_s", [1.8e13, -5.0])
def test_a_vehicle_with_an_impossible_date_is_recorded(tmp_path, pennovation, unix_s):
    """A message's time in the file has 64 bits: what went beyond ended the record."""
    reported = []
    with Recorder(tmp_path, "m", unix_s=lambda: unix_s, trouble=reported.append) as recorder:
        recorder.begin(FlightSetup(pennovation, ()))
        recorder.file(pennovation.path)
        recorder.event(ComeHome(), 5.0)
    assert [entry.value for entry in Log(recorder.path) if entry.kind == "event"] == [ComeHome()]
    assert not reported


def test_after_a_reboot_of_the_vehicle_times_go_on(tmp_path):
    with Recorder(tmp_path, "m", unix_s=lambda: UNIX_S) as recorder:
        for t in (1000.0, 1005.0, 3.0, 7.0):
            recorder.event(ComeHome(), t)
    with recorder.path.open("rb") as file:
        messages = [(c.topic, m.log_time / 1e9) for _, c, m in make_reader(file).iter_messages()]
    times = [t - UNIX_S for topic, t in messages if topic == "/event/ComeHome"]
    assert times == pytest.approx([0.0, 5.0, 5.0, 9.0], abs=1e-3)
    notes = [entry.t for entry in Log(recorder.path) if entry.kind == "note"]
    assert notes == [1000.0, 3.0]  # what is noted now and then


def test_the_status_is_recorded_once_a_second_by_its_schema(tmp_path, pennovation):
    controller = Controller(FlightSetup(pennovation, ("io",)))
    with Recorder(tmp_path, "m.yaml", unix_s=lambda: UNIX_S) as recorder:
        for tenth in range(25):
            now = telemetry(1.0 + tenth / 10)
            recorder.event(now, now.time_s)
            recorder.actions(controller.handle(now, now.time_s), now.time_s)
            recorder.status(controller.status, now.time_s)
    with recorder.path.open("rb") as file:
        written = [
            (schema.name, json.loads(schema.data), json.loads(message.data))
            for schema, _, message in make_reader(file).iter_messages(topics=["/status"])
        ]
    assert [status["t"] for _, _, status in written] == pytest.approx([1.0, 2.0, 3.0])
    published = json_schema("Flight status", FlightStatus)
    for name, schema, status in written:
        assert name == "air_router.FlightStatus"
        assert schema["properties"].keys() == status.keys()
        jsonschema.validate({key: status[key] for key in status if key != "t"}, published)
    assert written[-1][2]["state"] == controller.state.name
    assert [entry.kind for entry in Log(recorder.path)].count("event") == 25  # a replay ignores it


def test_two_flights_in_one_second_have_two_files(tmp_path):
    with Recorder(tmp_path, "m") as first, Recorder(tmp_path, "m") as second:
        assert first.path != second.path
        for recorder in (first, second):
            recorder.event(ComeHome(), 0.0)
    assert len(list(tmp_path.glob("flight-*.mcap"))) == 2


def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch, pennovation):
    monkeypatch.chdir(tmp_path)
    with Recorder(None, "m") as recorder:
        recorder.begin(FlightSetup(pennovation))
        recorder.file(pennovation.path)
        recorder.event(ComeHome(), 0.0)
        recorder.links(dict, dict, 0.0)
        assert recorder.path is None
    assert list(tmp_path.iterdir()) == []


def test_a_flight_that_never_began_leaves_nothing(tmp_path, pennovation):
    with Recorder(tmp_path, "m") as recorder:
        recorder.begin(FlightSetup(pennovation))
    assert recorder.path is None
    assert list(tmp_path.iterdir()) == []
    with Recorder(tmp_path, "m") as recorder:
        recorder.note("Preflight", 1.0, {"ready": False})  # why it was refused is worth keeping
    assert recorder.path.exists()


def test_a_folder_that_cannot_be_used_is_reported_once_and_the_flight_goes_on(tmp_path):
    (tmp_path / "file").write_text("")
    reported = []
    with Recorder(tmp_path / "file" / "logs", "m", trouble=reported.append, must=False) as recorder:
        recorder.event(ComeHome(), 0.0)
    assert reported == [f"{tmp_path}/file/logs: Not a directory; the flight is not recorded"]


def disk_of(monkeypatch, room):
    """A disk with room for `room["bytes"]`, which may change."""

    def append(sink, data):
        fits = max(0, room["bytes"] - sink._on_disk)
        sink._file.write(data[:fits])
        if fits < len(data):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(record_file._Sink, "_append", append)
    monkeypatch.setattr(record_file, "FLUSH_S", 0.0)


@pytest.mark.parametrize("room", [0, 8_000])
def test_a_disk_that_stays_full_keeps_what_was_whole(tmp_path, monkeypatch, room):
    disk_of(monkeypatch, {"bytes": room})
    reported = []
    with Recorder(tmp_path, "m", trouble=reported.append) as recorder:
        for step in range(400):
            recorder.event(telemetry(step, math.sqrt(step)), float(step))
    assert [text.partition(": ")[2] for text in reported] == [
        "No space left on device; the record waits in memory: make room on the disk",
        "the disk takes nothing; nothing more is recorded, the flight goes on",
    ]
    log = Log(recorder.path)
    if room:
        times = [entry.t for entry in log if entry.kind == "event"]
        assert times == [float(step) for step in range(len(times))]
        assert 5 < len(times) < 400
        assert log.ending.startswith("it was cut off")
    else:
        with pytest.raises(LogError, match="not an MCAP file"):
            list(log)


def test_a_disk_with_room_again_gets_what_happened_meanwhile(tmp_path, monkeypatch):
    room = {"bytes": 3_000}
    disk_of(monkeypatch, room)
    reported, full = [], threading.Event()

    def trouble(text):
        reported.append(text)
        full.set()

    with Recorder(tmp_path, "m", trouble=trouble) as recorder:
        for step in range(100):
            recorder.event(telemetry(step, math.sqrt(step)), float(step))
        assert full.wait(60)
        room["bytes"] = 10**9
        for step in range(100, 200):
            recorder.event(telemetry(step, math.sqrt(step)), float(step))
    assert [text.partition("; ")[2] for text in reported] == [
        "the record waits in memory: make room on the disk",
        "nothing of the record is lost",
    ]
    log = Log(recorder.path)
    assert [e.t for e in log if e.kind == "event"] == [float(step) for step in range(200)]
    assert log.ending is None


def test_a_disk_that_stands_still_is_given_up_before_memory_is_full(tmp_path, monkeypatch):
    going, write = threading.Event(), record_file._Sink.write
    monkeypatch.setattr(
        record_file._Sink, "write", lambda sink, data: going.wait(60) and write(sink, data)
    )
    monkeypatch.setattr(record_file, "MOST_WAITING", 50_000)
    reported = []
    with Recorder(tmp_path, "m", trouble=reported.append) as recorder:
        steps = 0
        while not reported and steps < 5000:
            recorder.event(telemetry(float(steps)), float(steps))
            steps += 1
        recorder.event(telemetry(9999.0), 9999.0)
        going.set()
    assert [text.partition(": ")[2] for text in reported] == [
        "the disk is too slow; nothing more is recorded, the flight goes on"
    ]
    assert 50 < steps < 500


def test_an_event_that_cannot_be_written_is_a_note_and_no_error(tmp_path, caplog):
    with Recorder(tmp_path, "m") as recorder:
        recorder.event("text", 1.0)
        recorder.event("text", 2.0)
    assert len(caplog.records) == 1
    notes = [e.value for e in Log(recorder.path) if e.kind == "note"]
    assert [note.fields for note in notes if note.name == "Unwritable"] == [
        {"kind": "event", "value": "'text'"}
    ] * 2


KILLED = """
import sys
import time
from pathlib import Path
from air_router.record.recorder import Recorder
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point
recorder = Recorder(Path(sys.argv[1]), "m")
step = 0
while True:
    step += 1
    recorder.event(Telemetry(float(step), Point(0.0, 0.0), 1.0), float(step))
    print(step, flush=True)  # waits when the pipe has no reader
    time.sleep(0.002)
"""


def test_kill_9_costs_the_last_second_at_most(tmp_path):
    """A real process, killed while it writes: what it recorded a while ago is on the disk."""
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    with process:
        while int(process.stdout.readline()) < 100:
            pass
        (path,) = tmp_path.iterdir()
        while not any(e.kind == "event" and e.value.time_s == 100 for e in Log(path)):
            process.stdout.readline()  # it goes on, and puts on the disk what is a second old
        process.send_signal(signal.SIGKILL)
    log = Log(path)
    events = [entry.value for entry in log if entry.kind == "event"]
    assert log.ending.startswith("it was cut off")
    assert 100 <= len(events) == int(events[-1].time_s)
    assert record_file.FLUSH_S <= 1.0
    with path.open("rb") as file:  # the public reader, up to its end
        found = []
        with contextlib.suppress(EndOfFile, struct.error):
            found.extend(StreamReader(file).records)
    assert sum(isinstance(record, Message) for record in found) > len(events)


def mcap(path, *messages, ours=None, topic="/event/x"):
    """A file with messages in JSON; `ours`: the metadata with which a record of a flight begins."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        if ours is not None:
            writer.add_metadata(record_file.LIBRARY, ours)
        schema = writer.register_schema("x", "jsonschema", b"{}")
        channel = writer.register_channel(topic, "json", schema)
        for message in messages:
            writer.add_message(channel, 1, message, 1)
        writer.finish()
    return path


def test_a_file_that_is_no_record_is_reported(tmp_path, flown):
    path = tmp_path / "a.mcap"
    for data, message in (
        (b"", "not an MCAP file"),
        (b"\x89PNG\r\n\x1a\n" * 100, "not an MCAP file"),
        (flown.read_bytes()[:60], "it was cut off"),
    ):
        path.write_bytes(data)
        with pytest.raises(LogError, match=message):
            list(Log(path))
    for messages in ([], [b"5"], [b"{}"], [b"\x08\x96\x01"], [b"[" * 9_999]):
        with pytest.raises(LogError, match="an MCAP file, but not a flight's record"):
            list(Log(mcap(path, *messages)))


@pytest.mark.parametrize(
    ("topic", "message", "why"),
    [
        ("/event/x", b"[" * 9_999, "recursion"),
        ("/event/x", b'{"type": "Landed"}', "a message without 't'"),
        ("/event/x", b'{"t": "Infinity", "type": "GoOn"}', "'Infinity' is not a time"),
        ("/event/x", b'{"t": 1, "type": "Landed"}', "its type is not allowed here"),
        ("/links", b'{"t": 1}', "its type is not allowed here"),
        ("/links", b'{"t": 1, "type": "LandHere"}', "is no LinkMetrics"),
        ("/flight/Setup", b'{"t": 1, "type": "Setup", "setup": null}', "its type is not allowed"),
        ("/patches", b'{"t": 1, "patch": 5}', ""),
        ("/flight/Map", b'{"t": 1, "type": "Map"}', "a message without 'known_cells'"),
        (
            "/flight/Map",
            b'{"t": 1, "type": "Map", "known_cells": 1e999}',
            "valid integer",
        ),
        (
            "/flight/Held",
            b'{"t": 1, "type": "Held", "peer": "io", "held": [["a"]]}',
            "Field required",
        ),
    ],
)
def test_what_a_record_cannot_contain_is_reported(tmp_path, topic, message, why):
    path = mcap(tmp_path / "a.mcap", message, ours={"format": record_file.FORMAT}, topic=topic)
    with pytest.raises(LogError, match=f"not written by this version of air_router: .*{why}"):
        list(Log(path))


@pytest.mark.parametrize("version", ["1", "3", ""])
def test_a_record_of_another_version_is_one_clear_error(tmp_path, version):
    facts = {"format": version, "air-router": "0.9"}
    path = mcap(tmp_path / "a.mcap", b'{"t": 1, "type": "GoOn"}', ours=facts)
    with pytest.raises(LogError) as caught:
        list(Log(path))
    assert str(caught.value) == (
        f"{path}: a record of version {version}, and this program reads version 2; "
        "open it with the air-router that wrote it, 0.9"
    )


def test_damage_anywhere_ends_the_record_there_and_is_reported(flown):
    """Also where it makes the reader pass over a whole part of the file: a record's first byte."""
    with flown.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    good, data = len(list(Log(flown))), flown.read_bytes()
    shorter = 0
    places = [*range(8, len(data), len(data) // 40), *(c.chunk_start_offset for c in chunks)]
    for place in places:
        flown.write_bytes(data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :])
        log = Log(flown)
        try:
            found = len(list(log))
        except LogError:
            continue
        shorter += found < good
        assert found == good or log.ending is not None
    assert shorter > len(chunks)


def test_a_user_without_a_home_gets_an_error_with_the_option(monkeypatch):
    """As in a container that runs as a number."""

    def none():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", none)
    with pytest.raises(UsageError, match="set HOME, or pass --log-dir D"):
        default_folder()


def test_records_go_below_the_users_state(monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", "/somewhere")
    assert default_folder() == Path("/somewhere/air-router/flights")
    monkeypatch.setenv("XDG_STATE_HOME", "relative")
    monkeypatch.setenv("HOME", "/home/kim")
    assert default_folder() == Path("/home/kim/.local/state/air-router/flights")
