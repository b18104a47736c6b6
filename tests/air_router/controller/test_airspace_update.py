"""Zones and fences that change in flight."""

import dataclasses
import math
import random

import pytest

from air_router.controller.model.actions import (
    FlyToNode,
    FlyToPoint,
    HoldHere,
    ReadAgain,
)
from air_router.controller.model.airspace_in_force import ZoneChange
from air_router.controller.model.events import PlanRenewed, RobotPose, RobotSought
from air_router.controller.model.requests import ComeHome, GoOn, HoldNow, Reload, SeekNow
from air_router.controller.model.states import State
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from air_router.vehicle.vehicle import Ages, FlightMode, PlanCompared, PlanReplaced, PlanTried
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Point
from tests.air_router.controller.drawing import (
    ahead,
    boarding,
    box,
    change,
    clear_of,
    climbing,
    cruising,
    goes_on_board,
    moves,
)


@pytest.mark.parametrize(("share", "reached"), [(0.9, True), (1.4, True), (1.7, False)])
def test_what_it_may_reach_while_it_brakes_it_is_to_leave_and_not_in_breach_of(
    pretend, share, reached
):
    flight = cruising(pretend)
    before, speed = flight.mission, flight.mission.speed_m_s
    stops_m = speed * (flight.controller.gate.reaction_s + speed / 4.0)
    zone = Zone("new", Circle(Point(*ahead(flight, share * stops_m + 20.0)), 20.0))
    now = before.with_areas(before.fences, (*before.zones, zone))
    found = flight.controller.airspace_update._reached(
        before, now, flight.controller.context.telemetry
    )
    assert (zone.name in found) is reached


def drawn_over(pretend):
    """A zone that is drawn where the vehicle flies."""
    flight = cruising(pretend)
    zone = box(flight.position, half_m=8.0)
    change(flight, zone)
    return flight, zone


def test_a_leg_that_is_not_clear_any_more_is_held_for_and_flown_around(pretend):
    flight = cruising(pretend)
    zone, commanded = box(ahead(flight, 40.0)), len(flight.motions)
    change(flight, zone)
    assert isinstance(flight.motions[-1], HoldHere)
    assert "zones changed: 'new' is new" in flight.announced
    assert boarding(flight) == 0  # it still moves: a fence on board would catch it
    flight.fly_until(lambda: boarding(flight) == 1, 10.0)
    assert math.hypot(*flight.velocity) < 0.5
    flight.give(RobotPose("io", Point(10.0, 10.0), 1.0, "io"))
    flight.fly_for(5.0)
    assert moves(flight, commanded) == []  # nothing flies while the fence is on its way
    flight.give(PlanRenewed())
    assert moves(flight, commanded) != []
    flight.lands(600.0)
    assert clear_of(flight, zone) >= 5.0


LOW = Zone("low", Circle(Point(200.0, 200.0), 5.0), band=Band(0.0, 20.0))


@pytest.mark.parametrize("others", [(), (LOW,)])
def test_a_zone_that_is_drawn_above_a_climb_is_left_below_it(pretend, others):
    flight = climbing(pretend)
    zone = Zone("new", Circle(flight.position, 15.0), band=Band(20.0, 60.0))
    change(flight, zone, *others)

    def boards():
        assert flight.altitude_m < 20.0
        return boarding(flight)

    flight.fly_until(boards, 60.0)
    assert clear_of(flight, zone, since=-1) >= 5.0
    flight.give(PlanRenewed())
    flight.fly_for(9.0)
    assert flight.announced[-1] == "climbing from 11 to 40 m first"
    since = len(flight.track)
    flight.lands(600.0)
    assert clear_of(flight, zone, since) >= 5.0


def test_a_way_out_past_another_zone_stays_below_what_is_drawn_above_it_too(pretend):
    """In Mission mode PX4 would climb to the altitude of its item."""
    flight = climbing(pretend)
    band, (east_m, north_m) = Band(20.0, 60.0), flight.position
    above = Zone("above", Circle(flight.position, 15.0), band=band)
    beside = dataclasses.replace(box((east_m, north_m + 20.0), 10.0, "beside"), band=band)
    commanded = len(flight.motions)
    change(flight, above, beside)
    flight.fly_until(lambda: boarding(flight) == 1, 120.0)
    assert moves(flight, commanded) != []
    for motion in moves(flight, commanded):
        assert isinstance(motion, FlyToPoint)
        assert motion.altitude_m < 20.0
    assert clear_of(flight, above, since=-1) >= 5.0


