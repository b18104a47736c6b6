"""Routes: every leg is judged again by plain shapely distances."""

import dataclasses
import itertools
import json
import math
import random
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import networkx as nx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, MultiPoint, Polygon, union_all

from air_router.files.mission_form import PlannerSettings
from air_router.mission.loading import load_mission
from air_router.routing.departure import Departure, Momentum, PendingSetpoint
from air_router.routing.graph import WaypointGraph
from air_router.routing.limits import BRAKING_M_S2
from air_router.routing.router import Leg, NoRoute, Route, Router
from benchmarks.route.maps import made as made_map
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from geo.paths.shortest import ShortestPaths
from sitl.px4sim.motion.dynamics import MotionDemand, Multirotor
from tests.air_router.local_mission import box, local_mission

DATA = Path(__file__).parents[2] / "data"
MISSIONS = Path(__file__).parents[3] / "missions"


class Judge:
    """Clearances by plain shapely, knowing nothing of the code under test."""

    def __init__(self, mission):
        self.zones = union_all([zone.polygon for zone in mission.zones])
        self.fence = mission.fences[0].polygon
        self.limit_m = mission.planning_distance_m - 1e-6

    def distance_m(self, shape):
        if not self.fence.covers(shape):
            return -1.0
        return min(self.zones.distance(shape), self.fence.exterior.distance(shape))

    def clear(self, *points):
        return self.distance_m(MultiPoint(points).convex_hull) >= self.limit_m


def assert_clear(judge, start, route):
    points = [start, *(leg.to for leg in route.legs)]
    for a, b in itertools.pairwise(points):
        assert judge.clear(a, b), (a, b, judge.distance_m(LineString([a, b])))
    length_m = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
    assert route.length_m == pytest.approx(length_m)


@cache
def flown_in(name):
    mission = load_mission(MISSIONS / name / "mission.yaml")
    graph = WaypointGraph(mission)
    return mission, graph, Router(graph), Judge(mission)


@pytest.fixture(params=["pennovation", "urban"])
def flown(request):
    return flown_in(request.param)


@pytest.fixture
def pennovation():
    return flown_in("pennovation")


def made(folder, **changes):
    mission = local_mission(folder, **changes)
    graph = WaypointGraph(mission)
    return mission, graph, Router(graph), Judge(mission)


# The graph.


def test_edges_are_exactly_the_clear_pairs_within_reach(flown):
    mission, graph, _, judge = flown
    for a, b in itertools.combinations(graph.positions, 2):
        here, there = graph.position(a), graph.position(b)
        length_m = math.dist(here, there)
        expected = length_m <= mission.planner.max_edge_m and judge.clear(here, there)
        assert graph.graph.has_edge(a, b) == expected
        if expected:
            assert graph.graph.edges[a, b]["length_m"] == pytest.approx(length_m)
    assert nx.is_connected(graph.graph)
    assert list(graph.detours) == []


def test_pieces_are_joined_by_detours(tmp_path):
    _, graph, router, judge = made(
        tmp_path,
        waypoints=[[50, 60], [-50, 60]],
        no_fly_zones=[{"name": "river", "polygon": box(-80, 20, 80, 30)}],
    )
    assert nx.is_connected(graph.graph)
    ((a, b),) = graph.detours
    assert {a, b} in ({0, 1}, {0, 2})
    assert graph.via(a, b) == graph.via(b, a)[::-1]
    route = router.route(graph.position(1), 0)
    assert_clear(judge, graph.position(1), route)
    assert route.legs[-1] == Leg(Point(0, 0), 0)
    assert any(leg.node is None for leg in route.legs)


def test_far_pieces_are_joined_straight(tmp_path):
    _, graph, _, _ = made(tmp_path, waypoints=[[90, 0], [-90, 0]], planner={"max_edge_m": 50})
    assert nx.is_connected(graph.graph)
    assert sorted(graph.graph.edges) == [(0, 1), (0, 2), (1, 2)]
    assert list(graph.detours) == []


# Routes between nodes and points.


