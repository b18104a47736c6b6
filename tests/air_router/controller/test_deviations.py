"""Deviations from the plan: announced as they begin, and held for, by the table of `deviations`."""

import dataclasses
import math

import pytest

from air_router.controller.airspace_change import counted, plans_for
from air_router.controller.envelope import ClearanceWatch, ReturnMonitor
from air_router.controller.limits import OFF_ALTITUDE_HOME_S, OFF_ALTITUDE_S, OVERSPEED_S
from air_router.controller.model.actions import (
    FlyToNode,
    FlyToPoint,
    HoldHere,
    Refusal,
    RenewPlan,
    ReplanAirspace,
)
from air_router.controller.model.events import AirspaceChanged, PlanRenewed
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.requests import ComeHome, ExploreNow, GoOn, HoldNow
from air_router.controller.model.states import State
from air_router.controller.states.return_state import HomeReachability
from air_router.routing.departure import names_of
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from air_router.vehicle.height_frame import HomeMove
from air_router.vehicle.instructions import BRING_HOME_BY_HEIGHT, RETURN_ELSEWHERE, Severity
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Band, Circle, Outline, Zone
from geo.frame import Point
from tests.air_router.conftest import Airframe

LOWER, HIGHER = HomeMove(0.0, 0.0, -25.0), HomeMove(0.0, 0.0, 40.0)


@pytest.fixture
def cruising(away):
    """A flight on its way, whose home is far from where it is."""
    return away(duration_s=600.0)


def fly(flight, seconds):
    end_s = flight.now_s + seconds
    flight.fly_until(lambda: flight.now_s >= end_s)


def announced(flight, part):
    return [text for text in flight.announced if part in text]


@pytest.mark.parametrize("moved", [LOWER, HomeMove(30.0, 40.0, 15.0)])
def test_home_moved_up_or_down_it_holds_at_once_and_flies_on_in_the_planned_height(cruising, moved):
    cruising.home_moved = moved
    before = len(cruising.motions)
    cruising.step()
    assert isinstance(cruising.motions[before], HoldHere)
    assert len(announced(cruising, "home was moved")) == 1
    cruising.ends()
    after = cruising.motions[before + 1 :]
    assert not any(isinstance(motion, FlyToNode) for motion in after)
    heights_m = {motion.altitude_m for motion in after if isinstance(motion, FlyToPoint)}
    assert heights_m == {cruising.mission.altitude_above_home_m}
    assert cruising.finished.landed_by_us
    assert len(announced(cruising, "home was moved")) == 1


def test_a_jump_that_was_decided_before_home_moved_is_not_sent(cruising):
    motion = next(m for m in reversed(cruising.motions) if isinstance(m, FlyToNode))
    telemetry = cruising.telemetry()
    cruising.controller.gate.pending = motion
    navigator = cruising.controller.navigator
    assert navigator.objection(motion, telemetry.time_s) is None
    cruising.home_moved = LOWER
    cruising.controller.context.telemetry = cruising.telemetry()
    assert "home was moved" in navigator.objection(motion, telemetry.time_s)


def test_home_moved_aside_is_announced_and_flown_on(cruising):
    cruising.home_moved = HomeMove(60.0, 0.0, 0.5)
    before = len(cruising.motions)
    fly(cruising, 1.0)
    assert not any(isinstance(motion, HoldHere) for motion in cruising.motions[before:])
    (text,) = announced(cruising, "home was moved")
    assert "60 m east" in text


@pytest.mark.parametrize("state", [State.HOLD, State.HOME, State.LAND, State.PASSIVE])
def test_home_moved_is_announced_in_every_state_in_the_air(airborne, state):
    flight = airborne(duration_s=60.0)
    if state is State.HOLD:
        flight.fly_away()
        flight.operator_requests(HoldNow(by="operator"))
    elif state is State.PASSIVE:
        flight.fly_away()
        flight.pilot_chooses(FlightMode.OTHER)
    flight.fly_to_state(state)
    flight.home_moved = LOWER
    flight.step()
    assert len(announced(flight, "home was moved")) == 1


