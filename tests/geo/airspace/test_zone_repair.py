"""Borders that cross or touch themselves become all the area that they may mean."""

import itertools
import math

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, MultiPoint, Polygon

from geo.airspace.zone import Outline, ZoneError
from geo.airspace.zone_repair import STRIP_M, repaired
from geo.frame import Point
from tests.geo.exact import inside
from tests.geo.shapes import box_ring, outlines, ring

NEAR_M = 2e-3

BOW_TIE = ring((0, 0), (100, 100), (100, 0), (0, 30))
PENTAGRAM = tuple(
    Point(100 * math.sin(0.8 * math.pi * k), 100 * math.cos(0.8 * math.pi * k)) for k in range(5)
)
SPIKE = ring((0, 0), (100, 0), (100, 100), (50, 100), (50, 180), (50, 100), (0, 100))
THERE_AND_BACK = ring((0, 0), (100, 0))
ONE_PLACE = ring((5, 5), (5, 5), (5, 5))


def area_of(outlines):
    return shapely.union_all([outline.polygon for outline in outlines])


def winding(point, corners):
    """How often a border leads around a point, by the angles that its sides subtend."""
    turns = 0.0
    for a, b in itertools.pairwise([*corners, corners[0]]):
        ax, ay, bx, by = a[0] - point[0], a[1] - point[1], b[0] - point[0], b[1] - point[1]
        turns += math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return round(turns / math.tau)


# On a coarse grid corners coincide, and sides cross and lie on each other, all the time.
small = st.integers(0, 6).map(lambda value: 10.0 * value)
anywhere = st.floats(0, 60).map(lambda value: round(value, 2))
rings = st.one_of(
    st.lists(st.builds(Point, small, small), min_size=1, max_size=9),
    st.lists(st.builds(Point, anywhere, anywhere), min_size=1, max_size=9),
).map(tuple)
PLACES = [(2.6 + 4.9 * i, 1.7 + 5.3 * j) for i in range(-1, 13) for j in range(-1, 13)]


@given(rings)
def test_no_reading_of_a_border_has_a_place_outside_of_its_repair(corners):
    area = area_of(repaired(corners))
    assert area.distance(MultiPoint(corners)) == 0
    line = LineString([*corners, corners[0]])
    assert line.difference(area.buffer(NEAR_M)).length == 0
    enclosed = [p for p in PLACES if winding(p, corners) != 0 or inside(p, corners)]
    if enclosed:
        assert MultiPoint(enclosed).difference(area.buffer(1e-9)).is_empty
    if len(corners) > 2:
        for method in ("linework", "structure"):
            reading = shapely.make_valid(Polygon(corners), method=method)
            assert reading.difference(area.buffer(NEAR_M)).area < 1e-9


@given(rings, st.lists(rings, max_size=3))
def test_nor_has_any_reading_of_a_border_with_holes(corners, holes):
    area = area_of(repaired(corners, holes))
    near = area.buffer(1e-9)
    for place in PLACES:
        odd = sum(inside(place, border) for border in (corners, *holes)) % 2
        assert not odd or near.covers(shapely.Point(place))


@given(outlines())
def test_a_sound_outline_stays_as_it_is(outline):
    assert area_of(repaired(outline.ring, outline.holes)).symmetric_difference(
        outline.polygon
    ).area == pytest.approx(0, abs=1e-6)


@given(rings)
def test_what_is_repaired_is_sound_and_encloses_no_more_than_the_border_does(corners):
    for outline in repaired(corners):
        Outline(outline.ring)
        hull = MultiPoint(corners).convex_hull
        assert hull.buffer(2 * STRIP_M).covers(outline.polygon)


@pytest.mark.parametrize(
    ("corners", "area_m2", "parts"),
    [
        (box_ring(0, 0, 100, 100), 10_000, 1),
        (BOW_TIE, (100 * 1000 / 13 + 30 * 300 / 13) / 2, 2),  # its two triangles
        (PENTAGRAM, 11_225.7, 1),  # its centre too, which even-odd leaves out
        (SPIKE, 10_000 + 80 * 2 * STRIP_M, 1),
        (THERE_AND_BACK, 2 * STRIP_M * (100 + 2 * STRIP_M), 1),
        (ONE_PLACE, 4 * STRIP_M**2, 1),
    ],
)
def test_areas_of_borders_that_are_drawn_wrong(corners, area_m2, parts):
    areas = repaired(corners)
    assert sum(outline.polygon.area for outline in areas) == pytest.approx(area_m2, rel=0.01)
    assert len(areas) == parts


def test_holes_stay_open_only_where_every_reading_agrees():
    fence = box_ring(0, 0, 100, 100)
    good, touching, other = (
        box_ring(5, 5, 10, 10),
        box_ring(20, 20, 30, 30),
        box_ring(25, 25, 40, 40),
    )
    outside, across = box_ring(200, 0, 210, 10), box_ring(90, 50, 120, 60)
    (one,) = repaired(fence, [good])
    assert one.holes == (good,)
    (one,) = repaired(fence, [good, touching, other])
    assert one.holes == (good,)
    one, island = sorted(repaired(fence, [good, outside, across]), key=lambda o: o.ring[0][0] > 150)
    assert one.holes == (good,)
    assert one.polygon.area == pytest.approx(10_000 - 25 + 20 * 10)
    assert island.polygon.area == pytest.approx(100)
    assert area_of(repaired(PENTAGRAM, [box_ring(-5, -5, 5, 5)])).covers(shapely.Point(0, 0))


@pytest.mark.parametrize("corners", [(), ring((0, 0), (math.nan, 1), (1, 1))])
def test_what_has_no_place_cannot_be_repaired(corners):
    with pytest.raises(ZoneError):
        repaired(corners)