def test_a_zone_that_it_has_left_is_a_breach_also_on_a_way_home_without_our_plan(pretend):
    flight, zone = drawn_over(pretend)
    flight.fly_until(lambda: clear_of(flight, zone, since=-1) > 5.0, 60.0)
    flight.plan_compared("8 items")
    flight.fly_for(6.0)
    assert flight.operator_requests(ComeHome()).accepted
    flight.fly_for(1.0)
    flight.position = Point(*zone.polygon.representative_point().coords[0])
    flight.step()
    assert flight.controller.state is State.PASSIVE
    assert "hands off: breach of new is not resumed by itself" in flight.announced


def test_a_leg_that_stays_clear_is_flown_on(pretend):
    flight = cruising(pretend)
    commanded, leg = len(flight.motions), flight.controller.context.task.way.leg
    change(flight, box((300.0, 300.0)))
    flight.step()
    assert boarding(flight) == 1
    assert flight.motions[commanded:] == []
    flight.fly_until(lambda: math.dist(flight.position, leg.to) < 0.5, 60.0)
    flight.step()
    assert flight.motions[commanded:] == []  # and waits there
    flight.give(PlanRenewed())
    flight.lands(600.0)


def test_a_vehicle_that_a_zone_is_drawn_over_leaves_it_first(pretend):
    flight, zone = drawn_over(pretend)
    flight.fly_until(lambda: boarding(flight) == 1, 60.0)
    assert clear_of(flight, zone, -1) > 4.0  # its place lies 6.5 m off, and it is near that
    assert any(text.startswith("leaving no-fly zone 'new'") for text in flight.announced)
    assert math.dist(flight.position, zone.shape.ring[0]) < 30.0  # by the shortest way
    left = len(flight.track)
    flight.give(PlanRenewed())
    flight.lands(600.0)
    assert clear_of(flight, zone, left) >= 5.0


def test_another_order_meanwhile_does_not_keep_it_inside(pretend):
    flight, zone = drawn_over(pretend)
    flight.step()
    while not boarding(flight):
        robot = flight.controller.context.task.robot or "io"
        flight.give(RobotPose(robot, Point(10.0, 10.0), flight.now_s, robot))
        flight.step()
        assert flight.now_s < 400.0
    assert clear_of(flight, zone, -1) > 4.0  # its place lies 6.5 m off, and it is near that


def test_an_order_before_zones_go_on_board_leaves_no_leg_that_is_not_flown(pretend):
    flight = on_a_long_leg(pretend)
    change(flight, box(ahead(flight, 40.0)))
    flight.fly_until(lambda: math.hypot(*flight.velocity) < 2.0, 10.0)
    assert boarding(flight) == 0
    flight.give(SeekNow("io"))
    assert flight.controller.context.task.way.leg is None
    goes_on_board(flight)
    assert flight.controller.context.task.way.leg is not None


def test_a_hold_whose_confirmation_is_lost_does_not_keep_it_inside(pretend):
    flight, _ = drawn_over(pretend)
    flight.fly_until(lambda: "leaving no-fly zone 'new'" in flight.announced, 5.0)
    flight.act = lambda _: None
    flight.give(HoldNow())
    assert isinstance(flight.motions[-1], HoldHere)
    flight.step()
    assert isinstance(flight.motions[-1], FlyToPoint)


def test_waypoints_in_a_zone_are_left_out_and_the_others_flown(pretend, airborne):
    flight = pretend(duration_s=None)
    timers = dataclasses.replace(flight.mission.timers, init_s=3000.0)
    flight = airborne(duration_s=None, timers=timers)
    flight.fly_until(lambda: flight.controller.exploration.remaining < 36, 300.0)
    inside = next(w for w in flight.mission.waypoints if w.number == 10)
    change(flight, box(inside.position))
    skipped = flight.controller.context.airspace.mission.skipped
    assert skipped == {10}
    assert "waypoint 10 left out: no clear way leads there" in flight.announced
    goes_on_board(flight)
    flight.fly_until(lambda: flight.controller.exploration.remaining == 0, 3000.0)
    visited = {m.node for m in flight.motions if isinstance(m, FlyToNode)}
    assert set(range(1, 40)) - visited == set(skipped)


