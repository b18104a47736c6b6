"""Whose the vehicle is: a pilot takes it, the plan on board changes, a flight is resumed."""

import dataclasses
import itertools
import math

import pytest

from air_router.controller.limits import FAILSAFE_LATE_S, PLAN_COMPARED_S
from air_router.controller.model.actions import (
    Announce,
    FlyToNode,
    FlyToPoint,
    HoldHere,
    LandHere,
)
from air_router.controller.model.events import CommandFailed, RobotPose
from air_router.controller.model.requests import ComeHome, GoOn, GoTo, HoldNow, LandNow, SeekNow
from air_router.controller.model.states import State
from air_router.mission.flight_plan import HOME_NODE
from air_router.mission.loading import load_mission
from air_router.vehicle.instructions import (
    CHECK_SENDERS,
    CHOOSE_AGAIN,
    LAND_BY_HAND,
    Severity,
)
from air_router.vehicle.vehicle import (
    Ages,
    FlightMode,
    ItemReached,
    MavlinkSpoofed,
    PlanCompared,
    PlanReplaced,
    WrongVehicle,
)
from geo.airspace.airspace import Airspace
from geo.frame import Point
from tests.air_router.conftest import CORNERS, MISSIONS


@pytest.mark.parametrize("state", [State.INIT, State.SEARCH, State.COMM, State.EXPL, State.HOME])
@pytest.mark.parametrize("mode", [FlightMode.OTHER, FlightMode.RETURN, FlightMode.LAND])
def test_the_pilot_wins_and_is_left_alone(pretend, flown, state, mode):
    def fly():
        flight = pretend()
        flight.robots = dict(CORNERS)
        flight.take_off()
        if state is State.HOME:
            flight.fly_away()
            flight.operator_requests(ComeHome())
        flight.fly_to_state(state)
        return flight

    flight = flown(("pilot", state), fly)
    flight.pilot_chooses(mode)
    assert flight.controller.state is State.PASSIVE
    commanded = len(flight.motions)
    flight.fly_for(60.0)
    flight.operator_requests(ComeHome())
    flight.give(RobotPose("io", CORNERS["io"], 1e9, "io"))
    assert len(flight.motions) == commanded
    flight.mode = FlightMode.LAND
    flight.ends()
    assert not flight.finished.landed_by_us


@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.OTHER, FlightMode.RETURN])
def test_a_pilot_who_takes_over_in_the_climb_keeps_the_vehicle(pretend, mode):
    flight = pretend()
    flight.take_off_halfway()
    assert flight.controller.state is State.READY
    flight.pilot_chooses(mode)
    assert flight.controller.state is State.PASSIVE
    flight.altitude_m = flight.mission.altitude_above_home_m
    flight.pilot_chooses(FlightMode.MISSION)
    flight.fly_for(10.0)
    assert flight.motions == []
    flight.mode = FlightMode.LAND
    flight.ends()
    assert not flight.finished.landed_by_us


WRONG = "the vehicle is a fixed wing (MAV_TYPE 1); only multicopters are flown"


def alarms(flight):
    """Text and instruction of each alarm."""
    return [
        (a.text, a.instruction)
        for a in flight.actions
        if isinstance(a, Announce) and a.severity is Severity.ALARM
    ]


def test_a_type_that_changes_in_flight_is_an_alarm_and_nothing_is_commanded_any_more(away):
    flight = away()
    commanded = len(flight.motions)
    flight.give(WrongVehicle(flight.now_s, WRONG))
    assert flight.controller.state is State.PASSIVE
    assert alarms(flight) == [(WRONG, LAND_BY_HAND)]
    flight.give(WrongVehicle(flight.now_s, WRONG.replace("fixed wing", "VTOL")))
    assert len(alarms(flight)) == 1  # it is announced once, whatever it is
    flight.mode = FlightMode.HOLD
    flight.fly_for(30.0)
    for request in (GoOn(), GoOn(upload=True), ComeHome()):
        answer = flight.operator_requests(request)
        assert (answer.accepted, "land it by hand" in answer.why) == (False, True)
    assert len(flight.motions) == commanded
    flight.give(WrongVehicle(flight.now_s, None))
    assert flight.operator_requests(GoOn()).accepted
    flight.lands()


