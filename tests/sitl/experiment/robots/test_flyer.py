import math
from dataclasses import replace
from pathlib import Path

import pytest

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere, LandHere
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.loading import load_mission
from air_router.vehicle.vehicle import FlightMode
from geo.frame import Point
from sitl.experiment.robots.flyer import AirframeFlyer, Flyer
from sitl.experiment.settings import RunSettings

MISSION = replace(
    load_mission(Path(__file__).parents[4] / "missions" / "urban" / "mission.yaml"),
    home=Point(0.0, 0.0),
    speed_m_s=5.0,
    altitude_above_home_m=60.0,
)
PLAN = FlightPlan.of(MISSION)


@pytest.fixture
def flyer():
    return vehicle()


def vehicle(kind=Flyer, **settings):
    return kind(PLAN, MISSION, RunSettings(**settings))


def flown(flyer, until_s, step_s=0.5):
    """Places and speeds on the way, every step."""
    places = []
    for number in range(1, round(until_s / step_s) + 1):
        flyer.fly(number * step_s)
        places.append((flyer.position, math.hypot(*flyer.velocity_m_s)))
    return places


def test_a_leg_is_straight_at_the_cruise_speed_and_ends_at_rest(flyer):
    flyer.command(FlyToPoint(Point(60.0, 80.0), 60.0))
    places = flown(flyer, 26.0)
    assert all(abs(p.east_m * 0.8 - p.north_m * 0.6) < 0.1 for p, _ in places)
    assert max(speed for _, speed in places) == pytest.approx(5.0)
    assert flyer.position == Point(60.0, 80.0)
    assert flyer.at_rest
    # The shortest time: 100 m at 5 m/s, and 2.5 s for speeding up and braking.
    there = next(i for i, (p, _) in enumerate(places) if math.dist(p, (60.0, 80.0)) < 1.0)
    assert 21.0 <= (there + 1) * 0.5 <= 24.0


def test_modes_and_items_are_those_commanded(flyer):
    flyer.command(FlyToNode(3, Point(20.0, 0.0)))
    flyer.fly(2.0)
    telemetry = flyer.telemetry()
    assert (telemetry.mode, telemetry.item) == (FlightMode.MISSION, 5)
    flyer.command(HoldHere("to see"))
    flyer.fly(10.0)
    assert (flyer.telemetry().mode, flyer.telemetry().item) == (FlightMode.HOLD, None)
    assert flyer.at_rest
    assert flyer.position.east_m < 12.0  # it stopped on its way


def test_a_turn_takes_no_more_than_the_acceleration(flyer):
    flyer.command(FlyToPoint(Point(50.0, 0.0), 60.0))
    flyer.fly(6.0)
    flyer.command(FlyToPoint(Point(-50.0, 0.0), 60.0))
    before = flyer.velocity_m_s
    for number in range(1, 100):
        flyer.fly(6.0 + number * 0.1)
        change = math.dist(flyer.velocity_m_s, before)
        assert change <= 0.2 + 1e-6
        before = flyer.velocity_m_s
    flyer.fly(60.0)
    assert flyer.position == Point(-50.0, 0.0)


def test_it_flies_the_same_however_often_it_is_queried(flyer):
    other = vehicle()
    for each in (flyer, other):
        each.command(FlyToPoint(Point(33.3, -12.1), 60.0))
    flown(flyer, 9.0, 0.1)
    flown(other, 9.0, 0.5)
    assert math.dist(flyer.position, other.position) < 0.01


def test_it_takes_off_straight_up(flyer):
    assert not flyer.telemetry().in_air
    flyer.fly(20.0)
    assert (flyer.telemetry().in_air, flyer.telemetry().altitude_m) == (True, 30.0)
    assert flyer.position == Point(0.0, 0.0)
    flyer.fly(60.0)
    assert flyer.altitude_m == 60.0


def test_with_the_autopilot_s_airframe_legs_take_as_long_as_in_the_simulation_in_processes():
    flyer, now_s, took_s = vehicle(AirframeFlyer), 40.0, []
    flyer.fly(now_s)
    assert flyer.at_rest
    for node in (1, 2, 3, 4):
        place, began_s = MISSION.waypoints[node - 1].position, now_s
        flyer.command(FlyToNode(node, place))
        while math.dist(flyer.position, place) > 2.0:
            now_s += 0.1
            flyer.fly(now_s)
        took_s.append(now_s - began_s)
    assert took_s[2:] == pytest.approx([19.6, 16.9], abs=0.3)  # `air-router sim --speed 2`
    flyer.fly(now_s + 10.0)
    assert math.dist(flyer.position, place) < 0.5


def test_the_autopilot_s_airframe_holds_a_braking_distance_ahead():
    flyer = vehicle(AirframeFlyer)
    flyer.command(FlyToPoint(Point(100.0, 0.0), 60.0))
    flyer.fly(12.0)
    there_m = flyer.position.east_m
    flyer.command(HoldHere("to see"))
    flyer.fly(40.0)
    assert 3.0 < flyer.position.east_m - there_m < 9.0
    assert math.hypot(*flyer.velocity_m_s) < 0.1


def test_it_lands_as_the_simulated_autopilot_and_drains_its_battery_until_then():
    flyer = vehicle(battery=200.0 / 60.0)
    flyer.fly(50.0)
    assert flyer.telemetry().battery == pytest.approx(0.75)
    flyer.command(LandHere())
    flown(flyer, 50.0)  # times that are over change nothing
    landed_s = next(t for t in range(51, 200) if flyer.fly(float(t)) or flyer.landed)
    assert landed_s - 50 == pytest.approx(50 / 1.5 + 5 / 1.1 + 5 / 0.7, abs=2.0)
    telemetry = flyer.telemetry()
    assert (telemetry.armed, telemetry.in_air, telemetry.mode) == (False, False, FlightMode.LAND)
    assert vehicle().telemetry().battery is None
