"""What the live page of a flight is sent; tests/system/test_whole_flight.py looks at the page."""

import asyncio
import base64
import dataclasses
import json

import aiohttp
import numpy as np
import pytest

from air_router.controller.model.actions import Announce, CommandAck
from air_router.controller.model.events import AirspaceChanged, RobotPath, RobotPose
from air_router.controller.model.requests import HoldNow
from air_router.controller.model.states import State
from air_router.errors import UsageError
from air_router.flight.flight_loop import CommandService
from air_router.gossip.interactions import Interactions
from air_router.gossip.mapper import Mapper
from air_router.live.scene import MAX_LOG_LINES, LiveScene
from air_router.live.server import LivePage, MapFeed
from air_router.repeats import PAUSE_S
from air_router.vehicle.instructions import BE_READY, FLY_OUT, Severity
from air_router.vehicle.vehicle import Telemetry
from air_router.web.serving import HERE, web_of, web_options
from geo.frame import Point
from geo.grid import GridPatch, Terrain
from mocha_link.cli import command
from mocha_link.links.metrics import Direction, LinkMetrics, SyncEnded, SyncStarted
from mocha_link.links.reading import Reading, Unit
from tests.air_router.tile_maker import around, write_tiles
from tests.command_lines import options_for

ROBOTS = {"callisto": Point(-150.0, 60.0), "europa": Point(75.0, -150.0), "io": Point(64.0, 0.0)}


class Shown:
    """A pretended flight that updates its page, as the flight shell does."""

    def __init__(self, flight, web=HERE):
        self.flight = flight
        self.commands = CommandService(flight.mission.frame, self.status, self.deliver)
        self.mapper = Mapper(flight.mission)
        self.page = LivePage(
            self.status,
            lambda: flight.controller.router,
            self.commands,
            mapper=self.mapper,
            web=web,
        )
        self._sent = [len(flight.events), len(flight.actions)]

    def status(self):
        links = {
            name: LinkMetrics(name, signal=Reading(-60.0, Unit.DBM, "radio")) for name in ROBOTS
        }
        return dataclasses.replace(self.flight.controller.status(), links=links)

    def deliver(self, request):
        decided = self.flight.deliver(request)
        self.update()
        return decided

    def update(self):
        flight = self.flight
        for event, now_s in flight.events[self._sent[0] :]:
            self.page.step(event, (), now_s)
        decided = flight.actions[self._sent[1] :]
        self.page.step(None, decided, flight.now_s)
        self._sent = [len(flight.events), len(flight.actions)]

    def fly(self, steps=1):
        for _ in range(steps):
            self.flight.step()
        self.update()


@pytest.fixture
def flight(pretend):
    made = pretend()
    made.robots = dict(ROBOTS)
    made.take_off()
    return made


def test_a_page_that_is_opened_late_is_sent_everything_and_sends_requests(flight):
    shown = Shown(flight)

    def paint(west_m, cells):
        grid = shown.mapper.grid
        corner = (grid.west_m + west_m, grid.south_m + 20.0)
        assert shown.mapper.paint(GridPatch(*corner, 1.0, cells).encode())

    async def look():
        printed = []
        paint(10.0, np.full((3, 4), Terrain.ROAD, dtype=np.uint8))
        serving = shown.page.serving(printed.append)
        async with serving as address, aiohttp.ClientSession() as browser:
            shown.fly(300)
            async with browser.ws_connect(f"{address}socket") as socket:

                async def until(kind):
                    while True:
                        message = json.loads((await socket.receive(30)).data)
                        sent[message["type"]] = message
                        if message["type"] == kind:
                            return message

                sent = {}
                await until("links")
                paint(30.0, np.full((2, 2), Terrain.GRASS, dtype=np.uint8))
                await until("piece")
                answers = []
                for kind, request in (
                    ("done", {"request": "hold", "id": 1}),
                    ("refused", {"request": "dance", "id": 2}),
                    ("refused", ["hold"]),
                    ("done", {"request": "seek", "robot": "phantom", "id": 4}),
                ):
                    await socket.send_str(json.dumps(request))
                    answers.append(await until(kind))
                await socket.send_str("[" * 50_000)
                answers.append(await until("refused"))
        return printed, sent, answers

    printed, sent, answers = asyncio.run(look())
    assert printed[0].startswith("the flight is shown at http://127.0.0.1:")
    assert {"scenery", "vehicle", "robots", "links", "track", "log"} <= sent.keys()
    areas = sent["scenery"]["areas"]
    assert [area["fence"] for area in areas].count(True) == len(flight.mission.fences)
    assert len(areas) == len(flight.mission.fences) + len(flight.mission.zones)
    assert all(area["outline"] and len(area["buffers"]) == 2 for area in areas)
    assert len(sent["scenery"]["places"]) == 1 + 39 + len(flight.mission.rally_points)
    assert len(sent["track"]["points"]) > 50
    seen = [sent["map"]["piece"], sent["piece"]]
    assert [(p["row"], p["column"], p["rows"], p["columns"]) for p in seen if p][-1] == (
        20,
        30,
        2,
        2,
    )
    assert base64.b64decode(sent["piece"]["cells"]) == bytes([Terrain.GRASS] * 4)
    assert answers[0]["accepted"]
    assert flight.controller.state is State.HOLD
    assert "no request 'dance'" in answers[1]["why"]
    assert answers[3]["code"] == "unknown-robot"