def test_from_every_waypoint_to_every_other(flown):
    mission, graph, router, judge = flown
    for a, b in itertools.product(graph.positions, repeat=2):
        route = router.route(graph.position(a), b)
        assert isinstance(route, Route)
        assert route.legs[-1] == Leg(graph.position(b), b)
        assert_clear(judge, graph.position(a), route)
        assert route.warnings == ()
    assert len(mission.waypoints) == len(graph.positions) - 1


def test_the_operators_leg_through_a_zone_is_flown_around(pennovation):
    _, graph, router, judge = pennovation
    six, seven = graph.position(6), graph.position(7)
    assert not judge.clear(six, seven)
    assert not router.check_leg(six, seven)
    route = router.route(six, 7)
    assert [leg.node for leg in route.legs] == [3, 7]


def test_routes_on_the_graph_are_the_shortest_there_are():
    _, graph, router, _ = flown_in("urban")
    for a, b in itertools.product(graph.positions, repeat=2):
        if not router.check_leg(graph.position(a), graph.position(b)):
            on_graph_m = nx.dijkstra_path_length(graph.graph, a, b, weight="length_m")
            assert router.route(graph.position(a), b).length_m <= on_graph_m + 1e-9


@pytest.mark.parametrize("name", ["W20_Z20_disjoint", "W100_Z20_disjoint"])
def test_every_pair_of_a_map_is_joined_by_a_clear_route(tmp_path, name):
    data = json.loads((DATA / "maps" / f"{name}.json").read_text())
    _, graph, router, judge = made(
        tmp_path,
        home=data["waypoints"][0],
        waypoints=data["waypoints"][1:],
        fence=data["fence"],
        no_fly_zones=data["zones"],
        planner={
            "clearance_m": data["clearance"] - 0.02,
            "tracking_margin_m": 0.02,
            "max_edge_m": data["max_edge"],
        },
    )
    assert nx.is_connected(graph.graph)
    for start, goal in data["pairs"]:
        route = router.route(Point(*start), Point(*goal))
        assert isinstance(route, Route)
        assert route.legs[-1].to == pytest.approx(tuple(goal))
        assert_clear(judge, Point(*start), route)


def test_a_point_on_a_waypoint_is_that_waypoint(pennovation):
    _, graph, router, _ = pennovation
    there = graph.position(5)
    route = router.route(graph.position(6), Point(there.east_m + 0.004, there.north_m))
    assert route.legs[-1] == Leg(there, 5)


# Answers that are no route.


def test_a_goal_that_is_not_clear(pennovation):
    _, _, router, _ = pennovation
    inside = router.route(Point(0, 0), Point(10, -50))
    assert inside == NoRoute("the goal lies inside no-fly zone 'zone 1'", ("zone 1",))
    outside = router.route(Point(0, 0), Point(0, 300))
    assert outside == NoRoute("the goal lies outside the fence", ("fence",))
    beside = router.route(Point(0, 0), Point(23, -2))
    assert isinstance(beside, NoRoute)
    assert beside.blockers == ("zone 1",)
    assert beside.reason.endswith("m from no-fly zone 'zone 1', routes keep 6.5 m")


def test_a_goal_behind_walls_names_them(tmp_path):
    _, _, router, _ = made(
        tmp_path,
        no_fly_zones=[
            {"name": "wall", "polygon": box(-99, -60, 99, -50)},
            {"name": "shed", "polygon": box(-60, 60, -50, 70)},
        ],
    )
    answer = router.route(Point(0, 0), Point(0, -80))
    assert isinstance(answer, NoRoute)
    assert answer.blockers == ("fence", "wall")
    assert "the fence and no-fly zone 'wall' separate start and goal" in answer.reason


def test_a_goal_in_a_courtyard_is_refused_by_what_is_kept_from_its_walls(tmp_path):
    holes = [box(-60, 40, -20, 80)]
    _, _, router, _ = made(
        tmp_path,
        no_fly_zones=[
            {"name": "court", "polygon": box(-70, 30, -10, 90), "holes": holes, "clearance_m": 8}
        ],
    )
    answer = router.route(Point(0, 0), Point(-40, 60))
    reason = "no-fly zone 'court' separates start and goal at 9.5 m of distance"
    assert answer == NoRoute(reason, ("court",))


