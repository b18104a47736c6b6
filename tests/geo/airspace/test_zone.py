"""What is taken as an area, what is repaired, and what is refused with which reason."""

import math

import pytest
from shapely import LineString, Polygon

from geo.airspace.zone import (
    Band,
    Circle,
    Outline,
    Zone,
    ZoneError,
    checked_ring,
    circle_ring,
    polygons_of,
)
from geo.frame import Point
from tests.geo.shapes import box_ring, ring

SQUARE = box_ring(0, 0, 100, 100)
BOW_TIE = ring((0, 0), (100, 100), (100, 0), (0, 30))
PENTAGRAM = tuple(
    Point(100 * math.sin(4 * math.pi * k / 5), 100 * math.cos(4 * math.pi * k / 5))
    for k in range(5)
)


@pytest.mark.parametrize(
    ("corners", "code", "reason"),
    [
        ([], "zone-too-few-corners", "0 different corners"),
        ([(5, 5)] * 4, "zone-too-few-corners", "1 different corner,"),
        ([(0, 0), (10, 0)], "zone-too-few-corners", "2 different corners"),
        ([(0, 0), (10, 0), (0, 0), (10, 0)], "zone-too-few-corners", "2 different corners"),
        ([(0, 0), (10, 0), (20, 0)], "zone-no-area", "on one line"),
        ([(0, 0), (10, 10), (30, 30), (20, 20)], "zone-no-area", "on one line"),
        ([(0, 0), (0, 1e-7), (1e-7, 1e-7)], "zone-no-area", "no area"),
        (BOW_TIE, "zone-self-intersects", "crosses or touches itself"),
        (PENTAGRAM, "zone-self-intersects", "crosses or touches itself"),
        # two lobes that meet in a corner, a spike, a ring drawn twice
        ([(0, 0), (10, 0), (5, 5), (10, 10), (0, 10), (5, 5)], "zone-self-intersects", "touches"),
        ([(0, 0), (10, 0), (20, 0), (10, 0), (10, 10)], "zone-self-intersects", "touches"),
        ([*SQUARE, *SQUARE], "zone-self-intersects", "touches"),
        ([(0, 0), (10, 0), (math.nan, 5)], "zone-not-finite", "not a finite number"),
        ([(0, 0), (10, 0), (math.inf, 5)], "zone-not-finite", "not a finite number"),
    ],
)
def test_rings_that_bound_no_area_are_refused(corners, code, reason):
    with pytest.raises(ZoneError, match=reason) as caught:
        Zone("z", tuple(Point(*corner) for corner in corners))
    assert caught.value.code == code


def test_a_crossing_is_reported_with_its_place():
    with pytest.raises(ZoneError) as caught:
        checked_ring(BOW_TIE)
    east_m, north_m = caught.value.place
    assert east_m == pytest.approx(north_m)  # on the diagonal
    assert 0 < east_m < 100


def test_repeated_and_closing_corners_are_harmless():
    corners = [(0, 0), (0, 0), (9, 0), (9, 9), (9, 9), (0, 0)]
    assert checked_ring(corners) == ring((0, 0), (9, 0), (9, 9))
    assert Outline(tuple(Point(*c) for c in corners)).polygon.area == 40.5


def test_either_way_around_is_the_same_area():
    assert Outline(SQUARE).polygon.equals(Outline(SQUARE[::-1]).polygon)
    both = [Outline(SQUARE, (hole,)) for hole in (box_ring(1, 1, 9, 9), box_ring(1, 1, 9, 9)[::-1])]
    assert both[0].polygon.equals(both[1].polygon)


