"""Seek policies that stand beside `tour` in experiments: turns, ablations, beliefs."""

import math

import pytest

from air_router.controller.targets import SeekContext, TargetList, Tour
from geo.frame import Point
from mocha_link.links import Direction
from sitl.experiment.robots.ablations import TourOfOne, TourWithoutAges, TourWithoutPaths
from sitl.experiment.robots.ferry import Ferry
from sitl.experiment.robots.turns import Nearest, ThreeInTurn

SPEED_M_S = 5.0
PLACES = {"a": Point(0, 100), "b": Point(0, 20), "c": Point(0, 60), "d": Point(0, 40)}


def targets_of(places=PLACES, *, now_s=0.0):
    """All met at once, then not any more."""
    targets = TargetList(tuple(places))
    for name, place in places.items():
        targets.tracks[name].pose_received(place, 1e9 + now_s, now_s)
        for direction in Direction:
            targets.tracks[name].synced(direction, now_s)
    return targets


def context_at(now_s, here=(0.0, 0.0), round_s=30.0):
    def leg_s(start, end):
        return math.dist(start, end) / SPEED_M_S

    def flight_s(place):
        return leg_s(here, place)

    return SeekContext(now_s, 0.0, flight_s, leg_s, flight_s, Point(500, 0), round_s)


def first(policy, targets, now_s=300.0):
    return next(iter(policy.order(targets, context_at(now_s))))


def test_three_in_turn_goes_on_where_the_turn_was_and_flies_to_the_nearest_first():
    policy, targets = ThreeInTurn(), targets_of()
    place = first(policy, targets)
    assert (*place.over, place.robot) == ("b", "c", "a")
    place = first(policy, targets)
    assert (*place.over, place.robot) == ("b", "d", "a")  # d, then a and b again
    every = list(policy.order(targets, context_at(300.0)))
    assert sorted(place.robot for place in every) == sorted(PLACES)


def test_three_in_turn_leaves_a_robot_to_the_uav_that_seeks_it():
    policy, targets = ThreeInTurn(), targets_of()
    targets.sought_by_other("uav02", "b", 300.0)
    place = first(policy, targets)
    assert (*place.over, place.robot) == ("d", "c", "a")


def test_the_nearest_that_is_not_sought_in_this_round_comes_first():
    policy, targets = Nearest(), targets_of()
    assert [first(policy, targets).robot for _ in range(5)] == ["b", "d", "c", "a", "b"]
    every = list(policy.order(targets, context_at(300.0)))
    assert sorted(place.robot for place in every) == sorted(PLACES)


def test_a_tour_of_one_goes_over_no_other_robot():
    assert first(Tour(), targets_of()).over
    place = first(TourOfOne(), targets_of())
    assert (place.over, place.robot) == ((), "b")


def test_without_ages_a_robot_that_was_just_met_counts_like_the_others():
    targets = targets_of()
    for direction in Direction:
        targets.tracks["b"].synced(direction, 299.0)
    targets.tracks["b"].pose_received(PLACES["b"], 1e9 + 299.0, 299.0)
    tour = first(Tour(), targets)
    blind = first(TourWithoutAges(), targets)
    assert "b" not in {*tour.over, tour.robot}
    assert "b" in {*blind.over, blind.robot}


def test_without_paths_a_robot_is_looked_for_where_it_was():
    targets = targets_of({"a": Point(0, 0)})
    targets.tracks["a"].path_received((Point(0, 0), Point(200, 0)), 1e9 + 0.1, 0.0)
    context = context_at(60.0, here=(0.0, -50.0))
    assert Tour().place("a", targets, context).position != Point(0, 0)
    place = TourWithoutPaths().place("a", targets, context)
    assert (place.position, place.along) == (Point(0, 0), ())


def test_a_ferry_s_belief_moves_on_along_the_path_and_leaves_where_it_looked_in_vain():
    targets = targets_of({"a": Point(0, 0)})
    targets.tracks["a"].path_received((Point(0, 0), Point(200, 0)), 1e9 + 0.1, 0.0)
    ferry = Ferry(reach_m=10.0)
    places = [ferry.place("a", targets, context_at(now_s)) for now_s in (20.0, 90.0)]
    assert places[0].position.east_m < places[1].position.east_m <= 200.0
    before = first(ferry, targets, 600.0)
    targets.tracks["a"].tried()
    after = first(ferry, targets, 600.0)
    assert (before.position, before.along) != (after.position, after.along)


def test_a_ferry_seeks_a_robot_that_was_never_received_where_the_uav_was_longest_ago():
    assert first(Ferry(reach_m=10.0), TargetList(("a",))).position is None


@pytest.mark.parametrize("policy", [Ferry(10.0), Nearest(), ThreeInTurn()])
def test_without_robots_nothing_is_sought(policy):
    assert list(policy.order(TargetList(()), context_at(0.0))) == []
