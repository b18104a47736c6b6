"""The cases that naive routing gets wrong, one test each; numbers as in the list of them.

Those of files and of frames (9, 12, 19) are tested where files and frames are.
"""

import itertools
import json
import math

import pytest
import shapely
from shapely import LineString, Polygon

from air_router.errors import MissionFileError
from air_router.mission.loading import load_mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import NoRoute, Route, Router
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Circle, Outline, Zone, ZoneError
from geo.frame import Geodetic, LocalFrame, Point
from geo.paths.regions import Regions
from geo.paths.shortest import ShortestPaths, path_length_m
from tests.geo.optimum import ring

FENCE = ((-100, -100), (100, -100), (100, 100), (-100, 100))


def box(west, south, east, north):
    return [[west, south], [east, south], [east, north], [west, north]]


def space(*boxes, fence=FENCE, clearance_m=5.0):
    zones = [Zone(f"zone {n}", ring(box(*b))) for n, b in enumerate(boxes, 1)]
    return Airspace(ring(fence), zones, clearance_m)


def routing(folder, zones, kind="shortest", **changes):
    """A router of a mission in metres; home at (0, -60)."""
    data = {
        "coordinates": "local",
        "frame": {"origin": [38.5, -98.5]},
        "home": [0, -60],
        "altitude_m": 30,
        "waypoints": [[60, -60]],
        "fence": [list(corner) for corner in FENCE],
        "no_fly_zones": [{"name": f"zone {n}", "polygon": z} for n, z in enumerate(zones, 1)],
        "planner": {"clearance_m": 4.98, "tracking_margin_m": 0.02, "kind": kind},
    }
    path = folder / "mission.yaml"
    path.write_text(json.dumps(data | changes))
    return Router(WaypointGraph(load_mission(path)))


def walk(start, route):
    return [start, *(leg.to for leg in route.legs)]


@pytest.mark.parametrize("kind", ["shortest", "waypoints"])
def test_case_01_a_start_in_the_buffer_has_a_route_that_leaves_it_and_says_so(tmp_path, kind):
    router = routing(tmp_path, [box(-20, -20, 20, 20)], kind)
    start = Point(0, -23)
    route = router.route(start, Point(0, 60))
    assert isinstance(route, Route)
    assert "the vehicle is 3.0 m from no-fly zone 'zone 1'" in route.warnings[0]
    zone = Polygon(box(-20, -20, 20, 20))
    assert zone.distance(LineString(walk(start, route))) >= 3 - 0.02
    assert zone.distance(LineString(walk(start, route)[1:])) >= 5 - 1e-6


def test_case_02_the_way_out_does_not_cross_the_other_wall(tmp_path):
    walls = [box(-50, 0, 50, 1), box(-50, 7, 50, 8)]
    route = routing(tmp_path, walls).route(Point(0, 3), Point(0, -60))
    assert isinstance(route, Route)
    track = LineString(walk(Point(0, 3), route))
    assert min(Polygon(wall).distance(track) for wall in walls) >= 2 - 0.02
    assert max(place[0] for place in track.coords) > 50 or min(c[0] for c in track.coords) < -50


def test_case_03_no_leg_slips_between_zones_that_share_a_side_or_a_corner():
    shared = space((0, 0, 10, 10), (10, 0, 20, 10), (20, 10, 30, 20), clearance_m=0.0)
    assert not shared.leg_clear(Point(10, -5), Point(10, 15))
    assert not shared.leg_clear(Point(15, 15), Point(25, 5))
    path = ShortestPaths(shared).path(Point(10, -5), Point(10, 15))
    union = shapely.union_all([zone.polygon for zone in shared.zones])
    assert not union.buffer(-1e-6).intersects(LineString(path))
    assert path_length_m(path) > 25


@pytest.mark.parametrize("turned", range(0, 200, 7))
def test_case_04_legs_along_the_limit_are_clear_however_the_zone_is_turned(turned):
    turn = shapely.affinity.rotate(Polygon(box(-20, -20, 20, 20)), turned * 0.9, origin=(0, 0))
    corners = [Point(*corner) for corner in turn.exterior.coords[:-1]]
    paths = ShortestPaths(Airspace(ring(FENCE), [Zone("hall", tuple(corners))], 5.0))
    for a, b in itertools.combinations([Point(1.6 * e, 1.6 * n) for e, n in corners], 2):
        path = paths.path(a, b)
        assert path is not None
        assert turn.distance(LineString(path)) >= 5 - 1e-6


