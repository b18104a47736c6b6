"""Lines over areas, against shapely's own intersection."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Polygon

from geo.coverage.visibility import (
    Border,
    CoverageError,
    Swath,
    Sweep,
    Visibility,
    common,
    merged,
)
from geo.frame import Point
from tests.geo.shapes import star

SQUARE = Polygon([(0, 0), (10, 0), (10, 10), (0, 10)])


@pytest.mark.parametrize("bearing_deg", [0.0, 30.0, 90.0, 179.0, 271.5])
def test_a_sweep_keeps_lengths_and_turns_back(bearing_deg):
    sweep = Sweep(bearing_deg)
    ahead = sweep.place(1.0, 0.0)
    assert ahead == pytest.approx(
        (math.sin(math.radians(bearing_deg)), math.cos(math.radians(bearing_deg)))
    )
    right = sweep.place(0.0, 1.0)
    turned = math.radians(bearing_deg + 90)
    assert right == pytest.approx((math.sin(turned), math.cos(turned)))
    across_m, span = sweep.span(sweep.place(7.0, 3.0), sweep.place(-2.0, 3.0))
    assert across_m == pytest.approx(3.0)
    assert span == pytest.approx((-2.0, 7.0))
    assert sweep.turned(sweep.turned(SQUARE)).equals_exact(SQUARE, 1e-9)


def test_corners_and_sides_count_once():
    levels = np.array([-1.0, 0.0, 5.0, 10.0, 11.0])
    spans = Border(SQUARE).spans(levels)
    assert spans[0] == spans[4] == []
    assert spans[2] == [(0.0, 10.0)]
    pointed = Polygon([(0, 0), (5, 5), (10, 0), (10, 10), (0, 10)])
    diamond = Polygon([(0, 0), (5, 5), (0, 10), (-5, 5)])
    assert Border(diamond).spans(np.array([5.0])) == [[(-5.0, 5.0)]]
    assert Border(pointed).spans(np.array([5.0]))[0] in ([(0.0, 10.0)], [(0.0, 5.0), (5.0, 10.0)])


def test_holes_are_left_out():
    holed = SQUARE.difference(Polygon([(4, 4), (6, 4), (6, 6), (4, 6)]))
    assert Border(holed).spans(np.array([5.0])) == [[(0.0, 4.0), (6.0, 10.0)]]
    assert Border(holed).total(np.array([1.0, 5.0])) == (3, 18.0)


def test_nothing_has_no_pieces():
    assert Border(Polygon()).spans(np.array([0.0, 1.0])) == [[], []]
    assert Border(SQUARE).spans(np.empty(0)) == []


radii = st.lists(st.floats(2.0, 50.0), min_size=3, max_size=14)


@given(radii, radii, st.floats(0, 180))
def test_pieces_are_those_of_shapely(outer, inner, bearing_deg):
    hole = Polygon(star(Point(5, 1), [r / 3 for r in inner]))
    area = Polygon(star(Point(0, 0), outer)).difference(hole)
    sweep = Sweep(bearing_deg)
    turned = sweep.turned(area)
    levels = np.linspace(-55.1, 54.7, 23)
    for level, spans in zip(levels, Border(turned).spans(levels), strict=True):
        line = LineString([(-200, level), (200, level)]).intersection(turned)
        assert sum(end - begin for begin, end in spans) == pytest.approx(line.length, abs=1e-6)
        for begin, end in spans:
            middle = sweep.place((begin + end) / 2, level)
            assert shapely.Point(middle).distance(area) < 1e-6
            assert Point(*middle) == middle


@pytest.mark.parametrize(("depth_m", "count"), [(5_000.0, 5_000), (5_000.5, None)])
def test_as_many_rows_as_may_be(depth_m, count):
    strip = shapely.box(0.0, 0.0, 10.0, depth_m)
    sight = Visibility(strip, strip, Swath(1.0, 1.0, 1.0))
    if count is None:
        with pytest.raises(CoverageError, match="would take 5001 rows"):
            sight.levels(strip, strip)
    else:
        assert len(sight.levels(strip, strip)) == count


def test_spans_merge_and_meet():
    assert merged([(5, 6), (0, 2), (1, 3), (3, 4)]) == [(0, 4), (5, 6)]
    assert common([(0, 4), (5, 9)], [(3, 6), (8, 20)]) == [(3, 4), (5, 6), (8, 9)]
    assert merged([(0, 10), (2, 3), (9, 10)]) == [(0, 10)]  # one within another
    assert common([(0, 1)], [(2, 3)]) == []
    assert common([(0, 1)], [(1, 3)]) == [(1, 1)]  # a look is enough
