import dataclasses
import itertools
import math
import random

import pytest

from air_router.controller.model.actions import (
    Announce,
    FlyToNode,
    FlyToPoint,
    HoldHere,
    LandHere,
    PublishMap,
    Refusal,
)
from air_router.controller.model.events import AirspaceChanged, PeerFault, RobotPose
from air_router.controller.model.interlocks_raised import Anomaly
from air_router.controller.model.requests import ComeHome, GoOn, GoTo, HoldNow
from air_router.controller.model.states import State
from air_router.controller.motion.navigator import Navigator
from air_router.mission.mission import Waypoint
from air_router.vehicle.instructions import CHECK_PEER, Severity
from air_router.vehicle.vehicle import Ages, FlightMode, ItemReached, LinkSilent
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted
from tests.air_router.conftest import CORNERS


def test_the_paper_s_times(airborne):
    flight = airborne()
    began_s = flight.now_s
    flight.fly_to_state(State.SEARCH)
    assert flight.now_s - began_s == pytest.approx(180.0, abs=0.2)
    assert flight.controller.context.left_s is None  # it counts from the arrival on
    flight.fly_until(lambda: flight.controller.context.left_s is not None)
    assert math.dist(flight.position, flight.controller.context.task.way.goal.position) < 3.0
    arrived_s = flight.now_s
    flight.fly_to_state(State.EXPL)
    assert flight.now_s - arrived_s == pytest.approx(45.0, abs=0.2)
    exploring_s = flight.now_s
    flight.fly_to_state(State.SEARCH)
    assert flight.now_s - exploring_s == pytest.approx(120.0, abs=0.2)


def in_comm(pretend):
    flight = pretend()
    flight.robots = dict(CORNERS)
    flight.take_off()
    flight.fly_to_state(State.COMM)
    return flight


def test_comm_ends_when_both_directions_have_synced(pretend):
    flight = in_comm(pretend)
    began_s = flight.now_s
    assert any(isinstance(a, PublishMap) for a in flight.actions)
    flight.fly_to_state(State.EXPL)
    assert flight.now_s - began_s < 5.0


def test_comm_ends_after_t_c_when_only_one_direction_syncs(pretend):
    flight = in_comm(pretend)
    robot, began_s = flight.controller.context.task.robot, flight.now_s
    flight.robots = {}
    flight.give(SyncStarted(robot, 0.0, Direction.IN))
    flight.give(SyncEnded(robot, 0.0, Direction.IN, 1, 1, 0.1))
    flight.fly_to_state(State.EXPL)
    assert flight.now_s - began_s == pytest.approx(20.0, abs=0.3)


def test_a_sync_that_a_byte_budget_cut_short_does_not_end_comm(pretend):
    flight = in_comm(pretend)
    robot = flight.controller.context.task.robot
    flight.robots = {}

    def sync(*, complete):
        for direction in Direction:
            flight.give(SyncStarted(robot, 0.0, direction))
            flight.give(SyncEnded(robot, 0.0, direction, 1, 1, 0.1, complete=complete))

    sync(complete=False)
    assert flight.controller.state is State.COMM
    sync(complete=True)
    assert flight.controller.state is State.EXPL


def test_a_sync_that_began_before_the_robot_was_found_does_not_count(pretend):
    flight = in_comm(pretend)
    robot = flight.controller.context.task.robot
    flight.robots = {}
    for direction in Direction:
        flight.give(SyncEnded(robot, 0.0, direction, 1, 1, 0.1))
    assert flight.controller.state is State.COMM


def test_a_carried_pose_moves_the_search_but_is_not_found(airborne):
    flight = airborne()
    flight.fly_to_state(State.SEARCH)
    robot = flight.controller.context.task.robot
    flight.give(RobotPose(robot, CORNERS["io"], 10.0, "europa"))
    assert flight.controller.state is State.SEARCH
    assert flight.controller.context.task.way.goal.position == CORNERS["io"]
    flight.give(RobotPose(robot, CORNERS["io"], 11.0, robot))
    assert flight.controller.state is State.COMM


