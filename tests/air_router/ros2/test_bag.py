"""A flight's record as a ROS 2 bag, read by a reader of others."""

import io
import math
from collections import defaultdict

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")

from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from air_router.cli.cli import main
from air_router.controller.model.flight_setup import FlightSetup
from air_router.errors import ExitCode, RefusedError
from air_router.gossip.mapper import Mapper
from air_router.record.log import Note, RecordEntry
from air_router.record.recorder import Recorder
from air_router.ros2.bag import ros2_mcap
from air_router.ros2.sampler import POLL_S, SLOW_POLLS
from air_router.vehicle.vehicle import Telemetry
from geo.grid import GridPatch, Terrain
from mocha_link.links.metrics import LinkMetrics

UNIX_S = 1.7e9


@pytest.fixture
def record(pretend):
    """A minute of a flight that paints a map."""
    flight = pretend(duration_s=60.0)
    start_s = flight.now_s
    entries = [
        RecordEntry(0.0, "setup", FlightSetup(flight.mission, ("io",), name="titan-2")),
        RecordEntry(start_s, "note", Note("Clock", {"unix_s": UNIX_S})),
        RecordEntry(start_s, "link", LinkMetrics("io", rssi_dbm=-55.0)),
    ]
    handle = flight.controller.handle

    def recorded(event, now_s):
        entries.append(RecordEntry(now_s, "event", event))
        return handle(event, now_s)

    flight.controller.handle = recorded
    flight.take_off()
    flight.fly_until(lambda: flight.now_s > start_s + 40.0)
    grid = Mapper(flight.mission).grid
    road = np.full((2, 3), Terrain.ROAD, np.uint8)
    patch = GridPatch(grid.west_m, grid.south_m, 1.0, road).encode()
    half = len(entries) // 2
    return [*entries[:half], RecordEntry(entries[half].t, "patch", patch), *entries[half:]]


def read(data):
    """Messages and their Unix times by topic, decoded by the definitions in the file itself."""
    reader, store = make_reader(io.BytesIO(data)), get_typestore(Stores.EMPTY)
    assert reader.get_header().profile == "ros2"
    messages = defaultdict(list)
    for schema, channel, message in reader.iter_messages():
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        types = get_types_from_msg(schema.data.decode(), schema.name)
        store.register({name: of for name, of in types.items() if name not in store.fielddefs})
        decoded = store.deserialize_cdr(message.data, schema.name)
        messages[channel.topic].append((message.log_time / 1e9, decoded))
    return messages


def test_a_ros_program_reads_the_flight_from_the_file_alone(record):
    messages = read(ros2_mcap(record))
    events = [entry for entry in record if entry.kind == "event"]
    telemetry = [entry.value for entry in events if isinstance(entry.value, Telemetry)]
    poses = messages["/titan_2/pose"]
    took_s = events[-1].t - events[0].t
    assert len(poses) == pytest.approx(took_s / POLL_S, abs=2)
    at_s, last = poses[-1]
    assert at_s - UNIX_S == pytest.approx(took_s, abs=POLL_S)
    place = last.pose.position
    assert (place.x, place.y) == pytest.approx(telemetry[-1].position, abs=3.0)
    assert place.z == pytest.approx(telemetry[-1].altitude_m, abs=1.0)
    assert last.header.frame_id == "map"
    states = [message.data for _, message in messages["/titan_2/state"]]
    assert states[-1] == "INIT"  # its first exploration
    ((_, areas),) = messages["/titan_2/areas"]
    assert {"graph", "waypoints"} <= {marker.ns for marker in areas.markers}
    grid = messages["/titan_2/map"][-1][1]
    assert (np.asarray(grid.data) >= 0).sum() == 6
    assert len(messages["/diagnostics"]) == pytest.approx(took_s / (POLL_S * SLOW_POLLS), abs=2)
    assert math.isnan(messages["/titan_2/fix"][-1][1].altitude)


def test_a_record_without_a_flight_is_refused():
    with pytest.raises(RefusedError, match="no flight"):
        ros2_mcap([])


def test_a_record_without_the_time_begins_at_0(record):
    without = [entry for entry in record if entry.kind != "note"]
    (first_s, _), *_ = read(ros2_mcap(without))["/titan_2/pose"]
    assert first_s == pytest.approx(record[0].t, abs=200.0)


def test_the_command_writes_it(tmp_path, record, pennovation):
    with Recorder(tmp_path, "mission.yaml", unix_s=lambda: UNIX_S) as recorder:
        recorder.begin(record[0].value)
        for entry in record:
            if entry.kind == "event":
                recorder.event(entry.value, entry.t)
    assert main(["ros2", "--bag", str(recorder.path)]) == ExitCode.DONE
    (target,) = tmp_path.glob("*.ros2.mcap")
    assert target.stem == f"{recorder.path.stem}.ros2"
    assert len(read(target.read_bytes())["/titan_2/pose"]) > 100