def test_home_moved_in_the_climb_it_comes_down_again(pretend):
    flight = pretend()
    flight.take_off_halfway()
    flight.home_moved = LOWER
    flight.step()
    assert State.HOME in flight.states
    assert announced(flight, "home was moved in the climb")


def test_a_battery_at_its_reserve_in_the_climb_is_announced_and_ends_it(pretend):
    flight = pretend()
    flight.take_off_halfway()
    flight.battery = 0.2
    flight.step()
    assert flight.states[-2:] == [State.HOME, State.LAND]
    assert announced(flight, "coming home: battery at 20%")
    flight.lands()


@pytest.mark.parametrize("off_m", [-8.0, 8.0])
def test_sinking_or_climbing_off_its_altitudes_is_announced_and_held_for(cruising, off_m):
    for _ in range(20):
        cruising.altitude_m += off_m / 20
        cruising.step()
    before = len(cruising.motions)
    fly(cruising, OFF_ALTITUDE_S + 0.5)
    assert isinstance(cruising.motions[before], HoldHere)
    assert len(announced(cruising, "too low" if off_m < 0 else "too high")) == 1
    fly(cruising, OFF_ALTITUDE_HOME_S)
    assert cruising.controller.state is State.HOME


def test_a_vehicle_that_comes_down_to_its_altitudes_is_left_alone(pretend):
    flight = pretend()
    Airframe.take_off(flight)
    flight.altitude_m += 30.0
    for _ in range(300):
        flight.altitude_m -= 0.1
        flight.step()
    assert not announced(flight, "too high")


def test_a_jump_of_the_altitude_is_held_for_until_it_is_back(cruising):
    cruising.altitude_m += 12.0
    before = len(cruising.motions)
    fly(cruising, 10.0)
    (hold,) = cruising.motions[before:]
    assert isinstance(hold, HoldHere)
    assert len(announced(cruising, "the altitude jumped from 40 to 52 m")) == 1
    cruising.altitude_m -= 12.0
    fly(cruising, 5.0)
    assert cruising.motions[before + 1 :]
    assert cruising.controller.state is not State.HOME


def test_a_lost_clearance_is_announced_while_it_happens_and_held_for(cruising):
    mission = cruising.mission
    cruising.position = next(
        place
        for east in range(-160, 110)
        for place in (Point(float(east), float(north)) for north in range(-160, 110, 7))
        if 3.0 < mission.airspace.distance_m(place) < 4.5
    )
    cruising.velocity = (0.0, 0.0)
    distance_m, name = mission.airspace.nearest(cruising.position)
    before = len(cruising.motions)
    cruising.step()
    assert isinstance(cruising.motions[before], HoldHere)
    (text,) = announced(cruising, "m are required")
    assert names_of((name,)) in text
    left_m = float(text.split(": ")[1].split()[0])
    assert left_m == pytest.approx(distance_m, abs=1.0)
    cruising.lands()


def test_a_zone_far_above_counts_once_it_has_climbed_there(pennovation):
    east_m, north_m = home = pennovation.home
    corners = ((3.0, -9.0), (9.0, -9.0), (9.0, 9.0), (3.0, 9.0))
    outline = tuple(Point(east_m + e, north_m + n) for e, n in corners)
    high = Zone("high", outline, band=Band(70.0, math.inf))
    mission = pennovation.with_areas(pennovation.fences, (*pennovation.zones, high))
    watch = ClearanceWatch(MissionContext(mission, None))
    assert watch.update(Telemetry(1.0, home, 60.0)) is None
    found = watch.update(Telemetry(2.0, home, 75.0))
    assert found is not None
    assert "too near to no-fly zone 'high'" in found.words