def test_unsigned_messages_in_the_vehicles_name_are_a_warning_and_change_nothing(away):
    flight = away()
    before = len(flight.actions)
    flight.give(MavlinkSpoofed(flight.now_s, 3))
    text = "3 MAVLink messages posed as the vehicle without its signature, and were ignored"
    assert flight.actions[before:] == [Announce(text, Severity.WARNING, CHECK_SENDERS)]


def test_what_one_of_two_vehicles_reports_on_the_ground_is_no_crash_of_the_other(away):
    """They report by turns under one system id; the flight is over when neither flies."""
    flight = away()
    flight.give(WrongVehicle(flight.now_s, "two autopilots", twins=True))
    for turn in range(20):
        flight.shown = {"armed": False, "in_air": False} if turn % 2 else {}
        flight.fly_for(0.5)
    assert not any("disarmed" in text for text in flight.announced)
    assert flight.controller.state is State.PASSIVE
    flight.shown = {"armed": False, "in_air": False}
    flight.fly_for(6.0)
    assert flight.controller.state is State.DONE


def test_a_type_that_changes_on_the_ground_refuses_the_flight(pretend):
    flight = pretend()
    flight.step()
    flight.give(WrongVehicle(flight.now_s, WRONG))
    assert flight.finished.refused
    assert flight.finished.why == f"{WRONG}, before take-off"
    ((text, instruction),) = alarms(flight)
    assert (text, "connect a multicopter" in instruction) == (WRONG, True)
    assert flight.motions == []


@pytest.mark.parametrize(("altitude_m", "aside_m"), [(70.0, 0.0), (70.0, 40.0), (8.0, 60.0)])
def test_what_is_held_where_no_leg_may_begin_stays_there(pretend, altitude_m, aside_m):
    """In or above another UAV's layer; low, and away from home."""
    flight = pretend(load_mission(MISSIONS / "pair" / "mission.yaml", uav="atlas"))
    east_m, north_m = flight.mission.home
    by_hand_to(flight, Point(east_m + aside_m, north_m), altitude_m)
    flight.fly_for(60.0)
    high = altitude_m == 70.0
    flight.battery = 0.2
    flight.fly_for(5.0)
    assert [type(motion) for motion in flight.motions] == [HoldHere]
    assert any(
        "battery at 20%: it should come home, and cannot" in text for text in flight.announced
    )
    answer = flight.operator_requests(ComeHome())
    assert answer.accepted is not high
    if high:
        assert "descend to 48 m first" in answer.why
        flight.altitude_m = 48.0
        flight.step()
        flight.operator_requests(ComeHome())
    else:
        assert isinstance(flight.motions[-1], FlyToPoint)  # up first
    flight.ends()
    assert math.dist(flight.position, flight.mission.home) < 3.0


@pytest.mark.parametrize(("altitude_m", "aside_m"), [(70.0, 0.0), (8.0, 60.0)])
def test_the_same_plan_uploaded_again_begins_no_mission_where_no_leg_may_begin(
    pretend, altitude_m, aside_m
):
    flight = pretend(load_mission(MISSIONS / "pair" / "mission.yaml", uav="atlas"))
    east_m, north_m = flight.mission.home
    by_hand_to(flight, Point(east_m + aside_m, north_m), altitude_m)
    flight.fly_for(6.0)
    flight.plan_compared()
    flight.fly_for(6.0)
    assert flight.controller.state is State.READY
    assert [type(motion) for motion in flight.motions] == [HoldHere]
    assert "the plan on board is equivalent to this mission's; holding: Mission was chosen" in (
        "".join(flight.announced)
    )
    flight.altitude_m = 48.0
    flight.step()
    assert flight.operator_requests(ComeHome()).accepted
    flight.ends()
    assert flight.finished.landed_by_us