def test_a_waypoint_whose_zone_is_taken_away_is_flown_again(pretend):
    flight = cruising(pretend)
    last = flight.mission.waypoints[-1]
    change(flight, box(last.position, half_m=4.0))
    remaining = flight.controller.exploration.remaining
    goes_on_board(flight)
    change(flight)
    assert flight.controller.exploration.remaining > remaining
    assert any(text.endswith("flown again") for text in flight.announced)


def test_where_no_waypoint_is_left_it_goes_on_seeking(pretend):
    flight = cruising(pretend, duration_s=400.0)
    zones = [box(w.position, 3.0, f"over {w.number}") for w in flight.mission.waypoints]
    change(flight, *zones)
    goes_on_board(flight)
    assert flight.controller.state is State.SEARCH
    flight.lands(600.0)


def test_without_the_fence_on_board_it_comes_home_among_the_new_zones(pretend):
    flight = cruising(pretend)
    zone = box(ahead(flight, 40.0))
    change(flight, zone)
    commanded = len(flight.motions)
    goes_on_board(flight, 10.0, "PX4 did not accept the fence: TIMEOUT")
    assert flight.controller.state is State.HOME
    assert flight.controller.context.ending_why == "the changed fence is not on board"
    flight.lands(600.0)
    assert clear_of(flight, zone) >= 5.0
    assert not any(isinstance(m, FlyToNode) for m in flight.motions[commanded:])


def test_on_the_ground_it_is_put_on_board_at_once(pretend):
    flight = pretend(duration_s=200.0)
    flight.give(flight.telemetry())
    change(flight, box((90.0, 90.0)))
    assert boarding(flight) == 1
    flight.give(PlanRenewed("no"))
    assert "the changed fence is not on board" in flight.finished.why


@pytest.mark.parametrize("mode", [FlightMode.POSITION, FlightMode.HOLD])
def test_what_did_not_get_on_board_takes_no_vehicle_from_a_pilot_who_has_taken_off(pretend, mode):
    flight = pretend(duration_s=200.0, pilot_arms=True)
    flight.step()
    change(flight, box((90.0, 90.0)))
    assert boarding(flight) == 1
    flight.take_off_halfway(mode)
    flight.give(PlanRenewed("no"))
    flight.fly_for(5.0)
    assert (flight.controller.state, flight.motions) == (State.READY, [])
    flight.altitude_m = flight.mission.altitude_above_home_m
    flight.pilot_chooses(FlightMode.MISSION)
    flight.fly_until(lambda: boarding(flight) == 2, 5.0)
    flight.give(PlanRenewed())
    flight.lands(600.0)


@pytest.mark.parametrize("mode", [FlightMode.POSITION, FlightMode.RETURN])
@pytest.mark.parametrize("ready", [False, True])
def test_nothing_more_is_put_on_board_once_the_pilot_has_it(pretend, mode, ready):
    if ready:
        flight = pretend(pilot_arms=True)
        flight.step()
    else:
        flight = cruising(pretend)
    change(flight, box((300.0, 300.0)))
    flight.fly_until(lambda: boarding(flight) == 1, 10.0)
    objection = flight.controller.airspace_update.objection
    assert objection() is None
    flight.take_off_halfway(mode) if ready else flight.pilot_chooses(mode)
    assert objection() == "this program no longer commands the vehicle"


