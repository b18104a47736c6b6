"""Circles, holes, several fences, clearances of zones, margins; and the exact distances of all."""

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from shapely import Point as ShapelyPoint

from geo.airspace.airspace import FENCE, TOLERANCE_M, Airspace
from geo.airspace.zone import Band, Circle, Outline, Zone
from geo.frame import Point
from geo.paths.free_space import FreeSpace
from geo.paths.shortest import ShortestPaths
from geo.validity import Period, Validity
from tests.geo import exact
from tests.geo.shapes import box, box_ring, place, shapes

P = Point
FENCED = box_ring(-100, -100, 100, 100)
DONUT = Outline(box_ring(-50, -50, 50, 50), (box_ring(-30, -30, 30, 30),))


def test_a_circle_is_a_circle():
    space = Airspace(None, [Zone("mast", Circle(P(0, 0), 10))], 5)
    for step in range(97):
        angle = 2 * math.pi * step / 97
        east, north = math.cos(angle), math.sin(angle)
        for reach_m, clear in ((15.0, True), (15.000002, True), (14.99999, False)):
            here = P(reach_m * east, reach_m * north)
            assert space.point_clear(here) is clear
            ahead = P(here.east_m - 50 * north, here.north_m + 50 * east)
            back = P(here.east_m + 50 * north, here.north_m - 50 * east)
            assert space.leg_clear(ahead, back) is clear  # a tangent
        assert space.distance_m(P(17 * east, 17 * north)) == pytest.approx(7, abs=1e-9)
        assert space.distance_m(P(4 * east, 4 * north)) == pytest.approx(-6, abs=1e-9)
    assert space.zones_at(P(9.9, 0)) == ("mast",)
    assert space.zones_at(P(10.001, 0)) == ()
    assert space.track_distance_m([P(-20, 12), P(20, 12)]) == (pytest.approx(2), "mast")
    assert space.track_distance_m([P(-20, 2), P(20, 2)]) == (0, "mast")


def test_a_circle_as_a_fence():
    space = Airspace(Circle(P(0, 0), 100), [], 5)
    assert space.leg_clear(P(-95, 0), P(95, 0))
    assert not space.leg_clear(P(-95.001, 0), P(95, 0))
    assert not space.point_clear(P(200, 0))
    assert space.swept_clear([P(0, 95), P(0, -95), P(95, 0)])
    assert space.distance_m(P(0, 60)) == 40
    assert space.distance_m(P(0, 160)) == -60
    assert space.zones_at(P(0, 101)) == (FENCE,)
    assert space.blockers(P(0, 0), P(0, 96)) == (FENCE,)
    assert space.track_distance_m([P(0, 0), P(0, 90)]) == (10, FENCE)
    assert space.track_distance_m([P(0, 0), P(0, 110), P(0, 0)]) == (-10, FENCE)
    assert ShortestPaths(space).nearest(P(0, 300)) == pytest.approx((0, 95), abs=1)


def test_the_hole_of_a_zone_is_free_and_no_way_leads_out():
    space = Airspace(FENCED, [Zone("wall", DONUT)], 5)
    assert space.point_clear(P(0, 0))
    assert space.point_clear(P(70, 0))
    assert space.leg_clear(P(-25, 0), P(25, 0))
    assert not space.leg_clear(P(-25.1, 0), P(25, 0))
    assert not space.leg_clear(P(0, 0), P(70, 0))
    assert space.distance_m(P(0, 0)) == 30
    assert space.distance_m(P(40, 0)) == -10
    assert space.distance_m(P(32, 0)) == -2
    assert space.zones_at(P(0, 0)) == ()
    assert len(FreeSpace(space).tight()) == 2


def test_the_hole_of_a_fence_is_out_of_bounds():
    space = Airspace(DONUT, [], 5)
    assert not space.point_clear(P(0, 0))
    assert space.point_clear(P(40, 0))
    assert not space.point_clear(P(34, 0))
    assert not space.leg_clear(P(-40, 0), P(40, 0))
    assert space.leg_clear(P(-40, 40), P(40, 40))
    assert space.distance_m(P(20, 0)) == -10
    assert space.zones_at(P(0, 0)) == (FENCE,)


