"""Rows over areas: what they see is judged point by point, their legs by the airspace."""

import itertools
import json
import math
import random
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from geo.airspace.airspace import Airspace
from geo.airspace.zone import Circle, Outline, Zone
from geo.coverage.coverage import CoverageError, Swath, UnseenCause, cover
from geo.frame import Point
from tests.geo.shapes import box_ring as box
from tests.geo.shapes import star

MAPS = Path(__file__).parents[2] / "data" / "maps"
OPEN = Airspace(None, [], 5.0)
FIELD = Polygon([(0, 0), (300, 0), (300, 200), (0, 200)])
SWATH = Swath(across_m=40.0, along_m=30.0, spacing_m=30.0)


def plan(area, airspace=OPEN, swath=SWATH, **options):
    return cover(area, airspace, swath, **options)


def seen_share(coverage, area, airspace, swath, step_m=2.0):
    """Which share of the ground outside of zones some row sees: point by point."""
    west, south, east, north = area.bounds
    grid = np.mgrid[west:east:step_m, south:north:step_m].reshape(2, -1).T + step_m / 2
    grid = grid[shapely.contains_xy(area, *grid.T)]
    for zone in airspace.zones:
        grid = grid[~shapely.contains_xy(zone.polygon, *grid.T)]
    bearing = math.radians(coverage.bearing_deg)
    ahead, right = (math.sin(bearing), math.cos(bearing)), (math.cos(bearing), -math.sin(bearing))
    seen = np.zeros(len(grid), dtype=bool)
    for row in coverage.rows:
        along, across = (grid - row.start) @ ahead, (grid - row.start) @ right
        end = np.subtract(row.end, row.start) @ ahead
        low, high = min(0.0, end) - swath.along_m / 2, max(0.0, end) + swath.along_m / 2
        seen |= (np.abs(across) <= swath.across_m / 2) & (along >= low) & (along <= high)
    return seen.mean()


def check(coverage, area, airspace, swath=SWATH):
    for leg in coverage.legs:
        assert airspace.leg_clear(*leg), leg
    assert seen_share(coverage, area, airspace, swath) == pytest.approx(coverage.share, abs=0.02)
    missed_m2 = sum(part.area_m2 for part in coverage.missed)
    assert coverage.seen.area + missed_m2 == pytest.approx(coverage.target.area, abs=1.0)
    legs = {frozenset(leg) for leg in itertools.pairwise(coverage.track)}
    for row in coverage.rows:
        assert row.start == row.end or frozenset((row.start, row.end)) in legs
    assert all(a != b for a, b in coverage.legs)


def test_an_open_field_is_seen_whole_by_as_few_rows_as_can_be():
    coverage = plan(FIELD)
    check(coverage, FIELD, OPEN)
    assert coverage.share == pytest.approx(1.0)
    assert coverage.missed == ()
    assert coverage.bearing_deg == 90.0  # along the longer side
    norths = sorted({round(row.start.north_m, 6) for row in coverage.rows})
    assert norths == pytest.approx(np.linspace(20, 180, 7))  # 160 m, at most 30 m apart
    assert len(coverage.rows) == 7
    assert coverage.length_m == pytest.approx(7 * 300 + 160)


def test_the_bearing_can_be_chosen():
    coverage = plan(FIELD, bearing_deg=180.0)
    assert coverage.bearing_deg == 0.0
    assert len(coverage.rows) == 10
    for row in coverage.rows:
        assert row.start.east_m == pytest.approx(row.end.east_m)


def test_a_field_narrower_than_a_picture_is_one_row_in_the_middle():
    coverage = plan(Polygon([(0, 0), (300, 0), (300, 20), (0, 20)]))
    (row,) = coverage.rows
    assert (row.start.north_m, row.end.north_m) == pytest.approx((10, 10))
    assert coverage.share == pytest.approx(1.0)


def test_zones_are_cut_out_and_flown_around():
    airspace = Airspace(
        box(-10, -10, 310, 210),
        [Zone("barn", box(100, 60, 160, 120)), Zone("mast", box(220, 150, 224, 154))],
        5.0,
    )
    coverage = plan(FIELD, airspace, start=Point(5, 5))
    check(coverage, FIELD, airspace)
    assert coverage.share > 0.99
    assert coverage.way_out[0] == coverage.way_back[-1] == Point(5, 5)
    assert coverage.target.area == pytest.approx(FIELD.area - 60 * 60 - 16)


def test_a_hole_in_the_area_need_not_be_seen_but_may_be_flown_over():
    holed = FIELD.difference(Polygon(box(100, 60, 200, 140)))
    coverage = plan(holed)
    check(coverage, holed, OPEN)
    assert coverage.share == pytest.approx(1.0)
    assert sum(row.length_m for row in coverage.rows) < 7 * 300


def test_the_start_decides_on_which_side_of_a_wall():
    wall = Airspace(box(-10, -10, 310, 210), [Zone("wall", box(148, -20, 152, 220))], 5.0)
    coverage = plan(FIELD, wall, start=Point(10, 10))
    check(coverage, FIELD, wall)
    (missed,) = [m for m in coverage.missed if m.why is UnseenCause.APART]
    assert missed.by in {"wall", "fence"}
    assert missed.place.east_m > 150
    assert 0.4 < coverage.share < 0.6


