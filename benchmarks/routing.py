"""How long a mission takes to load, its graph to build, and a route to find."""

import random
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import shapely

from air_router.mission.loading import load_mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from geo.frame import Point

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


def median_ms(function: Any, times: int) -> float:
    values = []
    for _ in range(times):
        began_s = time.perf_counter()
        function()
        values.append((time.perf_counter() - began_s) * 1e3)
    return statistics.median(values)


def row(what: str, value: float, unit: str, note: str = "") -> dict[str, Any]:
    return {"what": what, "value": value, "unit": unit, "note": note}
