"""Maps made from a seed: scattered concave zones in a fence, waypoints, pairs of start and goal."""

import json
import math
import random
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import shapely
from shapely import Polygon, STRtree

from geo.airspace import Airspace, Zone
from geo.frame import Geodetic, LocalFrame, Point

CLEARANCE_M = 5.0
_APART_M = 2.4 * CLEARANCE_M
"""Zones keep so much between them that there is a way through."""

_PLACE_M = 1.4 * CLEARANCE_M
_IN_TREE = 50
"""So many zones more, and they are looked up as well: making the tree anew takes long."""


@dataclass(frozen=True, slots=True)
class Map:
    name: str
    airspace: Airspace
    waypoints: tuple[Point, ...]
    max_edge_m: float
    pairs: tuple[tuple[Point, Point], ...]


def made(waypoints: int, zones: int, seed: int = 1, pairs: int = 40) -> Map:
    """A map as large as it needs to be for so many zones and waypoints."""
    chance = random.Random(f"{waypoints} {zones} {seed}")
    side_m = max(300.0, 100 * math.sqrt(zones), 60 * math.sqrt(waypoints))
    half_m = side_m / 2 + 40
    fence = tuple(
        Point(*place)
        for step in range(20)
        for place in [_on_square(half_m * chance.uniform(1.0, 1.03), step / 20)]
    )
    rings = _rings(chance, zones, side_m)
    airspace = Airspace(fence, [Zone(f"zone {n}", r) for n, r in enumerate(rings, 1)], CLEARANCE_M)
    tight = airspace.with_margin(_PLACE_M - CLEARANCE_M)

    def place() -> Point:
        while True:
            point = Point(*(round(chance.uniform(-0.5, 0.5) * side_m, 3) for _ in "en"))
            if tight.point_clear(point):
                return point

    return Map(
        f"W{waypoints}_Z{zones}",
        airspace,
        tuple(place() for _ in range(waypoints)),
        min(500.0, 2.29 * side_m / math.sqrt(waypoints)),
        tuple((place(), place()) for _ in range(pairs)),
    )


def walled(map_: Map, *, gate: bool) -> Map:
    """A map with four walls around one of its goals; every pair leads there from outside.

    Args:
        map_: what stands around them.
        gate: corners of two walls leave a gap of little more than twice the distance to keep, which
            rounder corners than cheap ones keep open.
    """
    goal, gap_m = map_.pairs[1][1], (6.0, 8.07) if gate else (0.0, 0.0)
    east_m, north_m = goal
    corners = {  # west, south, east, north of the goal
        "south": (-30.0, -30.0, 30.0 - gap_m[0], -26.0),
        "north": (-30.0, 26.0, 30.0, 30.0),
        "west": (-30.0, -30.0, -26.0, 30.0),
        "east": (30.0, -26.0 + gap_m[1], 34.0, 30.0),
    }
    walls = [
        Zone(name, _ring([[east_m + e, north_m + n] for e, n in ((w, s), (o, s), (o, t), (w, t))]))
        for name, (w, s, o, t) in corners.items()
    ]
    pairs = [(start, goal) for start, _ in map_.pairs if math.dist(start, goal) > 50]
    old = map_.airspace
    airspace = Airspace(old.fences, [*old.zones, *walls], old.clearance_m)
    return replace(map_, airspace=airspace, pairs=tuple(pairs))


def read(path: Path) -> Map:
    """A map from a file: rings and places in metres east and north."""
    data = json.loads(path.read_text())
    zones = [Zone(f"zone {n}", _ring(zone)) for n, zone in enumerate(data["zones"], 1)]
    return Map(
        path.stem,
        Airspace(_ring(data["fence"]), zones, data["clearance"]),
        _ring(data["waypoints"]),
        data["max_edge"],
        tuple((Point(*start), Point(*goal)) for start, goal in data["pairs"]),
    )


def _ring(places: list[list[float]]) -> tuple[Point, ...]:
    return tuple(Point(*place) for place in places)


def _rings(chance: random.Random, zones: int, side_m: float) -> list[tuple[Point, ...]]:
    rings: list[tuple[Point, ...]] = []
    shapes: list[Polygon] = []
    tree, recent = STRtree([]), 0  # of all but those after that number
    while len(rings) < zones:
        reach_m = 0.2 * side_m / math.sqrt(zones) * chance.lognormvariate(0.0, 0.45)
        room_m = side_m / 2 - reach_m
        east_m, north_m = (chance.uniform(-room_m, room_m) for _ in "en")
        corners = chance.randint(4, 40)
        ring = tuple(
            Point(
                round(east_m + reach_m * share * math.cos(angle), 3),
                round(north_m + reach_m * share * math.sin(angle), 3),
            )
            for step in range(corners)
            for angle in [math.tau * (step + chance.uniform(-0.4, 0.4)) / corners]
            for share in [chance.uniform(0.55, 1.0)]
        )
        shape = Polygon(ring)
        if not shape.is_valid:
            continue
        near = len(tree.query(shape, predicate="dwithin", distance=_APART_M)) > 0
        if not (near or shapely.dwithin(shapes[recent:], shape, _APART_M).any()):
            rings.append(ring)
            shapes.append(shape)
            if len(shapes) - recent == _IN_TREE:
                tree, recent = STRtree(shapes), len(shapes)
    return rings


def _on_square(half_m: float, share: float) -> tuple[float, float]:
    """A point on the border of a square, anticlockwise from its south-western corner."""
    side, along = divmod(4 * share, 1.0)
    run = half_m * (2 * along - 1)
    return [(run, -half_m), (half_m, run), (-run, half_m), (-half_m, -run)][int(side)]


def mission_text(map_: Map) -> str:
    """A mission file of the map."""
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