# Where the vehicle is, how fast it moves.


def coming_to_rest(start, rest):
    """The momentum of a vehicle that would stop there."""
    way_m = math.dist(start, rest)
    speed_m_s = BRAKING_M_S2 * (math.sqrt(0.36 + 2 * way_m / BRAKING_M_S2) - 0.6)
    share = speed_m_s / way_m if way_m else 0.0
    velocity_m_s = share * (rest.east_m - start.east_m), share * (rest.north_m - start.north_m)
    return Momentum(rest, velocity_m_s, 3.5, 0.6)


@given(st.floats(-math.pi, math.pi), st.floats(0.5, 4.0), st.floats(2.0, 4.0), st.floats(5, 60))
def test_a_turn_stays_within_its_corners(angle, speed_m_s, cruise_m_s, away_m):
    """A vehicle with the acceleration and the jerk of a PX4 that receives its leg after 0.15 s."""
    here, end = Point(0.0, 0.0), Point(away_m * math.cos(angle), away_m * math.sin(angle))
    rest = Point(speed_m_s * (0.6 + speed_m_s / (2 * BRAKING_M_S2)), 0.0)
    momentum = Momentum(rest, (speed_m_s, 0.0), cruise_m_s, 0.6)
    corners = (here, rest, momentum.turn(here, end), end)
    vehicle = Multirotor()
    vehicle.up_m, vehicle.on_ground = 40.0, False
    vehicle.velocity_east_m_s, vehicle.east_m = speed_m_s, 0.15 * speed_m_s
    flown = []
    while (left_m := math.dist((vehicle.east_m, vehicle.north_m), end)) > 1.0 and len(flown) < 900:
        speed = min(cruise_m_s, math.sqrt(1.27 + 6 * left_m) - 1.13)
        east, north = end.east_m - vehicle.east_m, end.north_m - vehicle.north_m
        vehicle.step(0.05, MotionDemand(speed * north / left_m, speed * east / left_m))
        flown.append((vehicle.east_m, vehicle.north_m))
    assert MultiPoint(corners).convex_hull.buffer(0.05).covers(MultiPoint(flown))


def test_turning_back_takes_no_more_room_than_stopping_and_going_on_none():
    here, rest = Point(0.0, 0.0), Point(6.0, 0.0)
    momentum = Momentum(rest, (4.0, 0.0), 4.0, 0.5)
    assert momentum.turn(here, Point(-50.0, 0.0)) == rest
    assert momentum.turn(here, Point(50.0, 0.0)) == Point(2.0, 0.0)
    stands = Momentum(rest, (0.3, 0.0), 4.0, 0.5)
    assert stands.turn(here, Point(0.0, 50.0)) == rest


def test_a_moving_vehicle_gets_a_leg_whose_sweep_is_clear(pennovation):
    mission, graph, router, judge = pennovation
    rng = random.Random(7)
    answers = 0
    for _ in range(300):
        start = Point(rng.uniform(-180, 130), rng.uniform(-180, 90))
        rest = Point(start.east_m + rng.uniform(-4, 4), start.north_m + rng.uniform(-4, 4))
        turns = Point(start.east_m + rng.uniform(-30, 30), start.north_m + rng.uniform(-30, 30))
        if not (judge.clear(start) and judge.clear(rest)):
            continue
        under_way = [PendingSetpoint(turns, turns)] if judge.clear(start, rest, turns) else []
        goal = rng.randrange(len(graph.positions))
        route = router.route(start, goal, momentum=coming_to_rest(start, rest), pending=under_way)
        if isinstance(route, NoRoute):
            assert route.reason == "no first leg is clear at this speed"
            continue
        answers += 1
        assert judge.clear(start, rest, *(on.place for on in under_way), route.legs[0].to)
        assert router.check_leg(start, route.legs[0].to, coming_to_rest(start, rest), under_way)
        assert_clear(judge, start, route)
    assert answers > 60
    assert mission.planning_distance_m == 6.5


