"""Ways home: their lengths, what they take of the battery, and the autopilot's own return."""

import math
import random

import pytest

from air_router.routing.graph import WaypointGraph
from air_router.routing.limits import LANDING_M_S, LANDING_MARGIN, WAY_HOME_MOVED_M
from air_router.routing.return_planner import Pace, ReturnPlanner, Way, WayHome, straight_returns
from air_router.routing.router import Route, Router
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point
from tests.air_router.local_mission import box, local_mission


def made(folder, **changes):
    square = {"waypoints": [[80, 0], [80, 80], [0, 80]], "fence": box(-200, -200, 200, 200)}
    barn = {"name": "barn", "polygon": box(20, 20, 60, 60)}
    values = {"altitude_m": 35, "speed_m_s": 5, **square, "no_fly_zones": [barn]}
    return local_mission(folder, **values | changes)


def planner_of(mission):
    graph = WaypointGraph(mission)
    return ReturnPlanner(Router(graph))


def test_ways_home_go_around_and_straight_ones_are_taken(tmp_path):
    ways = planner_of(made(tmp_path)).home
    assert ways[0] == Way(0.0, 0)
    assert ways[1] == Way(80.0)
    assert ways[2] == Way(160.0, 2)  # straight over the barn it would be 113 m
    assert ways[3] == Way(80.0)


def test_the_worst_waypoint_and_the_worst_place_of_a_leg(tmp_path):
    found = planner_of(made(tmp_path))
    assert found.worst_waypoint == (2, Way(160.0, 2))
    (_, leg), (_, way) = found.worst_place[0], found.worst_place
    assert leg == 2
    assert way.length_m == pytest.approx(160.0)


def test_where_routes_are_the_shortest_so_is_the_worst_way(tmp_path):
    waypoints = [[80, 0], [80, 80], [-150, -150], [0, 80]]
    mission = made(tmp_path, waypoints=waypoints, planner={"kind": "shortest"})
    found = planner_of(mission)
    assert found.worst_place is None
    assert found.worst_waypoint == (3, Way(math.hypot(150, 150)))
    hidden = planner_of(made(tmp_path, waypoints=waypoints[:2], planner={"kind": "shortest"}))
    number, way = hidden.worst_waypoint
    assert number == 2
    assert 113 < way.length_m < 160  # around the barn, not by way of waypoint 1


def test_no_way_home_is_longer_than_over_the_graph_or_shorter_than_straight(pennovation):
    graph = WaypointGraph(pennovation)
    router = Router(graph)
    for node, way in ReturnPlanner(router).home.items():
        straight_m = math.dist(graph.position(node), pennovation.home)
        route = router.route(graph.position(node), 0)
        assert isinstance(route, Route)
        assert straight_m - 1e-6 <= way.length_m
        assert route.length_m == pytest.approx(way.length_m, rel=0.02)


def test_what_a_way_takes(tmp_path):
    pace = Pace.of(made(tmp_path, endurance_s=1000))
    assert pace.landing_s == 35 / LANDING_M_S == 50
    assert pace.time_s(Way(100.0, 2)) == 100 / 5 + 2 * 2.5
    assert pace.need(Way(100.0, 2)) == pytest.approx((25 + 50) / 1000)
    assert Pace.of(made(tmp_path)).need(Way(1.0)) is None


def test_rally_points(tmp_path):
    assert planner_of(made(tmp_path)).rally == {}
    ways = planner_of(made(tmp_path, rally_points=[[80, 100], [-100, 0]])).rally
    assert ways[2] == Way(20.0)
    assert ways[0] == Way(100.0)
    assert ways[1] == Way(100.0)  # the other one would be 180 m
    assert ways[3].length_m == pytest.approx(math.hypot(80, 20))


def test_a_rally_point_that_no_waypoint_sees_is_reached_around_corners(tmp_path):
    west = [[60, 110], [-50, 110], [-50, 150], [60, 150]]
    yard = [[-60, 100], [60, 100], *west, [60, 160], [-60, 160]]
    mission = made(tmp_path, no_fly_zones=[{"polygon": yard}], rally_points=[[-35, 130]])
    ways = planner_of(mission).rally
    assert set(ways) == {0, 1, 2, 3}
    assert ways[3].length_m > 150


def test_where_the_autopilot_s_straight_return_cuts(tmp_path):
    found = straight_returns(made(tmp_path))
    assert [(r.waypoint, r.to, r.cuts) for r in found] == [(2, "home", ("barn",))]
    rally = straight_returns(made(tmp_path, rally_points=[[80, 100]]))
    assert rally == ()  # waypoint 2 has one in sight
    rally = straight_returns(made(tmp_path, rally_points=[[0, 10]], waypoints=[[80, 80]]))
    assert [(r.waypoint, r.to) for r in rally] == [(1, "rally point 1")]


def test_a_concave_fence_is_cut_too(tmp_path):
    fence = [[-20, -20], [200, -20], [200, 100], [150, 100], [150, 20], [-20, 20]]
    mission = made(tmp_path, fence=fence, no_fly_zones=[], waypoints=[[180, 80], [100, 0]])
    assert [(r.waypoint, r.cuts) for r in straight_returns(mission)] == [(1, ("fence",))]