@pytest.mark.parametrize(("altitude_m", "aside_m"), [(70.0, 0.0), (8.0, 60.0)])
def test_a_vehicle_whose_hold_was_lost_until_it_is_level_comes_home_for_its_battery(
    pretend, altitude_m, aside_m
):
    flight = pretend(load_mission(MISSIONS / "pair" / "mission.yaml", uav="atlas"))
    flight.deaf = True
    east_m, north_m = flight.mission.home
    by_hand_to(flight, Point(east_m + aside_m, north_m), altitude_m)
    assert any(text.startswith("holding: Mission was chosen") for text in flight.announced)
    flight.altitude_m = 48.0  # as PX4 does by itself
    flight.step()
    flight.deaf = False
    assert flight.controller.state is State.INIT
    flight.battery = 0.2
    flight.lands(300.0)


def test_armed_and_disarmed_again_without_a_take_off(pretend):
    flight = pretend()
    for armed in (True, False):
        flight.armed = armed
        flight.step()
    assert not flight.finished.landed_by_us
    assert flight.finished.why == "disarmed, before take-off"


def test_a_pilot_who_arms_and_lets_it_disarm_again_may_arm_again(pretend):
    flight = pretend(pilot_arms=True)
    for armed in (True, False):
        flight.armed = armed
        flight.step()
    assert flight.finished is None
    assert any("still waiting for the pilot to arm" in text for text in flight.announced)
    flight.take_off()
    flight.fly_to_state(State.INIT)


def test_a_climb_that_does_not_go_on_is_landed(pretend):
    flight = pretend()
    flight.take_off_halfway()
    flight.ends(120.0)
    assert any("the climb has stopped" in text for text in flight.announced)
    assert flight.finished.landed_by_us
    assert flight.states == [State.HOME, State.LAND, State.DONE]


def test_another_plan_before_take_off_ends_it(pretend):
    flight = pretend()
    flight.step()
    flight.give(PlanReplaced(flight.now_s))
    assert flight.finished is None  # it may be the same again
    flight.give(PlanCompared(flight.now_s, "8 items"))
    assert flight.finished.why == "another plan is on board (8 items), before take-off"


@pytest.mark.parametrize("hops", [False, True])
@pytest.mark.parametrize("compared", [False, True])
def test_a_plan_that_is_replaced_as_it_takes_off_refuses_the_flight(pretend, hops, compared):
    flight = pretend()
    flight.armed, flight.mode = True, FlightMode.MISSION
    flight.step()
    flight.give(PlanReplaced(flight.now_s))
    assert isinstance(flight.motions[-1], HoldHere)
    flight.in_air, flight.altitude_m = hops, 0.5 * hops
    flight.step()
    flight.in_air = False
    flight.step()
    if compared:
        flight.give(PlanCompared(flight.now_s))
    flight.armed = False
    flight.step()
    assert flight.finished.refused
    assert flight.finished.why == (
        "the plan on board was replaced as it took off; it is on the ground: "
        "start the mission again"
    )


@pytest.mark.parametrize("difference", [None, "8 items"])
@pytest.mark.parametrize("again", [False, True])
def test_a_plan_that_was_replaced_before_the_hand_over_is_compared_first(
    pretend, again, difference
):
    """What was sent to a vehicle that was armed and disarmed before counts for nothing."""
    flight = pretend(pilot_arms=True)
    flight.step()
    if again:
        flight.armed, flight.mode = True, FlightMode.MISSION
        flight.step()
    flight.give(PlanReplaced(flight.now_s))
    flight.armed, flight.mode = False, FlightMode.HOLD
    flight.step()
    commanded = len(flight.motions)
    flight.take_off()
    flight.fly_for(6.0)
    assert [type(motion) for motion in flight.motions[commanded:]] == [HoldHere]
    flight.give(PlanCompared(flight.now_s, difference))
    flight.fly_for(2.0)
    assert flight.controller.state is (State.PASSIVE if difference else State.INIT)
    assert isinstance(flight.motions[-1], HoldHere if difference else FlyToNode)


def test_a_comparison_that_ends_late_takes_no_vehicle_from_a_pilot_who_took_off_since(pretend):
    flight = pretend(pilot_arms=True)
    flight.armed, flight.mode = True, FlightMode.MISSION
    flight.step()
    flight.give(PlanReplaced(flight.now_s))
    flight.armed = False
    flight.step()
    flight.take_off_halfway(FlightMode.POSITION)
    commanded = len(flight.motions)
    flight.give(PlanCompared(flight.now_s))
    flight.fly_for(6.0)
    assert (flight.controller.state, flight.motions[commanded:]) == (State.READY, [])