def test_exploration_resumes_where_it_stopped_and_then_only_search_remains(pretend, airborne):
    short = dataclasses.replace
    flight = pretend()
    timers = short(flight.mission.timers, init_s=60.0, search_s=1.0)
    flight = airborne(timers=timers, duration_s=None)
    flight.fly_until(lambda: flight.controller.exploration.remaining == 0, 4000.0)
    visited = [m.node for m in flight.motions if isinstance(m, FlyToNode)]
    assert set(range(1, 40)) <= set(visited)
    assert flight.controller.exploration.left_out == []
    seen = len(flight.states)
    flight.fly_until(lambda: len(flight.states) > seen + 6, 4000.0)
    later = flight.states[seen:]
    assert State.COMM not in later
    # EXPL is left in the moment it is entered: nothing is explored any more.
    assert all(b is State.SEARCH for a, b in itertools.pairwise(later) if a is State.EXPL)


def test_with_position_noise_every_waypoint_is_visited_and_no_leg_commanded_twice(pretend):
    flight = pretend(timers=dataclasses.replace(pretend().mission.timers, init_s=2000.0))
    flight.noise_m = 0.3
    flight.take_off()
    flight.fly_until(lambda: flight.controller.exploration.remaining == 0, 2500.0)
    assert flight.controller.exploration.left_out == []
    commanded = [m.node for m in flight.motions if isinstance(m, FlyToNode)]
    assert set(range(1, 40)) <= set(commanded)
    assert len(commanded) < 80
    assert flight.closest_m() >= flight.mission.planner.clearance_m


def test_a_robot_over_a_zone_is_waited_for_beside_it(pretend):
    flight = pretend(radius_m=200.0)
    inside = Point(
        *(sum(axis) / len(axis) for axis in zip(*flight.mission.zones[0].shape.ring, strict=True))
    )
    assert flight.mission.airspace.distance_m(inside) < 0
    flight.robots = {"callisto": inside}
    flight.take_off()
    flight.fly_to_state(State.COMM)
    goal = flight.controller.context.task.way.goal.position
    assert flight.mission.planning_airspace.point_clear(goal)
    assert any("no hovering over callisto" in text for text in flight.announced)


def test_a_command_that_fails_is_tried_again(airborne):
    flight = airborne()
    flight.fly_until(lambda: flight.controller.exploration.remaining < 39)
    flight.deaf = True
    flight.fly_until(lambda: any("did not follow" in text for text in flight.announced))
    flight.fly_for(5.0)
    flight.deaf = False
    left = flight.controller.exploration.remaining
    flight.fly_until(lambda: flight.controller.exploration.remaining < left - 1)


def test_a_repeated_report_of_an_earlier_node_does_not_skip_one(airborne):
    flight = airborne()
    flight.fly_until(lambda: flight.controller.exploration.remaining == 37)
    before = flight.controller.context.task.way.leg
    flight.give(ItemReached(flight.now_s, flight.plan.item_of(1)))
    assert flight.controller.context.task.way.leg == before


def test_the_autopilot_s_report_alone_is_enough_to_go_on(airborne):
    flight = airborne()
    leg = flight.controller.context.task.way.leg
    flight.position = Point(leg.to.east_m + 2.5, leg.to.north_m)  # outside our radius, inside PX4's
    flight.velocity = (0.0, 0.0)
    flight.target = None
    flight.step()
    assert flight.controller.context.task.way.leg == leg
    flight.give(ItemReached(flight.now_s, flight.plan.item_of(leg.node)))
    assert flight.controller.context.task.way.leg != leg