def test_faster_than_commanded_is_announced_and_held_for(cruising):
    east_m_s, north_m_s = cruising.velocity
    speed_m_s = math.hypot(east_m_s, north_m_s)
    before = len(cruising.motions)

    def rushes():
        telemetry = type(cruising).telemetry(cruising)
        velocity = (12.0 * east_m_s / speed_m_s, 12.0 * north_m_s / speed_m_s)
        return dataclasses.replace(telemetry, velocity_m_s=velocity)

    cruising.telemetry = rushes
    cruising.fly_until(lambda: announced(cruising, "it flies at 12.0 m/s"), OVERSPEED_S + 0.5)
    assert isinstance(cruising.motions[before], HoldHere)


@pytest.fixture
def off_by(pretend):
    """A flight whose satellites' altitude is off by what the list has last."""
    flight, off_m = pretend(duration_s=600.0), [0.0]

    def reads():
        telemetry = Airframe.telemetry(flight)
        amsl_m = 489.0 + telemetry.altitude_m
        gps_m = amsl_m + 2.0 + off_m[-1]  # never the same
        return dataclasses.replace(telemetry, altitude_amsl_m=amsl_m, gps_amsl_m=gps_m)

    flight.telemetry = reads
    return flight, off_m


def test_an_altitude_that_the_satellites_do_not_follow_is_announced_and_brings_it_home(off_by):
    flight, off_m = off_by
    flight.take_off()
    flight.fly_away()
    for _ in range(300):  # 0.3 m/s, as a barometer drifts
        off_m[-1] -= 0.03
        flight.step()
    first, last = announced(flight, "the altitude is in doubt")
    assert first.endswith("40 m by the autopilot, 36 m by the satellites")
    assert last.startswith("coming home")
    assert flight.controller.state in {State.HOME, State.LAND}


@pytest.mark.parametrize("later_s", [0.0, 60.0])
@pytest.mark.parametrize("silent_s", [0.0, 10.0])
def test_one_bad_altitude_of_the_satellites_raises_no_doubt(off_by, later_s, silent_s):
    """It is believed for 1.5 s at most, and may be the first after the receiver had no fix."""
    flight, off_m = off_by
    flight.take_off()
    fly(flight, later_s)
    flight.now_s += silent_s
    off_m.append(4000.0)
    fly(flight, 1.5)
    off_m.append(0.0)
    fly(flight, 30.0)
    assert not announced(flight, "in doubt")


@pytest.mark.parametrize(("off", "soon_s"), [(8.0, 6.0), (60.0, 4.0)])
def test_an_altitude_that_is_off_for_good_is_announced_within_seconds(off_by, off, soon_s):
    flight, off_m = off_by
    flight.take_off()
    flight.fly_away()
    off_m.append(off)
    fly(flight, soon_s)
    assert announced(flight, "coming home: the altitude is in doubt")


ABOVE, BELOW = Band(48.0, 70.0), Band(20.0, 32.0)


def in_doubt(off_by, off, *zones_between):
    """A vehicle that holds away from home, its altitude in doubt; and the first of those zones."""
    flight, off_m = off_by
    flight.hold_away()
    mission = flight.mission
    zones = [between(flight.position, mission.home) for between in zones_between]
    flight.give(AirspaceChanged(mission.fences, (*mission.zones, *zones)))
    fly(flight, 1.0)
    flight.give(PlanRenewed())
    off_m.append(off)
    flight.fly_until(lambda: announced(flight, "coming home: the altitude is in doubt"), 10.0)
    return flight, zones[0]


def beside(band):
    """What a vehicle can fly around that comes home."""

    def between(here, home):
        middle = Point(*((a + b) / 2 for a, b in zip(here, home, strict=True)))
        return Zone("doubtful", Circle(middle, 8.0), band=band)

    return between


def around(_here, home):
    """What leaves no way home above it."""
    ring, hole = (Circle(home, radius_m).corners for radius_m in (30.0, 20.0))
    return Zone("ring", Outline(ring, (hole,)), band=ABOVE)