def test_the_vehicle_stays_inside_of_all_fences():
    fences = [Outline(FENCED), Circle(P(100, 0), 80), Outline(box_ring(-200, -30, 200, 30))]
    space = Airspace(fences, [], 5)
    assert space.point_clear(P(60, 0))
    assert space.fences == tuple(fences)
    for beyond in (P(120, 0), P(10, 0), P(60, 50)):
        assert space.zones_at(beyond) == (FENCE,)
        assert not space.leg_clear(P(60, 0), beyond)
    assert space.distance_m(P(60, 20)) == pytest.approx(10)
    (free,) = FreeSpace(space).tight()
    assert free.covers(ShapelyPoint(60, 0))
    west, south, east, north = free.bounds
    assert west > 25
    assert east < 95.01
    assert (south, north) == pytest.approx((-25, 25), abs=0.05)
    apart = Airspace([Circle(P(-50, 0), 10), Circle(P(50, 0), 10)], [], 0)
    assert FreeSpace(apart).tight() == []
    assert ShortestPaths(apart).nearest(P(0, 0)) is None


def test_no_fence_in_every_form():
    for none in (None, (), []):
        space = Airspace(none, [], 5)
        assert space.fences == ()
        assert space.point_clear(P(1e5, 1e5))


def test_a_zone_may_have_its_own_clearance():
    zones = [box("far", 0, 0, 10, 10, clearance_m=20), box("near", 50, 0, 60, 10, clearance_m=0.5)]
    space = Airspace(FENCED, [*zones, box("as ever", -60, 0, -50, 10)], 5)
    assert space.distances_m == (20, 0.5, 5)
    assert not space.point_clear(P(-19, 5))
    assert space.point_clear(P(-20, 5))
    assert space.point_clear(P(49.4, 5))
    assert space.blockers(P(-19, 30), P(-19, -30)) == ("far",)
    assert space.blockers(P(30.1, -30), P(30.1, 30)) == ()
    planning = space.with_margin(1.5)
    assert planning.distances_m == (21.5, 2, 6.5)
    assert planning.fence_distance_m == 6.5
    assert space.with_margin(-3).distances_m == (17, 0, 2)
    assert space.as_drawn().distances_m == (0, 0, 0)
    assert space.as_drawn().fence_distance_m == 0
    assert (space.required_m("far"), space.required_m("near"), space.required_m(FENCE)) == (
        20,
        0.5,
        5,
    )
    with pytest.raises(KeyError):
        space.required_m("nothing")


def test_spare_distance_weighs_what_is_kept():
    zones = [box("far", 0, 0, 10, 10, clearance_m=20), box("near", 40, 0, 60, 10, clearance_m=2)]
    space = Airspace(None, zones, 5)
    assert space.nearest(P(26, 5)) == (14, "near")
    assert space.clearance_left_m(P(26, 5)) == (-4, "far")
    assert space.clearance_left_m(P(39, 5)) == (-1, "near")
    assert Airspace(None, [], 5).clearance_left_m(P(0, 0)) == (math.inf, "")
    assert Airspace(FENCED, [], 5).clearance_left_m(P(97, 0)) == (-2, FENCE)


def test_easing_for_one_zone_takes_little_from_the_others():
    zones = [box("wide", 0, 0, 10, 10, clearance_m=50), box("usual", 100, 0, 110, 10)]
    space = Airspace(FENCED, zones, 5, 1.5)
    assert space.relaxed(3, 4).distances_m == (48.5, 4)
    assert space.relaxed(48, 3.5).distances_m == (3.5, 3.5)
    assert space.relaxed(48, 3.5).fence_distance_m == 3.5
    assert space.relaxed(1, 9).distances_m == (50.5, 6.5)
    assert space.relaxed(99, -2).distances_m == (0, 0)
    assert space.relaxed(48, 3.5).point_clear(P(-4, 5))
    assert not space.point_clear(P(-4, 5))


def test_on_the_way_out_everything_else_still_counts():
    fences = [Circle(P(0, 0), 50), Outline(FENCED)]
    space = Airspace(fences, [box("a", 60, 0, 70, 10), box("b", 65, 5, 80, 20)], 5, 1)
    out = space.without_zones_at(P(66, 6))
    assert out.fences == (fences[1],)
    assert out.zones == ()
    assert [zone.name for zone in space.without_zones_at(P(61, 1)).zones] == ["b"]
    assert space.without_zones_at(P(0, 0)).fences == tuple(fences)
    assert (out.clearance_m, out.margin_m) == (5, 1)