@pytest.mark.parametrize("requested", [False, True])
def test_with_its_battery_at_the_reserve_it_comes_home_without_waiting_for_an_upload(
    pretend, requested
):
    flight = cruising(pretend, duration_s=2000.0)
    zone = box(ahead(flight, 40.0))
    change(flight, zone)
    flight.fly_until(lambda: boarding(flight) == 1, 10.0)
    if requested:
        answer = flight.operator_requests(ComeHome())
        assert "sets out once the changed zones are on board" in answer.why
        flight.fly_for(5.0)
        assert math.hypot(*flight.velocity) < 0.1
    commanded = len(flight.motions)
    flight.battery = flight.mission.battery_reserve
    flight.fly_for(3.0)
    assert flight.controller.state is State.HOME
    assert math.hypot(*flight.velocity) > 1.0
    assert {*map(type, moves(flight, commanded))} == {FlyToPoint}  # who knows what is on board
    assert (
        "the changed fence is not on board: it comes home at once, for its battery"
        in flight.announced
    )
    assert flight.controller.airspace_update.objection() == "the mission goes on without it"
    announced = len(flight.announced)
    flight.give(PlanRenewed("the transfer did not end"))
    assert flight.announced[announced:] == []
    flight.lands(600.0)
    assert clear_of(flight, zone) >= 5.0


def test_zones_that_change_on_a_way_home_for_the_battery_go_on_board_no_more(pretend):
    flight = cruising(pretend, duration_s=2000.0)
    flight.battery = flight.mission.battery_reserve
    flight.fly_for(2.0)
    zone = box(ahead(flight, 25.0), 5.0)
    change(flight, zone)
    assert isinstance(flight.motions[-1], HoldHere)
    flight.fly_for(6.0)
    assert flight.controller.context.airspace.change is None
    assert flight.controller.airspace_update.objection() is not None
    assert isinstance(flight.motions[-1], FlyToPoint)
    flight.lands(600.0)
    assert clear_of(flight, zone) >= 5.0


def test_a_way_home_whose_time_has_come_waits_for_the_upload(pretend):
    flight = cruising(pretend, duration_s=60.0)
    change(flight, box(ahead(flight, 40.0)))
    flight.fly_until(lambda: boarding(flight) == 1, 10.0)
    commanded = len(flight.motions)
    flight.fly_for(90.0)
    assert flight.controller.state is State.HOME
    assert moves(flight, commanded) == []


def test_brought_home_with_another_plan_on_board_it_uploads_none(pretend):
    flight = cruising(pretend)
    flight.plan_compared("8 items")
    flight.fly_to_state(State.PASSIVE)
    zone = box((90.0, 90.0))
    change(flight, zone)
    flight.give(ComeHome())
    flight.lands(600.0)
    assert boarding(flight) == 0
    assert clear_of(flight, zone) >= 5.0


def test_a_zone_that_is_drawn_over_the_climb_is_left_and_one_that_was_there_is_a_breach(pretend):
    flight = pretend(duration_s=200.0)
    flight.take_off_halfway()
    change(flight, box(flight.position))
    flight.fly_for(2.0)
    flight.altitude_m = flight.mission.altitude_above_home_m
    flight.fly_until(lambda: boarding(flight) == 1, 30.0)
    assert State.PASSIVE not in flight.states
    flight = pretend()
    flight.take_off_halfway()
    flight.position = Point(
        *flight.mission.climb_airspace.zones[0].polygon.representative_point().coords[0]
    )
    flight.step()
    assert isinstance(flight.motions[-1], HoldHere)
    flight.fly_for(2.0)
    assert flight.controller.state is State.PASSIVE
    assert "hands off: breach of" in " ".join(flight.announced)


def test_what_changes_while_a_pilot_has_it_counts_and_goes_on_board_when_it_is_resumed(pretend):
    flight = cruising(pretend)
    flight.pilot_chooses(FlightMode.HOLD)
    flight.fly_until(lambda: math.hypot(*flight.velocity) < 0.1, 10.0)
    commanded = len(flight.motions)
    change(flight, box((flight.position[0] + 40.0, flight.position[1])))
    flight.fly_for(2.0)
    assert (boarding(flight), flight.motions[commanded:]) == (0, [])
    flight.give(GoOn())
    flight.step()
    assert (boarding(flight), flight.motions[commanded:]) == (1, [])
    flight.give(PlanRenewed())
    flight.lands(600.0)


