"""A recorded flight on the live page: decided again, at any speed, forwards and backwards."""

import asyncio
import json
import math

import aiohttp
import numpy as np
import pytest

from air_router.cli.cli import main
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.states import State
from air_router.errors import ExitCode, RefusedError
from air_router.live.playback import Playback, RecordedFlight
from air_router.live.server import LivePage
from air_router.record.log import Note, RecordEntry
from air_router.record.replay import Replayer
from air_router.web.serving import Web
from geo.frame import Point
from geo.grid import GridPatch, Terrain
from mocha_link.links.metrics import LinkMetrics

SEEK = ("callisto", "io")


class Silent:
    """Looks at what a film decides."""

    def __init__(self):
        self.actions = []

    def step(self, event, actions, now_s):
        self.actions.extend(actions)

    def links(self, links):
        pass


@pytest.fixture
def record(pretend):
    """What is recorded of a flight of two minutes."""
    flight = pretend(duration_s=40.0, radius_m=150.0, seek=SEEK)
    flight.robots = {"callisto": Point(-90.0, 60.0), "io": Point(30.0, 0.0)}
    handle = flight.controller.handle
    entries = [
        RecordEntry(0.0, "about", {}),
        RecordEntry(0.0, "setup", FlightSetup(flight.mission, SEEK)),
        RecordEntry(100.0, "note", Note("Reaction", {"reaction_s": 0.6})),
        RecordEntry(101.0, "link", LinkMetrics("io", rssi_dbm=-55.0)),
    ]

    def recorded(event, now_s):
        actions = handle(event, now_s)
        entries.append(RecordEntry(now_s, "event", event))
        entries.extend(RecordEntry(now_s, "action", action) for action in actions)
        return actions

    flight.controller.handle = recorded
    flight.take_off()
    flight.fly_until(lambda: flight.finished is not None)
    grid = RecordedFlight(entries).mapper.grid
    patch = GridPatch(grid.west_m, grid.south_m, 1.0, np.full((2, 3), Terrain.ROAD, np.uint8))
    return [*entries[:200], RecordEntry(entries[199].t, "patch", patch.encode()), *entries[200:]]


def test_a_film_decides_what_the_flight_decided_and_can_begin_again(record):
    film, page = RecordedFlight(record), Silent()
    decided = [entry.value for entry in record if entry.kind == "action"]
    for _ in range(2):
        page.actions.clear()
        while not film.go_on(film.end_s, page):
            pass
        assert page.actions == decided
        assert film.status().state is State.DONE
        assert film.mapper.known_cells == 6
        assert film.status().links["io"].rssi_dbm == -55.0
        assert film.now_s == film.end_s
        film.rewind()
        assert (film.now_s, film.status().state) == (film.begin_s, State.READY)
        assert film.mapper.known_cells == 0


def test_a_record_without_a_flight_is_refused(record, tmp_path, capsys):
    for entries in ([], record[:2], record[2:]):
        with pytest.raises(RefusedError, match="no flight in the record"):
            RecordedFlight(entries)
    (tmp_path / "x.mcap").write_bytes(b"nonsense")
    assert main(["replay", str(tmp_path / "x.mcap"), "--web", "0"]) == ExitCode.INVALID_FILE
    assert "not an MCAP file" in capsys.readouterr().err
    assert main(["replay", "x.mcap", "--web", "70000"]) == ExitCode.USAGE


def test_the_viewer_steers_the_film_and_requests_nothing_else(record):
    film = RecordedFlight(record)
    playback = Playback(film, Web(), speed=100.0)

    async def look():
        serving = playback.serving(lambda _: None)
        async with serving as address, aiohttp.ClientSession() as browser:
            socket = await browser.ws_connect(f"{address}socket")

            async def until(condition):
                while True:
                    message = json.loads((await socket.receive(30)).data)
                    if condition(message):
                        return message

            async def send(**values):
                await socket.send_str(json.dumps({"id": 7, **values}))
                return await until(lambda message: message.get("id") == 7)

            ended = await until(
                lambda m: m["type"] == "playback" and m["now_s"] >= m["end_s"] - 0.2
            )
            refused = [
                await send(request="hold"),
                await send(ask="speed", speed=-1),
                await send(ask="go", to_s="x"),
                await send(ask="dance"),
                await send(ask="go", to_s=math.nan),
            ]
            assert (await send(ask="go", to_s=10**400))["type"] == "done"
            assert (await send(ask="pause", paused=True))["type"] == "done"
            assert (await send(ask="go", to_s=ended["begin_s"] + 20.0))["type"] == "done"
            await until(lambda m: m["type"] == "welcome")
            back = await until(lambda m: m["type"] == "playback")
            vehicle = await until(lambda m: m["type"] == "vehicle")
            await socket.close()
        return ended, refused, back, vehicle

    ended, refused, back, vehicle = asyncio.run(look())
    assert ended["speed"] == 100.0
    assert {answer["type"] for answer in refused} == {"refused"}
    assert "shown from its record" in refused[0]["why"]
    assert back["paused"]
    assert back["now_s"] == pytest.approx(back["begin_s"] + 20.0, abs=0.1)
    assert vehicle["state"] == "INIT"


def test_a_flight_that_ended_by_a_fault_is_shown_up_to_its_end(record, monkeypatch):
    """As `replay` compares it: what has failed fails again."""
    decide, last_s = Replayer.decide, record[-1].t

    def fail(replayer, step):
        if step.t == last_s:
            raise ZeroDivisionError("of ours")
        return decide(replayer, step)

    monkeypatch.setattr(Replayer, "decide", fail)
    marks = Playback(RecordedFlight(record), Web())._page.record["marks"]
    assert marks[-1]["text"] == "no decision: ZeroDivisionError: of ours"


def test_a_page_that_fails_to_show_something_logs_so_now_and_then_and_goes_on(record, caplog):
    film = RecordedFlight(record)
    page = LivePage(film.status, film.router, None, mapper=film.mapper)
    page.scene.step = lambda *_: 1 / 0
    for _ in range(10):
        page.step(record[5].value, (), 1.0)
    assert caplog.text.count("ZeroDivisionError: ") == 1