@pytest.mark.parametrize("margin_m", [math.nan, math.inf])
def test_a_margin_is_a_distance(margin_m):
    with pytest.raises(ValueError, match="margin"):
        Airspace(None, [], 5, margin_m)


def test_zones_by_altitude_and_time():
    start = datetime(2026, 11, 20, 8, tzinfo=UTC)
    hour = timedelta(hours=1)
    space = Airspace(
        FENCED,
        [
            box("low", 0, 0, 1, 1, band=Band(upper_m=10)),
            box("high", 0, 0, 1, 1, band=Band(lower_m=60)),
            box("morning", 0, 0, 1, 1, validity=Validity((Period(start, start + hour),))),
            box("always", 0, 0, 1, 1),
        ],
        5,
        1.5,
    )
    names = lambda airspace: [zone.name for zone in airspace.zones]  # noqa: E731
    assert names(space.at(20, 40)) == ["morning", "always"]
    assert names(space.at(10, 60)) == ["low", "high", "morning", "always"]
    assert names(space.during(start + 2 * hour, None)) == ["low", "high", "always"]
    assert names(space.during(start, start)) == ["low", "high", "morning", "always"]
    chosen = space.at(20, 40).during(start + 2 * hour, None)
    assert (chosen.clearance_m, chosen.margin_m, len(chosen.fences)) == (5, 1.5, 1)


def distance_m(a, b, shape):
    """By first principles; 0 where the leg meets the shape."""
    if isinstance(shape, Circle):
        return max(exact.to_circle(a, b, shape.centre, shape.radius_m), 0.0)
    return exact.to_area(a, b, shape.ring, shape.holes)


zones = st.lists(st.tuples(shapes, st.none() | st.floats(0, 12)), max_size=4).map(
    lambda drawn: [Zone(f"z{n}", s, clearance_m=c) for n, (s, c) in enumerate(drawn)]
)
distances = st.floats(0, 15)


@given(zones, place, place, distances, st.floats(-3, 5))
def test_legs_are_judged_by_exact_distance(drawn, a, b, clearance_m, margin_m):
    space = Airspace(None, drawn, clearance_m, margin_m)
    spares = []
    for zone, kept_m in zip(drawn, space.distances_m, strict=True):
        own_m = clearance_m if zone.clearance_m is None else zone.clearance_m
        assert kept_m == max(own_m + margin_m, 0.0)
        spares.append(distance_m(a, b, zone.shape) - kept_m)
    spare_m = min(spares, default=math.inf)
    clear = space.leg_clear(a, b)
    if abs(spare_m) > 2 * TOLERANCE_M:
        assert clear == (spare_m > 0)
    assert clear == (space.blockers(a, b) == ())
    assert space.leg_clear(b, a) == clear
    assert space.swept_clear([a, b]) == clear
    closest_m, _ = space.track_distance_m([a, b])
    nearest_m = min((distance_m(a, b, z.shape) for z in drawn), default=math.inf)
    assert max(closest_m, 0.0) == pytest.approx(nearest_m, abs=1e-9)


@given(zones, st.lists(shapes, max_size=2), st.tuples(place, place), distances, st.floats(0, 10))
@example([], [Circle(P(0, 0), 40)], (P(0, 0), P(0, 35)), 5.0, 1.0)
def test_clearance_is_monotone(drawn, fences, leg, clearance_m, more_m):
    a, b = leg
    space = Airspace(fences, drawn, clearance_m)
    wider = space.with_margin(more_m)
    if wider.leg_clear(a, b):
        assert space.leg_clear(a, b)
        assert space.point_clear(a)
        assert space.as_drawn().leg_clear(a, b)
        assert not space.zones_at(a)
    spare_m, _ = space.clearance_left_m(a)
    if abs(spare_m) > 2 * TOLERANCE_M:
        assert space.point_clear(a) == (spare_m > 0)
    assert wider.clearance_left_m(a)[0] == pytest.approx(spare_m - more_m) or math.isinf(spare_m)


