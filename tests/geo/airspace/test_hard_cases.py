"""Where simple geometry goes wrong: sides, corridors, seams, rounding on the wire."""

import math
from itertools import pairwise

import numpy as np
import pytest
from shapely import LineString
from shapely import Point as Spot

from geo.airspace.airspace import Airspace
from geo.airspace.zone import Circle, Zone
from geo.frame import Geodetic, LocalFrame, Point, dense_ring
from geo.paths.free_space import FreeSpace
from geo.paths.shortest import ShortestPaths
from tests.geo.shapes import box, box_ring

P = Point


def turned(ring, angle, middle=(0.0, 0.0)):
    """A ring, turned about the origin and moved."""
    cos, sin = math.cos(angle), math.sin(angle)
    return tuple(P(middle[0] + e * cos - n * sin, middle[1] + e * sin + n * cos) for e, n in ring)


@pytest.mark.parametrize("step", range(0, 200, 7))
def test_along_a_side_at_the_clearance_is_clear_however_the_zone_is_turned(step):
    angle = math.radians(step * 1.8)
    middle = (1234.5 * math.cos(step), 987.6 * math.sin(step))
    space = Airspace(None, [Zone("hall", turned(box_ring(-20, -10, 20, 10), angle, middle))], 5)
    for sign in (1, -1):
        side = [(-40, sign * 15), (-20, sign * 15), (20, sign * 15), (40, sign * 15)]
        for a, b in pairwise(turned(side, angle, middle)):
            assert space.leg_clear(a, b)
        a, b = turned([(-40, sign * 14.999), (40, sign * 14.999)], angle, middle)
        assert not space.leg_clear(a, b)


def test_the_sides_of_drawn_free_space_are_legs():
    zones = [box("a", 0, 0, 30, 10), Zone("b", Circle(P(60, 40), 12)), box("c", 20, 10, 30, 40)]
    space = Airspace(box_ring(-100, -100, 150, 150), zones, 5)
    (clear,) = FreeSpace(space).tight()
    for ring in (clear.exterior, *clear.interiors):
        corners = [P(*corner) for corner in ring.coords]
        for a, b in pairwise(corners):
            assert space.leg_clear(a, b)
            assert space.leg_clear(a, a)


@pytest.mark.parametrize(("gap_m", "parts"), [(10.0, 2), (10.0001, 2), (10.001, 1), (10.1, 1)])
def test_a_corridor_is_as_wide_as_it_is(gap_m, parts):
    walls = [box("w", -100, -5, 0, 5), box("e", gap_m, -5, 100, 5)]
    space = Airspace(box_ring(-100, -50, 100, 50), walls, 5)
    middle = gap_m / 2
    assert space.leg_clear(P(middle, -40), P(middle, 40))
    assert not space.leg_clear(P(middle + 0.06, -40), P(middle + 0.06, 40))
    assert len(FreeSpace(space).tight()) == parts
    assert not Airspace(None, walls, gap_m / 2 + 1e-5).leg_clear(P(middle, -40), P(middle, 40))


def test_zones_whose_clearances_touch_in_a_point_leave_no_way():
    corners = [box("sw", -50, -50, -5, -5), box("ne", 5, 5, 50, 50)]
    apart_m = math.dist((-5, -5), (5, 5))
    space = Airspace(box_ring(-50, -50, 50, 50), corners, apart_m / 2)
    nw, se = P(-30, 30), P(30, -30)
    assert space.leg_clear(nw, se)  # exactly as wide as it must be
    assert not space.with_margin(1e-4).leg_clear(nw, se)
    assert len(FreeSpace(space).tight()) == 2


def test_what_is_left_of_free_space_is_areas():
    """Zones that cover it all but for slivers, seams and points."""
    zones = [box("w", -50, -50, 0, 50), box("e", 0, -50, 50, 50)]
    assert FreeSpace(Airspace(box_ring(-50, -50, 50, 50), zones, 0)).tight() == []
    half = Airspace(box_ring(-50, -50, 50, 50), zones[:1], 0)
    (left,) = FreeSpace(half).tight()
    assert left.area == pytest.approx(50 * 100, rel=0.001)
    assert ShortestPaths(half).nearest(P(-20, 0)) == pytest.approx((0, 0), abs=0.001)