def requested(flight, action):
    return [each for each in flight.actions if isinstance(each, action)]


def replanned(flight):
    """The requested ways are planned."""
    mission = flight.controller.context.airspace.mission
    flight.give(AirspaceChanged(mission.fences, mission.drawn))


def on_board(flight):
    """The plan that is uploaded is on board."""
    before = len(requested(flight, RenewPlan))
    flight.fly_until(lambda: len(requested(flight, RenewPlan)) > before, 30.0)
    flight.give(PlanRenewed())


@pytest.mark.parametrize(("off", "band"), [(8.0, ABOVE), (-8.0, ABOVE), (8.0, BELOW)])
def test_with_its_altitude_in_doubt_it_comes_home_clear_of_zones_at_every_height(off_by, off, band):
    flight, zone = in_doubt(off_by, off, beside(band))
    since, router = len(flight.track), flight.controller.context.airspace.router
    flight.step()
    assert (
        flight.controller.context.airspace.router is router
    )  # it is replaced by one made elsewhere
    replanned(flight)
    assert "zones changed: all apply at every altitude" in flight.announced
    on_board(flight)
    flight.lands()
    assert Airspace(None, [zone], 5.0).track_distance_m(flight.track[since:])[0] >= 5.0
    assert len(requested(flight, ReplanAirspace)) == 1


def test_with_its_altitude_in_doubt_it_leaves_a_zone_that_ends_below_it(off_by):
    flight, zone = in_doubt(off_by, 8.0, lambda here, _: Zone("low", Circle(here, 9.0), band=BELOW))
    replanned(flight)
    assert Airspace(None, [zone], 0.0).zones_at(flight.position)
    fly(flight, 1.0)
    assert announced(flight, "leaving no-fly zone 'low'")
    on_board(flight)
    assert not Airspace(None, [zone], 0.0).zones_at(flight.position)
    flight.lands()


@pytest.mark.parametrize(("lower_m", "counts"), [(95.0, True), (96.0, False)])
def test_zones_that_begin_far_above_are_none_with_the_altitude_in_doubt_either(
    off_by, lower_m, counts
):
    """The cruise ends at 45 m, and airspace classes of whole countries begin some way above it."""
    band = Band(lower_m, 900.0)
    flight, _ = in_doubt(off_by, 8.0, lambda here, _: Zone("class", Circle(here, 30.0), band=band))
    fly(flight, 1.0)
    assert bool(requested(flight, ReplanAirspace)) == counts
    if not counts:
        flight.lands()


def test_zones_above_home_are_none_with_the_altitude_in_doubt_either(off_by):
    """It took off below them: if they counted, no way would lead home."""
    flight, _ = in_doubt(off_by, 8.0, lambda _, home: Zone("over", Circle(home, 900.0), band=ABOVE))
    flight.lands()
    assert not requested(flight, ReplanAirspace)


def test_zones_that_are_reloaded_with_the_altitude_in_doubt_count_at_every_height_too(off_by):
    flight, _ = in_doubt(off_by, 8.0, beside(ABOVE))
    mission = flight.controller.context.airspace.mission
    another = Zone("another", Circle(Point(500.0, 500.0), 9.0), band=BELOW)
    flight.give(AirspaceChanged(mission.fences, (*mission.zones, another)))
    now = flight.controller.context.airspace.mission
    assert {"doubtful", "another"} <= {zone.name for zone in now.airspace.zones}
    assert now.drawn[-1] == another
    on_board(flight)
    fly(flight, 3.0)
    assert len(requested(flight, ReplanAirspace)) == 1  # which came too late
    assert announced(flight, "zones changed: 'another' is new, all apply at every altitude")


