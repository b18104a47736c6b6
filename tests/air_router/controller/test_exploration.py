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


def test_the_unknown_is_sought_where_it_is_largest(exploration):
    exploration.passed(1, 1.0)
    exploration.passed(2, 2.0)
    assert exploration.longest_unseen().node == 5
    exploration.passed(5, 3.0)
    assert exploration.longest_unseen().node in {3, 4}


def test_once_all_is_known_the_oldest_is_sought(exploration):
    for second, number in enumerate((3, 1, 2, 5, 4)):
        exploration.passed(number, float(second))
    assert exploration.longest_unseen().node == 3
    exploration.passed(3, 9.0)
    assert exploration.longest_unseen().node == 1
