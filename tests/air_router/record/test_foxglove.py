"""A record and a flight in Foxglove's own schemas, read back with the public libraries."""

import asyncio
import importlib
import json
import re
import struct
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.reader import make_reader
from mcap.records import Schema

from air_router.cli.cli import main
from air_router.controller.model.actions import Announce
from air_router.errors import ExitCode, RefusedError
from air_router.record.recorder import Recorder
from air_router.vehicle.instructions import BE_READY, Severity
from geo.frame import Point
from tests.air_router.record.conftest import DRAWN, UNIX_S, fly

pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")
aiohttp = pytest.importorskip("aiohttp")
decoder = pytest.importorskip("mcap_protobuf.decoder")

LAYOUT = Path(__file__).parents[3] / "docs" / "foxglove-layout.json"


def messages_of(path):
    """Of each topic: the schema's name, and its messages as a public reader decodes them."""
    found = {}
    with path.open("rb") as file:
        reader = make_reader(file)
        for schema, channel, message in reader.iter_messages():
            decode = decoder.DecoderFactory().decoder_for(channel.message_encoding, schema)
            content = (decode or json.loads)(message.data)
            found.setdefault(channel.topic, (schema.name, []))[1].append((message, content))
    return found


@pytest.fixture(scope="module")
def found(record, tmp_path_factory):
    """The record in Foxglove's schemas."""
    target = tmp_path_factory.mktemp("foxglove") / "shown.mcap"
    assert main(["convert", str(record), str(target)]) == ExitCode.DONE
    return messages_of(target)


def test_a_record_in_foxglove_s_schemas_has_what_was_flown(found, pennovation):
    drawn = {topic: name for topic, (name, _) in found.items() if name.startswith("foxglove.")}
    assert drawn == DRAWN
    message, fix = found["/vehicle/location"][1][0]
    assert message.log_time == fix.timestamp.seconds * 10**9
    where = pennovation.frame.to_geodetic(Point(1.0, 2.0))
    assert (fix.latitude, fix.longitude) == pytest.approx(where)
    assert len(found["/vehicle/location"][1]) == 20
    fix = found["/robots/io/location"][1][0][1]
    assert (fix.latitude, fix.longitude) == pytest.approx(
        pennovation.frame.to_geodetic(Point(5, 6))
    )
    assert [entry.message for _, entry in found["/log"][1]] == ["READY -> INIT", "coming home"]
    grid = found["/map"][1][0][1]
    assert len(grid.data) == grid.column_count * (len(grid.data) // grid.column_count)
    assert set(grid.data) == {0, 1}
    signal = found["/links"][1][0][1]["signal"]
    assert (signal["value"], signal["unit"]) == (47.0, "DEVICE")
    assert found["/event/Telemetry"][1][0][1]["battery"] == 0.75


def test_zones_graph_robots_and_links_stand_in_the_scene(found, pennovation):
    scene = {entity.id: entity for entity in found["/scene"][1][0][1].entities}
    assert scene.keys() == {
        *(f"fence {number}" for number in range(1, len(pennovation.fences) + 1)),
        *(f"zone {zone.name}" for zone in pennovation.zones),
        "graph",
    }
    zone = pennovation.zones[0]
    drawn = scene[f"zone {zone.name}"]
    assert {(p.x, p.y) for p in drawn.lines[0].points} == set(zone.shape.corners)
    assert len(drawn.triangles[0].points) == 6 * len(zone.shape.corners)
    numbers = [text.text for text in scene["graph"].texts]
    assert numbers == ["home", *(str(waypoint.number) for waypoint in pennovation.waypoints)]
    assert len(scene["graph"].lines[0].points) % 2 == 0
    (robot,) = found["/scene/robots"][1][-1][1].entities
    assert (robot.id, robot.texts[0].text) == ("io", "io 47 device")
    ends = [(p.x, p.y, p.z) for p in robot.lines[0].points]
    assert ends == [(20.0, 2.0, 40.0), (5.0, 6.0, 0.0)]


def test_a_record_that_was_cut_is_shown_as_far_as_it_goes(record, tmp_path):
    cut, target = tmp_path / "cut.mcap", tmp_path / "shown.mcap"
    cut.write_bytes(record.read_bytes()[:-2000])
    assert main(["convert", str(cut), str(target)]) == ExitCode.DONE
    assert "/scene" in messages_of(target)


def topics_in(layout):
    """All topics that a layout's panels name."""
    if isinstance(layout, dict):
        for key, value in layout.items():
            if key == "topics":
                yield from value
            elif key in ("value", "topicPath", "topicToRender", "followTopic") and value:
                yield value
            else:
                yield from topics_in(value)
    elif isinstance(layout, list):
        for value in layout:
            yield from topics_in(value)


def test_the_layout_shows_what_is_there(found):
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    paths = set(topics_in(layout["configById"]))
    assert len(paths) > 10
    for path in paths:
        topic, _, field = path.partition(".")
        topic = topic.replace("/robots/NAME", "/robots/io")
        assert topic in found, path
        content = found[topic][1][0][1]
        names = content if isinstance(content, dict) else content.DESCRIPTOR.fields_by_name
        assert not field or field.split(".")[0] in names, path
    shown = json.dumps(layout["layout"])
    assert all(f'"{panel}"' in shown for panel in layout["configById"])


async def received(address, topics):
    """The first message of each topic that a viewer gets who comes when all has happened."""
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(
            address.replace("ws://", "http://"), protocols=["foxglove.sdk.v1"]
        ) as socket,
    ):
        messages, channels = {}, {}
        while topics - messages.keys():
            answer = await socket.receive(timeout=20)
            if answer.type is aiohttp.WSMsgType.TEXT:
                plain = json.loads(answer.data)
                for channel in plain.get("channels", []) if plain["op"] == "advertise" else []:
                    channels[channel["id"]] = channel
                    wanted = {"id": channel["id"], "channelId": channel["id"]}
                    await socket.send_json({"op": "subscribe", "subscriptions": [wanted]})
            elif answer.data[0] == 1:
                (number,) = struct.unpack_from("<I", answer.data, 1)
                messages.setdefault(channels[number]["topic"], answer.data[13:])
        return messages