def scene_of(flight):
    controller = flight.controller
    return LiveScene(flight.mission, controller.status, lambda: controller.router, "titan")


def test_the_scene_follows_events_and_forgets_old_lines(flight):
    reading = Reading(47.0, Unit.DEVICE, "rajant")
    links = {"io": LinkMetrics("io", signal=reading, bytes_out=900)}  # to a peer that was there

    def status():
        return dataclasses.replace(flight.controller.status(), links=links)

    scene = LiveScene(flight.mission, status, lambda: flight.controller.router, "titan")
    scene.step(SyncStarted("io", 0.0, Direction.IN), (), 50.0)
    assert scene.link_lines(status())[0]["lit"]
    scene.step(SyncEnded("io", 0.0, Direction.IN, 1, 1, 0.1), (), 50.5)
    assert scene.link_lines(status())[0]["lit"]
    scene.step(flight.telemetry(), (), 52.0)
    line = scene.link_lines(status())[0]
    assert line["syncs"] == 1
    shown = (line["lit"], line["signal"], line["unit"], line["synced_ago_s"])
    assert shown == (False, 47.0, "device", 1.5)
    scene.step(flight.telemetry(), (), 52.5)  # the same second counts once
    scene.step(SyncStarted("io", 0.0, Direction.IN), (), 53.0)
    scene.step(flight.telemetry(), (), 53.1)
    rows = scene.rows.since()
    assert [row[0] for row in rows] == [52.0, 53.1]
    assert [row[-1] for row in rows] == [{"io": [47.0, lit, 1, "device"]} for lit in (0, 1)]
    away_m = flight.mission.airspace.nearest(flight.telemetry().position)[0]
    assert rows[0][1:5] == [flight.telemetry().altitude_m, 0.0, 1.0, round(away_m, 1)]
    assert scene.rows.since(1) == rows[1:]
    for number in range(MAX_LOG_LINES + 10):
        scene.step(None, (CommandAck(str(number), "eve", False, "no"),), 53.0)
    assert scene.log.count == MAX_LOG_LINES + 10
    assert len(scene.log.since()) == MAX_LOG_LINES
    assert [line["n"] for line in scene.log.since(MAX_LOG_LINES + 8)] == [
        MAX_LOG_LINES + 9,
        MAX_LOG_LINES + 10,
    ]
    flight.controller.handle(HoldNow(), flight.now_s)
    assert scene.vehicle(status())["what"] == State.HOLD.value


def test_lines_that_come_again_have_a_count_but_no_alarm_and_no_answer_does(flight):
    scene = scene_of(flight)
    info, warning = Announce("searching"), Announce("too near", Severity.WARNING, BE_READY)
    alarm = Announce("breach", Severity.ALARM, FLY_OUT)
    for second in range(3):
        scene.step(None, (info, warning), 50.0 + second)
    scene.step(None, (alarm, alarm, info, CommandAck("7", "eve", False, "no"), info, info), 53.0)
    scene.step(None, (info,), 50.0 + 10 * PAUSE_S)
    shown = [(line["text"].partition(".")[0], line.get("again")) for line in scene.log.since()]
    assert shown == [
        ("searching", None),
        ("too near", None),
        ("searching", "again"),
        ("too near", "again"),
        ("searching", "again 2 times"),
        ("too near", "again 2 times"),
        ("breach", None),
        ("breach", None),
        ("searching", None),  # it may be new after an alarm
        ("eve: refused: no", None),
        ("searching", None),
        ("searching", "again"),
        ("searching", None),
    ]


