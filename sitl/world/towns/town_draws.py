"""What a seed draws in a town that is there: where its vehicles stand, and where robots start."""

import math
import random
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Final

from geo.frame import Point
from sitl.world.towns.terrain import Road
from sitl.world.towns.town import Goal, Town
from sitl.world.towns.ways import Ways

APART_M: Final = 25.0
"""Vehicles are at least so far apart, so that two are not taken for one."""

_KERB_M: Final = 2.0


def scatter(town: Town, seed: int, goals: int) -> Town:
    """The same town with its vehicles at other places beside its roads, 25 m apart at least.

    Raises:
        ValueError: there are not so many places, or it is no number of vehicles.
    """
    if goals < 0:
        raise ValueError(f"{goals} vehicles; a town has none at least")
    chance = random.Random(f"goals {seed}")  # noqa: S311 - places, not a secret
    empty = replace(town, goals=())
    costs = Ways(empty.lattice, empty.ground, empty.lattice.cell(town.starts[0])).costs
    places = [
        place for place in _kerbs(town.roads) if math.isfinite(costs[town.lattice.cell(place)])
    ]
    chance.shuffle(places)
    chosen: list[Point] = []
    for place in places:
        if len(chosen) == goals:
            break
        if all(math.dist(place, other) >= APART_M for other in chosen):
            chosen.append(place)
    if len(chosen) < goals:
        raise ValueError(f"only {len(chosen)} vehicles find a place in {town.name}, not {goals}")
    digits = len(str(goals))
    return replace(
        town,
        goals=tuple(Goal(f"v{n:0{digits}d}", place) for n, place in enumerate(chosen, start=1)),
    )


def drawn_starts(town: Town, seed: int, count: int) -> tuple[Point, ...]:
    """Some of a town's starts, in a random order; over again if there are too few."""
    chance = random.Random(f"starts {seed}")  # noqa: S311 - places, not a secret
    starts = list(town.starts)
    chance.shuffle(starts)
    return tuple(starts[number % len(starts)] for number in range(count))


def _kerbs(roads: tuple[Road, ...]) -> Iterator[Point]:
    """Places where a vehicle stands at the side of a road, every 5 m."""
    for road in roads:
        aside_m = max(0.0, road.width_m / 2 - _KERB_M)
        for a, b in pairwise(road.points):
            length_m = math.dist(a, b)
            for k in range(1, int(length_m // 5)):
                for side in (-1, 1):
                    part, off = 5 * k / length_m, side * aside_m / length_m
                    yield Point(
                        half_metres(a[0] + part * (b[0] - a[0]) + off * (b[1] - a[1])),
                        half_metres(a[1] + part * (b[1] - a[1]) - off * (b[0] - a[0])),
                    )


def half_metres(value: float) -> float:
    """To half a metre, so that files of towns are short."""
    return round(value * 2) / 2