def test_case_05_a_leg_that_leaves_the_fence_between_two_ends_inside_is_none():
    notched = ((-100, -100), (100, -100), (100, 100), (10, 100), (0, -50), (-10, 100), (-100, 100))
    airspace = space(fence=notched)
    a, b = Point(-60, 50), Point(60, 50)
    assert not airspace.leg_clear(a, b)
    path = ShortestPaths(airspace).path(a, b)
    assert Polygon(notched).contains(LineString(path))
    assert Polygon(notched).exterior.distance(LineString(path)) >= 5 - 1e-6
    cut = Regions(space((-5, -120, 5, 120)))
    assert cut.separators(Point(-50, 0), Point(50, 0)) == ("fence", "zone 1")


def test_case_06_the_vehicle_stays_inside_of_all_fences():
    fences = [Outline(ring(FENCE)), Circle(Point(60, 0), 100)]
    paths = ShortestPaths(Airspace(fences, [Zone("wall", ring(box(0, -5, 10, 200)))], 5.0))
    path = paths.path(Point(-20, 0), Point(60, 0))
    assert path is not None
    assert all(math.dist(place, (60, 0)) <= 95 + 1e-6 for place in path)
    assert paths.path(Point(-60, 0), Point(60, 0)) is None


def test_case_07_a_target_in_a_zone_has_a_reachable_place_beside_it():
    yard = [box(-40, -40, 40, -30), box(-40, 30, 40, 40), box(-40, -40, -30, 40)]
    paths = ShortestPaths(space(*[tuple(b[0] + b[2]) for b in yard], (30, -40, 40, 40)))
    home = Point(0, -80)
    assert paths.connected(Point(0, 0), Point(10, 10))
    for target in (Point(0, 0), Point(0, -31), Point(0, -35)):
        place = paths.nearest(target, reachable_from=home)
        assert paths.path(home, place) is not None
        assert math.dist(place, target) <= 46
    assert paths.nearest(Point(60, 60), reachable_from=home) == (60, 60)


def test_case_08_a_start_in_the_hole_of_a_zone_never_flies_out(tmp_path):
    donut = {"name": "donut", "polygon": box(-40, -40, 40, 40), "holes": [box(-20, -20, 20, 20)]}
    router = routing(tmp_path, [], no_fly_zones=[donut])
    answer = router.route(Point(0, 0), Point(0, -60))
    assert isinstance(answer, NoRoute)
    assert answer.blockers == ("donut",)
    assert "separate" in answer.reason
    small = {"name": "ring", "polygon": box(-40, -40, 40, 40), "holes": [box(-4, -4, 4, 4)]}
    answer = routing(tmp_path, [], no_fly_zones=[small]).route(Point(0, 0), Point(0, -60))
    assert isinstance(answer, NoRoute)
    assert answer.blockers == ("ring",)


def test_case_09_a_zone_that_crosses_itself_is_refused():
    with pytest.raises(ZoneError, match="crosses or touches itself"):
        Zone("bow-tie", ring(((0, 0), (100, 100), (100, 0), (0, 30))))


def test_case_10_repeated_and_closing_corners_do_not_matter_and_nothing_is_dropped():
    plain = space((-20, -20, 20, 20))
    corners = [(-20, -20), (20, -20), (20, -20), (20, 20), (-20, 20), (-20, -20)]
    messy = Airspace(ring(FENCE), [Zone("zone 1", ring(corners))], 5.0)
    a, b = Point(-60, 0), Point(60, 0)
    assert ShortestPaths(messy).path(a, b) == ShortestPaths(plain).path(a, b)
    for corners in (((0, 0), (10, 0), (20, 0)), ((0, 0), (1, math.nan), (1, 1))):
        with pytest.raises(ZoneError):
            Zone("line", ring(corners))


@pytest.mark.parametrize(("gap_m", "is_open"), [(10.0, False), (10.01, True)])
def test_case_11_a_corridor_of_twice_the_clearance_is_closed_and_one_a_hand_wider_open(
    gap_m, is_open
):
    paths = ShortestPaths(space((-120, -5, 0, 5), (gap_m, -5, 120, 5)))
    a, b = Point(gap_m / 2, 50), Point(gap_m / 2, -50)
    assert paths.connected(a, b) is is_open
    assert (paths.path(a, b) is not None) is is_open


def test_case_12_the_antimeridian_is_a_line_like_any_other():
    frame = LocalFrame(Geodetic(10.0, 179.9999))
    there = frame.to_local(10.0, -179.9999)
    assert math.hypot(*there) == pytest.approx(21.93, abs=0.01)
    assert ShortestPaths(space()).path(Point(0, 0), there) is not None


def test_case_13_a_route_keeps_its_clearance_as_it_is_sent(tmp_path):
    router = routing(
        tmp_path, [box(-20, -20, 20, 20)], planner={"kind": "shortest", "tracking_margin_m": 0.02}
    )
    route = router.route(Point(-60, 0), Point(60, 0))
    frame = LocalFrame(Geodetic(38.5, -98.5))
    sent = []
    for place in walk(Point(-60, 0), route):
        latitude, longitude = frame.to_geodetic(place)
        sent.append(frame.to_local(round(latitude * 1e7) / 1e7, round(longitude * 1e7) / 1e7))
    assert Polygon(box(-20, -20, 20, 20)).distance(LineString(sent)) >= 5.0


