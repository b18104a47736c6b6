import itertools
import json
import math
from pathlib import Path

import pytest
from shapely import LineString, Polygon, union_all

from geo.airspace.airspace import FENCE, Airspace
from geo.airspace.zone import Circle, Outline, Zone
from geo.frame import Point
from geo.paths.free_space import FreeSpace
from geo.paths.separators import barriers
from geo.paths.shortest import ShortestPaths, shortest_paths
from geo.paths.shortest import path_length_m as length_m
from tests.geo.optimum import least_m
from tests.geo.shapes import box, box_ring, ring

DATA = Path(__file__).parents[2] / "data"
FENCED = box_ring(-100, -100, 100, 100)


def test_no_path_into_a_walled_yard_and_who_walls_it():
    walls = [
        box("south", -30, -30, 30, -25),
        box("north", -30, 25, 30, 30),
        box("west", -30, -30, -25, 30),
        box("east", 25, -30, 30, 30),
        box("shed", 60, 60, 70, 70),
    ]
    space = Airspace(FENCED, walls, 5)
    inside, outside = Point(0, 0), Point(80, -80)
    assert shortest_paths(space).path(inside, outside) is None
    assert not shortest_paths(space).connected(inside, outside)
    assert barriers(space, inside, outside) == ("south", "north", "west", "east")
    assert barriers(space, inside, Point(5, 5)) == ()
    assert shortest_paths(space.without(["east"])).connected(inside, outside)


def test_a_zone_from_fence_to_fence_separates_with_the_fence():
    space = Airspace(FENCED, [box("river", -120, -5, 120, 5), box("shed", 50, 50, 60, 60)], 5)
    assert len(shortest_paths(space).space.lean) == 2
    assert barriers(space, Point(0, 50), Point(0, -50)) == (FENCE, "river")
    assert shortest_paths(space).path(Point(0, 50), Point(0, -50)) is None


def test_without_a_fence_there_is_always_a_way_around():
    space = Airspace(None, [box("river", -1000, -5, 1000, 5)], 5)
    path = shortest_paths(space).path(Point(0, 50), Point(0, -50))
    assert path is not None
    assert len(shortest_paths(Airspace(None, [], 5)).space.lean) == 1
    assert shortest_paths(space).connected(Point(0, 50), Point(40_000, -30_000))


@pytest.mark.parametrize(("gap_m", "open_"), [(9.9, False), (10.2, True), (11, True)])
def test_a_gap_is_open_when_it_is_wider_than_twice_the_clearance(gap_m, open_):
    walls = [box("west", -150, -5, 0, 5), box("east", gap_m, -5, 150, 5)]
    space = Airspace(FENCED, walls, 5)
    path = shortest_paths(space).path(Point(-50, 50), Point(50, -50))
    assert (path is not None) is open_
    assert shortest_paths(space).connected(Point(-50, 50), Point(50, -50)) is open_


@pytest.mark.parametrize(("more_m", "open_"), [(-0.001, False), (0.05, True)])
@pytest.mark.parametrize("beyond", ["wall", "fence", "circle", "round fence"])
def test_a_gap_beside_a_large_circle_is_as_wide_as_it_is(beyond, more_m, open_):
    """Drawn with 48 sides it is 1 m larger."""
    gap_m = 10 + more_m
    reach_m, far_m = 500 + gap_m, 2_000
    fence = box_ring(-far_m, -far_m, far_m, far_m)
    zones = [Zone("circle", Circle(Point(0, 0), 500)), box("bar", -far_m, -1, -490, 1)]
    if beyond == "wall":
        zones.append(box("wall", reach_m, -far_m, far_m, far_m))
    elif beyond == "fence":
        fence = box_ring(-far_m, -far_m, reach_m, far_m)
    elif beyond == "circle":
        zones.append(Zone("other", Circle(Point(reach_m + 500, 0), 500)))
        zones.append(box("other bar", reach_m + 990, -1, far_m, 1))
    else:
        fence = Circle(Point(0, 0), reach_m)
    paths = ShortestPaths(Airspace(fence, zones, 5))
    middle_m = 500 + gap_m / 2
    assert paths.connected(Point(0, -middle_m), Point(0, middle_m)) is open_
    assert (paths.path(Point(0, -middle_m), Point(0, middle_m)) is not None) is open_