def test_too_fast_towards_a_zone_there_is_no_first_leg(pennovation):
    _, _, router, _ = pennovation
    start, rest = Point(0.0, 0.0), Point(10, -35)
    assert not router.check_leg(start, Point(0, 10), coming_to_rest(start, rest))
    answer = router.route(start, 25, momentum=coming_to_rest(start, rest))
    assert answer == NoRoute("no first leg is clear at this speed", ("zone 1",))


def wall_world(tmp_path):
    return made(
        tmp_path,
        home=[0, -50],
        waypoints=[[-60, -50], [60, -50], [0, 50]],
        no_fly_zones=[{"name": "wall", "polygon": box(-50, -2, 50, 2)}],
    )


def test_a_leg_that_ends_nearer_to_a_zone_than_routes_keep_is_not_flown(tmp_path):
    hall = {"name": "hall", "polygon": box(10, 20, 20, 30)}
    mission, _, router, _ = made(tmp_path, no_fly_zones=[hall])
    start = Point(15, -20)
    keeps_m = mission.planning_distance_m
    half_m = mission.planner.clearance_m + mission.tracking.flown_m
    assert not router.check_leg(start, Point(15, 20 - (keeps_m + half_m) / 2))
    assert router.check_leg(start, Point(15, 20 - keeps_m - 0.1))


@pytest.mark.parametrize("off_m", [0.01, 0.4, 1.4, 3, 4.5, 6.4])
def test_a_vehicle_inside_the_margin_leaves_it_without_coming_closer(tmp_path, off_m):
    mission, _, router, judge = wall_world(tmp_path)
    distance_m = mission.planning_distance_m - off_m
    start = Point(10, -2 - distance_m)
    for goal in (0, 1, 2, 3):
        route = router.route(start, goal)
        assert isinstance(route, Route)
        first = route.legs[0].to
        assert judge.distance_m(LineString([start, first])) >= distance_m - 0.02
        assert judge.clear(first)
        assert router.check_leg(start, first)
        assert_clear(judge, first, Route(route.legs[1:], route.length_m - math.dist(start, first)))
        beyond = LineString([start, first]).difference(MultiPoint([start]).buffer(2 * off_m + 1.1))
        if off_m > 0.75 and not beyond.is_empty:
            assert judge.distance_m(beyond) >= judge.limit_m
        assert bool(route.warnings) == (distance_m < mission.planner.clearance_m)
    assert not router.check_leg(start, Point(10, 50))


@pytest.mark.parametrize(("closer_m", "leaves"), [(0.2, True), (1.0, False)])
def test_too_near_and_coming_nearer_it_brakes_before_it_leaves(closer_m, leaves):
    """A hovering vehicle seems to drift by some centimetres; one that comes nearer has to stop."""
    zone = Zone("wall", (Point(0, -50), Point(10, -50), Point(10, 50), Point(0, 50)))
    airspace = Airspace(None, [zone], 5.0).with_margin(1.5)
    here = Point(-4.0, 0.0)
    rule = Departure(
        airspace, ShortestPaths(airspace), here, coming_to_rest(here, Point(-4.0 + closer_m, 0.0))
    )
    assert rule.allows(Point(-60.0, 0.0)) is leaves


def test_a_drifting_vehicle_beside_the_margin_is_not_stranded(tmp_path):
    mission, _, router, _ = wall_world(tmp_path)
    for distance_m in (6.45, 6.55):
        start = Point(10, -2 - distance_m)
        drift = Point(10.05, start.north_m + 0.15)
        route = router.route(start, 1, momentum=coming_to_rest(start, drift))
        assert isinstance(route, Route)
        assert router.check_leg(start, route.legs[0].to, coming_to_rest(start, drift))
    assert mission.planning_distance_m == 6.5


def test_out_of_a_narrow_lane_no_leg_leads_deeper_into_it(tmp_path):
    _, _, router, _ = made(
        tmp_path,
        home=[85, 0],
        waypoints=[[85, 50], [85, -50]],
        no_fly_zones=[
            {"name": "north", "polygon": box(-90, 5.5, 60, 40)},
            {"name": "south", "polygon": box(-90, -40, 60, -5.5)},
        ],
    )
    start = Point(0, 0)  # 5.5 m from both
    assert router.check_leg(start, Point(10, 0))
    assert not router.check_leg(start, Point(-10, 0))


