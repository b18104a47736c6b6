"""Where to look for a robot: as near to it as a clear way leads."""

import math
from types import SimpleNamespace

from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.task import Goal
from air_router.controller.motion.navigator import Navigator
from air_router.controller.states.search_points import Search
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from geo.frame import Point
from tests.air_router.local_mission import box, local_mission


def searching(folder, zones):
    places = {"home": [0, -60], "waypoints": [[60, -60]]}
    mission = local_mission(folder, **places, no_fly_zones=zones)
    exploration = SimpleNamespace(
        here=mission.home, began_s=0.0, remaining=0, longest_unseen=lambda: Goal(mission.home)
    )
    router = Router(WaypointGraph(mission))
    context = MissionContext(mission, router)
    setup = FlightSetup(mission, ("io",))
    return mission, Search(context, Navigator(context, None), setup, exploration)


def point_for(search, place):
    search.targets.tracks["io"].pose_received(place, 1.0, 1.0)
    (point,) = search.search_points(2.0)
    return point


def test_a_robot_in_the_open_is_sought_where_it_is(tmp_path):
    _, search = searching(tmp_path, [{"name": "hall", "polygon": box(-20, -20, 20, 20)}])
    point = point_for(search, Point(50, 50))
    assert point.goal.position == (50, 50)
    assert point.offset_m == 0
    assert point.reason == "its last position"


def test_a_robot_in_a_zone_is_sought_from_the_nearest_clear_place_with_that_as_reason(tmp_path):
    mission, search = searching(tmp_path, [{"name": "hall", "polygon": box(-20, -20, 20, 20)}])
    point = point_for(search, Point(15, 0))
    assert mission.planning_airspace.point_clear(point.goal.position)
    assert math.dist(point.goal.position, (26.5, 0)) < 0.01
    assert point.reason == (
        "its last position; it is inside no-fly zone 'hall', so 11.5 m beside it"
    )


def test_a_robot_in_a_closed_yard_is_sought_from_outside_of_it(tmp_path):
    yard = {"name": "yard", "polygon": box(-40, -30, 40, 40), "holes": [box(-30, -20, 30, 30)]}
    mission, search = searching(tmp_path, [yard])
    for place, why in ((Point(0, -10), "no clear way leads there"), (Point(28, 0), "too close")):
        point = point_for(search, place)
        search.targets.__init__(("io",))
        assert mission.planning_airspace.point_clear(point.goal.position)
        assert max(map(abs, point.goal.position)) > 35
        assert why in point.reason