def test_a_flight_is_shown_while_it_lasts_and_to_one_who_comes_late(shown):
    foxglove_sdk = importlib.import_module("air_router.record.foxglove_sdk")
    socket = foxglove_sdk.FoxgloveSocket("127.0.0.1", 0, "titan")
    try:
        shown(socket)
        topics = {"/scene", "/mission", "/links", "/vehicle/location"}
        messages = asyncio.run(received(socket.address, topics))
        with pytest.raises(RefusedError, match="choose another port"):
            foxglove_sdk.FoxgloveSocket(
                "127.0.0.1", int(socket.address.rpartition(":")[2]), "atlas"
            )
    finally:
        socket.close()
    assert json.loads(messages["/links"])["signal"]["value"] == 47.0
    assert b"zone 1" in messages["/scene"]


def test_what_fails_for_a_late_viewer_is_logged_beside_what_fails_in_flight(monkeypatch, caplog):
    """A guard logs once in 10 s: each thread has one of its own."""
    foxglove_sdk = importlib.import_module("air_router.record.foxglove_sdk")
    socket = foxglove_sdk.FoxgloveSocket("127.0.0.1", 0, "titan")
    channel = SimpleNamespace(topic="/links")

    def fail(*_):
        raise RuntimeError("no such schema")

    try:
        monkeypatch.setattr(socket._channels, "send", fail)
        socket.send(channel, 1, b"")
        socket.on_subscribe(None, channel)
        assert [record.exc_info[0] for record in caplog.records] == [RuntimeError] * 2
        assert "a viewer who has just come" in caplog.text
    finally:
        socket.close()


def test_the_log_has_the_severity_of_an_announcement(pennovation):
    """Levels of Foxglove's log: INFO, WARNING, ERROR."""
    drawing = importlib.import_module("air_router.record.drawing")
    levels = []
    for severity in Severity:
        announced = Announce("x", severity, BE_READY)
        ((channel, data),) = drawing.FlightDrawing(pennovation).draw(announced, 1.7e9)
        schema = Schema(1, channel.schema, "protobuf", channel.schema_name)
        log = decoder.DecoderFactory().decoder_for("protobuf", schema)(data)
        levels.append((channel.topic, log.level))
    assert levels == [("/log", 2), ("/log", 3), ("/log", 4)]


def test_a_record_itself_is_drawn_as_one_that_is_converted(record, found):
    """Where the SDK was there in flight: of every topic the same, as it was in the end."""
    own = messages_of(record)
    assert {topic: name for topic, (name, _) in own.items()} == {
        topic: name for topic, (name, _) in found.items()
    }
    for topic in DRAWN:
        here, there = (
            re.sub(r"timestamp \{[^}]*\}", "", str(messages[topic][1][-1][1]))
            for messages in (own, found)
        )
        assert here == there, topic


def test_without_the_sdk_a_flight_is_recorded_and_drawn_later(pennovation, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    monkeypatch.delitem(sys.modules, "air_router.record.drawing")
    with Recorder(tmp_path, "mission.yaml", unix_s=lambda: UNIX_S) as recorder:
        fly(recorder, pennovation)
    assert not DRAWN.keys() & messages_of(recorder.path).keys()
    monkeypatch.undo()
    target = tmp_path / "shown.mcap"
    assert main(["convert", str(recorder.path), str(target)]) == ExitCode.DONE
    assert DRAWN.keys() <= messages_of(target).keys()
