"""A search that goes over several robots."""

import dataclasses
import math

import pytest

from air_router.controller.model.states import State
from air_router.controller.model.task import Goal
from air_router.controller.states.search_points import Search, SearchPoint
from air_router.controller.targets.limits import MOST_STOPS
from air_router.controller.targets.policies import policy_of
from air_router.controller.targets.predicted_path import PredictedPath
from air_router.controller.targets.seeking import SeekContext
from air_router.controller.targets.target_list import TargetList
from air_router.controller.targets.tour import TourStop, best_tour, rate, stretch
from geo.frame import Point
from mocha_link.links.metrics import Direction, SyncEnded

SPEED_M_S = 5.0
TOUR = policy_of("tour")


def context(now_s=300.0, *, round_s=60.0, walled=()):
    def flight_s(place):
        return math.inf if place in walled else straight_s(place)

    def straight_s(place):
        return math.hypot(*place) / SPEED_M_S

    def leg_s(start, end):
        return math.dist(start, end) / SPEED_M_S

    unseen = Point(0.0, -500.0)
    return SeekContext(now_s, 0.0, flight_s, leg_s, straight_s, unseen=unseen, round_s=round_s)


def standing(**places):
    """Robots met at their places at the start, and not received since."""
    targets = TargetList(tuple(places))
    for name, place in places.items():
        track = targets.tracks[name]
        track.pose_received(Point(*place), 1e9, 0.0)
        for direction in Direction:
            track.synced(direction, 0.0)
    return targets


def first(targets, **how):
    return next(iter(TOUR.order(targets, context(**how))))


def test_it_goes_over_the_nearer_robot_on_the_way_to_the_farther_one():
    place = first(standing(far=(200, 0), near=(100, 0)))
    assert (place.robot, place.position) == ("far", (200, 0))
    assert (place.over, place.along) == (("near",), ())
    assert place.reason == "over near; oldest data, 300 s; 40 s away; its last position"


def test_a_robot_that_costs_more_than_it_brings_is_left_out():
    assert first(standing(here=(10, 0), there=(-4000, 0))).over == ()
    assert first(standing(here=(10, 0), there=(-4000, 0)), round_s=6000.0).over != ()


def test_no_search_goes_over_more_than_so_many_robots():
    place = first(standing(**{name: (10 * n, 0) for n, name in enumerate("abcdef", 1)}))
    assert len(place.over) == MOST_STOPS - 1


def test_every_robot_comes_once_and_those_that_cannot_be_reached_or_are_taken_not_first():
    targets = standing(a=(10, 0), b=(20, 0), c=(30, 0))
    targets.sought_by_other("uav02", "c", 300.0)
    places = [*TOUR.order(targets, context(walled=[Point(20, 0)]))]
    assert [place.robot for place in places] == ["a", "b", "c"]
    assert places[0].over == ()
    assert not [*TOUR.order(TargetList(()), context())]


def test_a_search_in_vain_leaves_a_quarter_of_the_chance():
    targets = standing(a=(100, 0), b=(-110, 0))
    assert first(targets, round_s=1.0).robot == "a"
    targets.tracks["a"].tries = 1
    assert first(targets, round_s=1.0).robot == "b"


def test_of_robots_never_received_one_is_sought_where_the_uav_passed_longest_ago():
    place = first(TargetList(("a", "b")))
    assert (place.position, place.over) == (None, ())


COURSE = PredictedPath((Point(0, 0), Point(100, 0), Point(100, 100)), 0.0, 1.0)


def test_a_robot_on_its_path_is_looked_for_along_where_it_may_be():
    there = dataclasses.replace(context(100.0), straight_s=lambda _: 0.0)  # as if it were there
    assert stretch(COURSE, there) == ((70, 0), (100, 0), (100, 20))
    near_the_end = dataclasses.replace(there, straight_s=lambda p: math.dist(p, (100, 20)) / 1e3)
    assert stretch(COURSE, near_the_end)[0][0] == 100  # from its nearer end


def test_a_robot_whose_path_is_over_is_looked_for_along_all_of_it():
    assert stretch(COURSE, context(200.0)) == ((0, 0), (100, 0), (100, 100))
    assert stretch(COURSE, context(199.0))[0] != (0, 0)
    stands = dataclasses.replace(COURSE, points=(Point(7, 7),))
    assert stretch(stands, context(200.0)) == ((7, 7),)


def test_a_tour_is_planned_by_few_routes_however_many_robots_and_corners():
    targets = standing(**{f"r{n}": (10 * n, 5) for n in range(10)})
    for track in targets.tracks.values():
        track.path_received(tuple(Point(10 * n, n % 2 * 9) for n in range(50)), 1e9, 0.0)
    planned = []
    counted = dataclasses.replace(context(), flight_s=lambda place: planned.append(place) or 1.0)
    next(iter(TOUR.order(targets, counted)))
    assert len(planned) <= MOST_STOPS


def test_insertion_takes_what_raises_the_rate_most_where_it_does():
    stops = [
        TourStop(name, (Point(east, 0),), gain, east / SPEED_M_S)
        for name, east, gain in (("a", 50, 10.0), ("b", 100, 30.0), ("c", 150, 20.0))
    ]
    tour = best_tour(stops, context(round_s=10.0))
    assert [stop.robot for stop in tour] == ["a", "b", "c"]
    assert rate(tour, context(round_s=10.0)) == pytest.approx(60 / (30 + 10))


# In flight.