@pytest.mark.parametrize("radius_m", [2.0, 20.0])
@pytest.mark.parametrize(("away_m", "speed_m_s"), [(8.0, 0.0), (2.0, 9.0)])
def test_it_does_not_land_beside_home_nor_while_it_passes_by(
    airborne, pennovation, away_m, speed_m_s, radius_m
):
    """PX4 reports the item above home from farther away than we land."""
    planner = dataclasses.replace(pennovation.planner, acceptance_radius_m=radius_m)
    flight = airborne(duration_s=60.0, planner=planner)
    flight.fly_to_state(State.HOME)
    flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) < 20.0)
    assert flight.controller.state is State.HOME
    east, north = flight.mission.home
    flight.position, flight.velocity = Point(east + away_m, north), (speed_m_s, 0.0)
    flight.give(flight.telemetry())
    flight.give(ItemReached(flight.now_s, flight.plan.item_of(HOME_NODE)))
    assert flight.controller.state is State.HOME
    flight.ends()
    assert math.dist(flight.position, flight.mission.home) < 3.0


def by_hand_to(flight, position, altitude_m):
    """A pilot takes off by hand, flies somewhere, and chooses Mission mode there."""
    flight.armed = flight.in_air = True
    flight.mode, flight.altitude_m, flight.position = FlightMode.OTHER, altitude_m, position
    flight.step()
    flight.pilot_chooses(FlightMode.MISSION)


def test_a_mission_of_the_pilot_s_own_is_not_held_while_what_was_replaced_is_compared(pretend):
    flight = pretend()
    flight.take_off_halfway(FlightMode.POSITION)
    flight.plan_compared("8 items")
    assert flight.controller.state is State.PASSIVE
    flight.give(PlanReplaced(flight.now_s))
    flight.pilot_chooses(FlightMode.MISSION)
    flight.fly_for(10.0)
    assert flight.motions == []


def test_mission_chosen_far_away_and_high_is_flown_on_from_there_around_the_zones(pretend):
    flight = pretend(duration_s=60.0)
    behind_zone_1 = Point(65.0, -60.0)
    by_hand_to(flight, behind_zone_1, 40.0)
    assert flight.controller.state is State.INIT
    flight.lands()
    assert flight.closest_m() >= flight.mission.planner.clearance_m


@pytest.mark.parametrize("only_fence", [False, True])
def test_another_plan_on_board_stops_our_leg_first_and_means_hands_off_then(away, only_fence):
    flight = away()
    flight.give(PlanReplaced(flight.now_s, only_fence))
    assert isinstance(flight.motions[-1], HoldHere)
    commanded = len(flight.motions)
    flight.fly_for(10.0)
    assert (flight.controller.state, len(flight.motions)) == (State.INIT, commanded)
    flight.give(PlanCompared(flight.now_s, "the mission: item 3 on board is another"))
    flight.step()
    assert flight.controller.state is State.PASSIVE
    assert any("hands off: another plan is on board" in text for text in flight.announced)


def test_a_plan_that_is_never_compared_counts_as_another(away):
    flight = away()
    flight.give(PlanReplaced(flight.now_s))
    flight.fly_to_state(State.PASSIVE, PLAN_COMPARED_S + 5.0)


def test_the_same_plan_uploaded_again_is_held_for_and_flown_on(away):
    flight = away(duration_s=400.0)
    flight.give(PlanReplaced(flight.now_s))
    flight.step()
    flight.give(PlanCompared(flight.now_s))
    assert State.PASSIVE not in flight.states
    assert isinstance(flight.motions[-1], FlyToNode)
    flight.lands()
    assert flight.closest_m() >= flight.mission.planner.clearance_m


