"""Whom the policies seek, and where they meet it."""

import dataclasses
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from air_router.controller.model.events import RobotPath, RobotPose
from air_router.controller.model.states import State
from air_router.controller.targets.limits import (
    EARLY_SHARE,
    LOST_AFTER_S,
    MEETING_M,
    USUAL_SPEED_M_S,
)
from air_router.controller.targets.policies import policy_of
from air_router.controller.targets.predicted_path import PredictedPath
from air_router.controller.targets.seeking import SeekContext, meet
from air_router.controller.targets.target_list import Sighting, TargetList, TargetTrack
from air_router.files import SEEK_POLICIES
from geo.frame import Point
from mocha_link.links.metrics import ContactBegan, Direction
from tests.air_router.conftest import CORNERS

HOME = Point(0.0, 0.0)
UNSEEN = Point(90.0, 90.0)
SPEED_M_S = 5.0

few = settings(max_examples=60, deadline=None)
names = st.lists(st.sampled_from("abcdefgh"), min_size=0, max_size=5, unique=True).map(tuple)
metres = st.floats(-400, 400, allow_nan=False)
points = st.builds(Point, metres, metres)
paths = st.lists(points, min_size=1, max_size=5).map(tuple)
moments = st.floats(0, 2500)


def leg_s(start, end):
    return math.dist(start, end) / SPEED_M_S


def context(now_s, here=HOME, *, began_s=0.0, walled=()):
    def flight_s(place):
        return math.inf if place in walled else math.dist(here, place) / SPEED_M_S

    return SeekContext(now_s, began_s, flight_s, leg_s, flight_s, unseen=UNSEEN, round_s=185.0)


def order(policy, targets, *args, **how):
    return [place.robot for place in policy_of(policy).order(targets, context(*args, **how))]


def received(targets, robot, place, now_s, *path, given=True):
    """Met at a place; its clock is far from ours."""
    stamp_s = 1e9 + now_s
    targets.tracks[robot].pose_received(place, stamp_s, now_s)
    if path:
        targets.tracks[robot].path_received(path, stamp_s, now_s)
    targets.tracks[robot].synced(Direction.IN, now_s)
    if given:
        targets.tracks[robot].synced(Direction.OUT, now_s)


@st.composite
def rosters(draw):
    targets = TargetList(draw(names))
    for name in targets.names:
        now_s, stamp_s = draw(moments), draw(st.floats(0, 1e11))
        if draw(st.booleans()):
            targets.tracks[name].pose_received(draw(points), stamp_s, now_s)
        if draw(st.booleans()):
            targets.tracks[name].path_received(draw(paths), draw(st.floats(0, 1e11)), now_s)
        if draw(st.booleans()):
            targets.tracks[name].synced(draw(st.sampled_from(Direction)), now_s)
        if draw(st.booleans()):
            targets.tracks[name].radio = Sighting(draw(points), draw(moments))
    if targets.names and draw(st.booleans()):
        targets.sought(draw(st.sampled_from(targets.names)))
        targets.sought_by_other("other", draw(st.sampled_from(targets.names)), draw(moments))
    return targets


@pytest.mark.parametrize("policy", SEEK_POLICIES)
@given(targets=rosters(), now_s=moments, here=points, wall=points)
@few
def test_every_robot_once_the_same_twice_and_in_its_group(policy, targets, now_s, here, wall):
    first = tuple(policy_of(policy).order(targets, context(now_s, here, walled=[wall, UNSEEN])))
    again = tuple(policy_of(policy).order(targets, context(now_s, here, walled=[wall, UNSEEN])))
    assert first == again
    robots = [place.robot for place in first]
    assert sorted(robots) == sorted(targets.names)
    groups = [set(group) for group in targets.groups(now_s)]
    rank = [next(i for i, group in enumerate(groups) if robot in group) for robot in robots]
    assert rank == sorted(rank)
    for place in first:
        assert place.reason
        assert place.position is not None or targets.tracks[place.robot].newest_s is None


courses = st.builds(PredictedPath, paths, st.floats(-300, 100), st.floats(0.2, 3.0))


@given(course=courses, here=points)
@few
def test_a_meeting_is_as_soon_as_can_be(course, here):
    view = context(100.0, here)
    along_m, flight_s = meet(course, view)
    place = course.place(along_m)
    assert flight_s == pytest.approx(math.dist(here, place) / SPEED_M_S)
    now_m = course.along_m(100.0)
    assert now_m <= along_m <= course.length_m + 1e-9

    def spare_s(at_m):
        way_s = (1 - EARLY_SHARE) * (course.due_s(at_m) - 100.0)
        return way_s - math.dist(here, course.place(at_m)) / SPEED_M_S

    if along_m < course.length_m:
        assert spare_s(along_m) >= -1e-6  # the vehicle is there first
    if along_m - MEETING_M > now_m:
        assert spare_s(along_m - MEETING_M) <= 1e-6  # and nowhere before


