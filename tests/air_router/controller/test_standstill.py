"""The watchdog: what should move, and does not, is an alarm, whatever the reason."""

import math

import pytest

from air_router.controller.limits import SETS_OUT_S, STANDS_FOR_PLAN_S, STANDS_IN_ZONE_S, STANDS_S
from air_router.controller.model.actions import Announce, FlyToPoint
from air_router.controller.model.airspace_in_force import ZoneChange
from air_router.controller.model.interlocks_raised import Anomaly
from air_router.controller.model.limits import ESCALATES_S, REPEATED_S
from air_router.controller.model.requests import ComeHome, HoldNow, LandNow
from air_router.controller.model.states import State
from air_router.controller.standstill import CAUSES, UNKNOWN, WATCHES, cause_of
from air_router.vehicle.instructions import (
    FLY_OUT,
    HOME_OR_TAKE_OVER,
    LAND_BY_HAND,
    TAKE_OVER_NOW,
    Severity,
)
from geo.airspace.zone import Band, Circle, Zone
from tests.air_router.controller.drawing import (
    boarding,
    box,
    change,
    climbing,
    cruising,
    goes_on_board,
)


def alarms(flight, part="has not moved for"):
    return [
        a
        for a in flight.actions
        if isinstance(a, Announce) and a.severity is Severity.ALARM and part in a.text
    ]


def stuck(pretend, **changes):
    """A vehicle that commands do not move any more, though each is confirmed."""
    flight = cruising(pretend, duration_s=None, **changes)
    held = flight.position

    def stays():
        flight.position, flight.velocity = held, (0.0, 0.0)

    move = flight.move
    flight.move = lambda: (move(), stays())
    return flight


@pytest.mark.parametrize("kind", ["below", "above", "around", "across"])
@pytest.mark.parametrize("moment", ["climb", "cruise", "hold", "home"])
def test_a_zone_at_any_height_is_left_at_any_height(pretend, moment, kind):
    flight = climbing(pretend) if moment == "climb" else cruising(pretend)
    if moment == "hold":
        flight.operator_requests(HoldNow())
        flight.fly_for(6.0)
    if moment == "home":
        flight.operator_requests(ComeHome())
        flight.fly_for(2.0)
    here_m = flight.altitude_m
    band = {
        "below": Band(-100.0, here_m - 6.0),
        "above": Band(here_m + 6.0, 500.0),
        "around": Band(here_m - 6.0, here_m + 6.0),
        "across": None,
    }[kind]
    zone = Zone("new", Circle(flight.position, 9.0), band=band)
    change(flight, zone)
    goes_on_board(flight)
    now = flight.mission.with_areas(flight.mission.fences, (*flight.mission.zones, zone))
    assert now.airspace_at(flight.altitude_m).zones_at(flight.position) == ()
    if moment == "hold":
        flight.operator_requests(ComeHome())
    flight.lands(600.0)
    assert alarms(flight) == []


def test_a_zone_below_cruise_that_is_drawn_over_a_low_climb_is_left_there(pretend):
    flight = climbing(pretend)
    zone = Zone("new", Circle(flight.position, 15.0), band=Band(0.0, 20.0))
    commanded = len(flight.motions)
    change(flight, zone)
    flight.fly_until(lambda: boarding(flight) == 1, 60.0)
    moved = [m for m in flight.motions[commanded:] if isinstance(m, FlyToPoint)]
    assert moved != []
    assert all(m.altitude_m < 20.0 for m in moved)  # out of it first, then up
    assert math.dist(flight.position, zone.shape.centre) > 20.0
    goes_on_board(flight)
    flight.fly_until(lambda: flight.altitude_m > 37.0, 60.0)


def test_what_ends_below_the_vehicle_keeps_it_from_no_climb(pretend):
    flight = climbing(pretend)
    flight.fly_until(lambda: flight.altitude_m > 25.0, 60.0)
    change(flight, Zone("new", Circle(flight.position, 15.0), band=Band(0.0, 8.0)))
    goes_on_board(flight)
    flight.fly_until(lambda: flight.altitude_m > 37.0, 60.0)


def test_a_vehicle_that_is_wanted_elsewhere_and_does_not_move_is_an_alarm_again_and_again(pretend):
    flight = stuck(pretend)
    flight.fly_for(STANDS_S - 6.0)
    assert alarms(flight) == []
    flight.fly_for(8.0 + ESCALATES_S + 2 * REPEATED_S)
    found = alarms(flight)
    assert len(found) == 4
    assert [each.instruction for each in found] == [HOME_OR_TAKE_OVER, *[TAKE_OVER_NOW] * 3]
    assert "should continue its mission" in found[0].text


