import pytest

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere, LandHere
from air_router.controller.model.airspace_in_force import ZoneChange
from air_router.controller.model.events import CommandConfirmed, CommandFailed
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.states import State
from air_router.controller.motion.command_gate import CommandGate, PendingSetpoints
from air_router.controller.motion.interlocks import MotionOutcome
from air_router.controller.motion.limits import JUMPS
from air_router.routing.departure import PendingSetpoint
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point

HERE = Point(0.0, 0.0)
MOTIONS = [
    (FlyToNode(1, HERE), FlightMode.MISSION),
    (FlyToPoint(HERE, 40.0), FlightMode.HOLD),
    (HoldHere("why"), FlightMode.HOLD),
    (LandHere(), FlightMode.LAND),
]


@pytest.fixture
def context(pennovation):
    return MissionContext(pennovation, None)


@pytest.fixture
def gate(context):
    gate = CommandGate(context, None)
    gate.assume(FlightMode.MISSION)
    return gate


@pytest.mark.parametrize(("motion", "mode"), MOTIONS)
def test_a_command_under_way_allows_the_old_and_the_new_mode(gate, motion, mode):
    gate.send(motion)
    assert gate.modes == {FlightMode.MISSION, mode}
    gate.confirmed(CommandConfirmed(motion))
    assert gate.modes == {mode}


def test_a_failed_command_leaves_both_open_and_a_pilot_s_mode_is_still_seen(gate):
    motion = FlyToNode(1, HERE)
    gate.send(motion)
    gate.failed(CommandFailed(motion, "deaf"))
    assert gate.pending is None
    assert gate.modes == {FlightMode.MISSION}


def test_a_late_confirmation_of_an_older_command_changes_nothing(gate):
    first, second = FlyToNode(1, HERE), FlyToPoint(HERE, 40.0)
    gate.send(first)
    gate.send(second)
    gate.confirmed(CommandConfirmed(first))
    assert gate.pending is second
    gate.failed(CommandFailed(first, "deaf"))
    assert gate.pending is second


def test_what_is_decided_on_after_a_late_confirmation_leaves_out_of_that_mode(gate):
    first, second, third = FlyToPoint(HERE, 40.0), LandHere(), FlyToNode(1, HERE)
    gate.send(first)
    gate.send(second)
    assert FlightMode.HOLD not in gate.ends
    gate.confirmed(CommandConfirmed(first))
    gate.send(third)
    assert gate.ends == {FlightMode.HOLD}


@pytest.mark.parametrize("sent", [False, True])
def test_only_jumps_that_were_sent_put_the_plan_on_board_in_doubt(gate, sent):
    for _ in range(JUMPS):
        jump = FlyToNode(1, HERE)
        gate.send(jump)
        gate.failed(CommandFailed(jump, "the position is too old", sent=sent))
    assert gate.by_points is sent


def test_an_uploaded_plan_is_left_only_after_as_many_lost_jumps_as_the_one_before(gate):
    def lose(jumps):
        for _ in range(jumps):
            jump = FlyToNode(1, HERE)
            gate.send(jump)
            gate.failed(CommandFailed(jump, "deaf"))

    lose(JUMPS)
    gate.fly_points(instead=False)
    lose(JUMPS - 1)
    assert not gate.by_points
    lose(1)
    assert gate.by_points


@pytest.mark.parametrize(
    ("sent", "announced", "pause_s"),
    [(True, "the vehicle did not follow", 3.0), (False, "not sent", 1.5)],
)
def test_what_did_not_leave_is_announced_as_not_sent_and_retried_sooner(
    context, gate, sent, announced, pause_s
):
    jump = FlyToNode(1, HERE)
    gate.send(jump)
    gate.failed(CommandFailed(jump, "the leg was no longer clear when it was due", sent=sent))
    assert context.actions[-1].text == f"{announced}: the leg was no longer clear when it was due"
    assert context.task.retry_at_s == context.now_s + pause_s


# What stands against a motion.


def test_what_became_of_a_motion_has_a_name(context, gate):
    leg = FlyToPoint(HERE, 40.0)
    assert gate.command(leg) is MotionOutcome.SENT
    assert gate.command(leg) is MotionOutcome.UNDER_WAY
    context.silent_for(1.0)
    assert gate.command(FlyToPoint(Point(9.0, 0.0), 40.0)).by.name == "LINK_SILENT"
    assert gate.command(HoldHere("why")) is MotionOutcome.MAY_BE_TAKEN
    context.silent_for(0.0)
    assert gate.wait_for_way("no way") is MotionOutcome.WAITS
    assert gate.hold("why") is MotionOutcome.UNDER_WAY
    gate.send(NODE)  # given up, and may come late
    gate.send(FlyToPoint(Point(0.0, 100.0), 40.0))
    assert gate.command(NODE) is MotionOutcome.INSTEAD