def test_a_course_has_the_places_of_the_robot_and_its_end():
    course = PredictedPath((Point(0, 0), Point(10, 0), Point(10, 0), Point(10, 20)), 100.0, 2.0)
    assert course.length_m == 30
    assert course.end_s == 115
    assert [course.place(m) for m in (-1, 0, 5, 10)] == [(0, 0), (0, 0), (5, 0), (10, 0)]
    assert [course.place(m) for m in (20, 30, 31)] == [(10, 10), (10, 20), (10, 20)]
    assert [course.along_m(s) for s in (0, 100, 103, 500)] == [0, 0, 6, 30]
    stands = PredictedPath((Point(3, 4),), 100.0, 2.0)
    assert (stands.length_m, stands.end_s, stands.place(7.0)) == (0, 100, (3, 4))


def test_clocks_of_robots_need_not_agree_with_ours():
    for behind_s in (-1e9, 0.0, 12345.0):
        robot = TargetTrack("io")
        robot.pose_received(Point(0, 0), 1e10 + behind_s, 100.0)  # straight from it
        robot.pose_received(Point(50, 0), 1e10 + behind_s + 50.0, 400.0)  # carried for 250 s
        assert robot.newest_s == pytest.approx(150.0)
        assert robot.updated_s == 400.0


def test_a_radio_that_is_received_shows_where_a_robot_is_once_its_path_is_over():
    robot = TargetTrack("io")
    robot.radio = Sighting(Point(7, 7), 50.0)
    assert (robot.course().points, robot.course().end_s, robot.newest_s) == (((7, 7),), 50.0, None)
    robot.path_received((Point(0, 0), Point(100, 0)), 1e9 + 100.0, 100.0)
    robot.pose_received(Point(0, 0), 1e9 + 100.0, 100.0)
    robot.radio = Sighting(Point(40, 10), 150.0)  # as it reported
    assert robot.course().points[-1] == (100, 0)
    robot.radio = Sighting(Point(90, 80), 300.0)  # it was not known
    assert robot.course().points == ((90, 80),)
    robot.pose_received(Point(95, 85), 1e9 + 310.0, 310.0)
    assert robot.course().points[0] == (95, 85)


def test_the_speed_is_that_of_driving_whatever_the_noise_and_the_stops():
    robot = TargetTrack("io")
    assert robot.speed_m_s is None
    east_m = 0.0
    for second in range(60):
        east_m += 0.7 if second < 30 else 0.0  # then it stands
        jitter_m = 0.3 * (-1) ** second
        robot.pose_received(Point(east_m + jitter_m, 0), second, second)
    assert robot.speed_m_s == pytest.approx(0.7, abs=0.15)


def test_a_robot_whose_speed_is_not_known_drives_as_the_others_do():
    targets = TargetList(("slow", "new"))
    for robot in targets.names:
        received(targets, robot, Point(0, 0), 0.0, Point(0, 0), Point(100, 0))
    assert targets.course("new").speed_m_s == USUAL_SPEED_M_S
    received(targets, "slow", Point(3, 0), 10.0)
    assert targets.course("slow").speed_m_s == pytest.approx(0.3)
    assert targets.course("new").speed_m_s == pytest.approx(0.3)


def test_a_course_follows_the_path_from_where_the_robot_is_on_it():
    robot = TargetTrack("io")
    robot.path_received((Point(0, 0), Point(100, 0), Point(100, 100)), 10.0, 10.0)
    robot.pose_received(Point(60, 1), 70.0, 70.0)
    assert robot.course().points == ((60, 1), (100, 0), (100, 100))
    assert robot.course().start_s == 70.0
    robot.pose_received(Point(60, 30), 75.0, 75.0)  # it has left the path
    assert robot.course().points == ((60, 30),)
    robot.path_received((Point(0, 50), Point(0, 90)), 200.0, 200.0)  # long after the pose
    assert robot.course().points == ((0, 50), (0, 90))
    assert robot.course().start_s == 200.0


def test_the_freshest_policy_seeks_who_has_waited_longest_both_ways():
    targets = TargetList(("a", "b", "c"))
    received(targets, "a", Point(50, 0), 200.0)
    received(targets, "b", Point(-50, 0), 100.0)
    received(targets, "c", Point(0, 50), 150.0)
    assert order("round_robin", targets, 300.0) == ["a", "b", "c"]
    assert order("freshest", targets, 300.0) == ["b", "c", "a"]
    received(targets, "b", Point(-50, 0), 290.0, given=False)  # it has not received our messages
    received(targets, "c", Point(0, 50), 290.0)
    assert order("freshest", targets, 300.0) == ["b", "a", "c"]


def test_a_near_robot_is_sought_before_a_far_one_that_is_hardly_older():
    targets = TargetList(("far", "near"))
    received(targets, "far", Point(400, 0), 100.0)
    received(targets, "near", Point(10, 0), 105.0)
    assert order("freshest", targets, 300.0) == ["near", "far"]
    (best, _) = policy_of("freshest").order(targets, context(300.0))
    assert best.reason == "data, 195 s; 2 s away; its last position"