def test_the_return_climbs_into_zones_above_the_mission(tmp_path):
    def cuts(lower_m, upper_m):
        zone = {
            "polygon": box(20, 20, 60, 60),
            "altitude": {"lower_m": lower_m, "upper_m": upper_m},
        }
        return [r.waypoint for r in straight_returns(made(tmp_path, no_fly_zones=[zone]))]

    assert cuts(50, 120) == [2]  # 15 m above the mission, below the return altitude
    assert cuts(70, 120) == []
    assert cuts(0, 20) == []


def test_large_missions(tmp_path):
    chance = random.Random(4)
    zones = []
    for east in range(22):
        for north in range(22):
            west, south = -1980 + 180 * east, -1980 + 180 * north
            zones.append([[west, south], [west + 60, south], [west + 60, south + 60]])
    waypoints = []
    while len(waypoints) < 500:
        place = [chance.uniform(-1990, 1990), chance.uniform(-1990, 1990)]
        if all(75 < (place[i] + 1980) % 180 < 170 for i in (0, 1)):
            waypoints.append(place)
    mission = made(
        tmp_path,
        home=[90, 90],
        waypoints=waypoints,
        no_fly_zones=zones,
        planner={"max_edge_m": 250},
        fence=[[-2100, -2100], [2100, -2100], [2100, 2100], [-2100, 2100]],
    )
    found = planner_of(mission)
    assert len(found.home) == 501
    assert len({r.waypoint for r in straight_returns(mission)}) > 250


def telemetry(mission, position, time_s=1.0, battery=0.5):
    return Telemetry(
        time_s,
        position,
        mission.altitude_above_home_m,
        in_air=True,
        mode=FlightMode.MISSION,
        battery=battery,
    )


class CountingRouter:
    def __init__(self, mission):
        self.graph = WaypointGraph(mission)
        self.router = Router(self.graph)
        self.requested = 0
        self.finds_none = False

    def route(self, *arguments):
        self.requested += 1
        return None if self.finds_none else self.router.route(*arguments)


def test_in_flight_the_way_home_is_planned_now_and_then(tmp_path):
    mission = made(tmp_path, endurance_s=1000)
    router = CountingRouter(mission)
    way = WayHome()
    assert way.need(telemetry(mission, Point(80, 80)), router) > way.need(
        telemetry(mission, Point(80, 0), 2.0), router
    )
    assert router.requested == 2
    for tenth in range(30):
        way.need(telemetry(mission, Point(80, 0.01 * tenth), 2.0 + tenth / 10), router)
    assert router.requested == 2
    way.need(telemetry(mission, Point(80, 0.3), 8.0), router)
    assert router.requested == 3
    among_other_zones = CountingRouter(mission)
    way.need(telemetry(mission, Point(80, 0.3), 8.0), among_other_zones)
    assert among_other_zones.requested == 1


def test_in_flight_the_way_home_has_a_leg_more_for_it_brakes_first(tmp_path):
    mission = made(tmp_path, endurance_s=1000)
    need = WayHome().need(telemetry(mission, Point(80, 0)), CountingRouter(mission))
    assert need == pytest.approx(Pace.of(mission).need(Way(80.0, 2)))


def test_the_way_home_is_planned_anew_as_soon_as_it_has_moved_so_far(tmp_path):
    mission = made(tmp_path, endurance_s=1000)
    way, router = WayHome(), CountingRouter(mission)
    for north_m, requested in ((0.0, 1), (WAY_HOME_MOVED_M - 0.1, 1), (WAY_HOME_MOVED_M, 2)):
        way.need(telemetry(mission, Point(80, north_m), 2.0), router)
        assert router.requested == requested


def test_without_a_way_the_last_one_counts_and_the_distance_since(tmp_path):
    mission = made(tmp_path, endurance_s=1000)
    here = telemetry(mission, Point(40, 40))
    assert WayHome().need(here, CountingRouter(mission)) is not None  # inside the barn: it gets out
    way, router = WayHome(), CountingRouter(mission)
    before = way.need(telemetry(mission, Point(80, 0)), router)
    lost = telemetry(mission, Point(80, -5000), 2.0)
    router.finds_none = True
    assert way.need(lost, router) == pytest.approx(before + 1000 / 1000, abs=0.01)
    assert WayHome().need(lost, router) is None
    assert WayHome().need(lost, CountingRouter(made(tmp_path))) is None


def test_the_vehicle_turns_when_the_charge_is_needed_for_the_way_home(airborne):
    flight = airborne(battery_reserve=0.05, endurance_s=600.0, duration_s=None)
    began_s, capacity_s = flight.now_s, 600.0

    def drain():
        flight.battery = max(0.0, 1.0 - (flight.now_s - began_s) / capacity_s)
        return flight.finished is not None

    flight.fly_until(drain)
    (why,) = [text for text in flight.announced if text.startswith("coming home")]
    assert "the way home takes" in why
    assert flight.controller.returns.need_home is None  # it is home
    assert flight.controller.context.ending_why in why
    assert flight.finished.landed_by_us
    assert 0.07 <= flight.battery <= 0.25  # not later than PX4's own return, and not much too early
    assert flight.mission.airspace.track_distance_m(flight.track)[0] >= 5.0


def test_the_margin_covers_px4_s_own_return():
    assert LANDING_MARGIN > 0.07
