import itertools
import math

import pytest

from geo.airspace.airspace import FENCE, Airspace
from geo.frame import Point
from geo.paths.shortest import ShortestPaths
from tests.geo.shapes import box, ring


def airspace(*zones, fence=None, clearance_m=5.0):
    return Airspace(fence and ring(*fence), zones, clearance_m)


P = Point
FENCED = [(-100, -100), (100, -100), (100, 100), (-100, 100)]
NOTCHED = [
    (-100, -100),
    (100, -100),
    (100, 100),
    (20, 100),
    (20, 0),
    (-20, 0),
    (-20, 100),
    (-100, 100),
]


def test_a_leg_is_clear_at_exactly_the_clearance_and_not_below():
    space = airspace(box("hall", 0, 0, 10, 10))
    assert space.leg_clear(P(-20, 15), P(30, 15))
    assert not space.leg_clear(P(-20, 14.999), P(30, 14.999))
    assert space.point_clear(P(-5, 5))
    assert not space.point_clear(P(-4.999, 5))
    assert not space.point_clear(P(5, 5))


def test_a_leg_without_length_is_its_point():
    space = airspace(box("hall", 0, 0, 10, 10), fence=FENCED)
    for point in (P(5, 14), P(97, 50)):
        assert not space.leg_clear(point, point)
        assert not space.swept_clear([point, point])
        assert space.legs_clear(point, [point]) == [False]
        assert len(space.blockers(point, point)) == 1
    assert space.leg_clear(P(5, 16), P(5, 16))


def test_blockers_are_named():
    space = airspace(box("a", 0, 0, 10, 10), box("b", 30, 0, 40, 10), fence=FENCED)
    assert space.blockers(P(-50, 5), P(20, 5)) == ("a",)
    assert space.blockers(P(-50, 5), P(150, 5)) == ("a", "b", FENCE)
    assert space.blockers(P(-50, 50), P(20, 50)) == ()


def test_both_ends_inside_a_notched_fence_but_not_the_leg():
    space = airspace(fence=NOTCHED)
    assert space.point_clear(P(-60, 50))
    assert space.point_clear(P(60, 50))
    assert not space.leg_clear(P(-60, 50), P(60, 50))
    assert space.leg_clear(P(-60, -5), P(60, -5))
    assert not space.leg_clear(P(-60, -4.9), P(60, -4.9))


def test_outside_of_the_fence_nothing_is_clear():
    space = airspace(fence=FENCED)
    assert not space.leg_clear(P(200, 200), P(300, 300))
    assert not space.point_clear(P(200, 200))
    assert space.distance_m(P(103, 0)) == pytest.approx(-3)
    assert space.distance_m(P(97, 0)) == pytest.approx(3)


def test_no_way_along_the_seam_of_two_zones():
    for clearance_m in (0, 5):
        touching = airspace(
            box("w", 0, 0, 10, 10), box("e", 10, 0, 20, 10), clearance_m=clearance_m
        )
        assert not touching.leg_clear(P(10, -5), P(10, 15))
        corner = airspace(
            box("sw", 0, 0, 10, 10), box("ne", 10, 10, 20, 20), clearance_m=clearance_m
        )
        assert not corner.leg_clear(P(0, 20), P(20, 0))


def test_without_clearance_a_leg_may_not_cross_or_touch():
    space = airspace(box("hall", 0, 0, 10, 10), fence=FENCED, clearance_m=0)
    assert not space.leg_clear(P(-20, 5), P(30, 5))
    assert not space.leg_clear(P(-20, 10), P(30, 10))
    assert space.leg_clear(P(-20, 10.001), P(30, 10.001))
    assert not space.leg_clear(P(0, 50), P(0, 150))


def test_a_swept_area_is_more_than_its_sides():
    space = airspace(box("mast", 45, 20, 46, 21))
    corners = [P(0, 0), P(100, 0), P(50, 80)]
    sides = [*itertools.pairwise(corners), (corners[2], corners[0])]
    assert all(space.leg_clear(a, b) for a, b in sides)
    assert not space.swept_clear(corners)
    assert space.swept_clear([P(0, 0), P(100, 0), P(50, 0)])  # a hull that is a line
    assert not space.swept_clear([P(46, 21)])  # and one that is a point


def test_distance_is_negative_inside_a_zone():
    space = airspace(box("hall", 0, 0, 10, 10))
    assert space.distance_m(P(5, 3)) == pytest.approx(-3)
    assert space.distance_m(P(5, 13)) == pytest.approx(3)
    assert airspace().distance_m(P(0, 0)) == math.inf


def test_closest_approach_of_a_track():
    space = airspace(box("hall", 0, 0, 10, 10), fence=FENCED)
    assert space.track_distance_m([P(-50, 20), P(50, 20)]) == (10, "hall")
    assert space.track_distance_m([P(-50, 97), P(50, 97)]) == (pytest.approx(3), FENCE)
    assert space.track_distance_m([P(-50, 8), P(5, 8)]) == (-2, "hall")
    assert space.track_distance_m([P(-50, 5), P(50, 5)]) == (0, "hall")
    assert space.track_distance_m([P(150, 0), P(160, 0)]) == (-60, FENCE)
    assert space.track_distance_m([P(0, 13)]) == (3, "hall")
    assert airspace().track_distance_m([P(0, 0), P(1, 1)]) == (math.inf, "")
    assert space.track_distance_m([]) == (math.inf, "")


def test_nearest_clear_place():
    space = airspace(box("hall", 0, 0, 10, 10), fence=FENCED)
    paths = ShortestPaths(space)
    assert paths.nearest(P(50, 50)) == (50, 50)
    assert paths.nearest(P(5, 8)) == pytest.approx((5, 15), abs=0.05)
    assert paths.nearest(P(0, 300)) == pytest.approx((0, 95), abs=0.05)
    full = airspace(box("all", -99, -99, 99, 99), fence=FENCED)
    assert ShortestPaths(full).nearest(P(0, 0)) is None


def test_holders_name_what_one_is_in():
    space = airspace(box("a", 0, 0, 10, 10), box("b", 5, 5, 20, 20), fence=FENCED)
    assert space.zones_at(P(7, 7)) == ("a", "b")
    assert space.zones_at(P(0, 200)) == (FENCE,)
    assert space.without(["a"]).zones_at(P(7, 7)) == ("b",)
    assert space.without([FENCE]).zones_at(P(0, 200)) == ()


@pytest.mark.parametrize("clearance_m", [-1, math.nan, math.inf])
def test_a_clearance_is_a_distance(clearance_m):
    with pytest.raises(ValueError, match="clearance"):
        airspace(clearance_m=clearance_m)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("zones", [[], [box("hall", 0, 0, 10, 10)]])
@pytest.mark.parametrize("fence", [None, FENCED])
def test_what_is_not_finite_is_not_clear(fence, zones, wrong):
    space, here = airspace(*zones, fence=fence), P(-50, 50)
    for there in (P(wrong, 50), P(-50, wrong)):
        assert not space.point_clear(there)
        assert not space.leg_clear(here, there)
        assert not space.leg_clear(there, here)
        assert space.legs_clear(here, [there, P(-40, 50)]) == [False, True]
        assert space.legs_clear(there, [here]) == [False]
        assert not space.swept_clear([here, P(-40, 50), there])
        paths = ShortestPaths(space)
        assert paths.path(here, there) is paths.path(there, here) is None
        assert paths.part_of(there) is paths.nearest(there) is paths.nearest(here, there) is None
        assert not paths.connected(here, there)
