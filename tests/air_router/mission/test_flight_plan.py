"""What goes on board: nodes as items; the fence, and what PX4 cannot store of it."""

import dataclasses
import math

import pytest

from air_router.mission.flight_plan import (
    FENCE_POINTS,
    HOME_NODE,
    Command,
    FlightPlan,
    Frame,
    PlanItem,
    fence_plan,
)
from air_router.mission.loading import load_mission
from air_router.preflight.check_facts import summary
from air_router.preflight.survey import MissionSurvey
from air_router.routing.graph import WaypointGraph
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Geodetic, Point
from sitl.px4sim.fence import fence_areas
from sitl.px4sim.plan_store import MissionItem
from sitl.px4sim.state import MapProjection

BASE = """\
coordinates: local
frame: {origin: [%s, %s]}
home: {position: [0, 0], altitude_amsl_m: 100}
altitude_m: 30
waypoints: [[60, 0]]
"""


def mission_of(folder, areas, origin=(38.5, -98.5)):
    path = folder / "mission.yaml"
    path.write_text(BASE % origin + areas)
    return load_mission(path)


def runs(mission):
    """Commands with the number of points, area by area."""
    items, found = list(fence_plan(mission).items), []
    while items:
        count = 1
        if items[0].command in {Command.FENCE_INCLUSION, Command.FENCE_EXCLUSION}:
            count = int(items[0].params[0])
        assert all(item.params == items[0].params for item in items[:count])
        assert all(item.command == items[0].command for item in items[:count])
        assert all(item.frame is Frame.GLOBAL_INT for item in items[:count])
        found.append((items[0].command.name, count))
        del items[:count]
    return found


def place(mission, item):
    return mission.frame.to_local(item.x_deg_e7 / 1e7, item.y_deg_e7 / 1e7)


def test_circles_go_on_board_as_circles(tmp_path):
    mission = mission_of(
        tmp_path,
        "fence: {circle: {centre: [10, 0], radius_m: 250.25}}\n"
        "no_fly_zones: [{circle: {centre: [0, 100], radius_m: 30.5}}]\n",
    )
    fence, zone = FlightPlan.of(mission).fence
    assert (fence.command, fence.params[0]) == (Command.FENCE_CIRCLE_INCLUSION, 250.25)
    assert (zone.command, zone.params[0]) == (Command.FENCE_CIRCLE_EXCLUSION, 30.5)
    assert place(mission, zone) == pytest.approx((0, 100), abs=0.01)
    assert mission.notes == ()


def test_several_fences_and_their_holes(tmp_path):
    mission = mission_of(
        tmp_path,
        "fences:\n"
        "  - circle: {centre: [0, 0], radius_m: 300}\n"
        "  - polygon: [[-200, -200], [200, -200], [200, 200], [-200, 200]]\n"
        "    holes: [[[100, 100], [150, 100], [150, 150]]]\n"
        "no_fly_zones: []\n",
    )
    assert runs(mission) == [
        ("FENCE_INCLUSION", 4),
        ("FENCE_EXCLUSION", 3),
        ("FENCE_CIRCLE_INCLUSION", 1),  # behind it PX4 1.17 would read no polygon
    ]


DONUT = """\
fence: null
no_fly_zones:
  - name: donut
    polygon: [[-90, -90], [190, -90], [190, 190], [-90, 190]]
    holes:
      - [[-70, -70], [80, -70], [80, 70], [-70, 70]]
      - [[100, 100], [120, 100], [120, 120]]
"""


def test_inside_of_a_donut_its_hole_is_the_fence(tmp_path):
    mission = mission_of(tmp_path, DONUT)
    assert runs(mission) == [("FENCE_INCLUSION", 4)]
    corners = [place(mission, item) for item in fence_plan(mission).items]
    assert corners[0] == pytest.approx((-70, -70), abs=0.02)


def test_outside_of_a_donut_it_is_filled(tmp_path):
    mission = mission_of(
        tmp_path,
        "fence: null\n"
        "no_fly_zones:\n"
        "  - polygon: [[200, 200], [400, 200], [400, 400], [200, 400]]\n"
        "    holes: [[[250, 250], [300, 250], [300, 300]]]\n",
    )
    assert runs(mission) == [("FENCE_EXCLUSION", 4)]


def test_zones_that_do_not_matter_take_no_points(tmp_path):
    mission = mission_of(
        tmp_path,
        "fence: {circle: {centre: [0, 0], radius_m: 200}}\n"
        "no_fly_zones:\n"
        "  - {name: beyond, circle: {centre: [500, 0], radius_m: 30}}\n"
        "  - {name: high, circle: {centre: [0, 100], radius_m: 30}, altitude: {lower_m: 90}}\n"
        "  - {name: low, circle: {centre: [0, -100], radius_m: 30}, altitude: {upper_m: 9}}\n"
        "  - {name: gone, circle: {centre: [0, -100], radius_m: 30},\n"
        '     active: [{until: "2020-01-01T00:00:00Z"}]}\n'
        "  - {name: here, circle: {centre: [-100, 0], radius_m: 30}}\n",
    )
    assert runs(mission) == [("FENCE_CIRCLE_INCLUSION", 1), ("FENCE_CIRCLE_EXCLUSION", 1)]
    (note,) = mission.notes
    assert note.code == "fence-simpler-on-board"
    assert note.line == 10
    assert "'low' is not in the fence on board: PX4 would apply it at all altitudes" in note.message