def test_a_leg_that_is_not_clear_any_more_is_held_for_once_its_mode_is_received_again(pretend):
    """While its mode is not received, a pilot may have the vehicle: nothing is commanded."""
    flight = cruising(pretend, duration_s=None)
    flight.shown = {"ages": Ages(mode_s=6.0)}
    flight.step()
    commanded, place = len(flight.motions), flight.controller.context.task.way.leg.to
    assert math.dist(flight.position, place) > 25.0
    zone = box(place, 6.0)
    change(flight, zone)
    flight.step()
    assert flight.motions[commanded:] == []
    flight.shown = {}
    flight.fly_until(lambda: boarding(flight) == 1, 20.0)
    flight.fly_for(20.0)
    assert clear_of(flight, zone) >= 5.0


def test_taken_back_on_its_way_to_another_s_place_it_stops_before_zones_go_on_board(pretend):
    flight = cruising(pretend, duration_s=None)
    place = Point(*ahead(flight, 120.0))
    flight.pilot_chooses(FlightMode.HOLD)
    flight.target = place
    flight.fly_for(4.0)
    zone = box(ahead(flight, 50.0))
    change(flight, zone)
    flight.give(GoOn())
    flight.fly_until(lambda: boarding(flight) == 1, 20.0)
    assert math.hypot(*flight.velocity) < 0.5
    flight.fly_for(20.0)
    assert clear_of(flight, zone) >= 5.0


def test_who_may_request_it_when(pretend):
    flight = cruising(pretend)

    def answer():
        return flight.operator_requests(Reload())

    assert answer().accepted
    assert sum(isinstance(a, ReadAgain) for a in flight.actions) == 1
    change(flight, box((300.0, 300.0)))
    flight.step()
    assert boarding(flight) == 1
    assert answer().code == "busy"
    change(flight, box((310.0, 310.0)))
    assert "zones not changed" in flight.announced[-1]
    flight.give(PlanRenewed())
    flight.give(PlanRenewed())  # of no upload
    flight.lands(600.0)
    assert answer().code == "flight-over"
    change(flight, box((300.0, 300.0)))
    assert flight.announced[-1] == "zones not changed: the flight is over"


@pytest.mark.parametrize("requested", [False, True])
def test_whom_it_goes_on_to_seek_it_still_yields_unless_it_was_requested(airborne, requested):
    flight = airborne(explore=False, name="titan", duration_s=2000.0)
    if requested:
        flight.operator_requests(SeekNow("callisto"))
    assert flight.controller.context.task.robot == "callisto"
    known = flight.controller.search.targets.tracks["callisto"]
    tries = known.tries
    east_m, north_m = flight.position
    change(flight, box((east_m, north_m), half_m=1.0, name="above"))
    goes_on_board(flight)
    assert (flight.controller.state, flight.controller.context.task.robot) == (
        State.SEARCH,
        "callisto",
    )
    assert known.tries == tries
    flight.give(RobotSought("atlas", "callisto", 1.0))
    assert flight.controller.context.task.robot == ("callisto" if requested else "europa")


@pytest.mark.parametrize("elsewhere", [True, False])
def test_a_search_that_new_zones_send_elsewhere_has_its_time_from_there(pretend, elsewhere):
    flight = pretend(seek=("io",), explore=False, duration_s=2000.0)
    flight.take_off()
    flight.give(RobotPose("io", Point(10.0, 10.0), 1.0, "callisto"))
    waits = "at the search position of io"
    flight.fly_until(lambda: waits in flight.announced)
    ends_s = flight.controller.context.task.ends_s
    flight.fly_for(20.0)
    east_m, north_m = flight.position
    change(flight, box((east_m, north_m) if elsewhere else (300.0, 300.0), half_m=20.0))
    goes_on_board(flight)
    flight.step()
    assert flight.controller.state is State.SEARCH
    if not elsewhere:
        assert flight.controller.context.task.ends_s == ends_s
        return
    flight.fly_until(lambda: flight.announced.count(waits) == 2)
    begun_s = flight.now_s
    flight.fly_until(lambda: flight.states.count(State.SEARCH) == 2)
    assert flight.now_s - begun_s == pytest.approx(flight.mission.timers.search_s, abs=1.0)


