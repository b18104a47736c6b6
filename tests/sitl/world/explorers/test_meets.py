"""A robot's policy that goes back to where it last had contact with a UAV."""

import math
from types import MappingProxyType

from air_router.messages import MAP_TOPIC, POSE_TOPIC, PoseMessage
from geo.frame import Geodetic, LocalFrame, Point
from sitl.robot_policies import Drive, Received, RobotView
from sitl.robot_policies.meets import DUE_S, MOST_DETOUR_S, PAUSE_S, WAIT_S, Meets
from sitl.robot_policies.testing import check

MEETING = Point(10.0, 0.0)
SPEED_M_S = 0.5
BEHIND_S = 1.7e9  # the UAV's clock, against the robot's


class Robot:
    """What a robot sees as time goes on."""

    def __init__(self):
        self.policy, self.received, self.position = Meets(), {}, MEETING

    def view(self, now_s, way_m=20.0):
        return RobotView(
            *("ugv01", ("ugv01",), now_s, 0.0, self.position, Point(0.0, 0.0), Point(0.0, 0.0)),
            speed_m_s=SPEED_M_S,
            frame=LocalFrame(Geodetic(0.0, 0.0)),
            goal=Point(60.0, 0.0),
            goals=(),
            way_m=lambda _: way_m,
            received=MappingProxyType(self.received),
        )

    def meets(self, now_s, delay_s=0.0):
        """A UAV's map and pose arrive, `delay_s` after they were published."""
        pose = PoseMessage(stamp_s=now_s + BEHIND_S - delay_s, latitude_deg=1.0, longitude_deg=2.0)
        self.received["uav01", MAP_TOPIC] = Received(b"a map", now_s)
        self.received["uav01", POSE_TOPIC] = Received(pose.encode(), now_s)
        return self.policy.choose(self.view(now_s))

    def left(self):
        """It has driven on."""
        self.position = Point(40.0, 0.0)
        return self


def test_it_keeps_the_contract():
    check(Meets)


def test_without_any_contact_so_far_it_looks_for_goals():
    assert Robot().policy.choose(Robot().view(900.0)) is None


def test_it_goes_back_to_where_it_had_contact_when_that_was_long_ago():
    robot = Robot()
    assert robot.meets(100.0) is None
    robot.left()
    assert robot.policy.choose(robot.view(100.0 + DUE_S - 5)) is None
    assert robot.policy.choose(robot.view(100.0 + 2 * DUE_S)) == Drive(MEETING)


def test_a_meeting_ends_with_the_contact():
    robot = Robot()
    robot.meets(100.0)
    robot.left().policy.choose(robot.view(460.0))
    assert robot.meets(500.0) is None
    assert robot.policy.expected > 0.5


def test_a_meeting_in_vain_ends_after_its_time_and_the_next_is_less_probable():
    robot = Robot()
    robot.meets(100.0)
    robot.left()
    began_s = 460.0
    ends_s = began_s + 20.0 / SPEED_M_S + WAIT_S
    assert robot.policy.choose(robot.view(began_s)) == Drive(MEETING)
    assert robot.policy.choose(robot.view(ends_s - 1)) == Drive(MEETING)
    assert robot.policy.choose(robot.view(ends_s + 5)) is None
    assert robot.policy.expected < 0.5
    assert robot.policy.choose(robot.view(ends_s + PAUSE_S - 5)) is None
    assert robot.policy.choose(robot.view(ends_s + 5 + PAUSE_S)) == Drive(MEETING)


def test_no_meeting_is_worth_a_long_way():
    for way_m in (SPEED_M_S * MOST_DETOUR_S + 1, math.inf):
        robot = Robot()
        robot.meets(100.0)
        robot.left()
        assert robot.policy.choose(robot.view(900.0, way_m)) is None


def test_what_others_carry_is_no_contact_whatever_the_clocks_show():
    robot = Robot()
    robot.meets(100.0)
    robot.left()
    robot.meets(250.0, delay_s=60.0)
    assert robot.policy.choose(robot.view(460.0)) == Drive(MEETING)
