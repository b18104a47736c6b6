import dataclasses
import math
import random

import pytest

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere, LandHere
from air_router.controller.model.events import CommandConfirmed, CommandFailed
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.requests import ExploreNow, GoTo
from air_router.controller.model.states import State
from air_router.controller.model.task import Goal
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import Navigator
from air_router.routing.limits import STANDING_M_S
from air_router.routing.router import Leg, Route
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Point

GIVEN_UP_S = 3.0
SEEK = ("callisto", "europa", "io")


def at(east_m, north_m, **more):
    return Telemetry(time_s=1.0, position=Point(east_m, north_m), altitude_m=40.0, **more)


@pytest.fixture
def bend(pretend, pennovation):
    """A vehicle on its way east; south of the rest of its way a zone, and south of that a goal."""
    box = ((40.0, -30.0), (60.0, -30.0), (60.0, -15.0), (40.0, -15.0))
    zone = Zone("box", tuple(Point(*corner) for corner in box))
    airspace = Airspace(None, [zone], 5.0)
    mission = dataclasses.replace(
        pennovation,
        zones=(zone,),
        fences=(),
        home=Point(0.0, 0.0),
        waypoints=pennovation.waypoints[:1],
        airspace=airspace,
        planning_airspace=airspace.with_margin(1.5),
        climb_airspace=airspace,
        above_airspace=airspace,
    )
    return pretend(mission)


def navigating(flight, telemetry):
    context = MissionContext(flight.mission, flight.router, telemetry=telemetry)
    gate = CommandGate(context, flight.plan)
    return context, gate, Navigator(context, gate)


def test_a_jump_that_might_arrive_late_is_held_for_first(bend):
    context, gate, navigator = navigating(bend, at(15.0, 0.0, velocity_m_s=(3.5, 0.0)))
    way = FlyToPoint(Point(100.0, 0.0), 40.0)
    gate.setpoints.sent(way)
    gate.setpoints.confirmed(way)
    goal = Goal(Point(15.0, -60.0))
    motion = navigator.plan_to(goal)
    assert isinstance(motion, HoldHere)  # sent from farther on it would cut the box
    gate.setpoints.sent(motion)
    stands = context.telemetry = at(20.0, 0.0)
    assert navigator.update(stands) is None  # the way east is not over while that is not confirmed
    assert isinstance(navigator.again(), HoldHere)
    gate.setpoints.confirmed(motion)
    assert navigator.update(stands) == FlyToPoint(goal.position, 40.0)


def test_a_jump_that_may_arrive_late_is_given_at_once(bend):
    _, gate, navigator = navigating(bend, at(15.0, 0.0, velocity_m_s=(3.5, 0.0)))
    gate.setpoints.sent(FlyToPoint(Point(100.0, 0.0), 40.0))
    assert navigator.plan_to(Goal(Point(15.0, 60.0))) == FlyToPoint(Point(15.0, 60.0), 40.0)


def test_a_near_end_of_a_leg_is_only_passed_where_the_next_leg_is_clear(bend):
    near, beyond = Point(51.0, -5.0), Point(50.0, -60.0)
    route = Route((Leg(near), Leg(beyond)), 60.0)
    bend.router.route = lambda *_, **__: route
    *_, navigator = navigating(bend, at(50.0, -5.0))
    assert navigator.plan_to(Goal(beyond)) == FlyToPoint(near, 40.0)