def test_no_leg_ends_nearer_to_a_zone_than_routes_keep(tmp_path):
    """Half of the tracking margin is for the way there, not for where it stays."""
    mission, _, router, _ = wall_world(tmp_path)
    keeps_m = mission.planning_distance_m
    start = Point(10, -25)
    assert router.check_leg(start, Point(10, -2 - keeps_m - 0.1))
    assert not router.check_leg(start, Point(10, -2 - keeps_m + 0.3))


def test_where_no_node_is_near_the_way_leads_onto_the_graph_from_afar(tmp_path):
    _, _, router, _ = made(
        tmp_path,
        waypoints=[[0, 40], [40, 40]],
        no_fly_zones=[{"name": "hides waypoint 2", "polygon": box(10, -30, 30, 20)}],
        planner={"max_edge_m": 45.0},
    )
    route = router.route(Point(0, -60), 2)
    assert [leg.node for leg in route.legs] == [1, 2]


def test_a_vehicle_a_bit_off_a_tight_leg_may_fly_it_on(pennovation):
    mission, graph, router, judge = pennovation
    a, b = graph.position(21), graph.position(22)
    along = (b.east_m - a.east_m, b.north_m - a.north_m)
    length_m = math.hypot(*along)
    shares = [share / 50 for share in range(1, 50)]
    tight = min(
        (Point(a.east_m + s * along[0], a.north_m + s * along[1]) for s in shares),
        key=lambda place: judge.distance_m(MultiPoint([place])),
    )
    slack_m = mission.tracking.planned_m - mission.tracking.flown_m
    for off_m in (-0.99 * slack_m, -0.1, 0.1, 0.99 * slack_m):
        start = Point(
            tight.east_m - off_m * along[1] / length_m, tight.north_m + off_m * along[0] / length_m
        )
        for end in (a, b):
            assert router.check_leg(start, end)
            limit_m = min(judge.distance_m(MultiPoint([start])), judge.limit_m) - 0.02
            assert judge.distance_m(LineString([start, end])) >= limit_m
    assert mission.planner.tracking_margin_m == 1.5


def test_a_vehicle_that_would_stop_within_the_clearance_brakes_first(tmp_path):
    _, _, router, _ = wall_world(tmp_path)
    start, rest = Point(10, -20), Point(10, -5)
    assert isinstance(router.route(start, 0, momentum=coming_to_rest(start, rest)), NoRoute)
    assert isinstance(router.route(start, 0), Route)


def test_a_leg_out_of_the_margin_keeps_away_from_other_zones(tmp_path):
    # 3 m beside the wall, a mast close to the straight way home: the first metres may be near the
    # wall, but nothing else may be passed at 3 m.
    _, _, router, judge = made(
        tmp_path,
        home=[0, -80],
        waypoints=[[60, -80]],
        no_fly_zones=[
            {"name": "wall", "polygon": box(-50, -2, 50, 2)},
            {"name": "mast", "polygon": box(2, -42, 6, -38)},
        ],
    )
    start = Point(0, -5)
    route = router.route(start, 0)
    assert isinstance(route, Route)
    points = [start, *(leg.to for leg in route.legs)]
    assert Polygon(box(2, -42, 6, -38)).distance(LineString(points)) >= 6.5 - 1e-6
    assert_clear(
        judge, points[1], Route(route.legs[1:], sum(map(math.dist, points[1:], points[2:])))
    )


@pytest.mark.parametrize("inside", [(0, 0), (-49, 1), (49.9, -1.9), (20, 1.5)])
def test_a_vehicle_inside_a_zone_takes_the_short_way_out_and_reports_it(tmp_path, inside):
    mission, _, router, judge = wall_world(tmp_path)
    route = router.route(Point(*inside), 3)
    assert isinstance(route, Route)
    assert "inside no-fly zone 'wall'" in route.warnings[0]
    first = route.legs[0].to
    assert router.check_leg(Point(*inside), first)
    nearest = ShortestPaths(mission.planning_airspace).nearest(Point(*inside))
    out = LineString([inside, first])
    assert out.intersection(judge.zones).length <= 1.5 * math.dist(inside, nearest) + 1
    assert judge.clear(first)