def test_who_was_sought_in_vain_is_not_sought_at_once_again():
    targets = TargetList(("a", "b"))
    received(targets, "a", Point(50, 0), 100.0)
    received(targets, "b", Point(50, 0), 150.0)
    assert order("freshest", targets, 300.0)[0] == "a"
    targets.tracks["a"].tries += 1
    assert order("freshest", targets, 400.0) == ["b", "a"]
    targets.tracks["a"].pose_received(Point(60, 0), 2e9, 410.0)  # a peer has seen it
    assert order("freshest", targets, 900.0)[0] == "a"


def test_lost_ones_and_those_that_others_seek_come_last_and_those_without_a_way():
    targets = TargetList(("lost", "taken", "walled", "open"))
    received(targets, "lost", Point(5, 5), 1.0)
    late_s = LOST_AFTER_S + 50.0
    for robot in ("taken", "walled", "open"):
        received(targets, robot, Point(100, 10) if robot == "walled" else Point(9, 9), 1000.0)
    targets.sought_by_other("other", "taken", late_s)
    for policy in ("freshest", "rendezvous"):
        ranked = order(policy, targets, late_s, walled=[Point(100, 10)])
        assert ranked == ["open", "walled", "lost", "taken"]


def test_robots_never_received_are_sought_in_turns():
    targets = TargetList(("a", "b"))
    policy = policy_of("rendezvous")
    seen = []
    for _ in range(4):
        first = policy.order(targets, context(200.0))[0]
        assert first.position is None
        seen.append(first.robot)
        targets.sought(first.robot)
    assert seen == ["a", "b", "a", "b"]


def test_a_rendezvous_is_ahead_of_the_robot_with_that_as_reason():
    targets = TargetList(("io",))
    received(targets, "io", Point(100, 0), 100.0, Point(100, 0), Point(100, 300))
    (place,) = policy_of("rendezvous").order(targets, context(120.0))
    assert place.position[0] == 100
    assert 20 < place.position[1] < 60
    assert "where its path leads it in" in place.reason
    (place,) = policy_of("rendezvous").order(targets, context(500.0))
    assert place.position == (100, 300)
    assert place.reason.endswith("where its path ends")
    (place,) = policy_of("freshest").order(targets, context(120.0))
    assert place.position == (100, 0)


def test_a_moving_robot_is_met_on_its_way_in_flight(airborne):
    flight = airborne(seek=("io",), seek_policy="rendezvous", radius_m=15.0)
    south, north = Point(75.0, -140.0), Point(64.0, 40.0)
    way_m = math.dist(south, north)

    def place():
        share = min(max(flight.now_s - 270.0, 0.0) * 1.2 / way_m, 1.0)
        return Point(*(a + share * (b - a) for a, b in zip(south, north, strict=True)))

    for second in range(4):  # received for a moment as it sets out
        flight.fly_until(lambda moment=270.0 + 2 * second: flight.now_s >= moment)
        flight.give(RobotPose("io", place(), flight.now_s, "io"))
        if not second:
            flight.give(RobotPath("io", (south, north), flight.now_s))
    flight.fly_to_state(State.SEARCH)
    aimed = flight.controller.context.task.way.goal.position
    assert north[1] > aimed[1] > place()[1]

    def drive():
        flight.robots = {"io": place()}
        return flight.controller.state is not State.SEARCH

    flight.fly_until(drive, 300.0)
    assert flight.controller.state is State.COMM
    assert any("SEARCH io: oldest data" in text for text in flight.announced)


def test_where_a_radio_is_received_is_noted_in_flight(airborne):
    flight = airborne(seek=("io",), seek_policy="freshest")
    flight.fly_until(lambda: flight.now_s > 200.0)
    flight.give(ContactBegan("io", 0.0, None))
    there, known = flight.position, flight.controller.search.targets.tracks["io"]
    assert math.dist(known.course().points[0], there) < 1.0
    flight.fly_to_state(State.SEARCH)
    assert math.dist(flight.controller.context.task.way.goal.position, there) < 1.0


@pytest.mark.parametrize("policy", SEEK_POLICIES)
def test_every_policy_finds_all_robots(pretend, policy):
    timers = dataclasses.replace(pretend().mission.timers, init_s=30.0, explore_s=20.0)
    flight = pretend(duration_s=1000.0, seek_policy=policy, timers=timers)
    flight.robots = dict(CORNERS)
    flight.take_off()
    found = set()

    def all_found():  # also in passing
        tracks = flight.controller.search.targets.tracks.values()
        found.update(track.robot for track in tracks if track.taken_s is not None)
        return len(found) == 3

    flight.fly_until(all_found, 1000.0)
    assert flight.mission.airspace.track_distance_m(flight.track)[0] >= 5.0