def test_a_router_that_was_made_elsewhere_decides_nothing_else(pretend):
    decided = []
    for prepared in (False, True):
        flight = cruising(pretend)
        zone = box(ahead(flight, 40.0))
        if prepared:
            changed = flight.mission.with_areas(
                flight.mission.fences, (*flight.mission.zones, zone)
            )
            flight.controller.airspace_update.prepared = Router(WaypointGraph(changed))
        change(flight, zone)
        flight.fly_until(lambda flight=flight: boarding(flight) == 1, 10.0)
        flight.give(PlanRenewed())
        flight.lands(600.0)
        decided.append(flight.actions)
    assert decided[0] == decided[1]


@pytest.mark.parametrize("seed", range(2))
def test_wherever_zones_appear_what_has_been_left_is_not_entered_again(pretend, seed):
    chance = random.Random(seed)
    flight = pretend(
        duration_s=240.0, timers=dataclasses.replace(pretend().mission.timers, init_s=30)
    )
    flight.take_off()
    zones, outside_since, due = [], {}, None
    while flight.finished is None:
        flight.step()
        assert flight.now_s < 900.0, (flight.controller.state, flight.announced[-3:])
        flying = flight.in_air and flight.controller.context.in_charge
        if flying and len(zones) < 3 and due is None and chance.random() < 0.004:
            place = [p + chance.uniform(-40.0, 40.0) for p in flight.position]
            zone = box(place, chance.uniform(3.0, 15.0), f"new {len(zones)}")
            if math.dist(place, flight.mission.home) > 40.0:
                zones.append(zone)
                change(flight, *zones)
                due = flight.now_s + chance.uniform(0.5, 5.0)
        if boarding(flight) and due is not None and flight.now_s > due:
            flight.give(PlanRenewed())
            due = None if flight.controller.context.airspace.change is None else due
        for zone in zones:
            far_m = Airspace(None, [zone], 0.0).distance_m(flight.position)
            if far_m >= 5.0:
                outside_since.setdefault(zone.name, flight.now_s)
            if zone.name in outside_since:
                began_s = outside_since[zone.name]
                assert far_m > 0.0, (zone.name, began_s, flight.now_s)
    assert zones
    assert flight.controller.state is State.DONE
    assert any(isinstance(m, FlyToPoint | FlyToNode) for m in flight.motions)


def test_a_second_change_while_it_leaves_a_zone_is_no_breach_of_the_first(pretend):
    flight, zone = drawn_over(pretend)
    flight.step()
    change(flight, zone, box((300.0, 300.0), name="another"))
    goes_on_board(flight)
    flight.lands(600.0)


def test_it_leaves_a_zone_also_where_others_are_nearer_than_allowed(pretend):
    flight = cruising(pretend)
    flight.give(HoldNow())
    flight.fly_until(lambda: math.hypot(*flight.velocity) < 0.01, 10.0)
    (east_m, north_m), before = flight.position, len(flight.track)
    zone = box((east_m, north_m - 4.5), half_m=9.0)
    other = box((east_m - 11.0, north_m), half_m=10.0, name="another")
    change(flight, zone, other)
    flight.fly_until(lambda: boarding(flight) == 1, 60.0)
    assert clear_of(flight, zone, -1) > 4.0
    assert clear_of(flight, other, before) > 0.95
    flight.give(PlanRenewed())
    flight.give(GoOn())
    flight.lands(600.0)


def on_a_long_leg(pretend):
    flight = pretend(duration_s=200.0)
    flight.take_off()
    flight.fly_until(lambda: 40.0 < math.dist(flight.position, flight.target) < 45.0)
    return flight


def test_a_hold_that_is_lost_while_zones_change_is_commanded_again_before_all_else(pretend):
    flight = on_a_long_leg(pretend)
    zone = box(ahead(flight, 28.0), half_m=2.0)
    flight.deaf = True
    change(flight, zone)
    flight.fly_for(1.0)
    assert boarding(flight) == 0
    flight.deaf = False
    flight.fly_until(lambda: boarding(flight) == 1, 20.0)
    assert math.hypot(*flight.velocity) < 0.5
    flight.give(PlanRenewed())
    flight.lands(600.0)
    assert clear_of(flight, zone) >= 5.0