@pytest.mark.parametrize("taken", [True, False])
def test_zones_that_count_at_every_height_hold_no_vehicle_of_a_pilot_and_no_landing(off_by, taken):
    flight, _ = in_doubt(off_by, 8.0, beside(ABOVE))
    if taken:
        flight.pilot_chooses(FlightMode.POSITION)
    else:
        flight.fly_to_state(State.LAND)
    before, uploads = len(flight.motions), len(requested(flight, RenewPlan))
    replanned(flight)
    fly(flight, 1.0)
    assert flight.motions[before:] == []
    assert len(requested(flight, RenewPlan)) == uploads
    assert flight.controller.state is (State.PASSIVE if taken else State.LAND)
    if not taken:
        flight.lands()


def test_zones_that_counted_at_every_height_while_a_pilot_had_it_go_on_board_once_it_is_resumed(
    off_by,
):
    flight, zone = in_doubt(off_by, 8.0, beside(ABOVE))
    flight.pilot_chooses(FlightMode.POSITION)
    replanned(flight)
    flight.pilot_chooses(FlightMode.HOLD)
    since = len(flight.track)
    assert flight.operator_requests(GoOn()).accepted
    on_board(flight)
    flight.give(ComeHome())
    flight.lands()
    assert Airspace(None, [zone], 5.0).track_distance_m(flight.track[since:])[0] >= 5.0


def test_ways_that_are_planned_while_a_plan_is_put_on_board_are_requested_again(off_by):
    flight, _ = in_doubt(off_by, 8.0, beside(ABOVE))
    flight.controller.airspace_update.upload_again()
    before = len(requested(flight, RenewPlan))
    flight.fly_until(lambda: len(requested(flight, RenewPlan)) > before, 30.0)
    replanned(flight)
    assert not announced(flight, "zones not changed")
    fly(flight, 1.0)
    assert len(requested(flight, ReplanAirspace)) == 1
    flight.give(PlanRenewed())
    flight.step()
    assert len(requested(flight, ReplanAirspace)) == 2


def test_with_its_altitude_in_doubt_by_a_jump_that_is_held_for_before_zones_change(off_by):
    flight, _ = off_by
    flight.hold_away()
    mission, reads = flight.mission, flight.telemetry
    zone = beside(ABOVE)(flight.position, mission.home)
    flight.give(AirspaceChanged(mission.fences, (*mission.zones, zone)))
    on_board(flight)
    fly(flight, 1.0)

    def reads_low():
        telemetry = reads()
        low_m, low_amsl_m = telemetry.altitude_m - 8.0, telemetry.altitude_amsl_m - 8.0
        return dataclasses.replace(telemetry, altitude_m=low_m, altitude_amsl_m=low_amsl_m)

    flight.telemetry = reads_low
    flight.fly_until(lambda: announced(flight, "coming home: the altitude is in doubt"), 10.0)
    fly(flight, 5.0)
    assert not requested(flight, ReplanAirspace)
    flight.telemetry = reads
    fly(flight, 4.0)
    assert len(announced(flight, "the altitude jumped")) == 2
    assert len(requested(flight, ReplanAirspace)) == 1


def test_in_haste_it_comes_home_clear_of_zones_at_every_height_without_them_on_board(off_by):
    flight, zone = in_doubt(off_by, 8.0, beside(ABOVE))
    since = len(flight.track)
    flight.battery = flight.mission.battery_reserve
    replanned(flight)
    flight.lands()
    assert announced(flight, "not on board: it comes home at once, for its battery")
    assert Airspace(None, [zone], 5.0).track_distance_m(flight.track[since:])[0] >= 5.0


def covers(_here, home):
    """What is above everything but home."""
    ring, hole = (Circle(home, radius_m).corners for radius_m in (900.0, 25.0))
    return Zone("shelf", Outline(ring, (hole,)), band=ABOVE)