def test_long_sides_are_straight_where_they_were_drawn(tmp_path):
    """PX4 takes sides as straight in degrees: far north they would be metres off."""
    mission = mission_of(
        tmp_path,
        "fence: {polygon: [[-9000, -500], [9000, -500], [9000, 500], [-9000, 500]]}\n"
        "no_fly_zones: []\n",
        origin=(69.6, 18.9),
    )
    items = fence_plan(mission).items
    assert len(items) > 8
    ring = [Geodetic(item.x_deg_e7 / 1e7, item.y_deg_e7 / 1e7) for item in items]
    worst_m = 0.0
    for start, end in zip(ring, [*ring[1:], ring[0]], strict=True):
        middle = Geodetic((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        east_m, north_m = mission.frame.to_local(*middle)
        worst_m = max(worst_m, min(abs(abs(north_m) - 500), abs(abs(east_m) - 9000)))
    assert worst_m < 0.3


def test_sides_that_are_straight_in_degrees_need_no_corners_in_between(tmp_path):
    path = tmp_path / "mission.yaml"
    path.write_text(
        "home: [69.6, 18.9]\naltitude_m: 30\nwaypoints: [[69.601, 18.9]]\n"
        "fence: [[69.5, 18.8], [69.5, 19.0], [69.7, 19.0], [69.7, 18.8]]\nno_fly_zones: []\n"
    )
    mission = load_mission(path)
    assert len(mission.fences[0].ring) > 40  # they bend in the mission's metres
    assert [(item.x_deg_e7, item.y_deg_e7) for item in fence_plan(mission).items] == [
        (695000000, 188000000),
        (695000000, 190000000),
        (697000000, 190000000),
        (697000000, 188000000),
    ]


def test_on_the_antimeridian_px4_is_not_sent_what_it_cannot_test(tmp_path):
    areas = (
        "fence: {polygon: [[-300, -300], [300, -300], [300, 300], [-300, 300]]}\n"
        "no_fly_zones: [{name: mast, circle: {centre: [0, 90], radius_m: 30}}]\n"
    )
    mission = mission_of(tmp_path, areas, origin=(-16.5, 180.0))
    assert runs(mission) == [("FENCE_CIRCLE_EXCLUSION", 1)]
    (note,) = mission.notes
    assert note.code == "fence-simpler-on-board"
    assert "'fence' is not in the fence on board" in note.message
    assert len(fence_plan(mission_of(tmp_path, areas, origin=(-16.5, 179.9))).items) == 5


def fenced(folder, circles):
    """A fence of 56 points with some zones of one."""
    ring = [[round(150 * math.sin(a / 9), 2), round(150 * math.cos(a / 9), 2)] for a in range(56)]
    zones = ", ".join(f"{{circle: {{centre: [{9 + n}, 90], radius_m: 5}}}}" for n in range(circles))
    return mission_of(folder, f"fence: {{polygon: {ring}}}\nno_fly_zones: [{zones}]\n")


def printed_of(mission):
    return "\n".join(summary(MissionSurvey(WaypointGraph(mission))))


def test_as_many_points_as_px4_stores_are_in_order(tmp_path):
    mission = fenced(tmp_path, 8)
    assert len(fence_plan(mission).items) == FENCE_POINTS
    assert mission.notes == ()
    assert "64 fence points; PX4 stores 64" in "\n".join(
        summary(MissionSurvey(WaypointGraph(mission)))
    )


def test_more_points_than_px4_stores_are_noted(tmp_path):
    mission = fenced(tmp_path, 9)
    assert "MORE THAN THE 64" in printed_of(mission)
    assert len(fence_plan(mission).items) == 65 == FENCE_POINTS + 1
    (note,) = mission.notes
    assert (note.code, note.line) == ("fence-points", 6)
    assert "65 points with all zones, PX4 1.17 stores 64" in note.message


def test_the_simulated_autopilot_reads_the_same_areas(tmp_path):
    mission = mission_of(
        tmp_path,
        "fences:\n"
        "  - circle: {centre: [0, 0], radius_m: 300}\n"
        "  - polygon: [[-200, -200], [200, -200], [200, 200], [-200, 200]]\n"
        "no_fly_zones:\n"
        "  - {circle: {centre: [0, 100], radius_m: 30}}\n"
        "  - polygon: [[-100, -20], [-60, -20], [-60, 20], [-100, 20]]\n",
    )
    items = tuple(
        MissionItem(5, int(i.command), True, i.params, i.x_deg_e7, i.y_deg_e7, i.z_m)
        for i in fence_plan(mission).items
    )
    areas = fence_areas(items, MapProjection(38.5, -98.5))
    assert [area.inclusion for area in areas] == [True, False, True, False]
    for east in range(-290, 300, 20):
        for north in range(-290, 300, 20):
            if abs(mission.airspace.distance_m(Point(east, north))) > 2:
                on_board = all(area.allows(north, east) for area in areas)
                assert on_board == (mission.airspace.zones_at(Point(east, north)) == ())


def test_a_large_circle_reads_back_as_a_float_of_32_bits():
    sent = PlanItem(Command.FENCE_CIRCLE_INCLUSION, Frame.GLOBAL_INT, (50_000.003, 0, 0, 0))
    assert sent.same_as(dataclasses.replace(sent, params=(50_000.00390625, 0, 0, 0)))
    assert not sent.same_as(dataclasses.replace(sent, params=(50_001.0, 0, 0, 0)))


@pytest.fixture
def plan(pennovation):
    return FlightPlan.of(pennovation)


def test_speed_then_take_off_then_home_then_the_operator_s_waypoints(plan, pennovation):
    commands = [item.command for item in plan.items]
    assert commands == [Command.CHANGE_SPEED, Command.TAKEOFF] + [Command.WAYPOINT] * 40
    assert [i.autocontinue for i in plan.items] == [True, True] + [False] * 40  # each node stops it
    assert plan.item_of(HOME_NODE) == 2
    assert plan.item_of(1) == 3
    first = plan.items[plan.item_of(1)]
    latitude_deg, longitude_deg = pennovation.frame.to_geodetic(pennovation.waypoints[0].position)
    assert (first.x_deg_e7, first.y_deg_e7) == (
        round(latitude_deg * 1e7),
        round(longitude_deg * 1e7),
    )
    assert first.z_m == 40.0
    assert first.frame is Frame.RELATIVE_ALT_INT


def test_items_and_nodes_correspond(plan):
    for node in range(40):
        assert plan.node_of(plan.item_of(node)) == node
    assert plan.node_of(0) is None
    assert plan.node_of(1) is None
    assert plan.node_of(42) is None
    with pytest.raises(IndexError, match="no node 40"):
        plan.item_of(40)
    with pytest.raises(IndexError):
        plan.item_of(-1)


def test_the_fence_goes_on_board_as_polygons_that_know_their_size(pennovation):
    zones = [("FENCE_EXCLUSION", len(zone.shape.ring)) for zone in pennovation.zones]
    assert runs(pennovation) == [("FENCE_INCLUSION", len(pennovation.fences[0].ring)), *zones]


def test_quantised_to_what_mavlink_carries_the_nodes_stay_legal(plan, pennovation):
    for node in range(1, 40):
        item = plan.items[plan.item_of(node)]
        place = pennovation.frame.to_local(item.x_deg_e7 / 1e7, item.y_deg_e7 / 1e7)
        assert math.dist(place, pennovation.waypoints[node - 1].position) < 0.01
        assert pennovation.airspace.point_clear(place)


def test_reading_back_compares_what_flies(plan):
    item = plan.items[3]
    for rounded in (
        {"x_deg_e7": item.x_deg_e7 + 8},
        {"y_deg_e7": item.y_deg_e7 - 9},
        {"z_m": item.z_m + 0.09},
        {"params": (0.0, 2.0, 0.0, math.nan)},
        {"frame": Frame.RELATIVE_ALT},  # as PX4 gives it back
    ):
        assert item.same_as(dataclasses.replace(item, **rounded))
    for change in (
        {"x_deg_e7": item.x_deg_e7 + 20},
        {"y_deg_e7": item.y_deg_e7 - 90},
        {"z_m": item.z_m + 0.9},
        {"autocontinue": True},
        {"params": (0.0, 10.0, 0.0, math.nan)},
        {"params": (0.0, 2.0, 0.0, 0.0)},
        {"frame": Frame.GLOBAL_INT},
        {"command": Command.TAKEOFF},
    ):
        other = dataclasses.replace(item, **change)
        assert not item.same_as(other)
        assert not other.same_as(item)


def test_rally_points_that_a_zone_is_drawn_over_are_not_on_board(pennovation):
    place = pennovation.rally_points[0]
    zone = Zone("crane", Circle(place, 3.0))
    mission = pennovation.with_areas(pennovation.fences, (*pennovation.zones, zone))
    before, after = FlightPlan.of(pennovation).rally, FlightPlan.of(mission).rally
    assert place not in mission.landings
    assert len(after) == len(before) - 1


def test_above_its_altitudes_the_zones_that_begin_there_count(pennovation):
    place = pennovation.waypoints[3].position
    gliders = Zone("gliders", Circle(place, 30.0), band=Band(80.0, math.inf))
    mission = pennovation.with_areas(pennovation.fences, (*pennovation.zones, gliders))
    assert list(mission.airspace_at(mission.altitude_above_home_m).zones_at(place)) == []
    assert list(mission.airspace_at(79.0).zones_at(place)) == []  # it begins higher
    assert list(mission.airspace_at(90.0).zones_at(place)) == ["gliders"]