class LateFlight:
    """A pretended flight whose commands take their time: one at a time, in order, some given up."""

    def __init__(self, flight, late_s, seed):
        self.flight = flight
        self.late_s = late_s
        self.chance = random.Random(seed)
        self.waiting = self.sending = None
        self.under_way = []
        flight.act = self.act
        flight.take_off()
        flight.mode = FlightMode.MISSION

    def act(self, action):
        if isinstance(action, FlyToNode | FlyToPoint | HoldHere | LandHere):
            self.waiting = action

    def step(self):
        flight = self.flight
        now_s = flight.now_s
        while self.under_way and self.under_way[0][0] <= now_s:
            motion = self.under_way.pop(0)[1]
            self.carry_out(motion)
            if self.sending is not None and motion is self.sending[0]:
                self.sending = None
                flight.give(CommandConfirmed(motion))
        if self.sending is not None and now_s >= self.sending[1] + GIVEN_UP_S:
            motion, self.sending = self.sending[0], None
            flight.give(CommandFailed(motion, "it does not show"))
        if self.sending is None and self.waiting is not None:
            motion, self.waiting = self.waiting, None
            objection = flight.controller.navigator.objection(motion, now_s)
            if objection is not None:
                flight.give(CommandFailed(motion, objection))
            else:
                last_s = self.under_way[-1][0] if self.under_way else 0.0
                arrives_s = max(last_s, now_s + self.chance.uniform(0.0, self.late_s))
                self.under_way.append((arrives_s, motion))
                self.sending = (motion, now_s)
        flight.step()

    def carry_out(self, motion):
        flight = self.flight
        match motion:
            case FlyToNode(position=position):
                flight.mode, flight.target = FlightMode.MISSION, position
            case FlyToPoint(position=position):
                flight.mode, flight.target = FlightMode.HOLD, position
            case HoldHere():
                flight.mode, flight.target = FlightMode.HOLD, None
            case LandHere():
                flight.mode, flight.target = FlightMode.LAND, None


@pytest.mark.parametrize("seed", range(3))
def test_however_late_commands_arrive_the_clearance_is_kept(pretend, pennovation, seed):
    chance = random.Random(seed)
    timers = dataclasses.replace(
        pennovation.timers, init_s=20.0, explore_s=12.0, search_s=6.0, communicate_s=6.0
    )
    flight = pretend(timers=timers, speed_m_s=6.0, duration_s=260.0)
    late = LateFlight(flight, 2.9, seed)
    while flight.controller.state is not State.DONE and flight.now_s < 600.0:
        late.step()
        if chance.random() < 0.02:
            spot = chance.choice(flight.mission.waypoints).position
            flight.robots[chance.choice(SEEK)] = Point(spot[0] + 20.0, spot[1] - 10.0)
    assert flight.controller.state is State.DONE
    closest_m, what = flight.mission.airspace.track_distance_m(flight.track)
    assert closest_m >= flight.mission.planner.clearance_m, what


def test_what_may_come_late_is_held_for_where_it_would_not_show(airborne):
    """As it was rehearsed: the jump that shows is not the one that was made last."""
    flight = airborne()
    flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) > 40.0)
    jump = flight.motions[-1]
    assert isinstance(jump, FlyToNode)
    flight.deaf = True
    flight.give(GoTo((Point(60.0, -40.0),)))  # it was given up, and may come any moment
    flight.deaf = False
    flight.shown = {"item": flight.plan.item_of(jump.node)}
    flight.step()
    setpoints = len(flight.motions)
    flight.give(ExploreNow())
    assert isinstance(flight.motions[setpoints], HoldHere)
    flight.shown = {}
    flight.fly_until(lambda: isinstance(flight.motions[-1], FlyToNode), 10.0)
    assert flight.motions[-1].node == jump.node


def test_below_the_cruise_altitudes_it_is_reckoned_with_that_it_swings_beyond_its_leg(bend):
    mast = Zone("mast", Circle(Point(215.5, 0.0), 10.0), band=Band(-math.inf, 20.0))
    mission = bend.mission.with_areas((), (mast,))
    low = at(190.0, 0.0, velocity_m_s=(3.5, 0.0), target=Point(200.0, 0.0))
    flight = type(bend)(mission)
    for altitude_m, clear in ((40.0, True), (30.0, True), (22.0, False)):
        context, _, navigator = navigating(flight, dataclasses.replace(low, altitude_m=altitude_m))
        assert navigator.clear(context.last_telemetry, Point(190.0, 60.0)) is clear


def test_a_leg_is_swept_for_as_long_as_the_position_is_old(bend):
    _, gate, navigator = navigating(bend, at(22.0, 0.0, velocity_m_s=(3.5, 0.0)))
    gate.reaction_s = 2.0
    gate.pending = down = FlyToPoint(Point(22.0, -60.0), 40.0)
    assert navigator.objection(down, 1.0) is None
    assert navigator.objection(down, 2.9) is not None