@pytest.mark.parametrize("held", [True, False])
def test_a_place_chosen_while_a_command_of_ours_was_lost_is_not_left_again(airborne, held):
    """In the mode that it is in: a target while it hovers in Hold, a plan item in Mission."""
    flight = airborne(duration_s=None)
    flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) > 40.0)
    last = flight.controller.gate.last
    if held:
        flight.operator_requests(HoldNow())
        flight.fly_for(6.0)
        flight.shown = {"target": flight.position}
        flight.fly_for(3.0)
    flight.deaf = True
    flight.operator_requests(GoTo((Point(-20.0, -60.0),)) if held else SeekNow("io"))
    flight.deaf = False
    assert "did not follow" in flight.announced[-1]
    commanded = len(flight.motions)
    if held:
        flight.shown = {"target": Point(20.0, 20.0)}
    else:
        flight.shown = {"item": flight.plan.item_of(last.node) + 3}
    flight.fly_for(6.0)
    assert flight.motions[commanded:] == []
    assert flight.controller.state is State.PASSIVE
    assert flight.announced[-1].startswith("hands off: a pilot or ground station ")


@pytest.mark.parametrize("climbing", [False, True])
def test_a_go_to_of_a_ground_station_while_a_plan_is_compared_is_not_overridden(pretend, climbing):
    flight = pretend()
    if climbing:
        flight.take_off_halfway()
    else:
        flight.take_off()
        flight.fly_away()
    flight.give(PlanReplaced(flight.now_s))
    flight.shown = {"target": flight.position}
    flight.fly_for(5.0)
    east_m, north_m = flight.position
    flight.shown = {"target": Point(east_m + 60.0, north_m)}
    flight.fly_for(4.0)
    commanded = len(flight.motions)
    flight.give(PlanCompared(flight.now_s))
    flight.fly_for(5.0)
    assert (flight.controller.state, len(flight.motions)) == (State.PASSIVE, commanded)
    assert flight.announced[-2:] == [
        "hands off: a pilot or ground station gave it another place to go to",
        "the plan on board is equivalent to this mission's",
    ]


def test_a_vehicle_that_holds_already_is_not_commanded_again_before_hands_are_off(away):
    """A go-to of a ground station that has shown for a moment would end."""
    flight = away()
    flight.give(PlanReplaced(flight.now_s))
    flight.shown = {"target": flight.position}
    flight.fly_for(5.0)
    commanded, (east_m, north_m) = len(flight.motions), flight.position
    flight.shown = {"target": Point(east_m + 60.0, north_m)}
    flight.step()
    flight.give(PlanCompared(flight.now_s, "8 items"))
    flight.fly_for(5.0)
    assert (flight.controller.state, len(flight.motions)) == (State.PASSIVE, commanded)


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("up_m", [-9.0, 9.0, 5.0])
def test_another_altitude_that_a_ground_station_gives_a_hovering_vehicle_is_the_pilot_s(
    airborne, held, up_m
):
    flight = airborne()
    flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) > 40.0)
    place = flight.position
    flight.operator_requests(HoldNow() if held else GoTo((place._replace(east_m=place[0] + 20.0),)))
    flight.fly_for(7.0)
    level = {"target": flight.position, "target_altitude_m": 40.0}
    flight.shown = level
    flight.fly_for(4.0)
    commanded = len(flight.motions)
    flight.shown = {**level, "target_altitude_m": 40.0 + up_m}
    flight.fly_for(1.0)
    flight.altitude_m += up_m / 2
    flight.fly_for(2.0)
    assert (flight.controller.state is State.PASSIVE) is (abs(up_m) > 6.0)
    assert flight.motions[commanded:] == []


def test_the_operator_s_hold_while_a_plan_is_compared_stays(away):
    flight = away()
    flight.give(PlanReplaced(flight.now_s))
    flight.operator_requests(HoldNow())
    flight.give(PlanCompared(flight.now_s))
    flight.fly_for(5.0)
    assert flight.controller.state is State.HOLD
    assert isinstance(flight.motions[-1], HoldHere)


def test_a_landing_that_waits_for_a_comparison_lands_whatever_it_finds(away):
    flight = away()
    flight.operator_requests(HoldNow())
    flight.fly_for(6.0)
    flight.give(PlanReplaced(flight.now_s))
    flight.fly_for(1.0)
    flight.operator_requests(LandNow())
    flight.fly_for(1.0)
    assert not isinstance(flight.motions[-1], LandHere)
    flight.give(PlanCompared(flight.now_s, "the fence: item 3 on board is another"))
    announced = len(flight.announced)
    flight.lands(300.0)
    assert len(flight.announced) <= announced + 1