def test_a_doubtful_jump_does_not_stop_the_way_out_of_a_zone(context, gate):
    out = FlyToPoint(Point(0.0, 100.0), 40.0)
    gate.send(NODE)  # given up, and may come late
    gate.send(out)
    context.airspace.change = ZoneChange.LEAVING
    gate.command(NODE)
    assert gate.last is out
    context.airspace.change = None
    gate.command(NODE)
    assert isinstance(gate.last, HoldHere)


def test_of_a_vehicle_whose_mode_is_not_received_only_the_operator_s_hold_leaves(context, gate):
    hold = HoldHere("why")
    context.inputs.silent = True
    gate.command(hold)
    assert context.actions == []
    context.task.state = State.HOLD
    gate.command(hold)
    assert context.actions == [hold]


@pytest.mark.parametrize("zones", [ZoneChange.CLEARING, ZoneChange.UPLOADING])
def test_a_leg_while_zones_are_changed_has_it_hold(context, gate, zones):
    gate.send(PLACE)
    context.airspace.change = zones
    gate.command(FlyToPoint(HERE, 40.0))
    assert [*map(type, context.actions)] == [FlyToPoint, HoldHere]
    assert context.airspace.must_stop


# What it may be flying to.

NODE = FlyToNode(1, Point(100.0, 0.0))
PLACE = FlyToPoint(Point(0.0, 100.0), 40.0)
HOLD = HoldHere("a test")


def at(east_m, north_m, **more):
    return Telemetry(time_s=1.0, position=Point(east_m, north_m), altitude_m=40.0, **more)


def test_what_is_not_confirmed_may_all_be_flown_to():
    setpoints = PendingSetpoints(near_m=2.0, speed_m_s=0.0)
    setpoints.sent(NODE)
    setpoints.sent(PLACE)
    assert setpoints.open(at(0, 0)) == [NODE.position, PLACE.position]
    setpoints.confirmed(NODE)
    assert setpoints.open(at(0, 0)) == [NODE.position, PLACE.position]
    setpoints.confirmed(PLACE)
    assert setpoints.open(at(0, 0)) == [PLACE.position]
    assert setpoints.open(at(0.5, 99.0)) == []  # arrived
    setpoints.sent(HOLD)
    assert setpoints.open(at(0, 0)) == [PLACE.position]
    setpoints.confirmed(HOLD)
    assert setpoints.open(at(0, 0)) == []


def test_of_two_alike_the_newest_is_confirmed():
    setpoints = PendingSetpoints(near_m=2.0, speed_m_s=0.0)
    for motion in (NODE, HOLD, PLACE, HOLD, HOLD):
        setpoints.sent(motion)
    setpoints.confirmed(HOLD)
    assert setpoints.open(at(0, 0)) == []


def test_a_target_that_the_vehicle_reports_counts_where_it_is_far():
    setpoints = PendingSetpoints(near_m=2.0, speed_m_s=0.0)
    assert setpoints.pending(at(0, 0, target=Point(3.0, 3.0))) == ()
    assert setpoints.pending(at(0, 0, target=Point(30.0, 3.0))) == (
        PendingSetpoint(Point(30.0, 3.0), Point(30.0, 3.0)),
    )
    setpoints.sent(NODE)
    assert setpoints.pending(at(0, 0, target=Point(30.0, 3.0)))[0].place == NODE.position
    setpoints.forget()
    assert setpoints.pending(at(0, 0)) == ()


def test_a_jump_that_would_show_though_another_order_is_still_to_come_is_doubtful():
    setpoints = PendingSetpoints(near_m=2.0, speed_m_s=0.0)
    other = FlyToNode(2, Point(50.0, 50.0))
    assert not setpoints.under_way(NODE)
    setpoints.sent(NODE)  # given up
    assert not setpoints.under_way(NODE)  # it came late: the same place
    setpoints.sent(PLACE)
    assert setpoints.under_way(NODE)
    assert setpoints.given_up(NODE)  # the first one may come, and show
    assert setpoints.under_way(other)
    assert not setpoints.given_up(other)
    setpoints.confirmed(PLACE)
    assert not setpoints.under_way(NODE)
    setpoints.forget()
    assert not setpoints.under_way(NODE)


def test_it_may_be_turned_away_at_the_second_place_having_come_from_the_first():
    setpoints = PendingSetpoints(near_m=2.0, speed_m_s=4.0)
    setpoints.sent(NODE)
    setpoints.sent(FlyToPoint(Point(100.0, 50.0), 40.0))
    reaches = {on.reach for on in setpoints.pending(at(0, 0)) if on.place == (100.0, 50.0)}
    assert any(reach.east_m == 100.0 and reach.north_m > 52.0 for reach in reaches)


def test_it_swings_as_far_beyond_a_leg_s_end_as_its_true_speed_takes_it():
    setpoints = PendingSetpoints(near_m=2.0, speed_m_s=3.5)
    setpoints.sent(NODE)
    (slow,) = setpoints.pending(at(0, 0, velocity_m_s=(3.5, 0.0)))
    (fast,) = setpoints.pending(at(0, 0, velocity_m_s=(12.0, 0.0)))
    assert slow.reach.east_m < 103.0
    assert fast.reach.east_m > 115.0