def test_after_a_reboot_of_the_vehicle_the_page_goes_on(flight):
    scene = scene_of(flight)
    for t in (1000.0, 999.9, 5.0, 7.0):
        scene.step(Telemetry(t, Point(0.0, 0.0), 40.0), (), t)
    assert scene.now_s == 7.0
    assert [row[0] for row in scene.rows.since()] == [1000.0, 5.0, 7.0]


def test_a_position_that_others_carried_is_as_old_as_it_is(flight):
    """By the robot's own clock, which is another than ours: as the flight itself reckons."""
    scene = scene_of(flight)
    here, there = Point(10.0, 0.0), Point(50.0, 0.0)
    for event, now_s in (
        (RobotPath("io", (there,), 999.0), 99.0),
        (RobotPose("io", here, 1_000.0, "io"), 100.0),
        (RobotPose("io", there, 1_060.0, "callisto"), 400.0),
    ):
        scene.step(event, (), now_s)
    (io,) = scene.robots()
    assert (io["age_s"], io["by"]) == (240.0, "callisto")
    assert io["at"] == io["way"][-1]
    scene.step(RobotPose("io", here, 1_010.0, "europa"), (), 401.0)  # older than what is known
    assert scene.robots() == [{**io, "age_s": 241.0}]


def test_a_fault_in_a_decision_is_not_taken_for_a_wrong_request(flight):
    page = Shown(flight).page

    def fault(*_):
        raise ValueError("math domain error")

    page._commands.execute = fault
    with pytest.raises(ValueError, match="domain"):
        page._answer('{"request": "hold", "id": 1}')


def test_tiles_lie_under_the_map(flight, tmp_path):
    path = write_tiles(tmp_path / "site.mbtiles", around(17, 39.942, -75.2))
    page = command("Show it.")(web_options()(lambda _: 0))
    options = ["--web", "0", "--web-image", str(path)]
    with pytest.raises(UsageError, match="add --web"):
        web_of(options_for(page, *options[2:]))
    web = web_of(options_for(page, *options))
    shown = Shown(flight, web)

    async def look():
        async with (
            shown.page.serving(lambda _: None) as address,
            aiohttp.ClientSession() as browser,
        ):
            async with browser.get(f"{address}flights") as answer:
                (own,) = (await answer.json())["flights"]
                assert own == {"name": flight.mission.uav or "UAV", "socket": "/socket"}
            async with browser.ws_connect(f"{address}socket") as socket:
                return json.loads((await socket.receive(30)).data)

    assert asyncio.run(look()) == {
        "type": "welcome",
        "backdrop": json.loads(json.dumps(web.backdrop)),
    }


def test_zones_that_change_in_flight_are_drawn_anew(flight):
    page = Shown(flight).page
    before = json.loads(page._scenery)
    flight.give(AirspaceChanged(flight.mission.fences, flight.mission.zones[:-1]))
    page._tick()
    after = json.loads(page._scenery)
    assert len(after["areas"]) == len(before["areas"]) - 1


def test_a_robot_holds_of_the_map_what_was_there_when_it_came_for_it(flight):
    mapper, syncs = Mapper(flight.mission), Interactions()
    ground = MapFeed(mapper, flight.mission.frame, syncs)
    corner = (mapper.grid.west_m, mapper.grid.south_m)
    assert ground.whole()["piece"] is None
    mapper.paint(GridPatch(*corner, 1.0, np.ones((2, 2), dtype=np.uint8)).encode())
    mapper.publish(10.0)
    syncs.take(11.0, SyncStarted("io", 0.0, Direction.OUT))
    mapper.paint(GridPatch(*corner, 1.0, np.ones((2, 4), dtype=np.uint8)).encode())
    mapper.publish(12.0)
    assert ground.share("io") is None
    fetched = SyncEnded("io", 0.0, Direction.OUT, 1, 1, 0.1)
    syncs.take(13.0, fetched)
    ground.event(fetched)
    assert ground.share("io") == 0.5
    assert ground.update()["columns"] == 4
    assert ground.update() is None
    assert ground.whole()["piece"]["rows"] == 2
