"""What peers' poses may have the vehicle do: what a robot can have driven, and not often."""

import itertools
import math

import pytest

from air_router.controller.model.actions import Announce, FlyToPoint, Severity
from air_router.controller.model.events import RobotPath, RobotPose, RobotSought
from air_router.controller.model.states import State
from air_router.controller.targets.limits import (
    FASTEST_M_S,
    LONGEST_S,
    MOVES_S,
    NOISE_M,
    STAYS_S,
    YIELDS_S,
)
from air_router.controller.targets.pose_check import PoseCheck, PoseVerdict
from air_router.vehicle.instructions import CHECK_LOCALISATION
from geo.frame import Point
from tests.air_router.conftest import CORNERS
from tests.air_router.controller.test_controller import in_comm

BELIEVED, JUMPED, BACK = PoseVerdict.BELIEVED, PoseVerdict.JUMPED, PoseVerdict.BACK


def poses(flight, robot, places, every_s=0.2, ahead_s=0.0):
    """Have a robot report each of these places, one after the other; the motions since."""
    before = len(flight.motions)
    for place in places:
        flight.fly_for(every_s)
        flight.give(RobotPose(robot, place, flight.now_s + ahead_s, robot))
    return [m for m in flight.motions[before:] if isinstance(m, FlyToPoint)]


def warnings(flight):
    return [a for a in flight.actions if isinstance(a, Announce) and a.severity is Severity.WARNING]


@pytest.mark.parametrize("speed_m_s", [0.0, 1.0, FASTEST_M_S])
def test_what_a_robot_can_drive_is_believed_however_long_it_was_not_received(speed_m_s):
    check = PoseCheck()
    for second in (0.0, 0.2, 0.4, 1.0, 30.0, 3000.0):
        place = Point(speed_m_s * second, NOISE_M if second else 0.0)
        assert check.verdict(place, 1e9 + second, 7.0 + second) is BELIEVED


def test_what_came_late_through_others_counts_by_the_robots_own_clock():
    check = PoseCheck()
    check.verdict(Point(0.0, 0.0), 1e9, 500.0)
    assert check.verdict(Point(300.0, 0.0), 1e9 + 400.0, 500.1) is BELIEVED


def test_a_place_that_was_jumped_to_is_believed_once_the_robot_has_stayed_there():
    check = PoseCheck()
    check.verdict(Point(0.0, 0.0), 0.0, 0.0)
    found = [check.verdict(Point(60.0, 0.0), s, s) for s in range(1, 10)]
    first = found.index(BACK)
    assert found[:first] == [JUMPED] * first
    assert first == STAYS_S
    assert set(found[first + 1 :]) == {BELIEVED}
    assert check.jump.metres == 60.0
    assert check.jump.seconds == 1.0


def test_each_further_jump_has_to_last_longer_and_none_for_ever():
    check, now_s, side, lasted = PoseCheck(), 0.0, 1.0, []
    check.verdict(Point(0.0, 0.0), now_s, now_s)
    for _ in range(7):
        side, since_s = -side, now_s
        while True:
            now_s += 1.0
            if check.verdict(Point(900.0 * side, 0.0), now_s, now_s) is BACK:
                break
        lasted.append(now_s - since_s - 1.0)
    assert lasted[:3] == [STAYS_S, 2 * STAYS_S, 4 * STAYS_S]
    assert max(lasted) == LONGEST_S


def test_a_clock_that_runs_ahead_does_not_shorten_how_long_a_jump_has_to_last():
    check = PoseCheck()
    check.verdict(Point(0.0, 0.0), 0.0, 0.0)
    found = [check.verdict(Point(600.0, 0.0), 10.0 * k, 0.2 * k) for k in range(1, 12)]
    assert found == [JUMPED] * 11


def test_a_pose_that_jumps_moves_nothing_and_is_announced_once_with_an_instruction(pretend):
    flight = in_comm(pretend)
    robot, here = flight.controller.context.task.robot, flight.position
    sides = itertools.islice(itertools.cycle((30.0, -30.0)), 40)
    moved = poses(flight, robot, [Point(here[0] + side, here[1]) for side in sides])
    assert [m for m in moved if math.dist(m.position, here) > 20.0] == []
    (warning,) = warnings(flight)
    assert f"the position of {robot} jumped" in warning.text
    assert robot in warning.text
    assert warning.instruction == CHECK_LOCALISATION


@pytest.mark.parametrize("ahead_s", [0.0, 3600.0])
def test_peers_move_the_vehicle_once_in_a_while_whatever_their_stamps(pretend, ahead_s):
    flight = in_comm(pretend)
    robot, here, began_s = flight.controller.context.task.robot, flight.position, flight.now_s
    before = len(flight.motions)
    for number in range(1, 30):
        flight.fly_for(0.2)
        side = 12.0 if number % 2 else -12.0
        stamp_s = flight.now_s + number * ahead_s
        flight.give(RobotPose(robot, Point(here[0] + side, here[1]), stamp_s, robot))
        flight.give(RobotPath(robot, (Point(here[0] - side, here[1]),), stamp_s))
        if flight.controller.state is not State.COMM:
            break
    follows = [m for m in flight.motions[before:] if isinstance(m, FlyToPoint)]
    assert len(follows) <= 1 + (flight.now_s - began_s) / MOVES_S


def test_a_robot_that_drives_as_fast_as_any_is_followed(pretend):
    flight = in_comm(pretend)
    robot = flight.controller.context.task.robot
    flight.robots = {}  # no data are exchanged: it goes on hovering
    start = CORNERS[robot]
    places = [Point(start[0], start[1] - 0.2 * FASTEST_M_S * k) for k in range(1, 40)]
    assert len(poses(flight, robot, places)) >= 3
    assert warnings(flight) == []


def test_a_uav_that_changes_its_mind_takes_robots_away_only_now_and_then(pretend):
    flight = pretend(name="titan")
    flight.take_off()
    flight.fly_to_state(State.SEARCH)
    began_s, before = flight.now_s, flight.states.count(State.SEARCH)
    while flight.now_s < began_s + 10.0:
        flight.give(RobotSought("ariel", flight.controller.context.task.robot, flight.now_s))
        flight.fly_for(0.4)
    assert 1 <= flight.states.count(State.SEARCH) - before <= 1 + 10.0 / YIELDS_S