@pytest.mark.parametrize(
    ("holes", "code"),
    [
        ([box_ring(150, 0, 160, 10)], "hole-outside-ring"),
        ([box_ring(90, 40, 110, 60)], "holes-touch"),
        ([box_ring(-10, -10, 110, 110)], "hole-outside-ring"),
        ([box_ring(0, 40, 10, 60)], "holes-touch"),
        ([box_ring(10, 10, 50, 50), box_ring(40, 40, 60, 60)], "holes-touch"),
        ([box_ring(10, 10, 50, 50), box_ring(20, 20, 30, 30)], "holes-touch"),
        ([box_ring(10, 10, 50, 50), box_ring(50, 10, 80, 50)], "holes-touch"),
        ([SQUARE], "holes-touch"),
        ([ring((10, 10), (20, 20), (30, 30))], "zone-no-area"),
        ([tuple(Point(e / 2 + 20, n / 2 + 20) for e, n in BOW_TIE)], "zone-self-intersects"),
    ],
)
def test_holes_lie_within_and_apart(holes, code):
    with pytest.raises(ZoneError, match="hole") as caught:
        Outline(SQUARE, tuple(holes))
    assert caught.value.code == code


def test_an_outline_with_holes():
    outline = Outline(SQUARE, (box_ring(10, 10, 20, 20), box_ring(30, 30, 60, 60)))
    assert outline.polygon.area == 10_000 - 100 - 900
    assert len(outline.corners) == 12
    assert outline.border.length == 400 + 40 + 120
    assert outline == Outline(SQUARE, outline.holes)
    assert hash(outline) == hash(Outline(SQUARE, outline.holes))


@pytest.mark.parametrize("radius_m", [0, -1, math.nan, math.inf])
def test_circles_without_a_radius_are_refused(radius_m):
    with pytest.raises(ZoneError, match="radius") as caught:
        Circle(Point(0, 0), radius_m)
    assert caught.value.code == "zone-radius"
    with pytest.raises(ZoneError, match="finite"):
        Circle(Point(math.nan, 0), 5)


@pytest.mark.parametrize("more", [{}, {"within_m": 0.02}, {"within_m": 3.0}])
@pytest.mark.parametrize("radius_m", [0.5, 30, 2000])
def test_a_circle_is_never_drawn_too_small_nor_as_a_fence_too_large(radius_m, more):
    centre = Point(3, 4)
    zone = Polygon(circle_ring(centre, radius_m, **more))
    fence = Polygon(circle_ring(centre, radius_m, outward=False, **more))
    for step in range(360):
        a = math.radians(step)
        on_circle = Point(3 + radius_m * math.cos(a), 4 + radius_m * math.sin(a))
        assert zone.buffer(1e-9).covers(LineString([centre, on_circle]))
    farthest_m = max(math.dist(centre, c) for c in zone.exterior.coords)
    assert all(math.dist(centre, c) <= radius_m + 1e-9 for c in fence.exterior.coords)
    if "within_m" in more and len(zone.exterior.coords) not in {13, 361}:
        assert farthest_m <= radius_m + more["within_m"] + 1e-9
    if not more:
        assert farthest_m <= radius_m * 1.0025


def test_the_polygon_of_a_circle_covers_it():
    circle = Circle(Point(0, 0), 10)
    assert math.pi * 100 < circle.polygon.area < math.pi * 100.5
    assert circle.corners == tuple(Point(*c) for c in circle.polygon.exterior.coords[:-1])
    assert Zone("z", circle).polygon is circle.polygon


def test_altitude_bands_meet_when_they_touch():
    band = Band(10, 50)
    assert band.meets(50, 60)
    assert band.meets(0, 10)
    assert band.meets(20, 30)
    assert not band.meets(50.1, 60)
    assert Band().meets(-1e9, 1e9)
    with pytest.raises(ZoneError, match="exchange them") as caught:
        Band(50, 10)
    assert caught.value.code == "zone-altitudes-inverted"
    with pytest.raises(ZoneError):
        Band(math.nan, 10)


@pytest.mark.parametrize("clearance_m", [-1, math.nan, math.inf])
def test_the_clearance_of_a_zone_is_a_distance(clearance_m):
    with pytest.raises(ZoneError, match="clearance"):
        Zone("z", SQUARE, clearance_m=clearance_m)


def test_polygons_of_mixed_shapes():
    line, square = LineString([(0, 0), (9, 9)]), Outline(SQUARE).polygon
    assert polygons_of(line) == []
    assert polygons_of(Polygon()) == []
    assert polygons_of(square.union(LineString([(200, 0), (300, 0)]))) == [square]
