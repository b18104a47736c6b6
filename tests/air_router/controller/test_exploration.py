import copy
import math
from itertools import count
from random import Random

import pytest

from air_router.controller.states.explore_state import Exploration
from air_router.mission.mission import Waypoint
from geo.frame import Point


@pytest.fixture
def exploration():
    return Exploration([Waypoint(n, Point(100.0 * n, 0.0), 40.0) for n in range(1, 6)])


def test_waypoints_come_in_the_operator_s_order(exploration):
    numbers = []
    while exploration.remaining:
        numbers.append(exploration.goal.node)
        exploration.visited()
    assert numbers == [1, 2, 3, 4, 5]
    assert exploration.left_out == []


def test_one_that_cannot_be_reached_is_left_out_and_remembered(exploration):
    exploration.visited()
    assert exploration.leave_out() == 2
    assert exploration.goal.node == 3
    assert exploration.left_out == [2]


def test_back_to_a_mark_what_was_left_out_since_is_to_be_visited_again(exploration):
    exploration.leave_out()
    exploration.visited()
    mark = exploration.mark()
    exploration.leave_out()
    exploration.leave_out()
    exploration.back_to(mark)
    assert (exploration.left_out, exploration.goal.node, exploration.remaining) == ([1], 3, 3)


@pytest.fixture
def fly_past(exploration):
    """The vehicle flies past waypoints, one after the other."""
    seconds = count()

    def past(*numbers):
        for number in numbers:
            for north_m in (-30.0, 0.0, 30.0):
                exploration.note_nearby(Point(100.0 * number, north_m), float(next(seconds)))

    return past


def test_the_unknown_is_sought_where_it_is_largest(exploration, fly_past):
    fly_past(1, 2)
    assert exploration.longest_unseen().node == 5
    fly_past(5)
    assert exploration.longest_unseen().node in {3, 4}


def test_once_all_is_known_the_oldest_is_sought(exploration, fly_past):
    fly_past(3, 1, 2, 5, 4)
    assert exploration.longest_unseen().node == 3
    fly_past(3)
    assert exploration.longest_unseen().node == 1


def test_looking_around_only_where_other_waypoints_may_be_near_misses_none(exploration):
    always, random, here = copy.deepcopy(exploration), Random(1), Point(0.0, 0.0)
    looks = 0
    for second in range(3000):
        always.note_nearby(here, float(second))
        if math.dist(here, exploration.checked_from) >= exploration.recheck_m:
            exploration.note_nearby(here, float(second))
            looks += 1
        assert exploration.longest_unseen() == always.longest_unseen(), second
        east_m = (here.east_m + random.uniform(-2.0, 5.0)) % 600.0
        here = Point(east_m, here.north_m + random.uniform(-1.0, 1.0))
    assert looks < 1500
