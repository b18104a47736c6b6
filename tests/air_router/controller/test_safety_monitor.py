import dataclasses

import pytest

from air_router.controller.limits import BRAKED_S, FOREIGN_ORDER_S, ORDER_STALE_S
from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere
from air_router.controller.model.events import CommandConfirmed, CommandFailed
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.safety_monitor import FlightPhase, SafetyMonitor
from air_router.controller.states.ready_state import TakeOff, take_off
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.vehicle import Ages, FlightMode, Telemetry
from geo.frame import Point

FOREIGN, BREACH = "foreign order", "breach"
HERE, THERE = Point(0.0, 0.0), Point(10.0, 0.0)


@pytest.fixture
def plan(pennovation):
    return FlightPlan.of(pennovation)


@pytest.fixture
def watched(pennovation, plan):
    """Gives a motion, confirmed, and looks at what the vehicle shows afterwards."""
    context = MissionContext(pennovation, None)
    gate = CommandGate(context, plan)
    monitor = SafetyMonitor(context, gate, plan)

    def update(motion, seconds, **shown):
        gate.last, gate.pending = motion, None
        values = {"position": pennovation.home, "altitude_m": 40.0, "in_air": True, "armed": True}
        mode = FlightMode.MISSION if isinstance(motion, FlyToNode) else FlightMode.HOLD
        for s in seconds:
            telemetry = Telemetry(time_s=s, **values | {"mode": mode} | shown)
            order, breach = monitor.foreign_order(telemetry), monitor.breach(telemetry)
        update.suspected = order is not None
        return FOREIGN if order and order.sure else BREACH if breach else None

    update.context = context
    return update


def test_an_order_of_another_while_it_hovers_in_hold(watched):
    goto = FlyToPoint(HERE, 40.0)
    assert watched(goto, (1.0,), target=Point(1.0, 1.0)) is None
    assert watched(goto, (2.0, 2.0 + FOREIGN_ORDER_S - 0.1), target=THERE) is None
    assert watched(goto, (2.0 + FOREIGN_ORDER_S,), target=THERE) == FOREIGN


@pytest.fixture
def waiting(pennovation, plan):
    """It hovers at a place of ours, and the next order waits, or was lost on its way."""
    context = MissionContext(pennovation, None)
    gate = CommandGate(context, plan)
    monitor = SafetyMonitor(context, gate, plan)
    hovers = FlyToPoint(HERE, 40.0)
    gate.send(hovers)
    gate.confirmed(CommandConfirmed(hovers))

    def update(order, target, seconds):
        if gate.last is not order:
            gate.send(order)
        shown = {"target": target, "target_altitude_m": 40.0, "mode": FlightMode.HOLD}
        flying = Telemetry(0.0, HERE, 40.0, armed=True, in_air=True, **shown)
        found = [
            monitor.foreign_order(dataclasses.replace(flying, time_s=time_s)) for time_s in seconds
        ]
        assert gate.pending is order
        update.suspected = found[-1] is not None
        return found[-1] if update.suspected and found[-1].sure else None

    update.gate = gate
    return update


def test_another_order_is_seen_while_one_of_ours_waits(waiting):
    order, theirs = FlyToPoint(Point(0.0, 30.0), 40.0), Point(30.0, 0.0)
    assert waiting(order, HERE, (1.0, 9.0)) is None
    assert waiting(order, order.position, (10.0, 19.0)) is None  # it follows, unconfirmed
    assert waiting(order, theirs, (20.0, 20.0 + FOREIGN_ORDER_S - 0.1)) is None
    assert waiting.suspected
    assert waiting(order, theirs, (20.0 + FOREIGN_ORDER_S,)) is not None


def test_another_order_is_seen_while_a_hold_of_ours_is_lost(waiting):
    """However often it is sent: each explains where the vehicle stops for some seconds only."""
    theirs, sent_s = Point(30.0, 0.0), 1.0
    for number in range(2):
        order = HoldHere(f"why {number}")
        assert waiting(order, theirs, (sent_s, sent_s + 1.4)) is None
        sent_s += 1.5
        waiting.gate.failed(CommandFailed(order, "lost"))
    due_s = 1.0 + BRAKED_S + FOREIGN_ORDER_S
    order = HoldHere("why 2")
    assert waiting(order, theirs, (1.0 + BRAKED_S, due_s - 0.1)) is None
    assert waiting(order, theirs, (due_s,)) is not None