def island(pretend):
    """A flight whose only robot is somewhere that no way leads to."""

    def ring(west, south, east, north):
        corners = ((west, south), (east, south), (east, north), (west, north))
        return tuple(Point(*corner) for corner in corners)

    walls = ((100, 100, 200, 110), (100, 190, 200, 200), (100, 100, 110, 200), (190, 100, 200, 200))
    zones = [Zone(f"wall {number}", ring(*wall)) for number, wall in enumerate(walls)]
    airspace = Airspace(ring(-300, -300, 300, 300), zones, 5.0)
    flight = pretend(
        seek=("io",),
        home=Point(0.0, 0.0),
        waypoints=(Waypoint(1, Point(0.0, 50.0), 40.0),),
        airspace=airspace,
        planning_airspace=airspace.with_margin(1.5),
    )
    flight.take_off()
    flight.give(RobotPose("io", Point(150.0, 150.0), 1.0, "callisto"))
    return flight


def test_a_robot_that_no_way_leads_to_is_sought_from_outside(pretend):
    flight = island(pretend)
    flight.fly_until(lambda: any("SEARCH io" in text for text in flight.announced))
    assert any("no clear way leads there, so 56.5 m beside it" in text for text in flight.announced)
    flight.fly_until(lambda: math.dist(flight.position, Point(150.0, 150.0)) < 57.5, 200.0)


def test_when_no_robot_can_be_sought_it_hovers_and_tries_again_now_and_then(pretend, monkeypatch):
    flight = island(pretend)
    monkeypatch.setattr(Navigator, "hover_point", lambda _, place: place)
    flight.fly_until(lambda: any("no way to io" in text for text in flight.announced))
    assert flight.controller.state is State.SEARCH
    commanded, announced = len(flight.motions), len(flight.announced)
    assert isinstance(flight.motions[-1], HoldHere)
    flight.fly_for(60.0)
    assert len(flight.motions) == commanded
    assert 3 <= len(flight.announced) - announced <= 7
    flight.give(RobotPose("io", Point(0.0, 100.0), 100.0, "callisto"))
    flight.fly_until(lambda: math.dist(flight.position, Point(0.0, 100.0)) < 3.0, 60.0)


def test_a_place_from_which_no_waypoint_is_reached_costs_none_of_them(pretend, airborne):
    flight = airborne(timers=dataclasses.replace(pretend().mission.timers, init_s=2000.0))
    flight.fly_until(lambda: flight.controller.exploration.remaining == 35)
    flight.velocity, flight.target, here = (0.0, 0.0), None, flight.position
    flight.position = Point(0.0, 5000.0)  # a glitch of the position, far outside of the fence
    controller = flight.controller
    controller.context.telemetry = flight.telemetry()
    controller.navigator.plan_to(controller.exploration.goal)
    controller.navigator.advance(None)
    assert flight.controller.exploration.remaining >= 34
    flight.position = here
    flight.fly_until(lambda: flight.controller.exploration.remaining == 0, 2000.0)
    assert len(flight.controller.exploration.left_out) <= 1


def test_a_vehicle_that_stands_is_commanded_again_and_then_something_else(pretend, away):
    flight = away(timers=dataclasses.replace(pretend().mission.timers, init_s=2000.0))
    commanded = len(flight.motions)
    for _ in range(750):
        flight.target = None  # it takes every command and does not move
        flight.step()
    assert len(flight.controller.exploration.left_out) == 1
    assert 5 <= len(flight.motions) - commanded <= 15
    flight.fly_until(lambda: flight.controller.exploration.remaining == 0, 2500.0)
    assert flight.closest_m() >= flight.mission.planner.clearance_m


def test_a_motion_that_waited_is_looked_at_again_before_it_is_sent(away):
    flight = away()
    controller, now_s = flight.controller, flight.now_s
    motion = FlyToPoint(flight.mission.home, 40.0)
    assert "canceled" in controller.navigator.objection(motion, now_s)
    controller.gate.send(motion)
    assert controller.navigator.objection(motion, now_s) is None
    assert "too old" in controller.navigator.objection(motion, now_s + 1.0)
    across = FlyToPoint(Point(1e4, 0.0), 40.0)
    controller.gate.send(across)
    assert "no longer clear" in controller.navigator.objection(across, now_s)
    flight.pilot_chooses(FlightMode.OTHER)
    assert "canceled" in controller.navigator.objection(across, flight.now_s)