def test_a_leg_out_of_a_hover_is_not_refused_for_being_its_own_setpoint(bend):
    """What has not left is not flown: it is checked in its turn as it was when it was planned."""
    tracking, box = bend.mission.tracking, -15.0  # the zone's northern edge
    kept_m = bend.mission.planner.clearance_m + (tracking.flown_m + tracking.turned_m) / 2
    beside = box + kept_m
    assert tracking.flown_m < tracking.turned_m < bend.mission.planning_airspace.margin_m
    context, gate, navigator = navigating(bend, at(20.0, beside))
    here, order = context.last_telemetry, FlyToPoint(Point(80.0, beside), 40.0)
    assert navigator.clear(here, order.position)
    gate.command(order)
    assert navigator.objection(order, 1.0) is None
    # Flown already, or at speed, such a leg needs more room.
    assert not navigator.clear(here, order.position)
    context.telemetry = dataclasses.replace(here, velocity_m_s=(1.0, 0.0))
    assert "no longer clear" in navigator.objection(order, 1.0)
    # One alike that left before may be flown by now.
    context.telemetry = here
    gate.failed(CommandFailed(order, "no answer"))
    again = dataclasses.replace(order)
    gate.command(again)
    assert "no longer clear" in navigator.objection(again, 1.0)


@pytest.mark.parametrize(("reaction_s", "age_s"), [(0.6, 0.0), (0.6, 0.1), (0.72, 0.15)])
def test_a_leg_on_that_becomes_clear_while_it_brakes_stays_so_until_it_has_left(
    bend, reaction_s, age_s
):
    """It is commanded as soon as it is clear, so at the very speed at which it becomes so."""
    corner, beyond = Point(32.8, 0.0), Point(32.8, -60.0)
    bend.router.route = lambda *_, **__: Route((Leg(corner), Leg(beyond)), 93.0)
    context, gate, navigator = navigating(bend, at(0.0, 0.0))
    gate.reacts_within(reaction_s)
    first = navigator.plan_to(Goal(beyond))
    gate.command(first)
    gate.confirmed(CommandConfirmed(first))
    braking = [1.0 + 0.02 * step for step in range(150)]
    for time_s in braking:
        left_s = braking[-1] - time_s
        context.telemetry = telemetry = dataclasses.replace(
            at(corner.east_m - 0.35 * left_s**2, 0.0, velocity_m_s=(0.7 * left_s, 0.0)),
            time_s=time_s,
        )
        motion = navigator.update(telemetry)
        if motion is not None:
            break
    gate.command(motion)
    assert motion == FlyToPoint(beyond, 40.0)
    assert telemetry.velocity_m_s[0] > STANDING_M_S
    assert navigator.objection(motion, time_s + age_s) is None


@pytest.mark.parametrize(("reaction_s", "age_s"), [(0.6, 0.1), (0.72, 0.15), (1.8, 0.7)])
def test_a_leg_that_is_planned_at_speed_stays_clear_until_it_has_left(bend, reaction_s, age_s):
    """Where it would be clear for a moment only, the vehicle is stopped first."""
    planned = []
    for step in range(200):
        here = at(10.0 + step * 0.1, 0.0, velocity_m_s=(3.5, 0.0))
        _, gate, navigator = navigating(bend, here)
        gate.reacts_within(reaction_s)
        motion = navigator.plan_to(Goal(Point(here.position.east_m, -60.0)))
        gate.command(motion)
        assert navigator.objection(motion, here.time_s + age_s) is None
        planned.append(type(motion))
    assert {FlyToPoint, HoldHere} <= {*planned}


def test_a_hovering_vehicle_begins_no_leg_that_is_clear_at_one_place_alone(bend):
    """Its position wanders: it is sent on from where the next telemetry allows the leg as well."""
    corner, beyond = Point(33.0, 0.0), Point(33.0, -60.0)
    bend.router.route = lambda *_, **__: Route((Leg(corner), Leg(beyond)), 93.0)
    sent = []
    for step in range(60):
        place = Point(33.0 + 0.02 * step, 0.0)
        context, gate, navigator = navigating(bend, at(0.0, 0.0))
        first = navigator.plan_to(Goal(beyond))
        gate.command(first)
        gate.confirmed(CommandConfirmed(first))
        context.telemetry = telemetry = at(*place)
        motion = navigator.update(telemetry)
        sent.append(motion is not None)
        if motion is not None:
            gate.command(motion)
            context.telemetry = at(place.east_m + 0.05, place.north_m)
            assert navigator.objection(motion, 1.05) is None
    assert {*sent} == {True, False}