@pytest.mark.parametrize(
    ("zones", "alarm"),
    [
        ((around,), "no way home is clear at every altitude"),
        ((covers, around), "no way out of no-fly zone 'shelf'"),
    ],
)
@pytest.mark.parametrize("by_request", [True, False])
def test_where_no_way_is_clear_at_every_height_the_operator_or_the_reserve_decides(
    off_by, by_request, zones, alarm
):
    flight, _ = in_doubt(off_by, 8.0, *zones)
    replanned(flight)
    if covers not in zones:
        on_board(flight)
    flight.fly_until(lambda: announced(flight, alarm), 10.0)
    alarms = [each for each in flight.announcements if alarm in each.text]
    assert {(each.severity, each.instruction) for each in alarms} == {
        (Severity.ALARM, BRING_HOME_BY_HEIGHT)
    }
    fly(flight, 25.0)
    assert isinstance(flight.motions[-1], HoldHere)
    if by_request:
        answer = flight.operator_requests(ComeHome())
        assert answer.accepted
        assert "clear at PX4's altitude" in answer.why
    else:
        flight.battery = flight.mission.battery_reserve
    fly(flight, 1.0)
    assert announced(flight, "coming home, clear of zones by PX4's altitude alone")
    assert len(requested(flight, ReplanAirspace)) == 2
    replanned(flight)
    assert "zones changed: each applies at its altitudes again" in flight.announced
    before = len(flight.motions)
    fly(flight, 3.0)
    # PX4 would hold it at the fence on board: also at the reserve that is lifted first.
    assert all(isinstance(motion, HoldHere) for motion in flight.motions[before:])
    flight.give(PlanRenewed())
    flight.lands(200.0)
    assert len(requested(flight, ReplanAirspace)) == 2


def test_while_a_way_is_opened_home_once_more_trusts_no_altitude_that_is_in_doubt(off_by):
    flight, _ = in_doubt(off_by, 8.0, around, beside(ABOVE))
    replanned(flight)
    on_board(flight)
    flight.fly_until(lambda: announced(flight, "no way home is clear at every altitude"), 10.0)
    mission = flight.controller.context.airspace.mission
    zones = tuple(zone for zone in mission.drawn if zone.name != "ring")
    flight.give(AirspaceChanged(mission.fences, zones))
    fly(flight, 3.0)
    assert "already" in flight.operator_requests(ComeHome()).why
    flight.give(PlanRenewed())
    flight.lands()
    assert not announced(flight, "coming home, clear of zones by PX4's altitude alone")


def test_a_router_among_zones_of_other_heights_is_another_though_they_count_at_all(pennovation):
    def drawn(band):
        zone = Zone("doubtful", Circle(Point(90.0, 60.0), 5.0), band=band)
        mission = pennovation.with_areas(pennovation.fences, (*pennovation.zones, zone))
        return counted(mission, all_zones=True)

    above, below = drawn(ABOVE), drawn(BELOW)
    assert above.zones == below.zones
    router = Router(WaypointGraph(above))
    assert (plans_for(router, above), plans_for(router, below)) == (True, False)
    assert counted(below, all_zones=False).zones[-1].band == BELOW


def test_a_way_home_that_was_requested_and_is_needed_since_may_not_be_called_off(off_by):
    flight, off_m = off_by
    flight.take_off()
    flight.fly_away()
    flight.give(ComeHome())
    off_m.append(8.0)
    fly(flight, 12.0)
    assert flight.controller.state is State.HOME
    refused = flight.operator_requests(ExploreNow())
    assert refused.code is Refusal.COMING_HOME
    assert refused.why.startswith("it comes home: the operator's request; the altitude is in doubt")


def test_a_home_that_px4_corrects_is_no_jump_of_the_altitude(cruising):
    cruising.telemetry = lambda: dataclasses.replace(
        Airframe.telemetry(cruising), altitude_amsl_m=529.0
    )
    cruising.step()
    before = len(cruising.motions)
    cruising.altitude_m += 2.9
    fly(cruising, 2.0)
    assert not any(isinstance(motion, HoldHere) for motion in cruising.motions[before:])


