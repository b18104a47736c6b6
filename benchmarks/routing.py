"""How long a mission takes to load, its graph to build, a route to find, and an edit to show."""

import itertools
import json
import math
import random
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import shapely

from air_router.controller import Controller
from air_router.controller.model import FlightSetup
from air_router.editor import EditSession, MissionFile, Move
from air_router.files import SEEK_POLICIES
from air_router.mission import FlightPlan, load_mission
from air_router.routing import Router, WaypointGraph
from air_router.vehicle import Telemetry
from benchmarks.route.maps import Map, made
from geo.frame import Geodetic, LocalFrame, Point
from mocha_link.team import Document

MISSIONS = Path(__file__).parents[1] / "missions"


def measure(*, quick: bool) -> Iterator[dict[str, Any]]:
    for name in ("pennovation", "urban"):
        path = MISSIONS / name / "mission.yaml"
        mission = load_mission(path)
        yield row(f"{name}: load and check", median_ms(lambda p=path: load_mission(p), 5), "ms")
        build_ms = median_ms(lambda m=mission: WaypointGraph(m), 20)
        bare_ms = median_ms(lambda m=mission: bare_edges(m), 20)
        note = f"{build_ms / bare_ms:.1f} x all pairs by bare shapely distances"
        yield row(f"{name}: build the graph", build_ms, "ms", note)
        router = Router(WaypointGraph(mission))
        chance = random.Random(1)
        pairs = [
            (place(chance, mission), chance.randrange(len(mission.waypoints) + 1))
            for _ in range(50 if quick else 500)
        ]
        times_ms = []
        for start, goal in pairs:
            began_s = time.perf_counter()
            router.route(start, goal)
            times_ms.append((time.perf_counter() - began_s) * 1e3)
        note = f"worst {max(times_ms):.1f} ms of {len(pairs)}"
        yield row(f"{name}: route from anywhere", statistics.median(times_ms), "ms", note)
    yield edits(8 if quick else 40)
    yield from searches(4 if quick else 20)


def searches(times: int) -> Iterator[dict[str, Any]]:
    """What a search takes of the turn of the flight loop in which it begins, by each policy."""
    map_ = made(100, 500)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "mission.yaml"
        path.write_text(mission_text(map_))
        mission = load_mission(path)
    plan, router = FlightPlan.of(mission), Router(WaypointGraph(mission))
    for policy in SEEK_POLICIES:
        setup = FlightSetup(replace(mission, seek_policy=policy), tuple("abcdefghij"))
        chance = random.Random(1)
        begins: list[Callable[[], None]] = []
        for here, _ in map_.pairs[:times]:
            controller = Controller(setup, router, plan)
            context, exploration = controller.context, controller.exploration
            context.now_s, exploration.began_s, exploration.here = 300.0, 0.0, here
            context.telemetry = Telemetry(300.0, here, mission.altitude_above_home_m)
            for track in controller.search.targets.tracks.values():
                track.pose_heard(chance.choice(map_.pairs)[0], 0.0, 0.0)
                track.path_heard(winding(chance, track.pose.position), 0.0, 0.0)
            begins.append(controller.states.search.begin)
        search_ms = median_ms(lambda left=begins: left.pop()(), times, time.process_time)
        note = "paths of 50 corners; processor time"
        yield row(f"500 zones, 10 robots: a search begins, {policy}", search_ms, "ms", note)


def winding(chance: random.Random, place: Point) -> tuple[Point, ...]:
    """A robot's path: 50 legs of 12 m."""
    places, heading = [place], chance.uniform(0, math.tau)
    for _ in range(50):
        heading += chance.uniform(-0.6, 0.6)
        east_m, north_m = places[-1]
        places.append(Point(east_m + 12 * math.cos(heading), north_m + 12 * math.sin(heading)))
    return tuple(places)


def edits(times: int) -> dict[str, Any]:
    """What the edit page's server computes when a waypoint of a large mission is moved."""
    text = mission_text(made(500, 100))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "mission.yaml"
        path.write_text(text)
        session = EditSession(MissionFile(path))
        numbers = itertools.count(1)

        def edit() -> None:
            moved = session.view()["places"][next(numbers)]
            north = moved["at"][0] + 3e-6, moved["at"][1]
            session.edit(Move(do="move", keys=tuple(moved["keys"]), to=north))
            json.dumps(session.view())

        edit_ms = median_ms(edit, times, time.process_time)
        read_ms = median_ms(lambda: Document.from_text(text, path), times, time.process_time)
    note = f"{edit_ms / read_ms:.1f} x reading its YAML; processor time"
    return row("500 waypoints, 100 zones: move a waypoint", edit_ms, "ms", note)


def mission_text(map_: Map) -> str:
    frame = LocalFrame(Geodetic(39.94, -75.2))
    (fence,) = map_.airspace.fences

    def degrees(places: Any) -> list[list[float]]:
        return [[round(value, 7) for value in frame.to_geodetic(place)] for place in places]

    home, *waypoints = degrees(map_.waypoints)
    zones = [
        {"name": zone.name, "polygon": degrees(zone.shape.corners)} for zone in map_.airspace.zones
    ]
    planner = {"clearance_m": map_.airspace.clearance_m, "max_edge_m": map_.max_edge_m}
    return "\n".join(
        f"{key}: {json.dumps(value)}"
        for key, value in {
            "home": home,
            "altitude_m": 40,
            "planner": planner,
            "fence": {"polygon": degrees(fence.corners)},
            "waypoints": waypoints,
            "no_fly_zones": zones,
        }.items()
    )


def bare_edges(mission: Any) -> int:
    zones = shapely.union_all([zone.polygon for zone in mission.zones])
    places = [w.position for w in mission.waypoints]
    lines = [shapely.LineString((a, b)) for a in places for b in places if a < b]
    return int((shapely.distance(lines, zones) >= mission.planner.clearance_m).sum())


def place(chance: random.Random, mission: Any) -> Point:
    while True:
        point = Point(chance.uniform(-180, 140), chance.uniform(-180, 90))
        if mission.planning_airspace.point_clear(point):
            return point


def median_ms(function: Any, times: int, clock: Any = time.perf_counter) -> float:
    values = []
    for _ in range(times):
        began_s = clock()
        function()
        values.append((clock() - began_s) * 1e3)
    return statistics.median(values)


def row(what: str, value: float, unit: str, note: str = "") -> dict[str, Any]:
    return {"what": what, "value": value, "unit": unit, "note": note}