def test_a_zone_that_it_flies_into_because_the_hold_was_lost_is_left(pretend):
    flight = on_a_long_leg(pretend)
    zone = box(ahead(flight, 22.0), half_m=6.0)
    flight.deaf = True
    change(flight, zone)
    flight.fly_until(lambda: clear_of(flight, zone, -1) < -3.0, 20.0)
    flight.deaf = False
    flight.fly_until(lambda: boarding(flight) == 1, 30.0)
    assert any(text.startswith("leaving no-fly zone 'new'") for text in flight.announced)
    left = len(flight.track)
    flight.give(PlanRenewed())
    flight.lands(600.0)
    assert clear_of(flight, zone, left) >= 4.0


def test_a_leg_that_is_flown_on_because_a_stop_was_lost_counts_as_under_way(pretend):
    flight = on_a_long_leg(pretend)
    flight.deaf = True
    flight.give(HoldNow())
    flight.deaf = False
    zone = box(ahead(flight, 25.0), half_m=2.0)
    change(flight, zone)
    flight.fly_until(lambda: boarding(flight) == 1, 20.0)
    assert clear_of(flight, zone) >= 5.0
    assert math.hypot(*flight.velocity) < 0.5


def test_the_way_out_of_a_zone_is_commanded_again_if_it_was_lost(pretend):
    flight = cruising(pretend)
    flight.deaf = True
    change(flight, box(flight.position, half_m=8.0))
    flight.fly_for(1.0)
    flight.deaf = False
    flight.fly_until(lambda: boarding(flight) == 1, 20.0)


def test_the_battery_is_looked_at_while_zones_change(pretend):
    flight = on_a_long_leg(pretend)
    change(flight, box((300.0, 300.0)))
    flight.step()
    assert boarding(flight) == 1
    flight.battery = flight.mission.battery_reserve
    commanded = len(flight.motions)
    flight.step()
    assert flight.controller.state is State.HOME
    assert any(text.startswith("coming home: battery at") for text in flight.announced)
    # In one decision: of motions that wait only the last leaves.
    assert [type(m) for m in flight.motions[commanded:]] == [HoldHere, FlyToPoint]
    flight.lands(600.0)


def test_the_battery_is_looked_at_while_it_leaves_a_zone(pretend):
    flight = cruising(pretend)
    zone = box(flight.position, half_m=8.0)
    flight.battery = flight.mission.battery_reserve
    change(flight, zone)
    flight.fly_until(lambda: boarding(flight) == 1, 60.0)
    assert flight.controller.state is State.HOME
    assert clear_of(flight, zone, -1) > 4.0
    flight.give(PlanRenewed("no"))  # home all the same
    flight.lands(600.0)


def test_a_change_that_comes_just_before_hands_off_is_kept_and_announced(pretend):
    flight = cruising(pretend)
    flight.deaf = True
    flight.give(Reload())
    flight.give(PlanReplaced(flight.now_s, only_fence=True))
    flight.give(PlanCompared(flight.now_s, "the fence: 9 items sent, 0 are on board"))
    assert flight.controller.state is State.INIT  # it is commanded to hold first
    commanded = len(flight.motions)
    change(flight, box(ahead(flight, 60.0)))
    assert "'new' is new; they are uploaded when the mission is resumed" in flight.announced[-1]
    assert "new" in {zone.name for zone in flight.controller.context.airspace.mission.zones}
    assert (boarding(flight), flight.motions[commanded:]) == (0, [])
    flight.deaf = False
    flight.fly_to_state(State.PASSIVE, 5.0)
    assert boarding(flight) == 0


def test_a_fence_that_did_not_get_on_board_while_a_pilot_flew_is_tried_again(pretend):
    flight = cruising(pretend)
    change(flight, box((300.0, 300.0)))
    flight.step()
    flight.pilot_chooses(FlightMode.HOLD)
    assert flight.controller.state is State.PASSIVE
    flight.give(PlanRenewed("a ground station uploads"))
    flight.fly_until(lambda: math.hypot(*flight.velocity) < 0.1, 10.0)
    assert boarding(flight) == 1
    flight.give(GoOn())
    flight.step()
    assert boarding(flight) == 2
    flight.give(PlanRenewed())
    flight.lands(600.0)