def test_home_moved_while_zones_go_on_board_is_held_for(cruising):
    mission = cruising.mission
    cruising.give(AirspaceChanged(mission.fences, mission.zones[:-1]))
    fly(cruising, 1.0)
    assert isinstance(cruising.motions[-1], FlyToNode)  # its leg is still clear
    cruising.home_moved = LOWER
    cruising.step()
    assert isinstance(cruising.motions[-1], HoldHere)
    fly(cruising, 3.0)
    cruising.give(PlanRenewed(None))
    fly(cruising, 3.0)
    assert isinstance(cruising.motions[-1], FlyToPoint)  # at the planned height


def test_a_jump_of_the_altitude_is_forgotten_once_the_pilot_has_had_the_vehicle(cruising):
    cruising.altitude_m += 12.0
    fly(cruising, 1.0)
    cruising.pilot_chooses(FlightMode.POSITION)
    cruising.altitude_m = 20.0
    fly(cruising, 1.0)
    cruising.pilot_chooses(FlightMode.HOLD)
    cruising.give(GoOn())
    fly(cruising, 20.0)
    assert "climbing from 20 to 40 m first" in cruising.announced
    assert cruising.controller.state is not State.HOME


def test_home_that_px4_may_have_set_itself_is_no_operator_s_move(cruising):
    cruising.fix = False
    cruising.step()
    cruising.home_moved = LOWER
    cruising.step()
    (warning,) = [a for a in cruising.announcements if "home was" in a.text]
    assert warning.text.startswith(
        "home was set again while GPS has no fix, as PX4 does on its own: "
    )
    assert (warning.severity, warning.instruction) == (Severity.WARNING, RETURN_ELSEWHERE)


def test_home_that_px4_set_as_it_touched_down_is_no_operator_s_move(airborne):
    """A landing detection that bounces is a lift-off to PX4, which sets home there."""
    flight = airborne(duration_s=60.0)
    flight.fly_away()
    flight.pilot_chooses(FlightMode.LAND)
    flight.in_air = False
    flight.step()
    flight.in_air, flight.home_moved = True, HIGHER
    flight.step()
    (warning,) = [a for a in flight.announcements if "home was" in a.text]
    assert warning.text.startswith("home was set again as it lifted off or touched down")
    assert warning.instruction == RETURN_ELSEWHERE
    flight.home_moved = None
    flight.fly_for(10.0)
    flight.home_moved = HIGHER
    flight.step()
    assert announced(flight, "home was moved")  # long after that it is a station's


def test_a_mission_without_a_vertical_margin_is_flown_without_a_false_alarm(airborne, pennovation):
    planner = dataclasses.replace(pennovation.planner, vertical_margin_m=0.0)
    flight = airborne(duration_s=60.0, planner=planner, cruise=Band(40.0, 40.0))
    for number in range(200):
        flight.altitude_m = 40.0 + (2.3 if number > 20 else 0.0)
        flight.step()
    assert not announced(flight, "too high")


def test_much_slower_than_commanded_is_announced_once_and_flown_on(cruising):
    pace_m_s, before = 2.0 / 5.0, len(cruising.motions)
    wanted = cruising.wanted
    cruising.wanted = lambda: tuple(pace_m_s * component for component in wanted())
    fly(cruising, 40.0)
    assert len(announced(cruising, "it flies only at")) == 1
    assert not any(isinstance(motion, HoldHere) for motion in cruising.motions[before:])


def test_battery_and_duration_bring_it_home(pennovation):
    context = MissionContext(dataclasses.replace(pennovation, duration_s=60.0), None)
    returns = ReturnMonitor(context, HomeReachability(context))

    def due(now_s, battery):
        context.now_s, context.task.airborne_s = now_s, 0.0
        return returns.due(Telemetry(now_s, pennovation.home, 40.0, battery=battery))

    assert due(59.9, 0.9) is None
    assert due(60.0, 0.9).why == "mission duration (60 s) reached"
    assert due(0.0, pennovation.battery_reserve).why.startswith("battery at")
    assert due(0.0, None) is None
