"""What the beginning of a search takes of its turn of the flight loop, by each policy."""

import math
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from air_router.controller import Controller
from air_router.controller.model import FlightSetup
from air_router.files import SEEK_POLICIES
from air_router.mission import FlightPlan, load_mission
from air_router.routing import Router, WaypointGraph
from air_router.vehicle import Telemetry
from benchmarks.goals.figure import Conditions, Figure, median_ms
from benchmarks.route.maps import made, mission_text
from geo.frame import Point

ZONES, ROBOTS, LEGS = 500, tuple("abcdefghij"), 50


def measure(conditions: Conditions) -> Iterator[Figure]:
    """Processor time, so that it holds on a busy machine as well; beside it a bare route."""
    times = 4 if conditions.quick else 20
    map_ = made(100, ZONES)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "mission.yaml"
        path.write_text(mission_text(map_), encoding="utf-8")
        mission = load_mission(path)
    plan, router = FlightPlan.of(mission), Router(WaypointGraph(mission))
    starts = iter([here for here, _ in map_.pairs])
    route_ms = median_ms(lambda: router.route(next(starts), 0), times, time.process_time)
    for policy in SEEK_POLICIES:
        setup = FlightSetup(replace(mission, seek_policy=policy), ROBOTS)
        chance = random.Random(1)
        begins: list[Callable[[], None]] = []
        for here, _ in map_.pairs[:times]:
            controller = Controller(setup, router, plan)
            context, exploration = controller.context, controller.exploration
            context.now_s, exploration.began_s, exploration.here = 300.0, 0.0, here
            context.telemetry = Telemetry(300.0, here, mission.altitude_above_home_m)
            for track in controller.search.targets.tracks.values():
                track.pose_received(chance.choice(map_.pairs)[0], 0.0, 0.0)
                track.path_received(_winding(chance, track.pose.position), 0.0, 0.0)
            begins.append(controller.states.search.begin)
        search_ms = median_ms(lambda left=begins: left.pop()(), times, time.process_time)
        what = f"{ZONES} zones, {len(ROBOTS)} robots: {policy}"
        yield Figure(what, search_ms, "ms", anchors={"a route": route_ms})


def _winding(chance: random.Random, place: Point) -> tuple[Point, ...]:
    """A robot's path: 50 legs of 12 m."""
    places, heading = [place], chance.uniform(0, math.tau)
    for _ in range(LEGS):
        heading += chance.uniform(-0.6, 0.6)
        east_m, north_m = places[-1]
        places.append(Point(east_m + 12 * math.cos(heading), north_m + 12 * math.sin(heading)))
    return tuple(places)