def tour_flight(pretend):
    flight = pretend(seek=("europa", "io"), seek_policy="tour", radius_m=15.0)
    timers = dataclasses.replace(flight.mission.timers, init_s=5.0)
    flight = pretend(seek=("europa", "io"), seek_policy="tour", radius_m=15.0, timers=timers)
    tracks = flight.controller.search.targets.tracks
    tracks["io"].pose_received(Point(40.0, 0.0), 1e9, 0.0)
    tracks["europa"].pose_received(Point(75.0, 0.0), 1e9, 0.0)
    flight.take_off()
    flight.fly_to_state(State.SEARCH)
    (over,) = {"io", "europa"} - {flight.controller.context.task.robot}
    return (
        flight,
        flight.controller.states.search,
        tracks,
        over,
        flight.controller.context.task.robot,
    )


def test_it_flies_over_one_and_on_to_the_other_and_counts_each_as_tried_when_it_flies_there(
    pretend,
):
    flight, _, tracks, over, sought = tour_flight(pretend)
    assert f"SEARCH {sought}: over {over}; " in "\n".join(flight.announced)
    assert (tracks[sought].tries, tracks[over].tries) == (0, 1)
    first_goal = flight.controller.context.task.way.goal.position
    assert math.dist(first_goal, tracks[over].pose.position) < 10.0
    flight.fly_until(lambda: f"at the search position of {sought}" in flight.announced)
    assert math.dist(flight.position, tracks[sought].pose.position) < 10.0
    assert (tracks[sought].tries, tracks[over].tries) == (1, 1)


def test_a_robot_is_tried_once_more_by_a_search_that_begins_over_it(pretend):
    flight, search, tracks, over, sought = tour_flight(pretend)
    flight.fly_until(lambda: f"at the search position of {sought}" in flight.announced)
    search.begin()  # anew, over the robot where it waits
    assert flight.controller.context.task.robot == over
    assert tracks[sought].tries == 2


def test_a_search_that_is_planned_anew_tries_no_robot_once_more(pretend):
    _, search, tracks, over, sought = tour_flight(pretend)
    search.replan()  # straight to the one that is sought
    search.replan()
    assert (tracks[sought].tries, tracks[over].tries) == (1, 1)


def test_a_new_pose_of_the_sought_robot_waits_until_the_others_are_passed(pretend):
    flight, search, tracks, _, sought = tour_flight(pretend)
    goal = flight.controller.context.task.way.goal
    tracks[sought].pose_received(Point(-60.0, 0.0), 2e9, flight.now_s)
    search.follow()
    assert flight.controller.context.task.way.goal == goal


def test_where_a_robot_is_sought_is_worked_out_when_its_turn_comes(pretend):
    flight, _, tracks, _, sought = tour_flight(pretend)
    tracks[sought].pose_received(Point(60.0, 10.0), 2e9, flight.now_s)
    flight.fly_until(lambda: f"at the search position of {sought}" in flight.announced)
    assert math.dist(flight.position, (60.0, 10.0)) < 10.0


def test_where_no_way_leads_over_a_robot_it_goes_on_to_the_next(pretend):
    flight, search, *_ = tour_flight(pretend)
    goal = flight.controller.context.task.way.goal
    search.no_route("made up")
    assert flight.controller.context.task.way.goal != goal
    assert "made up" not in "\n".join(flight.announced)


def test_it_goes_on_once_a_robot_on_the_way_has_all_and_has_given_all(pretend):
    flight, _, tracks, over, sought = tour_flight(pretend)
    goal = flight.controller.context.task.way.goal
    flight.give(SyncEnded(over, flight.now_s, Direction.IN, 1, 100, 0.1))
    assert flight.controller.context.task.way.goal == goal
    flight.give(SyncEnded(over, flight.now_s, Direction.OUT, 1, 100, 0.1, complete=False))
    assert flight.controller.context.task.way.goal == goal
    flight.give(SyncEnded(over, flight.now_s, Direction.OUT, 1, 100, 0.1))
    goal = flight.controller.context.task.way.goal
    assert math.dist(goal.position, tracks[sought].pose.position) < 10.0
    flight.give(SyncEnded(over, flight.now_s, Direction.OUT, 1, 100, 0.1))
    assert flight.controller.context.task.way.goal == goal


def test_a_robot_that_was_met_before_its_turn_is_not_flown_over(pretend):
    flight, search, tracks, over, sought = tour_flight(pretend)
    search._stops.appendleft("met")
    tracks["met"] = dataclasses.replace(
        tracks[over], tries=0, taken_s=flight.now_s, given_s=flight.now_s
    )
    flight.fly_until(lambda: f"at the search position of {sought}" in flight.announced)
    assert tracks["met"].tries == 0


def test_places_where_it_is_already_are_gone_through_at_once_however_many(pretend):
    flight, search, _, _, sought = tour_flight(pretend)
    here = Goal(flight.controller.context.last_telemetry.position)
    search._places.extend([here] * 2000)
    search.arrived()
    flight.fly_until(lambda: f"at the search position of {sought}" in flight.announced)


def test_planned_anew_to_pass_other_places_first_it_has_its_time_once_it_is_back(
    pretend, monkeypatch
):
    flight, search, _, _, sought = tour_flight(pretend)
    flight.fly_until(lambda: f"at the search position of {sought}" in flight.announced)
    here = flight.controller.context.task.way.goal
    places = SearchPoint(sought, here, "", along=(here.position, Point(40.0, 20.0)))
    monkeypatch.setattr(Search, "search_point", lambda *_: places)
    search.replan()
    assert flight.controller.context.task.ends_s is None
    flight.fly_until(lambda: flight.controller.context.task.ends_s is not None)
    assert flight.announced[-1] == f"at the search position of {sought}"
    assert math.dist(flight.position, here.position) < 4.0
