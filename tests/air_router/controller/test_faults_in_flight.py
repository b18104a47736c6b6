"""What a flight does about what goes wrong: off its track, no satellites, in a zone."""

import itertools
import math

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere
from air_router.controller.model.events import CommandConfirmed, CommandFailed, RobotPose
from air_router.controller.model.requests import ComeHome
from air_router.controller.model.states import State
from air_router.vehicle.vehicle import FlightMode, ItemReached, PlanReplaced
from geo.frame import Point
from tests.air_router.conftest import CORNERS


def off_track(flight, east_m, north_m):
    """A gust, or a jump of the position estimate."""
    flight.position = Point(flight.position.east_m + east_m, flight.position.north_m + north_m)


def test_a_jump_of_the_position_has_the_leg_checked_again_from_there(away):
    flight = away(duration_s=200.0)
    leg = flight.controller.context.task.way.leg
    commanded = len(flight.motions)
    off_track(flight, 3.0, 3.0)
    flight.step()
    assert flight.controller.context.task.way.leg is leg
    assert len(flight.motions) == commanded  # clear from there as well: it flies on
    flight.lands()


def test_a_leg_that_is_not_clear_after_a_jump_is_not_flown_on(away):
    flight = away(duration_s=600.0)
    way = flight.controller.context.task.way
    behind = next(
        Point(*where)
        for where in itertools.product(range(-150, 100, 5), repeat=2)
        if flight.mission.planning_airspace.point_clear(Point(*where))
        and not flight.mission.airspace.leg_clear(Point(*where), way.leg.to)
    )
    flight.position = behind
    flight.step()
    leg = flight.controller.context.task.way.leg
    assert isinstance(flight.motions[-1], HoldHere) or leg.to != flight.motions[-2]
    track_from = len(flight.track)
    flight.ends()
    after = flight.track[track_from:]
    assert flight.mission.airspace.track_distance_m(after)[0] >= flight.mission.planner.clearance_m


def test_without_a_fix_it_holds_and_goes_on_some_seconds_after_it_is_back(away):
    flight = away(duration_s=120.0)
    flight.fix = False
    flight.step()
    assert isinstance(flight.motions[-1], HoldHere)
    commanded = len(flight.motions)
    flight.fly_for(20.0)
    assert len(flight.motions) == commanded
    flight.fix = True
    flight.fly_for(2.5)
    assert len(flight.motions) == commanded
    flight.fly_until(lambda: len(flight.motions) > commanded, 5.0)
    flight.lands()
    assert sum("lost its fix" in text for text in flight.announced) == 1


def in_comm(flight):
    flight.robots = dict(CORNERS)
    flight.take_off()
    flight.fly_to_state(State.COMM)
    flight.robots = {}
    return flight.controller.context.task.robot


def has_moved(robot, flight):
    return RobotPose(robot, Point(60.0, 0.0), flight.now_s + 100.0, robot)


def test_a_landing_goes_on_without_a_fix(airborne):
    flight = airborne(duration_s=60.0)
    flight.fly_to_state(State.LAND)
    commanded = len(flight.motions)
    flight.fix = False
    flight.ends()
    assert len(flight.motions) == commanded
    assert "GPS has lost its fix: the landing continues" in flight.announced
    assert flight.finished.landed_by_us


def test_while_a_jump_is_under_way_a_report_of_an_item_is_of_the_one_before(airborne):
    """The race that leads a vehicle past a waypoint: its report comes after the next jump."""
    flight = airborne()
    flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) > 20.0)
    flight.act = flight.actions.append  # neither confirmed nor failed
    flight.fly_until(lambda: isinstance(flight.controller.gate.pending, FlyToNode))
    jump, commanded = flight.controller.gate.pending, len(flight.motions)
    flight.give(ItemReached(flight.now_s, flight.plan.item_of(jump.node)))
    assert flight.controller.gate.pending is jump
    assert len(flight.motions) == commanded


def test_a_vehicle_that_does_not_jump_is_sent_to_points(pretend):
    flight = pretend(duration_s=100.0)
    act = flight.act

    def no_jumps(action):
        if isinstance(action, FlyToNode):
            flight.give(CommandFailed(action, "Mission mode was requested and it stays in Hold"))
        else:
            act(action)

    flight.act = no_jumps
    flight.take_off()
    flight.lands()
    first_point = next(m for m in flight.motions if isinstance(m, FlyToPoint))
    assert [type(m) for m in flight.motions[: flight.motions.index(first_point)]] == [FlyToNode] * 4
    assert flight.announced.count("the plan on board is not flown: flying to points instead") == 1


def test_without_a_fix_nothing_that_happens_moves_the_vehicle(pretend):
    flight = pretend()
    robot = in_comm(flight)
    flight.fix = False
    flight.step()
    commanded = len(flight.motions)
    flight.give(has_moved(robot, flight))
    flight.operator_requests(ComeHome())
    assert flight.controller.state is State.HOME
    flight.fix = True
    flight.fly_for(2.5)
    assert len(flight.motions) == commanded
    flight.lands()