def test_a_vehicle_outside_of_the_fence_comes_back_in(tmp_path):
    _, _, router, judge = wall_world(tmp_path)
    route = router.route(Point(-130, -50), 0)
    assert isinstance(route, Route)
    assert "outside the fence" in route.warnings[0]
    assert judge.clear(route.legs[-1].to)


def test_the_way_out_does_not_lead_through_the_next_wall(tmp_path):
    # Between two walls: the nearest clear place lies behind one of them.
    _, _, router, judge = made(
        tmp_path,
        home=[0, -50],
        waypoints=[[80, 0]],
        no_fly_zones=[
            {"name": "south wall", "polygon": box(-50, 0, 50, 1)},
            {"name": "north wall", "polygon": box(-50, 7, 50, 8)},
        ],
    )
    start = Point(0, 3)
    answer = router.route(start, 0)
    assert isinstance(answer, Route)
    assert "2.0 m from no-fly zone 'south wall'" in answer.warnings[0]
    points = [start, *(leg.to for leg in answer.legs)]
    assert judge.zones.distance(LineString(points)) >= 2.0 - 0.02
    assert router.check_leg(start, answer.legs[0].to)
    assert not router.check_leg(start, Point(0, -20))
    assert_clear(
        judge, points[1], Route(answer.legs[1:], sum(map(math.dist, points[1:], points[2:])))
    )


@given(st.integers(0, 2**32 - 1))
def test_from_anywhere_to_anywhere_every_clear_start_gets_clear_legs(seed):
    _mission, _graph, router, judge = flown_in("urban")
    rng = random.Random(seed)
    start, goal = (Point(rng.uniform(-190, 150), rng.uniform(-140, 80)) for _ in range(2))
    route = router.route(start, goal)
    if not judge.clear(goal):
        assert isinstance(route, NoRoute)
    elif judge.clear(start):
        assert isinstance(route, Route)
        assert_clear(judge, start, route)
        back = router.route(goal, start)
        assert back.length_m == pytest.approx(route.length_m)
    else:
        assert isinstance(route, Route | NoRoute)
        if isinstance(route, Route):
            onward = Route(route.legs[1:], route.length_m - math.dist(start, route.legs[0].to))
            assert_clear(judge, route.legs[0].to, onward)
            assert router.check_leg(start, route.legs[0].to)


# The planner `shortest`, and large graphs.


@cache
def straightest(name):
    mission = flown_in(name)[0]
    planner = dataclasses.replace(mission.planner, kind="shortest")
    return Router(WaypointGraph(dataclasses.replace(mission, planner=planner)))


def test_the_shortest_planner_is_never_longer_and_as_clear():
    _, graph, router, judge = flown_in("urban")
    shortest = straightest("urban")
    saved_m = 0.0
    for a, b in itertools.product(graph.positions, repeat=2):
        route, straight = router.route(graph.position(a), b), shortest.route(graph.position(a), b)
        assert_clear(judge, graph.position(a), straight)
        assert straight.legs[-1].node == b
        assert len(straight.legs) <= 16
        # Small turns along an arc are made one, which costs a little.
        assert straight.length_m <= 1.01 * route.length_m + 1e-9
        saved_m += route.length_m - straight.length_m
    assert saved_m > 0


@given(st.integers(0, 2**32 - 1))
def test_the_shortest_planner_keeps_speed_and_the_margin_too(seed):
    rng = random.Random(seed)
    start, goal = (Point(rng.uniform(-190, 150), rng.uniform(-140, 80)) for _ in range(2))
    rest = Point(start.east_m + rng.uniform(-5, 5), start.north_m + rng.uniform(-5, 5))
    judge, router = flown_in("urban")[3], straightest("urban")
    route = router.route(start, goal, momentum=coming_to_rest(start, rest))
    if isinstance(route, NoRoute):
        assert route.reason
        return
    first = route.legs[0].to
    assert router.check_leg(start, first, coming_to_rest(start, rest))
    assert judge.clear(goal)
    if judge.clear(start, rest):
        assert judge.clear(start, rest, first)
        onward = Route(route.legs[1:], route.length_m - math.dist(start, first))
        assert_clear(judge, first, onward)


