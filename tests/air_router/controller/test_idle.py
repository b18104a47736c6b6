"""What the vehicle does once everything is explored: no shuttling between robots that are met."""

import dataclasses
import math

import pytest

from air_router.controller.model.actions import HoldHere
from air_router.controller.model.events import RobotPose
from air_router.controller.model.states import State
from geo.frame import Point

BESIDE = {"io": Point(64.0, 0.0), "callisto": Point(30.0, 40.0)}


@pytest.fixture
def explored(pretend, pennovation):
    """A flight over robots with one waypoint to explore, which is soon done."""

    def make(robots=BESIDE, *, radius_m=100.0, **settings):
        one = {"waypoints": pennovation.waypoints[:1], "duration_s": None}
        flight = pretend(seek=tuple(robots), radius_m=radius_m, **one, **settings)
        flight.robots.update(robots)
        flight.take_off()
        for name, place in robots.items():
            flight.give(RobotPose(name, place, 1.0, "a base station"))
        return flight

    return make


def transitions(flight, seconds):
    before = len(flight.states)
    flight.fly_for(seconds)
    return flight.states[before:]


def test_over_robots_within_reach_it_stays_where_it_is(explored):
    flight = explored()
    flight.fly_to_state(State.IDLE)
    place, motions = flight.position, len(flight.motions)
    assert transitions(flight, 600.0) == []
    assert len(flight.motions) - motions <= 1  # it stops
    assert math.dist(place, flight.position) < 15.0
    assert flight.controller.state is State.IDLE


def test_a_robot_out_of_reach_is_visited_once_it_is_due(explored):
    flight = explored(radius_m=20.0)
    flight.fly_to_state(State.IDLE)
    met_s = {name: track.met_s for name, track in flight.controller.search.targets.tracks.items()}
    due_s = min(met_s.values()) + flight.mission.timers.revisit_s
    flight.fly_to_state(State.SEARCH)
    assert due_s <= flight.now_s <= due_s + 1.0
    assert flight.controller.context.task.robot == min(met_s, key=met_s.get)
    flight.fly_to_state(State.COMM)


def test_while_anything_is_left_to_explore_no_robot_has_to_wait(pretend, pennovation):
    timers = dataclasses.replace(pennovation.timers, init_s=10.0, explore_s=10.0)
    flight = pretend(seek=("io",), radius_m=1000.0, timers=timers)
    flight.robots.update(io=BESIDE["io"])
    flight.take_off()
    flight.fly_for(100.0)
    assert State.IDLE not in flight.states
    assert flight.states.count(State.COMM) >= 5


def test_it_comes_home_where_the_mission_requires_it(explored):
    flight = explored({**BESIDE, "europa": Point(75.0, -150.0)}, when_explored="home")
    flight.lands()
    assert State.COMM in flight.states
    assert "everything is explored and every robot has been met" in " ".join(flight.announced)


def test_on_its_way_to_the_middle_it_holds_at_once_for_an_input_that_is_missing(explored):
    """The next look at the robots, which is due much later, keeps no hold back."""
    flight = explored(when_explored="hover")
    flight.fly_to_state(State.IDLE)
    flight.fly_for(1.0)
    flight.robots["callisto"] = Point(-60.0, -20.0)  # so the middle is elsewhere
    for name, place in flight.robots.items():
        flight.give(RobotPose(name, place, flight.now_s, name))
    flight.fly_until(lambda: math.hypot(*flight.velocity) > 3.0, 200.0)
    assert flight.controller.context.task.retry_at_s is not None
    since, flight.fix = len(flight.motions), False
    flight.fly_for(2.0)
    assert [*map(type, flight.motions[since:])] == [HoldHere]


def test_it_hovers_in_the_middle_of_the_robots_and_follows_it(explored):
    flight = explored(when_explored="hover")
    flight.fly_to_state(State.IDLE)
    flight.fly_for(60.0)
    away = [math.dist(flight.position, place) for place in BESIDE.values()]
    assert away == pytest.approx([math.dist(*BESIDE.values()) / 2] * 2, abs=3.0)
    flight.robots["callisto"] = Point(-40.0, 20.0)
    flight.fly_for(90.0)
    away = [math.dist(flight.position, place) for place in flight.robots.values()]
    assert away[0] == pytest.approx(away[1], abs=3.0)
    assert flight.controller.state is State.IDLE


def test_a_vehicle_that_only_searches_waits_too(pretend):
    flight = pretend(seek=tuple(BESIDE), radius_m=100.0, explore=False)
    flight.robots.update(BESIDE)
    flight.take_off()
    flight.fly_to_state(State.IDLE)
    assert transitions(flight, 120.0) == []


def test_without_robots_it_explores_and_comes_home(pretend, pennovation):
    flight = pretend(seek=(), waypoints=pennovation.waypoints[:2], duration_s=None)
    flight.take_off()
    flight.lands()
    assert State.COMM not in flight.states
    assert "everything is explored, and the mission seeks no robot" in " ".join(flight.announced)