def test_on_the_way_home_it_is_to_be_landed_and_home_is_answered_with_why_it_does_not_come(pretend):
    flight = stuck(pretend)
    assert flight.operator_requests(ComeHome()).why == "it comes home"
    flight.fly_for(STANDS_S + 3.0)
    assert alarms(flight)[0].instruction == LAND_BY_HAND
    assert "the vehicle should come home" in alarms(flight)[0].text
    answer = flight.operator_requests(ComeHome())
    assert answer.accepted
    assert "it comes home already, and does not move: " in answer.why
    assert LAND_BY_HAND in answer.why


def test_the_reserve_of_the_battery_is_an_alarm_of_its_own_where_nothing_moves(pretend):
    flight = stuck(pretend)
    flight.shown["battery"] = flight.mission.battery_reserve
    flight.fly_for(STANDS_IN_ZONE_S + 3.0)
    assert flight.controller.state is State.HOME
    assert "at its battery reserve (25%)" in alarms(flight)[0].text
    assert alarms(flight)[0].instruction == LAND_BY_HAND


def test_it_is_announced_that_it_moves_again(pretend):
    flight = stuck(pretend)
    flight.fly_for(STANDS_S + 3.0)
    del flight.move
    flight.fly_for(20.0)
    assert "it moves again" in flight.announced
    count = len(alarms(flight))
    flight.fly_for(2 * REPEATED_S)
    assert len(alarms(flight)) == count


def test_in_a_zone_that_no_way_leads_out_of_an_alarm_is_announced_within_seconds(pretend):
    flight = cruising(pretend, duration_s=None)
    here = flight.position
    change(flight, box(here, 300.0, "everywhere"))
    flight.fly_for(STANDS_IN_ZONE_S + 10.0)
    shown = alarms(flight, "no way out") + alarms(flight)
    assert shown != []
    assert shown[0].instruction == FLY_OUT
    assert {each.instruction for each in shown[1:]} == {TAKE_OVER_NOW}
    assert flight.operator_requests(ComeHome()).accepted
    flight.fly_for(STANDS_IN_ZONE_S + 5.0)
    assert "does not move" in flight.operator_requests(ComeHome()).why
    assert "not left" not in flight.operator_requests(LandNow()).why


@pytest.mark.parametrize("rests", [HoldNow(), None])
def test_where_it_hovers_because_it_is_to_hover_it_is_no_alarm(pretend, rests):
    flight = cruising(pretend, duration_s=None)
    if rests is not None:
        flight.operator_requests(rests)
    else:
        flight.robots = {}
        flight.fly_to_state(State.SEARCH)
    flight.fly_for(100.0)
    assert alarms(flight) == []


def test_a_plan_that_does_not_get_on_board_is_an_alarm_after_longer(pretend):
    flight = cruising(pretend, duration_s=None)
    change(flight, box(flight.position, half_m=8.0))
    flight.fly_until(
        lambda: flight.controller.context.airspace.change is ZoneChange.UPLOADING, 60.0
    )
    flight.fly_for(STANDS_FOR_PLAN_S - 10.0)
    assert alarms(flight) == []
    flight.fly_for(20.0)
    assert "waits for its plan" in alarms(flight)[0].text
    assert "being uploaded" in alarms(flight)[0].text


def test_a_pilots_vehicle_may_stand_wherever_it_is(pretend):
    flight = stuck(pretend)
    flight.pilot_chooses(flight.mode.__class__.POSITION)
    flight.fly_for(100.0)
    assert alarms(flight) == []


def test_the_tables_go_from_the_gravest_on_and_each_cause_is_named(pretend):
    limits = [watch.after_s for watch in WATCHES]
    assert limits == sorted(limits)
    flight = cruising(pretend)
    context = flight.controller.context
    assert cause_of(context) == UNKNOWN
    context.airspace.change = ZoneChange.UPLOADING
    assert cause_of(context) == ZoneChange.UPLOADING.value
    context.interlocks.put(Anomaly.ALTITUDE_JUMP, raised=True)  # it counts before the change
    assert cause_of(context) == "the altitude has jumped"
    assert len(CAUSES) > 5


def test_one_that_was_kept_back_has_a_moment_to_set_out(pretend):
    """The fix is back after the vehicle stood for longer than it may: it is only just sent on."""
    flight = cruising(pretend, duration_s=None)
    flight.fix = False
    flight.fly_for(STANDS_S - 2.0)
    flight.fix = True
    flight.fly_until(lambda: flight.controller.status().waiting is None, 10.0)
    since = len(flight.actions)
    flight.fly_for(20.0)
    assert [a for a in alarms(flight) if a in flight.actions[since:]] == []


def test_one_that_does_not_set_out_then_is_an_alarm_after_that_moment(pretend):
    flight = cruising(pretend, duration_s=None)
    flight.fix = False
    flight.fly_for(STANDS_S - 2.0)
    flight.fix, flight.slow = True, True  # nothing is followed any more
    flight.fly_until(lambda: flight.controller.status().waiting is None, 10.0)
    since = len(flight.actions)
    flight.fly_for(SETS_OUT_S + 3.0)
    assert [a for a in alarms(flight) if a in flight.actions[since:]]