def test_a_zone_that_did_not_get_on_board_is_left_while_the_plan_is_compared(pretend):
    """Until the fence is on board, a zone that the stop may have ended in is no breach."""
    flight = on_a_long_leg(pretend)
    zone = box(ahead(flight, 28.0), half_m=6.0)
    change(flight, zone)
    flight.fly_until(lambda: boarding(flight) == 1, 20.0)
    flight.give(PlanReplaced(flight.now_s, only_fence=True))
    flight.give(PlanRenewed("another ground station has changed what is on board"))
    flight.position = Point(*zone.polygon.representative_point().coords[0])  # a gust
    flight.give(PlanCompared(flight.now_s, None))
    flight.fly_until(lambda: boarding(flight) == 2, 60.0)
    assert State.PASSIVE not in flight.states
    assert clear_of(flight, zone, -1) > 4.0


def test_a_zone_that_did_not_get_on_board_is_left_if_the_next_change_stops_it_inside(pretend):
    flight = cruising(pretend, duration_s=2000.0)
    missing = box(ahead(flight, 40.0))
    change(flight, missing)
    goes_on_board(flight, 10.0, "the fence was not taken: TIMEOUT")
    flight.fly_until(lambda: math.hypot(*flight.velocity) > 3.0, 60.0)
    flight.deaf = True
    change(flight, missing, box(ahead(flight, 25.0), name="next"))
    flight.position = Point(*missing.polygon.representative_point().coords[0])
    flight.step()
    flight.deaf = False
    flight.fly_until(lambda: boarding(flight) == 2, 60.0)
    assert State.PASSIVE not in flight.states
    assert clear_of(flight, missing, -1) > 4.0


def test_a_stop_that_changed_waypoints_need_is_kept_for_the_upload_on_resume(pretend):
    """PX4 takes a plan whose items move only in Hold."""
    flight = cruising(pretend)
    change(flight, box(flight.mission.waypoints[-1].position, half_m=4.0))
    flight.fly_until(lambda: boarding(flight) == 1, 20.0)
    flight.pilot_chooses(FlightMode.POSITION)
    flight.give(PlanRenewed("the pilot has the vehicle"))
    flight.fly_until(lambda: math.hypot(*flight.velocity) < 0.1, 10.0)
    flight.pilot_chooses(FlightMode.MISSION)
    assert flight.operator_requests(GoOn()).accepted
    flight.fly_until(lambda: boarding(flight) == 2, 10.0)
    assert flight.mode is FlightMode.HOLD


def test_another_stations_plan_during_a_renewal_ends_that_and_is_a_takeover(pretend):
    flight, _ = drawn_over(pretend)
    update = flight.controller.airspace_update
    flight.fly_until(lambda: boarding(flight) == 1, 60.0)
    assert update.objection() is None
    flight.give(PlanReplaced(flight.now_s))
    assert "another ground station" in update.objection()
    commanded = len(flight.motions)
    flight.give(PlanRenewed("another ground station has changed what is on board"))
    assert (
        flight.controller.context.airspace.change is ZoneChange.CLEARING
    )  # once more when it is resumed
    flight.give(PlanCompared(flight.now_s, "8 items"))
    flight.fly_for(20.0)
    assert flight.controller.state is State.PASSIVE
    assert moves(flight, commanded) == []
    assert any("hands off: another plan is on board" in text for text in flight.announced)
    assert not any("coming home" in text for text in flight.announced)
    refused = flight.operator_requests(GoOn())
    assert not refused.accepted
    assert "resume upload" in refused.why


def test_while_another_plan_is_read_ours_is_not_put_over_it_on_request(pretend):
    flight = cruising(pretend)
    flight.give(PlanReplaced(flight.now_s))
    flight.pilot_chooses(FlightMode.POSITION)
    flight.pilot_chooses(FlightMode.HOLD)
    flight.fly_for(3.0)
    answer = flight.operator_requests(GoOn(upload=True))
    assert not answer.accepted
    assert "is being read" in answer.why


def test_every_try_of_another_station_that_shows_is_announced(pretend):
    flight = cruising(pretend)
    flight.give(PlanTried(flight.now_s, "ground station 255"))
    assert any("ground station 255 tries to upload a plan" in text for text in flight.announced)
