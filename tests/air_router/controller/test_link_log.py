"""What the flight measures of links: samples of robots whose position is known."""

import pytest

from air_router.controller.targets import LinkLog, TargetList
from geo.frame import Point

HERE, HEIGHT_M = Point(0, 0), 40.0


def one_received(now_s=100.0):
    targets = TargetList(("a", "b"))
    targets.tracks["a"].pose_received(Point(50, 0), 1e9, now_s)
    return targets


def test_only_robots_whose_pose_is_recent_are_sampled():
    log, targets = LinkLog(), one_received()
    log.update(HERE, HEIGHT_M, targets, 110.0)
    (sample,) = log.samples
    assert (sample.robot, sample.time_s, sample.here, sample.place) == ("a", 110.0, HERE, (50, 0))
    assert (sample.altitude_m, sample.linked) == (HEIGHT_M, False)
    log.update(HERE, HEIGHT_M, targets, 140.0)
    assert len(log.samples) == 1


def test_a_robot_is_linked_from_the_beginning_of_a_contact_to_its_end():
    log, targets = LinkLog(), one_received()
    for now_s, linked in ((102.0, True), (104.0, True), (106.0, False)):
        log.contact("a", linked=linked)
        log.update(HERE, HEIGHT_M, targets, now_s)
    assert [sample.linked for sample in log.samples] == [True, True, False]


def test_samples_have_an_interval_and_a_bound():
    log, targets = LinkLog(), one_received()
    for step in range(100):
        log.update(HERE, HEIGHT_M, targets, 100.0 + 0.1 * step)
    assert len(log.samples) == 5
    for step in range(30_000):
        if step % 10 == 0:
            targets.tracks["a"].pose_received(Point(50, 0), 1e9 + 110 + 2 * step, 110.0 + 2 * step)
        log.update(HERE, HEIGHT_M, targets, 110.0 + 2 * step)
    assert len(log.samples) == 2000


def test_a_robot_that_drives_is_where_its_path_and_speed_have_it():
    log, targets = LinkLog(), TargetList(("a",))
    track = targets.tracks["a"]
    for step in range(3):
        track.pose_received(Point(10.0 * step, 0), 1e9 + 10 * step, 10.0 * step)
    track.path_received((Point(20, 0), Point(200, 0)), 1e9 + 20, 20.0)
    log.update(HERE, HEIGHT_M, targets, 30.0)
    assert log.samples[0].place == pytest.approx((30, 0))
