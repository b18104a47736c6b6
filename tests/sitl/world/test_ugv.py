import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from geo.frame import Point
from sitl.world.ugv import SIGHT_M, Patrol, PatrolPlan, PatrolRobot

SQUARE = (Point(0, 0), Point(0, 100), Point(100, 100), Point(100, 0))

coordinates = st.floats(-1000, 1000).map(lambda value: round(value, 2))
points = st.lists(st.builds(Point, coordinates, coordinates), min_size=1, max_size=8)


def test_a_robot_drives_its_round_at_its_speed():
    robot = PatrolRobot("io", PatrolPlan(Patrol(SQUARE), 1.5))
    robot.step(60.0)
    assert robot.position == pytest.approx((0, 90))
    assert robot.heading_deg == 0
    robot.step(20.0)
    assert robot.position == pytest.approx((20, 100))
    assert robot.heading_deg == pytest.approx(90)
    assert robot.driven_m == pytest.approx(120)
    robot.step(400 / 1.5)
    assert robot.position == pytest.approx((20, 100))


def test_a_closed_patrol_returns_straight_and_an_open_one_the_way_it_came():
    path = (Point(0, 0), Point(0, 10), Point(10, 10))
    assert Patrol(path).length_m == pytest.approx(20 + math.sqrt(200))
    there_and_back = Patrol(path, closed=False)
    assert there_and_back.length_m == pytest.approx(40)
    assert there_and_back.at(25).position == pytest.approx((5, 10))
    assert there_and_back.at(25).heading_deg == pytest.approx(270)
    assert there_and_back.at(35).position == pytest.approx((0, 5))


def test_a_robot_with_one_point_stays_there():
    base = PatrolRobot("base", PatrolPlan(Patrol([Point(3, 4)])))
    base.step(100.0)
    assert base.position == (3, 4)
    assert base.driven_m == 0
    assert base.path == (Point(3, 4),)


def test_the_path_names_the_next_points_and_ends_at_the_destination():
    robot = PatrolRobot("io", PatrolPlan(Patrol(SQUARE)))
    assert robot.path == (SQUARE[1], SQUARE[2], SQUARE[3])
    robot.step(150.0)
    assert robot.path == (SQUARE[2], SQUARE[3], SQUARE[0])


def test_a_robot_starts_where_its_plan_begins():
    robot = PatrolRobot("io", PatrolPlan(Patrol(SQUARE), start_m=110.0))
    assert robot.position == pytest.approx((10, 100))
    assert robot.driven_m == 0


def test_a_robot_remembers_the_vehicles_that_it_passed():
    vehicles = (Point(10, 50), Point(-SIGHT_M - 1, 20), Point(50, 105))
    robot = PatrolRobot("io", PatrolPlan(Patrol(SQUARE)), vehicles)
    assert robot.sightings == ()
    for _ in range(160):
        robot.step(1.0)
    assert robot.sightings == (vehicles[0], vehicles[2])


def test_a_patrol_without_points_is_refused():
    with pytest.raises(ValueError, match="at least one point"):
        Patrol([])


@given(points=points, closed=st.booleans(), distance_m=st.floats(0, 1e5))
def test_a_robot_is_always_on_one_of_its_legs(points, closed, distance_m):
    patrol = Patrol(points, closed=closed)
    place = patrol.at(distance_m)
    assert 0 <= place.heading_deg < 360 + 1e-9
    if not patrol.legs():
        assert place.position == patrol.stops[0]
        return
    start, end = patrol.legs()[place.leg]
    detour = math.dist(start, place.position) + math.dist(place.position, end)
    assert detour == pytest.approx(math.dist(start, end), abs=1e-6)