def test_a_hold_without_a_fix_that_failed_is_commanded_again(away):
    flight = away()
    flight.fix, flight.deaf = False, True
    flight.step()
    flight.deaf = False
    commanded = len(flight.motions)
    flight.fly_until(lambda: len(flight.motions) > commanded, 5.0)
    assert isinstance(flight.motions[-1], HoldHere)
    flight.fly_for(10.0)
    assert len(flight.motions) == commanded + 1


def test_between_a_breach_and_hands_off_nothing_moves_the_vehicle(pretend):
    flight = pretend()
    robot = in_comm(flight)
    controller = flight.controller
    flight.position, flight.velocity = in_a_zone(flight), (0.0, 0.0)
    (hold,) = controller.handle(flight.telemetry(), flight.now_s)
    assert isinstance(hold, HoldHere)  # and it takes its time to be confirmed
    assert controller.handle(has_moved(robot, flight), flight.now_s) == []
    (answer,) = controller.handle(ComeHome(), flight.now_s)
    assert "hands off in a moment" in answer.why
    assert controller.navigator.objection(hold, flight.now_s) is None
    flight.give(CommandConfirmed(hold))
    assert controller.state is State.PASSIVE


def in_a_zone(flight):
    zone = next(z for z in flight.mission.airspace.zones)
    west, south, east, north = zone.polygon.bounds
    return Point((west + east) / 2, (south + north) / 2)


def test_a_breach_is_held_given_to_the_pilot_and_never_resumed_by_itself(away):
    flight = away()
    flight.position = in_a_zone(flight)
    flight.step()
    assert isinstance(flight.motions[-1], HoldHere)
    assert flight.controller.state is State.PASSIVE
    assert any("breach of" in text and "not resumed" in text for text in flight.announced)
    commanded = len(flight.motions)
    flight.position = flight.mission.home
    flight.fly_for(30.0)
    assert len(flight.motions) == commanded
    assert flight.controller.state is State.PASSIVE


def in_breach_and_deaf(away):
    flight = away()
    flight.deaf = True
    commanded = len(flight.motions)
    flight.position, flight.velocity = in_a_zone(flight), (0.0, 0.0)
    flight.target = flight.position
    flight.step()
    return flight, commanded


def test_a_hold_before_hands_off_that_was_lost_is_commanded_again(away):
    flight, commanded = in_breach_and_deaf(away)
    flight.fly_for(3.5)
    assert flight.controller.state is State.INIT
    flight.deaf = False
    flight.fly_to_state(State.PASSIVE, 5.0)
    assert flight.mode is FlightMode.HOLD
    assert [type(m) for m in flight.motions[commanded:]] == [HoldHere] * 3  # every three seconds


def test_a_breach_that_cannot_be_held_is_given_to_the_pilot_all_the_same(away):
    flight, commanded = in_breach_and_deaf(away)
    flight.give(has_moved("io", flight))  # and nothing else is commanded meanwhile
    flight.fly_to_state(State.PASSIVE, 30.0)
    assert [type(m) for m in flight.motions[commanded:]] == [HoldHere] * 6
    assert flight.announced[-1].endswith("it did not follow the hold command")


def test_a_pilot_who_takes_it_while_the_hold_is_commanded_again_keeps_it(away):
    flight, commanded = in_breach_and_deaf(away)
    flight.pilot_chooses(FlightMode.OTHER)
    assert flight.controller.state is State.PASSIVE
    flight.fly_for(10.0)
    assert len(flight.motions) == commanded + 1


def test_while_it_is_held_before_hands_off_another_fence_changes_nothing(away):
    flight, _ = in_breach_and_deaf(away)
    flight.give(PlanReplaced(flight.now_s, only_fence=True))
    assert flight.controller.state is State.INIT  # the hold is still to come
    flight.deaf = False
    flight.fly_to_state(State.PASSIVE, 5.0)
    assert flight.mode is FlightMode.HOLD


def test_a_hold_without_a_fix_that_failed_is_commanded_again_whatever_happens_meanwhile(airborne):
    flight = airborne()
    flight.fly_to_state(State.SEARCH)
    robot = flight.controller.context.task.robot
    flight.fix, flight.deaf = False, True
    flight.step()
    flight.give(RobotPose(robot, Point(60.0, 0.0), flight.now_s, robot))
    assert flight.controller.state is State.COMM  # the pause before the next try was the state's
    flight.deaf = False
    flight.fly_until(lambda: flight.mode is FlightMode.HOLD, 5.0)


def test_a_climb_that_does_not_go_on_ends_and_a_pilot_s_climb_is_not_watched(pretend):
    for mode, state in ((FlightMode.MISSION, State.LAND), (FlightMode.POSITION, State.READY)):
        flight = pretend(pilot_arms=True)
        flight.take_off_halfway(mode)
        flight.fly_for(19.0)
        assert flight.controller.state is State.READY
        flight.fly_for(3.0)
        assert flight.controller.state is state