@pytest.mark.parametrize("origin", [(0.0, 0.0), (47.4, 8.5), (-78.0, 179.9999)])
def test_legs_that_are_clear_by_two_centimetres_are_clear_as_they_are_sent(origin):
    """MAVLink carries 1e-7 degrees, up to 8 mm beside the place."""
    frame = LocalFrame(Geodetic(*origin))
    random = np.random.default_rng(5)
    zones = [
        Zone(str(n), turned(box_ring(-12, -6, 12, 6), n, random.uniform(-200, 200, 2)))
        for n in range(40)
    ]
    space = Airspace(None, [*zones, Zone("c", Circle(P(0, 0), 30))], 5)
    starts, ends = random.uniform(-250, 250, (2, 1500, 2))
    planned = space.with_margin(0.02).legs_clear_between(starts, ends)
    assert 100 < planned.sum() < 1400

    def sent(points):
        degrees = np.rint(frame.to_geodetic_many(points) * 1e7) / 1e7
        moved = frame.to_local_many(*degrees.T)
        assert np.hypot(*(moved - points).T).max() < 0.0081
        return moved

    assert space.legs_clear_between(sent(starts), sent(ends))[planned].all()


@pytest.mark.parametrize("latitude", [0.0, 50.0, 69.0, -80.0])
def test_long_sides_that_are_straight_in_degrees_bend_on_the_ground(latitude):
    frame = LocalFrame(Geodetic(latitude, 179.95))
    corners = [(0.0, -0.1), (0.0, 0.1), (0.05, 0.1), (0.05, -0.1)]
    ring = [Geodetic(latitude + lat, (179.95 + lon + 180) % 360 - 180) for lat, lon in corners]
    dense = dense_ring(ring)
    places = [frame.to_local(*corner) for corner in dense]
    line = LineString([*places, places[0]])
    for (lat, lon), (to_lat, to_lon) in pairwise([*corners, corners[0]]):
        for share in np.linspace(0, 1, 97):
            here = (179.95 + lon + share * (to_lon - lon) + 180) % 360 - 180
            on_map = frame.to_local(latitude + lat + share * (to_lat - lat), here)
            assert line.distance(LineString([on_map, on_map]).centroid) < 0.2
    for here, there in pairwise(places):
        assert math.dist(here, there) < 1020
    assert dense[0] == ring[0]
    assert set(ring) <= set(dense)


def bent_m(frame, start, end, shares):
    """How far a side lies from the line in degrees between two corners, at parts of its length."""
    ring = dense_ring([start, end])
    side = LineString([frame.to_local(*place) for place in ring[: ring.index(end) + 1]])
    lat_deg, lon_deg = (there - here for here, there in zip(start, end, strict=True))
    on_map = [(start[0] + share * lat_deg, start[1] + share * lon_deg) for share in shares]
    return max(side.distance(Spot(frame.to_local(*place))) for place in on_map)


def test_a_border_of_thousands_of_kilometres_is_where_it_was_drawn_at_the_mission():
    """The 49th parallel: with a corner every 20 km it was 9 m off."""
    frame = LocalFrame(Geodetic(49.0, -110.0))
    border = Geodetic(49.0, -123.0), Geodetic(49.0, -96.0)
    assert bent_m(frame, *border, np.linspace(0.475, 0.49, 400)) < 0.03


@pytest.mark.parametrize("latitude", [72.0, 80.0, 89.0, 89.9])
def test_towards_a_pole_sides_bend_more(latitude):
    frame = LocalFrame(Geodetic(latitude, 10.0))
    half_deg = min(0.05 / math.cos(math.radians(latitude)), 60.0)
    side = [Geodetic(latitude, 10.0 + lon_deg) for lon_deg in (-half_deg, half_deg)]
    assert bent_m(frame, *side, np.linspace(0, 1, 997)) < 0.07
    out = Geodetic(latitude - 0.01, 10.0 + half_deg)
    assert bent_m(frame, side[0], out, np.linspace(0, 1, 997)) < 0.07
    there, back = (len(dense_ring(ring)) for ring in ([side[0], out], [out, side[0]]))
    assert there == back


def test_short_rings_stay_as_they_are():
    ring = [Geodetic(47.0, 8.0), Geodetic(47.001, 8.0), Geodetic(47.001, 8.001)]
    assert dense_ring(ring) == ring
    assert dense_ring([]) == []
    assert len(dense_ring([Geodetic(47.0, 8.0), Geodetic(47.0, 9.0)], step_m=10_000)) == 16