@pytest.mark.parametrize(
    ("clearance_m", "slit_m", "slant_m"),
    [(0, 0.0004, 0), (0, 0.0004, 6), (0, 0.0003, 9), (5, 0.0003, 3)],
)
def test_a_way_through_a_slit_is_found_from_both_sides(clearance_m, slit_m, slant_m):
    east = 2 * clearance_m + slit_m
    west = Zone("west", ring((-98, -5), (0, -5), (-slant_m, 5), (-98, 5)))
    walls = [west, Zone("east", ring((east + slant_m, -5), (98, -5), (98, 5), (east, 5)))]
    paths = ShortestPaths(Airspace(FENCED, walls, clearance_m))
    for start, end in itertools.product(
        (Point(-47, 13), Point(3, 88), Point(60, 41)), (Point(-60, -90), Point(0, -11))
    ):
        lengths_m = [length_m(paths.path(*ends)) for ends in ((start, end), (end, start))]
        assert lengths_m[0] == pytest.approx(lengths_m[1])
        by_slit_m = math.dist(start, (east / 2, 5)) + math.dist((east / 2, -5), end)
        assert lengths_m[0] < by_slit_m + 25 + slant_m


def test_no_question_takes_a_mesh_of_the_whole_map(monkeypatch):
    """Not even one that is refused, nor a gap between zones that meet elsewhere."""
    fence = ring((-900, -900), (900, -900), (900, 900), (-900, 900))
    hook = ring(
        (-40, 0), (-5.05, 0), (-5.05, 4), (-40, 40), (40, 40), (40, 50), (-60, 50), (-60, 0)
    )
    yard = Outline(
        ring((200, 200), (300, 200), (300, 300), (200, 300)),
        (ring((230, 230), (270, 230), (270, 270), (230, 270)),),
    )
    zones = [Zone("hook", hook), Zone("tip", ring((5.05, 2), (40, -10), (40, 42), (30, 42)))]
    paths = ShortestPaths(Airspace(fence, [*zones, Zone("yard", yard)], 5))
    drawn = []
    monkeypatch.setattr(FreeSpace, "tight", lambda _, within=None: drawn.append(within) or [])
    assert paths.path(Point(0, 20), Point(250, 250)) is None
    assert paths.path(Point(0, 20), Point(800, -800)) is not None
    assert paths.connected(Point(0, 20), Point(-800, 800))
    assert all(within is not None and within[2] - within[0] < 100 for within in drawn)


def test_start_and_end_that_are_not_clear_have_no_path():
    space = Airspace(FENCED, [box("hall", 0, 0, 10, 10)], 5)
    assert shortest_paths(space).path(Point(5, 5), Point(50, 50)) is None
    assert shortest_paths(space).path(Point(50, 50), Point(12, 5)) is None


def test_places_on_the_limit_itself_have_paths():
    space = Airspace(FENCED, [box("hall", -20, -20, 20, 20)], 5)
    sides = [Point(-25, 0), Point(0, 25), Point(25, 0), Point(0, -25), Point(95, 95)]
    for a, b in itertools.permutations(sides, 2):
        path = shortest_paths(space).path(a, b)
        assert path is not None
        assert least_m(path, Polygon(FENCED), [space.zones[0].polygon]) >= 5 - 1e-6


def test_no_way_leads_between_zones_that_share_a_side_or_a_corner():
    zones = [box("w", 0, 0, 10, 10), box("e", 10, 0, 20, 10), box("ne", 20, 10, 30, 20)]
    path = ShortestPaths(Airspace(FENCED, zones, 0.0)).path(Point(10, -5), Point(10, 15))
    union = union_all([zone.polygon for zone in zones])
    assert not union.buffer(-1e-6).intersects(LineString(path))
    assert length_m(path) > 25