def test_an_old_target_that_still_shows_for_a_moment_is_no_order(watched):
    goto = FlyToPoint(HERE, 40.0)
    assert watched(goto, (1.0, 2.0), target=THERE) is None
    assert watched(goto, (2.5,), target=HERE) is None
    assert watched(goto, (3.0, 4.0), target=THERE) is None


def test_a_target_that_is_not_reported_any_more_is_no_order(watched):
    stale = {"target": THERE, "ages": Ages(target_s=ORDER_STALE_S)}
    assert watched(FlyToPoint(HERE, 40.0), (1.0, 9.0, 99.0), **stale) is None
    assert not watched.suspected


def test_a_vehicle_that_does_not_report_its_target_is_believed(watched):
    assert watched(FlyToPoint(HERE, 40.0), (1.0, 99.0), target=None) is None


def test_where_it_braked_to_since_its_position_was_lost_is_no_order(watched):
    far, hold = Point(1000.0, 1000.0), HoldHere("why")
    lost = {"position": HERE, "target": far}
    for age_s in (2.0, 30.0):
        assert watched(hold, (1.0, 9.0, 99.0), **lost, ages=Ages(position_s=age_s)) is None
    assert watched(hold, (100.0, 102.0), **lost) == FOREIGN  # its position is known again


def test_where_it_stopped_is_ours_and_another_place_is_not(watched):
    hold = HoldHere("why")
    assert watched(hold, (1.0, 3.0), target=HERE) is None
    # It has braked: this is the place.
    assert watched(hold, (4.0, 9.0), target=THERE, position=THERE) is None
    assert watched(hold, (10.0, 12.0), target=HERE, position=THERE) == FOREIGN


@pytest.mark.parametrize(
    ("position", "velocity_m_s"), [(Point(4.0, 0.0), (0.0, 0.0)), (Point(9.0, 0.0), (5.0, 0.0))]
)
def test_a_target_of_before_a_hold_that_is_received_late_is_not_where_it_stopped(
    watched, position, velocity_m_s
):
    """A stop ten metres before the point that it flew to, then its target is received, late."""
    hold = HoldHere("why")
    late = {"target": THERE, "position": position, "velocity_m_s": velocity_m_s}
    assert watched(hold, (1.0, 4.0, 5.0), **late) is None
    assert watched(hold, (6.0, 9.0, 20.0), target=HERE, position=HERE) is None
    assert watched(hold, (21.0, 23.0), target=THERE, position=HERE) == FOREIGN


def test_a_far_place_right_after_a_hold_is_not_where_it_stopped(watched, pennovation):
    hold, far = HoldHere("why"), Point(pennovation.home.east_m + 60.0, pennovation.home.north_m)
    assert watched(hold, (1.0, 3.9, 4.0, 5.4), target=far) is None
    assert watched(hold, (5.5,), target=far) == FOREIGN


def test_another_plan_item_in_mission_mode(watched, plan):
    jump = FlyToNode(3, HERE)
    assert watched(jump, (1.0, 9.0), item=plan.item_of(3)) is None
    assert watched(jump, (10.0, 12.0), item=None) is None
    assert watched(jump, (20.0, 22.0), item=plan.item_of(4)) == FOREIGN


def test_a_breach(watched, pennovation):
    hold = HoldHere("why")
    assert watched(hold, (1.0,)) is None
    zone = pennovation.airspace.zones[0]
    west, south, east, north = zone.polygon.bounds
    inside = Point((west + east) / 2, (south + north) / 2)
    assert watched(hold, (2.0,), position=inside, in_air=False) is None
    assert watched(hold, (3.0,), position=inside) == BREACH
    assert watched(hold, (4.0,), position=Point(5000.0, 0.0)) == BREACH
    assert watched(hold, (5.0,)) is None


# Off the ground, and down again.


