"""Shortest paths on many maps, judged by plain distances and by brute force."""

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon

from benchmarks.route.maps import made, read
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from geo.paths.polyanya import Source
from geo.paths.shortest import ShortestPaths, path_length_m, shortest_path
from tests.geo.optimum import BruteForce, gridded, least_m, places, ring, scattered

pytestmark = pytest.mark.long

MAPS = sorted((Path(__file__).parents[2] / "data" / "maps").glob("*.json"))


@pytest.mark.parametrize("path", MAPS, ids=lambda path: path.stem)
def test_every_pair_of_the_maps_has_a_clear_path(path):
    check_pairs(read(path))


def test_every_pair_of_a_large_map_has_a_clear_path():
    check_pairs(made(20, 500))


def check_pairs(map_):
    paths = ShortestPaths(map_.airspace)
    (fence,) = map_.airspace.fences
    zones = [Polygon(zone.shape.ring) for zone in map_.airspace.zones]
    for start, goal in map_.pairs:
        path = paths.path(start, goal)
        assert path is not None
        assert (path[0], path[-1]) == (start, goal)
        assert least_m(path, Polygon(fence.ring), zones) >= map_.airspace.clearance_m - 1e-6
        assert path_length_m(path) >= math.dist(start, goal) - 1e-9


@pytest.mark.parametrize("part", range(2))
def test_random_maps(part):
    for seed in range(100 * part, 100 * part + 100):
        ground, chance = (scattered if seed % 4 else gridded)(seed)
        found = places(chance, 12, None if seed % 4 else 5)
        clear = [place for place in found if ground.least_m([place, place]) >= 5.001]
        if len(clear) < 2:
            continue
        start, goal = clear[:2]
        path = ShortestPaths(ground.airspace).path(start, goal)
        if path is None:
            assert not ground.connected(start, goal), seed
        else:
            assert (path[0], path[-1]) == (start, goal)
            assert ground.least_m(path) >= 5 - 1e-6, seed


def pairs(many):
    return list(zip(many[::2], many[1::2], strict=True))


@lru_cache(maxsize=25)
def searched(kind, seed):
    """Who sees whom takes brute force most of its time, whatever the goal is then."""
    ground, _ = kind(seed)
    return ShortestPaths(ground.airspace), BruteForce(ground.grown())


def ratios(kind, seeds, step=None):
    found = []
    for seed in seeds:
        ground, chance = kind(seed)
        paths, optimum = searched(kind, seed)
        for start, goal in pairs(places(chance, 6, step)):
            if not (optimum.holds(start) and optimum.holds(goal)):
                continue
            path, best_m = paths.path(start, goal), optimum.length_m(start, goal)
            assert (path is None) == math.isinf(best_m), (seed, start, goal)
            if path is not None and best_m > 0:
                found.append(path_length_m(path) / best_m)
                assert ground.least_m(path) >= 5 - 1e-6
    return np.array(found)


@pytest.mark.parametrize(("kind", "step"), [(scattered, None), (gridded, None), (gridded, 5)])
def test_lengths_are_those_that_brute_force_finds(kind, step):
    found = ratios(kind, range(3000, 3008), step)
    assert len(found) > 8
    assert np.median(found) <= 1.0005
    assert found.max() <= 1.05
    assert found.min() >= 0.999  # its arcs are a little larger than ours


@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0.0, 5.0]))
def test_searches_find_what_brute_force_finds_in_the_same_area(seed, on_grid, clearance_m):
    ground, chance = (gridded if on_grid else scattered)(seed)
    paths = ShortestPaths(ground.airspace.with_margin(clearance_m - 5))
    optimum = BruteForce(shapely.union_all(paths.space.lean))
    for start, goal in pairs(places(chance, 6, 5 if on_grid else None)):
        path = shortest_path(paths.mesh, [Source(0.0, start)], goal)
        if path is not None:
            assert path_length_m(path) == pytest.approx(optimum.length_m(start, goal), abs=1e-4)
        elif optimum.holds(start) and optimum.holds(goal):
            assert paths.part_of(start) != paths.part_of(goal)


@pytest.mark.parametrize("kind", [scattered, gridded])
def test_planning_again_from_corners_and_from_the_middle_of_legs(kind):
    planned = 0
    for seed in range(4000, 4012):
        ground, chance = kind(seed)
        paths = ShortestPaths(ground.airspace)
        for start, goal in pairs(places(chance, 8)):
            path = paths.path(start, goal)
            if path is None:
                continue
            for leg in range(len(path) - 1):
                for share in (0.0, 0.37, 1.0) if leg else (0.37, 1.0):
                    here = Point(
                        path[leg][0] + share * (path[leg + 1][0] - path[leg][0]),
                        path[leg][1] + share * (path[leg + 1][1] - path[leg][1]),
                    )
                    left_m = path_length_m((here, *path[leg + 1 :]))
                    again = paths.path(here, goal)
                    assert again is not None, (seed, here, goal)
                    assert path_length_m(again) <= 1.01 * left_m + 1e-6, (seed, here, goal)
                    assert ground.least_m(again) >= 5 - 1e-6
                    planned += 1
    assert planned > 40


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_paths_are_the_same_both_ways(seed, on_grid):
    ground, chance = (gridded if on_grid else scattered)(seed)
    start, goal = places(chance, 2, 5 if on_grid else None)
    paths = ShortestPaths(ground.airspace)
    there, back = paths.path(start, goal), paths.path(goal, start)
    assert (there is None) == (back is None)
    if there is not None:
        assert there == back[::-1]


def test_of_two_ways_as_long_as_each_other_the_same_is_taken_there_and_back():
    far_off = Zone("wall", ring([(16, 156), (15.7, 156.4), (-80.4, 60.4)]), clearance_m=8)
    paths = ShortestPaths(Airspace(None, [Zone("mast", Circle(Point(70, 40), 10)), far_off], 0))
    start, goal = Point(65.0, 55.0), Point(75.0, 25.0)  # the mast is in the middle
    there, back = paths.path(start, goal), paths.path(goal, start)
    assert len(there) > 2
    assert there == back[::-1]


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 5))
def test_more_clearance_never_makes_a_path_shorter_or_possible(seed, more_m):
    ground, chance = scattered(seed)
    start, goal = places(chance, 2)
    narrow = ShortestPaths(ground.airspace).path(start, goal)
    wide = ShortestPaths(ground.airspace.with_margin(more_m)).path(start, goal)
    if wide is not None:
        assert narrow is not None
        # Short paths are looked at more closely than long ones, within 3 %.
        assert path_length_m(narrow) <= 1.03 * path_length_m(wide) + 1e-6