def test_a_way_stays_inside_of_all_fences():
    fences = [Outline(FENCED), Circle(Point(60, 0), 100)]
    paths = ShortestPaths(Airspace(fences, [box("wall", 0, -5, 10, 200)], 5.0))
    path = paths.path(Point(-20, 0), Point(60, 0))
    assert all(math.dist(place, (60, 0)) <= 95 + 1e-6 for place in path)
    assert paths.path(Point(-60, 0), Point(60, 0)) is None


def test_a_target_in_a_zone_has_a_place_beside_it_that_can_be_reached():
    yard = [box("s", -40, -40, 40, -30), box("n", -40, 30, 40, 40), box("w", -40, -40, -30, 40)]
    paths = ShortestPaths(Airspace(FENCED, [*yard, box("e", 30, -40, 40, 40)], 5.0))
    home = Point(0, -80)
    assert paths.connected(Point(0, 0), Point(10, 10))
    for target in (Point(0, 0), Point(0, -31), Point(0, -35)):
        place = paths.nearest(target, reachable_from=home)
        assert paths.path(home, place) is not None
        assert math.dist(place, target) <= 46
    assert paths.nearest(Point(60, 60), reachable_from=home) == (60, 60)


def test_starts_on_sides_of_the_mesh_are_as_good_as_others():
    halls = [box("w", -20, -20, 20, 20), box("e", 30, -50, 40, 30)]
    paths = ShortestPaths(Airspace(FENCED, halls, 5.0))
    mesh, goal = paths.mesh, Point(80, 10)
    for left, right, *_ in mesh.entries:
        (a, b), (c, d) = mesh.places[left], mesh.places[right]
        for share in (0.0, 0.5, 0.3):
            here = Point(a + share * (c - a), b + share * (d - b))
            around = [
                Point(here[0] + 0.01 * math.cos(k), here[1] + 0.01 * math.sin(k)) for k in range(8)
            ]
            beside = [near for near in around if mesh.part_of(near) is not None]
            best_m = min(length_m(paths.path(near, goal)) for near in beside) + 0.01
            # One of both may be looked for in the tight area, and be shorter by some per mille.
            assert length_m(paths.path(here, goal)) <= 1.005 * best_m


def test_an_airspace_without_room_has_no_paths_and_no_places():
    full = Airspace(FENCED, [box("all", -120, -120, 120, 120)], 5.0)
    paths = ShortestPaths(full)
    assert paths.path(Point(0, 0), Point(1, 1)) is None
    assert paths.nearest(Point(0, 0)) is None
    assert paths.part_of(Point(0, 0)) is None
    assert not paths.connected(Point(0, 0), Point(1, 1))
    assert paths.space.lean == []


def test_paths_among_needles_are_nearly_the_shortest():
    """Found among random needles; the optimum by brute force, for a clearance of 5 m."""
    for case in json.loads((DATA / "needles.json").read_text()):
        needles = [
            Zone(str(n), [Point(*place) for place in ring]) for n, ring in enumerate(case["zones"])
        ]
        paths = ShortestPaths(Airspace([Point(*p) for p in case["fence"]], needles, 5.0))
        found = paths.path(Point(*case["start"]), Point(*case["goal"]))
        assert case["opt"] * 0.999 <= length_m(found) <= 1.01 * case["opt"]


@pytest.mark.parametrize("gap_m", [10.002, 10.01, 10.03, 10.06])
def test_a_gap_between_pointed_corners_that_is_hardly_wide_enough_is_flown(gap_m):
    west = Zone("w", [Point(-60, -5), Point(-gap_m / 2, 0), Point(-60, 5)])
    east = Zone("e", [Point(60, -5), Point(gap_m / 2, 0), Point(60, 5)])
    airspace = Airspace(None, [west, east], 5.0)
    through = ShortestPaths(airspace).path(Point(3, -40), Point(-3, 40))
    assert length_m(through) < 80.3
    assert airspace.track_distance_m(through)[0] >= 5 - 1e-6
    near = Zone("e", [Point(60, -5), Point(9.99 - gap_m / 2, 0), Point(60, 5)])
    closed = Airspace(None, [west, near], 5.0)
    assert length_m(ShortestPaths(closed).path(Point(3, -40), Point(-3, 40))) > 100