def test_case_14_corners_are_flown_to_within_the_acceptance_radius_not_cut(tmp_path):
    mission = routing(tmp_path, []).graph.mission
    assert mission.planner.acceptance_radius_m == 2.0


def test_case_15_planning_again_from_the_limit_itself_is_never_refused():
    paths = ShortestPaths(space((-20, -20, 20, 20), (30, -50, 40, 30)))
    goal = Point(80, 10)
    path = paths.path(Point(-60, -5), goal)
    for leg, share in itertools.product(range(len(path) - 1), (0.0, 0.1, 0.5, 0.77, 1.0)):
        (a, b), (c, d) = path[leg], path[leg + 1]
        here = Point(a + share * (c - a), b + share * (d - b))
        again = paths.path(here, goal)
        left_m = path_length_m((here, *path[leg + 1 :]))
        assert path_length_m(again) == pytest.approx(left_m, rel=1e-6, abs=1e-6)


def test_case_16_starts_on_sides_and_vertices_of_the_mesh_are_as_good_as_others():
    paths = ShortestPaths(space((-20, -20, 20, 20), (30, -50, 40, 30)))
    mesh, goal = paths.mesh, Point(80, 10)
    for left, right, *_ in mesh.entries:
        (a, b), (c, d) = mesh.places[left], mesh.places[right]
        for share in (0.0, 0.5, 0.3):
            here = Point(a + share * (c - a), b + share * (d - b))
            beside = min(
                path_length_m(paths.path(near, goal)) + math.dist(here, near)
                for step in range(8)
                for near in [
                    Point(here[0] + 0.01 * math.cos(step), here[1] + 0.01 * math.sin(step))
                ]
                if mesh.part_of(near) is not None
            )
            assert path_length_m(paths.path(here, goal)) <= beside + 1e-6


def test_case_17_a_start_that_is_the_goal_and_one_on_a_waypoint(tmp_path):
    for kind in ("shortest", "waypoints"):
        router = routing(tmp_path, [box(-20, -20, 20, 20)], kind)
        here = router.route(Point(60, -60), 1)
        assert here.length_m == 0
        assert [leg.node for leg in here.legs] == [1]
        home = router.route(Point(0, -60), 0)
        assert home.length_m == 0


def test_case_18_answers_are_not_shared_and_a_new_zone_is_planned_around_at_once(tmp_path):
    router = routing(tmp_path, [box(-20, -20, 20, 20)])
    first = router.route(Point(0, -60), Point(0, 60))
    assert isinstance(first.legs, tuple)
    assert router.route(Point(0, -60), Point(0, 60)) == first
    west = router.route(Point(-1, -60), Point(-1, 60))
    blocked = box(-60, -10, -20, 10) if west.legs[0].to[0] < 0 else box(20, -10, 60, 10)
    again = routing(tmp_path, [box(-20, -20, 20, 20), blocked]).route(Point(-1, -60), Point(-1, 60))
    assert again.length_m > west.length_m
    assert Polygon(blocked).distance(LineString(walk(Point(-1, -60), again))) >= 5 - 1e-6


def test_case_19_a_waypoint_in_a_buffer_is_an_error_that_names_it(tmp_path):
    with pytest.raises(MissionFileError, match=r"waypoint 2 is 3\.0 m from no-fly zone 'zone 1'"):
        routing(tmp_path, [box(-20, -20, 20, 20)], waypoints=[[60, -60], [0, 23]])


def test_case_20_an_airspace_without_room_has_no_paths_and_no_places():
    full = space((-120, -120, 120, 120))
    paths = ShortestPaths(full)
    assert paths.path(Point(0, 0), Point(1, 1)) is None
    assert paths.nearest(Point(0, 0)) is None
    assert paths.part_of(Point(0, 0)) is None
    assert not paths.connected(Point(0, 0), Point(1, 1))
    assert len(Regions(full)) == 0


def test_case_21_distances_are_exact_at_any_scale():
    for size in (1e-2, 1.0, 1e3):
        airspace = space(
            *[tuple(size * side for side in (-20, -20, 20, 20))],
            fence=[(size * e, size * n) for e, n in FENCE],
            clearance_m=5 * size,
        )
        path = ShortestPaths(airspace).path(Point(-60 * size, 0), Point(60 * size, 0))
        zone = Polygon(box(*(size * side for side in (-20, -20, 20, 20))))
        nearest_m = zone.distance(LineString(path))
        assert 5 * size - 1e-6 <= nearest_m <= 5 * size + 1e-3