@pytest.mark.parametrize("kind", ["goto", "jump", "land", "hold"])
def test_a_motion_that_waited_is_not_sent_over_an_order_that_is_not_ours(away, kind):
    flight = away()
    controller, home = flight.controller, flight.mission.home
    motion = {
        "goto": FlyToPoint(home, 40.0),
        "jump": FlyToNode(0, home),
        "land": LandHere(),
        "hold": HoldHere("GPS has no fix"),  # what has it hold cannot wait
    }[kind]
    controller.gate.send(motion)
    assert controller.navigator.objection(motion, flight.now_s) is None
    controller.context.interlocks.put(Anomaly.FOREIGN_ORDER, raised=True)
    objection = controller.navigator.objection(motion, flight.now_s)
    assert objection == (
        None if kind == "hold" else "the vehicle seems to follow a foreign command"
    )


def test_where_the_vehicle_flies_already_it_may_be_sent_once_more(away):
    """So it is where its next way begins with the end of the leg that it is on."""
    flight = away()
    controller, leg = flight.controller, flight.motions[-1]
    flight.shown["velocity_m_s"] = (0.0, 30.0)
    again, other = dataclasses.replace(leg), FlyToPoint(Point(-20.0, 20.0), 40.0)
    controller.context.telemetry = flight.telemetry()
    controller.gate.send(again)
    assert not controller.navigator.clear(controller.context.telemetry, again.position)
    assert controller.navigator.objection(again, flight.now_s) is None
    controller.gate.send(other)
    assert "no longer clear" in controller.navigator.objection(other, flight.now_s)
    controller.gate.send(again)
    assert "no longer clear" in controller.navigator.objection(again, flight.now_s)


@pytest.mark.parametrize("seed", range(2))
def test_wherever_the_robots_are_no_zone_is_touched(pretend, seed):
    chance = random.Random(seed)
    flight = pretend(duration_s=1200.0, radius_m=chance.uniform(20, 90))
    for places in (flight.robots, flight.destinations):
        for name in CORNERS:
            places[name] = Point(chance.uniform(-180, 130), chance.uniform(-180, 90))
    flight.take_off()
    flight.lands(3000.0)
    assert flight.closest_m() >= flight.mission.planner.clearance_m


def test_a_long_silence_is_announced_now_and_then(airborne):
    flight = airborne()
    for silent_s in (2.0, 4.0, 5.0, 6.0, 13.0, 14.0, 15.0, 24.0, 4.0):
        flight.give(LinkSilent(flight.now_s, silent_s))
    flight.step()  # received for a moment; the next silence is checked a bit later than the first
    flight.give(LinkSilent(flight.now_s, 5.0))
    silences = [text for text in flight.announced if "nothing received" in text]
    assert [text.split()[-2] for text in silences] == ["4", "14", "24", "4", "5"]


def reports_mode(flight, mode_s):
    """What is received after a silence: positions first, then the flight mode."""
    flight.shown = {"ages": Ages(mode_s=mode_s)}
    flight.step()


@pytest.mark.parametrize("taken", [True, False])
def test_after_a_silence_nothing_is_commanded_before_the_flight_mode_is_received(hovering, taken):
    """A pilot may have taken it meanwhile; its last mode is from before the silence."""
    flight = hovering()
    assert flight.operator_requests(GoOn()).accepted
    flight.fly_for(3.0)
    commanded = len(flight.motions)
    flight.give(LinkSilent(flight.now_s, 4.0))
    flight.position = flight.controller.context.task.way.leg.to  # it has ended its leg: on, at once
    for mode_s in (1.2, 1.3, 1.4, 1.4):
        reports_mode(flight, mode_s)
        flight.give(RobotPose("io", CORNERS["io"], flight.now_s, "io"))
    assert flight.motions[commanded:] == []
    assert flight.operator_requests(GoTo((flight.position,))).code is Refusal.NOT_HEARD
    if taken:
        flight.pilot_chooses(FlightMode.POSITION)  # however old that is, a pilot chose it
        assert flight.controller.state is State.PASSIVE
        assert flight.motions[commanded:] == []
    else:
        reports_mode(flight, 0.1)
        flight.step()
        assert len(flight.motions) > commanded