def test_what_no_place_can_see_is_named():
    narrow = Airspace(None, [Zone("a", box(0, 0, 300, 98)), Zone("b", box(0, 102, 300, 200))], 5.0)
    coverage = plan(FIELD.buffer(30, join_style="mitre"), narrow, Swath(8.0, 6.0, 6.0))
    missed = {(m.why, m.by) for m in coverage.missed}
    assert missed & {(UnseenCause.NEAR, "a"), (UnseenCause.NEAR, "b")}
    outside = Airspace(box(0, 0, 100, 200), [], 5.0)
    coverage = plan(FIELD, outside)
    assert coverage.missed[0].why is UnseenCause.OUTSIDE
    assert coverage.missed[0].area_m2 > 30_000


@settings(max_examples=settings.default.max_examples // 4)
@given(st.integers(0, 10**6))
def test_circles_holes_clearances_of_their_own_and_several_fences(seed):
    chance = random.Random(seed)
    zones = []
    for number in range(chance.randint(1, 6)):
        centre = Point(chance.uniform(0, 300), chance.uniform(0, 200))
        clearance_m = chance.choice([None, 0.0, 12.0])
        if chance.random() < 0.5:
            shape = Circle(centre, chance.uniform(2, 40))
        else:
            east, north = centre
            hole = box(east - 15, north - 12, east + 15, north + 12)
            shape = Outline(box(east - 25, north - 25, east + 25, north + 25), (hole,))
        zones.append(Zone(str(number), shape, clearance_m=clearance_m))
    fences = [Circle(Point(150, 100), 210.0), Outline(box(-20, -20, 330, 230))]
    airspace = Airspace(fences, zones, 5.0, 1.5)
    coverage = plan(FIELD, airspace, Swath(35.0, 25.0, 20.0))
    check(coverage, FIELD, airspace, Swath(35.0, 25.0, 20.0))


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, 45.0, None])
def test_zones_in_line_with_the_rows_that_touch_each_other(bearing_deg):
    zones = [
        Zone(f"{east} {north}", box(east, north, east + 20, north + 20))
        for east, north in ((40, 35), (60, 35), (60, 55), (140, 80), (160, 100), (220, 20))
    ]
    airspace = Airspace(box(0, 0, 300, 200), zones, 5.0)
    coverage = plan(FIELD, airspace, bearing_deg=bearing_deg, start=Point(10, 10))
    check(coverage, FIELD, airspace)
    assert coverage.share > 0.98


@pytest.mark.parametrize("name", ["W100_Z3", "W100_Z20"])
def test_the_maps_of_the_router(name):
    data = json.loads((MAPS / f"{name}_disjoint.json").read_text())
    zones = [Zone(str(n), tuple(Point(*c) for c in z)) for n, z in enumerate(data["zones"])]
    fence = tuple(Point(*corner) for corner in data["fence"])
    airspace = Airspace(fence, zones, data["clearance"])
    swath = Swath(100.0, 70.0, 80.0)
    coverage = plan(Polygon(fence), airspace, swath)
    check(coverage, Polygon(fence), airspace, swath)
    assert coverage.share > 0.998
    inside = airspace.as_drawn()
    assert all(inside.leg_clear(*leg) for leg in coverage.legs)


def test_what_cannot_be_covered_at_all_is_reported():
    with pytest.raises(CoverageError, match="no ground outside of no-fly zones"):
        plan(FIELD, Airspace(None, [Zone("all", box(-1, -1, 301, 201))], 5.0))
    with pytest.raises(CoverageError, match="no place to fly"):
        plan(FIELD, Airspace(box(0, 0, 8, 8), [], 5.0))
    with pytest.raises(CoverageError, match="the start does not keep"):
        plan(FIELD, Airspace(box(0, 0, 300, 200), [], 5.0), start=Point(1, 1))
    with pytest.raises(CoverageError, match="would take 20000 rows; fly higher"):
        plan(FIELD, swath=Swath(0.01, 0.01, 0.01), bearing_deg=90.0)
    with pytest.raises(CoverageError, match="no row over the area"):
        plan(FIELD, Airspace(box(900, 900, 990, 990), [], 5.0))


@pytest.mark.parametrize("numbers", [(10, 10, 11), (10, 0, 5), (10, 10, 0), (math.nan, 1, 1)])
def test_swaths_that_leave_gaps_are_refused(numbers):
    with pytest.raises(CoverageError):
        Swath(*numbers)


def any_star(chance, centre, least_m, most_m):
    count, turn = chance.randint(3, 9), chance.uniform(0, math.tau)
    return star(Point(*centre), [chance.uniform(least_m, most_m) for _ in range(count)], turn)


@settings(max_examples=settings.default.max_examples // 3)
@given(st.integers(0, 10**6))
def test_random_concave_areas_with_zones(seed):
    chance = random.Random(seed)
    area = Polygon(any_star(chance, (0, 0), 80, 250))
    zones = [
        Zone(
            str(number),
            any_star(chance, (chance.uniform(-200, 200), chance.uniform(-200, 200)), 5, 45),
        )
        for number in range(chance.randint(0, 7))
    ]
    airspace = Airspace(box(-260, -260, 260, 260), zones, chance.choice([0.0, 3.0, 6.5]))
    swath = Swath(chance.uniform(30, 80), chance.uniform(20, 60), 28.0)
    coverage = plan(area, airspace, swath)
    check(coverage, area, airspace, swath)
    apart_m2 = sum(m.area_m2 for m in coverage.missed if m.why is not UnseenCause.SLIVER)
    assert coverage.seen.area > 0.96 * (coverage.target.area - apart_m2)
