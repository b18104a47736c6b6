"""The bench of routes: its maps are the same every time, its cells give figures."""

import math

from benchmarks.route.maps import made
from benchmarks.route.measure import measured


def test_maps_are_the_same_every_time_and_their_places_are_clear():
    one, other = made(30, 20), made(30, 20)
    assert one.airspace.zones == other.airspace.zones
    assert one.pairs == other.pairs
    assert made(30, 20, seed=2).pairs != one.pairs
    places = [*one.waypoints, *(place for pair in one.pairs for place in pair)]
    assert all(one.airspace.point_clear(place) for place in places)


def test_both_planners_are_measured_against_the_shortest_lengths():
    map_ = made(20, 3, pairs=6)
    cells = {name: measured(name, map_, 1) for name in ("arcs", "shortest", "waypoints")}
    for name, cell in cells.items():
        assert len(cell["lengths_m"]) == 6
        assert cell["build_ms"] > 0
        assert cell["cold_worst_ms"] >= cell["cold_median_ms"]
        for length_m, best_m in zip(cell["lengths_m"], cells["arcs"]["lengths_m"], strict=True):
            assert length_m >= best_m * (1 - 1e-4), name
        direct_m = [math.dist(start, goal) for start, goal in map_.pairs]
        assert all(m >= d - 1e-6 for m, d in zip(cell["lengths_m"], direct_m, strict=True))