@pytest.mark.parametrize("event", ["breach", "replaced", "reserve"])
def test_nothing_is_commanded_while_it_is_not_known_whose_the_vehicle_is(away, event):
    flight = away()
    lost_s, telemetry, mode = flight.now_s, flight.telemetry, flight.mode
    flight.telemetry = lambda: dataclasses.replace(
        telemetry(), mode=mode, ages=Ages(mode_s=flight.now_s - lost_s)
    )
    flight.fly_for(6.0)
    flight.mode, flight.target = FlightMode.POSITION, None  # the pilot's, not received
    commanded = len(flight.motions)
    match event:
        case "breach":
            flight.position = Point(5000.0, 0.0)
        case "replaced":
            flight.give(PlanReplaced(flight.now_s))
        case "reserve":
            flight.battery = 0.1
    flight.fly_for(25.0)
    assert flight.motions[commanded:] == []
    if event == "replaced":  # received again, and no pilot has it: held for
        flight.telemetry, flight.mode = telemetry, mode
        flight.fly_for(8.0)
        assert [type(motion) for motion in flight.motions[commanded:]] == [HoldHere]


def test_a_plan_uploaded_again_in_the_climb_is_climbed_on_with(pretend):
    flight = pretend()
    flight.take_off_halfway()
    flight.give(PlanReplaced(flight.now_s))
    flight.step()
    flight.give(PlanCompared(flight.now_s))
    flight.fly_until(lambda: isinstance(flight.motions[-1], FlyToNode), 60.0)
    assert flight.altitude_m > flight.mission.altitude_above_home_m - 2.0
    assert flight.controller.state is State.INIT


@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.MISSION])
def test_what_was_given_away_comes_back_only_when_the_operator_requests_it(away, mode):
    flight = away(duration_s=400.0)
    flight.pilot_chooses(FlightMode.OTHER)
    flight.operator_requests(GoOn())
    assert flight.controller.state is State.PASSIVE
    assert any("choose Hold first" in text for text in flight.announced)
    flight.pilot_chooses(mode)
    flight.fly_for(10.0)
    assert flight.controller.state is State.PASSIVE
    flight.operator_requests(GoOn())
    assert flight.controller.state is State.EXPL
    flight.lands()
    assert flight.finished.taken_by is None
    assert flight.closest_m() >= flight.mission.planner.clearance_m


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"failsafe": True}, "failsafe"),
        ({"fix": False}, "no fix"),
        ({"in_air": False}, "on the ground"),
    ],
)
def test_why_a_flight_is_not_resumed(away, change, reason):
    flight = away()
    flight.pilot_chooses(FlightMode.HOLD)
    for name, value in change.items():
        setattr(flight, name, value)
    flight.step()
    flight.operator_requests(GoOn())
    assert flight.controller.state is State.PASSIVE
    assert any(text.startswith("not resumed") and reason in text for text in flight.announced)


def test_a_companion_that_was_restarted_goes_on_when_requested(pretend):
    flight = pretend(duration_s=200.0)
    flight.armed = flight.in_air = True
    flight.mode, flight.altitude_m = FlightMode.HOLD, flight.mission.altitude_above_home_m
    flight.position = flight.mission.waypoints[5].position
    flight.fly_for(5.0)
    assert flight.motions == []
    flight.operator_requests(GoOn())
    assert flight.controller.state is State.INIT
    flight.lands()


def test_a_failsafe_while_it_hovers_in_hold_by_our_command_takes_it_over(pretend):
    flight = pretend()
    flight.robots = dict(CORNERS)
    flight.take_off()
    flight.fly_to_state(State.COMM)
    flight.fly_until(lambda: flight.mode is FlightMode.HOLD)
    flight.failsafe = True
    flight.step()
    assert flight.controller.state is State.PASSIVE
    assert any("an autopilot failsafe" in text for text in flight.announced)