def test_a_flight_mode_that_is_not_received_after_a_silence_counts_as_missing(away):
    flight = away()
    flight.give(LinkSilent(flight.now_s, 4.0))
    for mode_s in (4.8, 4.9, 5.0):
        assert not any("flight mode not received" in text for text in flight.announced)
        reports_mode(flight, mode_s)
    assert any("flight mode not received for 5 s" in text for text in flight.announced)


def test_a_hold_that_was_not_requested_does_not_leave_while_nothing_is_received(away):
    flight = away()
    flight.give(LinkSilent(flight.now_s, 4.0))
    commanded, mission = len(flight.motions), flight.mission
    over = Zone("new", Circle(flight.controller.context.task.way.leg.to, 6.0))
    flight.give(AirspaceChanged(mission.fences, (*mission.zones, over)))
    assert flight.motions[commanded:] == []
    flight.step()
    assert isinstance(flight.motions[-1], HoldHere)
    flight.give(LinkSilent(flight.now_s, 4.0))
    flight.operator_requests(HoldNow())
    assert flight.controller.state is State.HOLD


def test_one_message_with_an_empty_battery_right_after_a_silence_counts_for_nothing(away):
    flight = away()
    flight.voltage_v = 16.8
    flight.operator_requests(ComeHome())
    flight.give(LinkSilent(flight.now_s, 4.0))
    flight.battery = 0.0
    reports_mode(flight, 1.2)  # it is not known yet whether a pilot has it
    assert flight.controller.telemetry.battery == 1.0
    assert "the charge jumped from 100% to 0%" in flight.announced[-1]
    assert flight.operator_requests(HoldNow()).accepted


@pytest.mark.parametrize("seed", range(4))
def test_whatever_goes_wrong_nothing_raises_no_pilot_is_overridden_and_no_zone_is_touched(
    pretend, seed
):
    """A flight of random misfortune: lost commands, junk poses, gusts, then a pilot."""
    chance = random.Random(seed)
    flight = pretend(duration_s=700.0, radius_m=chance.uniform(30, 90))
    flight.noise_m = 0.2
    flight.robots = dict(CORNERS)
    flight.take_off()
    end_s = flight.now_s + chance.uniform(200, 600)
    while flight.now_s < end_s:
        flight.deaf = chance.random() < 0.05
        match chance.randrange(300):
            case 0:
                anywhere = Point(chance.uniform(-900, 900), chance.uniform(-900, 900))
                flight.give(RobotPose(chance.choice(list(CORNERS)), anywhere, flight.now_s, "io"))
            case 1:
                flight.give(ItemReached(flight.now_s, chance.randrange(60)))
            case 2:
                flight.give(LinkSilent(flight.now_s, chance.uniform(0, 30)))
            case 3:
                flight.now_s += chance.uniform(0, 3)  # telemetry is missing for a while
            case 4:
                flight.velocity = (chance.uniform(-1.5, 1.5), chance.uniform(-1.5, 1.5))  # a gust
            case _:
                pass
        flight.step()
    assert flight.closest_m() >= flight.mission.planner.clearance_m
    assert len(flight.motions) < (flight.now_s - 100.0) * 2
    if flight.controller.state is State.DONE:
        return
    flight.deaf = False
    flight.pilot_chooses(FlightMode.OTHER)
    commanded = len(flight.motions)
    flight.fly_for(30.0)
    assert flight.controller.state is State.PASSIVE
    assert len(flight.motions) == commanded


def test_a_robot_that_cannot_be_read_is_announced_and_changes_nothing(airborne):
    flight = airborne()
    before = len(flight.actions)
    flight.give(PeerFault("/pose of io cannot be read"))
    text = "/pose of io cannot be read"
    assert flight.actions[before:] == [Announce(text, Severity.WARNING, CHECK_PEER)]
