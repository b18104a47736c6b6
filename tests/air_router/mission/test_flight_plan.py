import dataclasses
import math

import pytest

from air_router.mission.flight_plan import HOME_NODE, Command, FlightPlan, Frame


@pytest.fixture
def plan(pennovation):
    return FlightPlan.of(pennovation)


def test_speed_then_take_off_then_home_then_the_operator_s_waypoints(plan, pennovation):
    commands = [item.command for item in plan.items]
    assert commands == [Command.CHANGE_SPEED, Command.TAKEOFF] + [Command.WAYPOINT] * 40
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


def test_every_node_stops_the_vehicle_until_the_next_is_commanded(plan):
    assert [i.autocontinue for i in plan.items] == [True, True] + [False] * 40


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


def test_the_fence_goes_on_board_as_polygons_that_know_their_size(plan, pennovation):
    rings = [pennovation.fences[0].ring, *(zone.shape.ring for zone in pennovation.zones)]
    assert len(plan.fence) == sum(len(ring) for ring in rings)
    at = 0
    for number, ring in enumerate(rings):
        vertices = plan.fence[at : at + len(ring)]
        at += len(ring)
        kind = Command.FENCE_EXCLUSION if number else Command.FENCE_INCLUSION
        assert {v.command for v in vertices} == {kind}
        assert {v.params[0] for v in vertices} == {float(len(ring))}


def test_quantised_to_what_mavlink_carries_the_nodes_stay_legal(plan, pennovation):
    for node in range(1, 40):
        item = plan.items[plan.item_of(node)]
        place = pennovation.frame.to_local(item.x_deg_e7 / 1e7, item.y_deg_e7 / 1e7)
        assert math.dist(place, pennovation.waypoints[node - 1].position) < 0.01
        assert pennovation.airspace.point_clear(place)


def test_reading_back_compares_what_flies(plan):
    item = plan.items[3]
    assert item.same_as(dataclasses.replace(item, z_m=item.z_m + 1e-4))
    assert item.same_as(dataclasses.replace(item, params=(0.0, 2.0, 0.0, math.nan)))
    for change in (
        {"x_deg_e7": item.x_deg_e7 + 20},
        {"z_m": item.z_m + 1.0},
        {"autocontinue": True},
        {"params": (0.0, 10.0, 0.0, math.nan)},
        {"params": (0.0, 2.0, 0.0, 0.0)},
        {"frame": Frame.GLOBAL_INT},
        {"command": Command.TAKEOFF},
    ):
        other = dataclasses.replace(item, **change)
        assert not item.same_as(other)
        assert not other.same_as(item)