def killed(flight, altitude_m, mode):
    """Disarmed by force: PX4 reports within a second that it has landed, and it falls."""
    flight.altitude_m = altitude_m
    flight.step()
    flight.armed, flight.mode = False, mode
    flight.step()
    flight.in_air = False
    while flight.altitude_m > 0.0:
        assert flight.finished is None
        flight.altitude_m = max(0.0, flight.altitude_m - 1.0)
        flight.step()
    flight.ends(5.0)


@pytest.mark.parametrize("state", [State.INIT, State.LAND])
def test_motors_stopped_in_the_air_are_announced_as_that_until_it_is_down(airborne, state):
    flight = airborne(duration_s=60.0 if state is State.LAND else None)
    flight.fly_to_state(state)
    killed(flight, 28.0, FlightMode.MISSION)  # PX4 falls back to it, out of Land
    assert "hands off: disarmed in the air at 28 m above home" in flight.announced
    assert not flight.finished.landed_by_us
    assert flight.finished.why == "disarmed in the air at 28 m above home"
    assert flight.finished.taken_by is None
    assert not any("pilot chose" in text for text in flight.announced)


def test_a_flight_termination_is_announced(airborne):
    flight = airborne()
    flight.fly_to_state(State.INIT)
    flight.terminated = True
    flight.step()
    assert "hands off: flight terminated in the air at 40 m above home" in flight.announced
    assert flight.controller.state is State.PASSIVE


def test_a_landing_whose_landed_state_comes_late_is_no_takeover(airborne):
    flight = airborne(duration_s=60.0)
    flight.fly_to_state(State.LAND)
    flight.fly_until(lambda: flight.altitude_m < 0.1)
    flight.armed, flight.mode = False, FlightMode.MISSION  # in_air is of another stream
    flight.altitude_m = 0.0
    flight.step()
    assert flight.finished.landed_by_us
    assert flight.finished.taken_by is None


def astray(flight):
    """Where the leg under way may not be flown on from."""
    legs, clear = flight.mission.airspace, flight.mission.planning_airspace.point_clear
    end = flight.controller.context.task.way.leg.to
    places = (Point(*place) for place in itertools.product(range(-150, 100, 5), repeat=2))
    return next(place for place in places if clear(place) and not legs.leg_clear(place, end))


def too_near(flight):
    """Within the clearance of a zone."""
    (east_m, north_m), *_ = flight.mission.zones[0].polygon.exterior.coords
    zones = Airspace(None, flight.mission.zones, 0.0)
    places = (Point(east_m + e, north_m + n) for e, n in itertools.product((-3.0, 3.0), repeat=2))
    return next(place for place in places if 1.0 < zones.distance_m(place) < 4.5)


@pytest.mark.parametrize("order", ["item", "target"])
@pytest.mark.parametrize("place", [astray, too_near])
def test_no_hold_of_ours_ends_an_order_of_a_pilot_before_it_is_known_as_such(away, order, place):
    """It leads the vehicle from its leg, and perhaps near to zones, at once."""
    flight = away()
    if order == "target":
        flight.operator_requests(
            GoTo((flight.position._replace(east_m=flight.position[0] + 20.0),))
        )
        flight.fly_for(1.0)
        assert isinstance(flight.motions[-1], FlyToPoint)
    commanded, elsewhere = len(flight.motions), {"item": 20, "target": Point(0.0, 80.0)}
    flight.shown = {order: elsewhere[order]}
    flight.position = place(flight)
    flight.fly_for(1.4)
    robot = flight.controller.context.task.robot or "io"
    flight.give(RobotPose(robot, CORNERS["io"], 1e9, robot))
    flight.fly_for(0.6)
    assert flight.controller.state is State.PASSIVE
    assert flight.motions[commanded:] == []


def test_what_looked_like_a_pilot_s_order_for_a_moment_is_held_for_after_it(away):
    flight = away()
    commanded = len(flight.motions)
    flight.shown = {"item": 20}
    flight.position = astray(flight)
    flight.fly_for(1.0)
    assert flight.motions[commanded:] == []
    flight.shown = {}
    flight.step()
    assert len(flight.motions) > commanded


