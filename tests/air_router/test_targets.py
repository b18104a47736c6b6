from air_router.targets import LOST_AFTER_S, RECENT_POSE_S, Roster
from geo.frame import Point


def roster():
    return Roster(("callisto", "europa", "io"))


def test_robots_take_turns():
    robots = roster()
    order = []
    for _ in range(5):
        robot = robots.candidates(0.0)[0]
        robots.sought(robot)
        order.append(robot)
    assert order == ["callisto", "europa", "io", "callisto", "europa"]


def test_a_recent_pose_says_where_to_look():
    robots = roster()
    robots.pose_heard("io", Point(1, 2), stamp_s=100.0, now_s=5.0)
    robots.path_heard("io", (Point(9, 9),), stamp_s=101.0, now_s=5.0)
    place = robots.place("io", now_s=5.0 + RECENT_POSE_S)
    assert place.position == Point(1, 2)


def test_after_a_while_the_end_of_the_path_says_where_to_look():
    robots = roster()
    robots.pose_heard("io", Point(1, 2), stamp_s=100.0, now_s=5.0)
    robots.path_heard("io", (Point(9, 9),), stamp_s=101.0, now_s=5.0)
    place = robots.place("io", now_s=6.0 + RECENT_POSE_S)
    assert place.position == Point(9, 9)
    assert "path" in place.reason


def test_without_a_path_the_last_pose_however_old():
    robots = roster()
    robots.pose_heard("io", Point(1, 2), stamp_s=100.0, now_s=5.0)
    assert robots.place("io", now_s=5000.0).position == Point(1, 2)


def test_a_robot_never_heard_of_has_no_place():
    assert roster().place("io", now_s=0.0).position is None


def test_old_news_changes_nothing():
    robots = roster()
    assert robots.pose_heard("io", Point(1, 2), stamp_s=100.0, now_s=5.0)
    assert not robots.pose_heard("io", Point(3, 4), stamp_s=100.0, now_s=6.0)
    assert not robots.pose_heard("io", Point(3, 4), stamp_s=99.0, now_s=6.0)
    assert robots.position_of("io") == Point(1, 2)
    assert robots.path_heard("io", (Point(9, 9),), stamp_s=100.0, now_s=6.0)
    assert not robots.path_heard("io", (Point(8, 8),), stamp_s=100.0, now_s=6.0)


def test_strangers_are_ignored():
    robots = roster()
    assert not robots.pose_heard("mallory", Point(1, 2), stamp_s=100.0, now_s=5.0)
    assert not robots.path_heard("mallory", (Point(1, 2),), stamp_s=100.0, now_s=5.0)
    assert robots.position_of("mallory") is None


def test_lost_robots_are_tried_last_and_robots_never_heard_are_not_lost():
    robots = roster()
    robots.pose_heard("callisto", Point(0, 0), stamp_s=1.0, now_s=0.0)
    late_s = LOST_AFTER_S + 1.0
    robots.pose_heard("io", Point(0, 0), stamp_s=1.0, now_s=late_s)
    assert robots.candidates(late_s) == ("europa", "io", "callisto")
