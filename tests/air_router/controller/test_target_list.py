import math

import pytest

from air_router.controller.targets.limits import LOST_AFTER_S, RECENT_POSE_S
from air_router.controller.targets.target_list import TargetList
from geo.frame import Point


def targets():
    return TargetList(("callisto", "europa", "io"))


def test_robots_take_turns():
    robots = targets()
    order = []
    for _ in range(5):
        robot = robots.candidates(0.0)[0]
        robots.sought(robot)
        order.append(robot)
    assert order == ["callisto", "europa", "io", "callisto", "europa"]


@pytest.mark.parametrize(
    ("path", "after_s", "where"),
    [
        ((Point(9, 9),), RECENT_POSE_S, Point(1, 2)),
        ((Point(9, 9),), RECENT_POSE_S + 1.0, Point(9, 9)),
        ((), 5000.0, Point(1, 2)),
    ],
    ids=["a recent pose", "later the path's end", "without a path an old pose"],
)
def test_where_to_look(path, after_s, where):
    robots = targets()
    assert robots.place("io", now_s=0.0).position is None
    robots.tracks["io"].pose_received(Point(1, 2), stamp_s=100.0, now_s=5.0)
    if path:
        robots.tracks["io"].path_received(path, stamp_s=101.0, now_s=5.0)
    assert robots.place("io", now_s=5.0 + after_s).position == where


def test_a_path_that_is_a_minute_older_than_the_pose_does_not_count_any_more():
    for older_s, where in ((59.0, Point(9, 9)), (61.0, Point(1, 2))):
        robots = targets()
        robots.tracks["io"].pose_received(Point(1, 2), stamp_s=200.0, now_s=200.0)
        robots.tracks["io"].path_received((Point(9, 9),), stamp_s=200.0 - older_s, now_s=200.0)
        assert robots.place("io", now_s=500.0).position == where


def test_what_another_uav_publishes_again_counts_as_new_when_it_had_lapsed():
    robots = targets()
    assert robots.sought_by_other("second", "io", 0.0)
    assert not robots.sought_by_other("second", "io", 179.0)
    assert "io" not in robots.free(179.0 + 180.0)
    assert "io" in robots.free(179.0 + 181.0)
    assert robots.sought_by_other("second", "io", 179.0 + 181.0)


def test_an_old_message_changes_nothing():
    robots = targets()
    assert robots.tracks["io"].pose_received(Point(1, 2), stamp_s=100.0, now_s=5.0)
    assert not robots.tracks["io"].pose_received(Point(3, 4), stamp_s=100.0, now_s=6.0)
    assert not robots.tracks["io"].pose_received(Point(3, 4), stamp_s=99.0, now_s=6.0)
    assert robots.tracks["io"].pose.position == Point(1, 2)
    assert robots.tracks["io"].path_received((Point(9, 9),), stamp_s=100.0, now_s=6.0)
    assert not robots.tracks["io"].path_received((Point(8, 8),), stamp_s=100.0, now_s=6.0)


def test_lost_robots_are_tried_last_and_robots_never_received_are_not_lost():
    robots = targets()
    robots.tracks["callisto"].pose_received(Point(0, 0), stamp_s=1.0, now_s=0.0)
    late_s = LOST_AFTER_S + 1.0
    robots.tracks["io"].pose_received(Point(0, 0), stamp_s=1.0, now_s=late_s)
    assert robots.candidates(late_s) == ("europa", "io", "callisto")


def poses(robots, stamps_s, from_s):
    """One a second, at other places; how many of them were new."""
    return sum(
        robots.tracks["io"].pose_received(Point(from_s + k, 0.0), stamp_s, from_s + k)
        for k, stamp_s in enumerate(stamps_s)
    )


@pytest.mark.parametrize("bad_s", [9.9e10, math.nan, math.inf, -math.inf, -9e10, 0.0])
def test_one_bad_stamp_blinds_to_no_robot(bad_s):
    robots = targets()
    assert poses(robots, [1000.0 + k for k in range(10)], 5.0) == 10
    poses(robots, [bad_s], 15.0)
    assert poses(robots, [1011.0 + k for k in range(90)], 16.0) >= 86
    assert robots.tracks["io"].pose.position == Point(105.0, 0.0)
    assert robots.tracks["io"].newest_s == pytest.approx(105.0)
    assert robots.tracks["io"].speed_m_s == pytest.approx(1.0)


def test_a_clock_that_is_set_back_is_followed():
    robots = targets()
    poses(robots, [1.7e9 + k for k in range(10)], 5.0)
    assert poses(robots, [20.0 + k for k in range(10)], 15.0) >= 6
    assert robots.tracks["io"].newest_s == pytest.approx(24.0)


def test_what_others_carried_stays_old():
    robots = targets()
    poses(robots, [1000.0 + k for k in range(10)], 5.0)
    late = [(900.0 + 7 * k, 15.0 + k / 10) for k in range(10)]  # all at once, of a long time
    assert not any(robots.tracks["io"].pose_received(Point(0, 0), *at) for at in late)