def test_what_robots_publish_ends_no_order_that_may_be_a_pilot_s(pretend):
    flight = pretend()
    flight.robots = dict(CORNERS)
    flight.take_off()
    flight.fly_to_state(State.COMM)
    flight.robots = {}
    flight.fly_until(lambda: flight.mode is FlightMode.HOLD)
    flight.fly_for(3.0)
    robot, commanded = flight.controller.context.task.robot, len(flight.motions)
    flight.shown = {"target": Point(0.0, 80.0), "velocity_m_s": (5.0, 5.0)}
    flight.step()
    for place in itertools.product(range(-150, 100, 25), repeat=2):
        flight.give(RobotPose(robot, Point(*place), 1e9 + len(flight.events), robot))
    assert flight.motions[commanded:] == []
    flight.shown = {}
    flight.fly_for(1.0)
    assert isinstance(flight.motions[-1], FlyToPoint | FlyToNode | HoldHere)
    assert len(flight.motions) > commanded


def test_while_the_plan_on_board_is_compared_no_state_sends_it_anywhere(pretend):
    flight = pretend()
    flight.robots = CORNERS
    flight.take_off()
    flight.fly_to_state(State.COMM)
    before = len(flight.motions)
    flight.give(PlanReplaced(flight.now_s))
    flight.fly_until(lambda: flight.controller.state is State.EXPL, PLAN_COMPARED_S - 1.0)
    assert {type(motion) for motion in flight.motions[before:]} <= {HoldHere}
    flight.give(PlanCompared(flight.now_s, None))
    assert isinstance(flight.motions[-1], FlyToNode | FlyToPoint)


# Alarms that are not answered.


def holds(flight):
    """A hold of ours that has been decided on, for a lost fix, and of which nothing shows yet."""
    flight.slow, flight.fix = True, False
    flight.step()
    assert isinstance(flight.motions[-1], HoldHere)
    return flight.motions[-1]


def crossing_alarms(flight):
    alarms = [a for a in flight.actions if isinstance(a, Announce)]
    return [alarm for alarm in alarms if "still under way" in alarm.text]


@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.RETURN, FlightMode.LAND])
def test_a_mode_that_kept_an_order_from_leaving_is_the_pilots(away, mode):
    """Hold among them: the hold that was about to leave does not explain it."""
    flight = away()
    order = holds(flight)
    flight.give(CommandFailed(order, "it was not sent", sent=False, taken=mode))
    assert flight.controller.state is State.PASSIVE
    assert flight.announced[-1] == f"hands off: the pilot chose {mode.value} mode"
    assert flight.controller.gate.pending is None


def test_a_hold_that_was_not_sent_explains_no_hold_mode(away):
    flight = away()
    order = holds(flight)
    flight.give(CommandFailed(order, "no current flight mode was received", sent=False))
    flight.pilot_chooses(FlightMode.HOLD)
    assert flight.controller.state is State.PASSIVE


def test_a_hold_that_was_sent_and_not_confirmed_explains_hold_mode(away):
    flight = away()
    order = holds(flight)
    flight.give(CommandFailed(order, "it does not show", sent=True))
    flight.mode = FlightMode.HOLD
    flight.step()
    assert flight.controller.state is not State.PASSIVE


def test_an_order_that_crossed_the_pilots_choice_is_an_alarm_with_an_instruction(away):
    flight = away()
    holds(flight)
    flight.pilot_chooses(FlightMode.RETURN)
    assert flight.announced[-1] == "hands off: the pilot chose Return mode"
    flight.mode = FlightMode.HOLD  # our hold has reached it behind the pilot's choice
    flight.step()
    (alarm,) = crossing_alarms(flight)
    assert alarm.severity is Severity.ALARM
    assert alarm.text == "Hold mode followed Return mode: our command was still under way"
    assert alarm.instruction == CHOOSE_AGAIN


@pytest.mark.parametrize("seen_s", [0.5, 10.0])
def test_a_hold_that_the_pilot_chooses_after_another_mode_is_no_alarm(away, seen_s):
    flight = away()
    if seen_s > FAILSAFE_LATE_S:
        holds(flight)
    flight.pilot_chooses(FlightMode.RETURN)
    flight.fly_for(seen_s)
    flight.mode = FlightMode.HOLD
    flight.step()
    assert crossing_alarms(flight) == []