def seen(*, armed=False, in_air=False, mode=FlightMode.HOLD, time_s=1.0, altitude_m=0.0):
    return Telemetry(time_s, Point(0.0, 0.0), altitude_m, armed=armed, in_air=in_air, mode=mode)


@pytest.fixture
def context(pennovation):
    return MissionContext(pennovation, None)


@pytest.fixture
def gate(context, plan):
    return CommandGate(context, plan)


@pytest.fixture
def flight_phase(context, gate):
    return FlightPhase(context, gate)


def test_armed_in_mission_mode_hands_the_flight_over_once(context, gate, flight_phase):
    flight_phase.note(seen(mode=FlightMode.MISSION))
    flight_phase.note(seen(armed=True))
    assert (context.authority.handed_over, gate.modes) == (False, set())
    flight_phase.note(seen(armed=True, mode=FlightMode.MISSION))
    assert (context.authority.handed_over, gate.modes) == (True, {FlightMode.MISSION})
    gate.assume(FlightMode.HOLD)
    flight_phase.note(seen(armed=True, mode=FlightMode.MISSION))
    assert gate.modes == {FlightMode.HOLD}


def test_it_is_over_when_down_and_disarmed_after_having_been_armed(flight_phase):
    flight_phase.note(seen())
    assert not flight_phase.over(seen())
    flight_phase.note(seen(armed=True, in_air=True))
    assert not flight_phase.over(seen(armed=True))
    assert flight_phase.over(seen())
    # Disarmed is on the ground, whatever another stream reports.
    assert flight_phase.over(seen(in_air=True))


def test_how_it_ended(context, flight_phase):
    context.task.stayed_why = "the operator's request"
    assert flight_phase.ending(landed_by_us=False) == "the operator's request, before take-off"
    flight_phase.note(seen(armed=True, in_air=True))
    assert flight_phase.ending(landed_by_us=False) == "landed, but not by our command"
    assert flight_phase.ending(landed_by_us=True) == "landed at home"


def test_armed_and_disarmed_it_begins_anew_but_not_after_a_flight(context, flight_phase):
    flight_phase.note(seen(armed=True, mode=FlightMode.MISSION))
    assert flight_phase.again()
    assert not context.authority.handed_over
    assert not flight_phase.over(seen())
    flight_phase.note(seen(armed=True, in_air=True))
    assert not flight_phase.again()


@pytest.fixture
def above_home(pennovation):
    return Telemetry(
        time_s=1.0,
        position=pennovation.home,
        altitude_m=pennovation.altitude_above_home_m,
        armed=True,
        in_air=True,
        mode=FlightMode.MISSION,
        battery=0.9,
    )


@pytest.mark.parametrize(
    ("change", "away_m", "stage"),
    [
        ({}, 0.0, TakeOff.COMPLETE),
        ({}, 100.0, TakeOff.COMPLETE),  # high: every leg from there is checked
        ({"altitude_m": 5.0}, 0.0, TakeOff.TO_COME),
        ({"altitude_m": 5.0}, 15.0, TakeOff.TO_COME),
        ({"altitude_m": 5.0}, 25.0, TakeOff.MISPLACED),
        ({"altitude_m": 5.0, "mode": FlightMode.OTHER}, 25.0, TakeOff.TO_COME),
        ({"mode": FlightMode.OTHER}, 0.0, TakeOff.TO_COME),
        ({"in_air": False}, 0.0, TakeOff.TO_COME),
    ],
)
def test_where_the_take_off_stands(pennovation, above_home, change, away_m, stage):
    place = above_home.position._replace(east_m=above_home.position.east_m + away_m)
    telemetry = dataclasses.replace(above_home, position=place, **change)
    assert take_off(MissionContext(pennovation, None), telemetry) is stage


def test_a_low_mission_still_climbs(pennovation, above_home):
    low = dataclasses.replace(pennovation, altitude_above_home_m=2.0)
    climbing = dataclasses.replace(above_home, altitude_m=0.2)
    assert take_off(MissionContext(low, None), climbing) is TakeOff.TO_COME
    higher = dataclasses.replace(climbing, altitude_m=1.5)
    assert take_off(MissionContext(low, None), higher) is TakeOff.COMPLETE