@given(zones, st.lists(shapes, max_size=2), st.lists(place, min_size=2, max_size=6), distances)
def test_in_bulk_the_answers_are_the_same(drawn, fences, places, clearance_m):
    space = Airspace(fences, drawn, clearance_m)
    starts = [a for a in places for _ in places]
    ends = [b for _ in places for b in places]
    clear = space.legs_clear_between(np.array(starts), np.array(ends))
    assert clear.dtype == bool
    for answer, a, b in zip(clear, starts, ends, strict=True):
        assert answer == (space.leg_clear(a, b) if a != b else space.point_clear(a))


def test_near_a_fence_the_answers_in_bulk_are_the_same():
    ring = (Point(0, 0), Point(100, 10), Point(90, 80), Point(40, 50), Point(-10, 90))
    hole = (Point(30, 20), Point(50, 20), Point(45, 35))
    space = Airspace(Outline(ring, (hole,)), [], clearance_m=3)
    chance = np.random.default_rng(1)
    starts = chance.uniform(-15, 105, (500, 2))
    ends = starts + chance.normal(0, 8, (500, 2))
    clear = space.legs_clear_between(starts, ends)
    assert 100 < clear.sum() < 400
    assert clear.tolist() == [
        space.leg_clear(Point(*a), Point(*b)) for a, b in zip(starts, ends, strict=True)
    ]


@given(zones, st.lists(shapes, max_size=2), distances, place)
def test_drawn_free_space_is_clear_and_hardly_smaller(drawn, fences, clearance_m, probe):
    space = Airspace(fences, drawn, clearance_m)
    inside = ShapelyPoint(probe)
    free = shapely.union_all(FreeSpace(space).tight())
    if free.covers(inside):
        assert space.point_clear(probe)
    spare_m, _ = space.clearance_left_m(probe)
    if spare_m > 0.04 + 0.005 * max(clearance_m, *space.distances_m, 0.0):
        assert free.covers(inside)
    near = ShortestPaths(space).nearest(probe)
    assert near is None or space.point_clear(near)


def test_nothing_in_bulk_is_nothing():
    space = Airspace(FENCED, [box("a", 0, 0, 1, 1)], 5)
    assert space.legs_clear_between(np.empty((0, 2)), np.empty((0, 2))).tolist() == []
    assert space.legs_clear(P(0, 0), []) == []


def test_inflated_zones_reach_as_far_as_must_be_kept():
    zones = [Zone("c", Circle(P(0, 0), 10), clearance_m=2), box("b", 50, 0, 60, 10)]
    circle, square = Airspace(None, zones, 5, 1.5).inflated()
    assert circle.bounds == pytest.approx((-13.5, -13.5, 13.5, 13.5), abs=0.05)
    assert square.bounds == pytest.approx((43.5, -6.5, 66.5, 16.5), abs=0.05)
    for step in range(360):
        angle = math.radians(step)
        assert circle.covers(ShapelyPoint(13.5 * math.cos(angle), 13.5 * math.sin(angle)))


def test_shapes_of_many_corners_are_judged_alike():
    """From 48 corners on an index is used."""
    many = [P(30 * math.cos(k / 50), 30 * math.sin(k / 50)) for k in range(314)]
    zone, fence = Outline(tuple(many)), Outline(tuple(P(5 * e, 5 * n) for e, n in many))
    space = Airspace(fence, [Zone("z", zone)], 5)
    a, b = P(-60, 36), P(60, 36)
    assert space.leg_clear(a, b)
    assert space.point_clear(P(0, 36))
    assert space.leg_clear(P(0, 36), P(0, 36))
    assert not space.leg_clear(P(0, 34), P(0, 34))
    assert not space.leg_clear(P(-60, 34.9), P(60, 34.9))
    assert not space.leg_clear(P(0, 0), P(1, 1))
    assert not space.leg_clear(P(0, 140), P(0, 160))
    assert space.legs_clear(P(0, 36), [P(0, 36), P(0, 40), P(0, 34)]) == [True, True, False]


def test_what_is_at_the_reach_itself_is_around_and_a_fence_is_left_by_who_is_beyond_it():
    mast = Zone("mast", Circle(P(0, 20), 10))
    space = Airspace(FENCED, [mast], 5)
    assert space.around(P(0, 0), 10.0).zones == (mast,)
    assert space.around(P(0, 0), 9.999).zones == ()
    for east, fences in ((99.999, 1), (100.0, 1), (100.001, 0)):
        assert len(space.without_zones_at(P(east, 0)).fences) == fences