def test_two_thousand_waypoints_among_a_hundred_zones_hang_together():
    map_ = made_map(2000, 100)
    mission = SimpleNamespace(
        planning_airspace=map_.airspace,
        home=map_.waypoints[0],
        waypoints=[SimpleNamespace(position=place) for place in map_.waypoints[1:]],
        planner=PlannerSettings(max_edge_m=map_.max_edge_m),
    )
    graph = WaypointGraph(mission)
    assert nx.is_connected(graph.graph)
    assert graph.graph.number_of_edges() > 10_000
    edges = random.Random(1).sample(sorted(graph.graph.edges), 500)
    zones = union_all([zone.polygon for zone in map_.airspace.zones])
    for a, b in edges:
        way = [graph.position(a), *graph.via(a, b), graph.position(b)]
        assert zones.distance(LineString(way)) >= 5 - 1e-6
        length_m = sum(math.dist(c, d) for c, d in itertools.pairwise(way))
        assert graph.graph.edges[a, b]["length_m"] == pytest.approx(length_m)


def test_no_leg_leads_from_a_waypoint_to_itself(flown):
    _, graph, router, _ = flown
    for start in graph.positions:
        for goal in (1, max(graph.positions)):
            route = router.route(graph.position(start), goal)
            assert isinstance(route, Route)
            assert start == goal or route.legs[0].node != start


@pytest.mark.parametrize(("aside_m", "allowed"), [(14.9, False), (15.1, True)])
def test_who_is_too_near_to_one_zone_keeps_the_clearance_of_others(aside_m, allowed):
    near = Zone("near", Circle(Point(0.0, -12.7), 10.0))
    wide = Zone("wide", Circle(Point(-30.0, 0.0), 5.0), clearance_m=60.0)
    other = Zone("other", Circle(Point(40.0, aside_m), 10.0))
    airspace = Airspace(None, [near, wide, other], 5.0, 1.5)
    rule = Departure(airspace, ShortestPaths(airspace), Point(0.0, 0.0), None)
    assert rule.in_margin
    assert rule.allows(Point(100.0, 0.0)) is allowed


@pytest.mark.parametrize(("away_m", "allowed"), [(10.0, False), (30.0, True)])
def test_who_is_too_near_to_a_zone_leaves_it_in_the_first_metres_and_not_along_it(away_m, allowed):
    wall = Zone("wall", (Point(-200, -5), Point(200, -5), Point(200, 0), Point(-200, 0)))
    airspace = Airspace(None, [wall], 5.0, 1.5)
    rule = Departure(airspace, ShortestPaths(airspace), Point(0.0, 3.0), None)
    assert airspace.point_clear(Point(40.0, away_m))
    assert rule.allows(Point(40.0, away_m)) is allowed


@pytest.mark.parametrize("fast", [False, True])
def test_a_leg_keeps_what_the_vehicle_may_be_off_and_more_if_it_begins_at_speed(tmp_path, fast):
    """Past a mast, from a place and to one that are both far from it."""
    mast = {"name": "mast", "polygon": box(-1, 0, 1, 2)}
    mission, _, router, _ = made(tmp_path, home=[0, -60], no_fly_zones=[mast])
    tracking = mission.tracking
    assert tracking.flown_m < tracking.turned_m < tracking.planned_m
    least_m = mission.planner.clearance_m + (tracking.turned_m if fast else tracking.flown_m)
    for more_m, clear in ((-0.02, False), (0.02, True)):
        start, end = (Point(east_m, -least_m - more_m) for east_m in (-40.0, 40.0))
        momentum = coming_to_rest(start, Point(-34.0, start.north_m)) if fast else None
        assert router.check_leg(start, end, momentum) is clear
