"""Ground robots that meet by a plan: when they go, how they agree, what becomes of no-shows."""

from types import MappingProxyType

import pytest

from geo.frame import Geodetic, LocalFrame, Point
from sitl.robot_policies import POLICY_TOPIC, Drive, Received, RobotView
from sitl.robot_policies.planned import PLANS, STAYS_S, WAIT_S, Planned
from sitl.robot_policies.testing import check

TEAM = ("a", "b", "c")
HOME, GOAL = Point(0.0, 0.0), Point(50.0, 0.0)
SPEED_M_S, WAY_M = 0.5, 20.0
FIRST_S = PLANS[3][0][0]  # when a and c meet


class Robots:
    """Robots of a team of three, whose messages reach each other at once where they meet."""

    def __init__(self, *names):
        self.policies = {name: Planned() for name in names}
        self.positions = dict.fromkeys(names, GOAL)
        self.received = {}

    def choose(self, name, now_s, *, receives=True):
        view = RobotView(
            *(name, TEAM, now_s, 0.0, self.positions[name], HOME, HOME),
            speed_m_s=SPEED_M_S,
            frame=LocalFrame(Geodetic(0.0, 0.0)),
            goal=None,
            goals=(GOAL,),
            way_m=lambda place: 0.0 if place == self.positions[name] else WAY_M,
            received=MappingProxyType(self.received if receives else {}),
        )
        chosen = self.policies[name].choose(view)
        self.received[name, POLICY_TOPIC] = Received(self.policies[name].message, now_s)
        return chosen


def test_the_contract():
    check(Planned)


@pytest.mark.parametrize("robots", PLANS)
def test_every_robot_of_a_plan_meets_others_after_two_minutes_at_least(robots):
    assert {number for meeting in PLANS[robots] for number in meeting} == set(range(robots))
    assert all(len(meeting) == 2 for meeting in PLANS[robots])
    assert min(min(meeting.values()) for meeting in PLANS[robots]) >= 120


def test_a_robot_leaves_in_time_and_not_before():
    robots = Robots("a")
    assert robots.choose("a", 0.0) is None
    assert robots.choose("a", FIRST_S - WAY_M / SPEED_M_S - 1) is None
    assert robots.choose("a", FIRST_S - WAY_M / SPEED_M_S) == Drive(HOME)


def test_those_who_meet_agree_on_the_next_place():
    robots = Robots("a", "c")
    for name in "ac":
        robots.choose(name, 0.0)
        robots.positions[name] = HOME
    assert robots.choose("a", FIRST_S) == Drive(HOME)  # c has not published that it is there
    assert robots.choose("c", FIRST_S) == Drive(HOME)
    assert robots.choose("a", FIRST_S + 1) == Drive(HOME)  # it publishes where, and stays a while
    assert robots.choose("c", FIRST_S + 2) is None
    assert robots.choose("a", FIRST_S + 1 + STAYS_S) is None
    again_s = 2 * FIRST_S + 20
    assert robots.choose("a", again_s) == robots.choose("c", again_s) == Drive(GOAL)


def test_without_the_message_both_meet_at_home_again_in_the_end():
    robots = Robots("a", "c")
    for name in "ac":
        robots.choose(name, 0.0)
        robots.positions[name] = HOME
        robots.choose(name, FIRST_S)
    robots.choose("a", FIRST_S + 1)
    robots.choose("a", FIRST_S + 1 + STAYS_S)
    late_s = FIRST_S + WAIT_S + 1
    assert robots.choose("c", late_s, receives=False) is None
    robots.positions["c"] = GOAL
    assert robots.choose("c", late_s + FIRST_S, receives=False) == Drive(HOME)
    second_s = 2 * FIRST_S + 20 + WAIT_S
    assert robots.choose("a", second_s - 20) == Drive(GOAL)
    assert robots.choose("a", second_s) is None  # in vain: the place is forgotten


def test_a_team_without_a_plan_looks_for_goals():
    view = RobotView(
        *("a", ("a", "b"), 500.0, 0.0, HOME, HOME, HOME),
        speed_m_s=SPEED_M_S,
        frame=LocalFrame(Geodetic(0.0, 0.0)),
        goal=None,
        goals=(),
        way_m=lambda _: WAY_M,
        received=MappingProxyType({}),
    )
    assert Planned().choose(view) is None


def test_an_invalid_message_counts_as_none():
    robots = Robots("a")
    robots.choose("a", 0.0)
    robots.positions["a"] = HOME
    for data in (b"\xff", b"[]", b'"there"', b"{", b'{"next": [1]}', b'{"there": "x"}'):
        robots.received["c", POLICY_TOPIC] = Received(data, FIRST_S)
        assert robots.choose("a", FIRST_S) == Drive(HOME)
