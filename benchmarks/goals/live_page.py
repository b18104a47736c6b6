"""What the live page costs with many robots: frames in a browser, processor time in the flight.

A process of its own serves the page as a flight does; ten times a second it updates where the
vehicle and every robot are. For several UAVs it serves the pages of all, and the joint one.
Chromium (headless, no graphics card) looks on. The share of a core is all that this process takes:
nothing but the pages, and the programs that feed them.
"""

import asyncio
import contextlib
import dataclasses
import importlib.util
import math
import multiprocessing
import time
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

from air_router.controller import Controller, FlightStatus
from air_router.controller.model import FlightSetup, RobotPose
from air_router.flight import CommandService
from air_router.gossip import Mapper
from air_router.live import JointPage, LivePage
from air_router.mission import Mission, load_mission
from air_router.routing import Router, WaypointGraph
from air_router.vehicle import FlightMode, Telemetry
from air_router.web import PageAddress
from benchmarks.browser import chromium
from benchmarks.goals.figure import Conditions, Figure, UnmeasuredError
from geo.frame import Point
from mocha_link.links import Direction, LinkMetrics, Reading, SyncEnded, SyncStarted, Unit

MISSION: Final = Path(__file__).parents[2] / "missions" / "pennovation" / "mission.yaml"
STEP_S: Final = 0.1
SETTLE_S: Final = 3.0
WATCHED_S: Final = 10.0
ROBOTS: Final = 50
UAVS: Final = (1, 3)
OPTIONS: Final = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
FRAMES: Final = """(ms) => new Promise((done) => {
  const begin = performance.now();
  const gaps = [];
  let last = begin;
  const frame = (now) => {
    gaps.push(now - last);
    last = now;
    if (now - begin < ms) {
      requestAnimationFrame(frame);
      return;
    }
    gaps.sort((a, b) => a - b);
    const p95_ms = gaps[Math.floor(gaps.length * 0.95)];
    done({ frames_per_s: 1000 * gaps.length / (now - begin), p95_ms });
  };
  requestAnimationFrame(frame);
})"""


def _circling(now_s: float, robot: int) -> Point:
    return Point(100 * math.sin(now_s / 10 + robot), 100 * math.cos(now_s / 7 + robot))


class _Flight:
    """The page of one UAV, and what happens to it."""

    def __init__(self, mission: Mission, router: Router, number: int, robots: int) -> None:
        self.mission = dataclasses.replace(mission, uav=f"uav{number}")
        self._number = number
        self._names = names = tuple(f"robot{robot:02d}" for robot in range(robots))
        self._controller = Controller(FlightSetup(self.mission, names), router)
        signals = [Reading(-60.0 - n % 20, Unit.DBM, "radio") for n in range(robots)]
        self._links = {n: LinkMetrics(n, signal=s) for n, s in zip(names, signals, strict=True)}
        self.page = LivePage(
            self._status,
            lambda: self._controller.router,
            CommandService(mission.frame, self._status, lambda _: ()),
            mapper=Mapper(mission),
        )

    def _status(self) -> FlightStatus:
        return dataclasses.replace(self._controller.status(), links=self._links)

    def update(self, now_s: float) -> None:
        page, place = self.page, _circling(now_s, 40 * self._number)
        telemetry = Telemetry(now_s, place, 40.0, armed=True, in_air=True, mode=FlightMode.HOLD)
        self._controller.handle(telemetry, now_s)
        page.step(telemetry, (), now_s)
        for number, name in enumerate(self._names):
            page.step(RobotPose(name, _circling(now_s, number), now_s, name), (), now_s)
        peer = self._names[(int(now_s) + self._number) % len(self._names)]
        sync = SyncEnded(peer, now_s, Direction.IN, 1, 1, 0.1) if int(now_s * 2) % 2 else None
        page.step(sync or SyncStarted(peer, now_s, Direction.IN), (), now_s)


def _fly(wire: Connection, robots: int, uavs: int) -> None:
    """Serve pages, and update where all robots are, until "end" is received; sends times taken."""
    mission = load_mission(MISSION)
    router = Router(WaypointGraph(mission))
    flights = {f"uav{n}": _Flight(mission, router, n, robots) for n in range(uavs)}
    joint = JointPage(flights)

    async def serve() -> None:
        now_s = 0.0
        async with AsyncExitStack() as stack:
            for name, flight in flights.items():
                address = await stack.enter_async_context(flight.page.serving(lambda _: None))
                joint.found(name, PageAddress.of(address))
            if uavs > 1:
                address = await stack.enter_async_context(joint.serving(lambda _: None))
            wire.send(address)
            while True:
                now_s += STEP_S
                for flight in flights.values():
                    flight.update(now_s)
                if wire.poll():
                    if wire.recv() == "end":
                        return
                    wire.send(time.process_time())
                await asyncio.sleep(STEP_S)

    asyncio.run(serve())


def measure(conditions: Conditions) -> Iterator[Figure]:
    """One UAV, and the joint page of three."""
    path = chromium()
    if path is None or importlib.util.find_spec("playwright") is None:
        raise UnmeasuredError("no Chromium, or no playwright")
    robots, seconds = (5, 2.0) if conditions.quick else (ROBOTS, WATCHED_S)
    bare, _ = _watched(path, 0, 0, seconds)
    for uavs in UAVS[: 1 if conditions.quick else None]:
        frames, share = _watched(path, robots, uavs, seconds)
        where = f"{robots} robots, {uavs} UAV" + "s" * (uavs > 1)
        anchors = {"a blank page": bare["frames_per_s"]}
        yield Figure(f"{where}: frames", frames["frames_per_s"], "1/s", anchors=anchors)
        anchors = {"a blank page": bare["p95_ms"]}
        yield Figure(f"{where}: a frame, p95", frames["p95_ms"], "ms", anchors=anchors)
        yield Figure(f"{where}: the program", 100 * share, "% of a core")


def _watched(path: str, robots: int, uavs: int, seconds: float) -> tuple[dict[str, float], float]:
    """What a browser draws in a second, and the share of a core that the pages take."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - only where installed

    with (
        sync_playwright() as playwright,
        contextlib.closing(
            playwright.chromium.launch(executable_path=path, args=list(OPTIONS))
        ) as browser,
    ):
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        if not uavs:
            return page.evaluate(FRAMES, seconds * 1000), 0.0
        with _flown(robots, uavs) as (address, processor_s):
            page.goto(address)
            page.locator(".vehicle").nth(uavs - 1).wait_for(state="attached")
            page.locator(".robot").nth(robots - 1).wait_for(state="attached")
            page.wait_for_timeout(SETTLE_S * 1000)
            before_s, began_s = processor_s(), time.monotonic()
            frames = page.evaluate(FRAMES, seconds * 1000)
            return frames, (processor_s() - before_s) / (time.monotonic() - began_s)


@contextlib.contextmanager
def _flown(robots: int, uavs: int) -> Iterator[tuple[str, Callable[[], float]]]:
    """A process that serves the pages: the address, and what requests its processor time."""
    processes = multiprocessing.get_context("spawn")
    ours, theirs = processes.Pipe()
    flight = processes.Process(target=_fly, args=(theirs, robots, uavs))
    flight.start()

    def processor_s() -> float:
        ours.send("time")
        return float(ours.recv())

    try:
        yield ours.recv(), processor_s
    finally:
        ours.send("end")
        flight.join(10)
