"""Every state in the air has a way back: one sentence states it, and following it works.

Each test follows the answers to `resume` or `home` to the letter, until the vehicle is ours
again: never more than a few steps, never the same sentence twice.
"""

import re

import pytest

from air_router.controller.model.actions import FlyToNode, RenewPlan
from air_router.controller.model.events import AirspaceChanged, PlanRenewed
from air_router.controller.model.requests import ComeHome, GoOn, GoTo, HoldNow, SeekNow
from air_router.controller.model.states import State
from air_router.controller.model.task import Progress
from air_router.vehicle.vehicle import FlightMode
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Point
from tests.air_router.conftest import CORNERS

GOTO = GoTo((Point(-20.0, -60.0),))
STATES = (
    *(State.READY, State.INIT, State.SEARCH, State.COMM, State.EXPL),
    *(State.GOTO, State.HOLD, State.HOME, State.LAND),
)


def sticks(flight):
    flight.pilot_chooses(FlightMode.POSITION)
    assert flight.announced[-1] == "hands off: the pilot chose Position mode"


def pilot_returns(flight):
    flight.pilot_chooses(FlightMode.RETURN)


def hovers_low_after_a_failsafe(flight):
    """GPS was lost, PX4 sank in its blind landing, got GPS back and holds."""
    flight.failsafe, flight.fix = True, False
    flight.altitude_m = min(flight.altitude_m, 33.0)
    flight.pilot_chooses(FlightMode.LAND)
    flight.fix = True
    flight.failsafe = False
    flight.pilot_chooses(FlightMode.HOLD)


def failsafe_acts_without_gps(flight):
    flight.failsafe, flight.fix = True, False
    flight.pilot_chooses(FlightMode.HOLD)


def another_plan(flight):
    replaced(flight, "0 items", only_fence=False)


def fence_deleted(flight):
    replaced(flight, "the fence: 59 items sent, 0 are on board", only_fence=True)


def plan_deleted_while_the_pilot_flies(flight):
    flight.pilot_chooses(FlightMode.ALTITUDE)
    another_plan(flight)


def replaced(flight, difference, *, only_fence):
    flight.plan_compared(difference, only_fence=only_fence)
    flight.fly_for(5.0)
    if flight.controller.context.in_charge:  # it lands, and needs no plan for that
        flight.pilot_chooses(FlightMode.HOLD)


def carried_into_a_zone(flight):
    inside = flight.mission.zones[0].shape.polygon.representative_point()
    flight.position = Point(inside.x, inside.y)
    sticks(flight)


CAUSES = (
    sticks,
    pilot_returns,
    hovers_low_after_a_failsafe,
    failsafe_acts_without_gps,
    another_plan,
    fence_deleted,
    plan_deleted_while_the_pilot_flies,
)


@pytest.fixture
def flight_in(pretend, flown):
    """A flight in a state, by the shortest way."""
    return lambda state: flown(("way back", state), lambda: fly_to(pretend, state))


def fly_to(pretend, state):
    flight = pretend(duration_s=4000.0)
    flight.robots = dict(CORNERS)
    if state is State.READY:
        flight.take_off_halfway()
        return flight
    flight.take_off()
    flight.fly_away()
    requests = {
        State.GOTO: GOTO,
        State.HOLD: HoldNow(),
        State.HOME: ComeHome(),
        State.LAND: ComeHome(),
    }
    if state in requests:
        flight.operator_requests(requests[state])
    flight.fly_to_state(state)
    if state is State.LAND:
        flight.fly_for(10.0)
    return flight


def obey(flight, request, most=4):
    """Send the request, and follow the answers until it is accepted."""
    answers = []
    for _ in range(most):
        answer = flight.operator_requests(request)
        if answer.accepted:
            return answers
        assert answer.why not in answers, answers
        answers.append(answer.why)
        if "wait for it" in answer.why:
            flight.fix = True
        if climb := re.search(r"climb to (\d+) m by hand", answer.why):
            flight.altitude_m = float(climb[1])
        if "fly it out by hand" in answer.why:
            flight.position = flight.mission.home
        if "choose Hold" in answer.why:
            flight.failsafe = False
            flight.pilot_chooses(FlightMode.HOLD)
        if "resume upload" in answer.why and isinstance(request, GoOn):
            request = GoOn(upload=True)
        flight.step()
    raise AssertionError(f"no way back from {flight.states}: {answers}")


def goes_on(flight, since):
    """A leg of ours is flown, at the mission's altitude and with our plan on board."""
    up_m = flight.mission.altitude_above_home_m - 2.0

    def flies():
        new = flight.actions[since:]
        if isinstance(new[-1], RenewPlan):
            assert flight.mode is FlightMode.HOLD
            flight.give(PlanRenewed())
        return any(isinstance(action, FlyToNode) for action in new)

    flight.fly_until(flies, 120.0)
    assert flight.controller.context.in_charge
    assert flight.altitude_m > up_m


@pytest.mark.parametrize("cause", [*CAUSES, carried_into_a_zone])
def test_what_resume_answers_leads_back_to_the_mission(flight_in, cause):
    for state in STATES:
        flight = flight_in(state)
        cause(flight)
        assert flight.controller.state is State.PASSIVE, state
        since = len(flight.actions)
        answers = obey(flight, GoOn())
        goes_on(flight, since)
        uploads = sum(isinstance(action, RenewPlan) for action in flight.actions)
        assert uploads == any("resume upload" in why for why in answers), state


@pytest.mark.parametrize("cause", CAUSES)
def test_what_home_answers_leads_to_a_landing_at_home(flight_in, cause):
    for state in STATES:
        flight = flight_in(state)
        cause(flight)
        obey(flight, ComeHome())
        flight.fly_until(lambda flight=flight: flight.finished is not None, 600.0)
        assert flight.finished.landed_by_us, state
        assert flight.closest_m() >= flight.mission.planner.clearance_m, state


@pytest.mark.parametrize("cause", CAUSES)
def test_a_refused_request_has_the_reason_that_resume_would_have(flight_in, cause):
    flight = flight_in(State.EXPL)
    cause(flight)
    (why,) = {flight.operator_requests(request).why for request in (HoldNow(), GOTO)}
    way_back = why.split("; ", 1)[1]
    answer = flight.operator_requests(GoOn())
    assert answer.accepted == way_back.startswith("'resume' takes it back")
    assert answer.accepted or answer.why == way_back


@pytest.mark.parametrize("spare_m", [-2.0, 0.5])  # on top of the clearance; a climb needs more
def test_where_a_zone_may_be_above_the_pilot_climbs(flight_in, pennovation, spare_m):
    flight = flight_in(State.EXPL)
    sticks(flight)
    flight.altitude_m = 20.0
    away_m = 8.0 + pennovation.planner.clearance_m + spare_m
    beside = Point(flight.position[0] + away_m, flight.position[1])
    bridge = Zone("bridge", Circle(beside, 8.0), band=Band(25.0, 30.0))
    flight.give(AirspaceChanged(pennovation.fences, (*pennovation.zones, bridge)))
    flight.pilot_chooses(FlightMode.HOLD)
    (why,) = obey(flight, GoOn())
    assert why == (
        "it is 20 m above home, too near to bridge to climb by itself: climb to 40 m by hand, "
        "then choose Hold"
    )


def test_a_climb_that_a_new_zone_does_not_allow_is_warned_of_once(flight_in, pennovation):
    flight = flight_in(State.EXPL)
    given_back_low(flight)
    assert flight.operator_requests(GoOn()).accepted
    away_m = 8.0 + pennovation.planner.clearance_m + 0.5
    beside = Point(flight.position[0] + away_m, flight.position[1])
    bridge = Zone("bridge", Circle(beside, 8.0), band=Band(25.0, 30.0))
    flight.give(AirspaceChanged(pennovation.fences, (*pennovation.zones, bridge)))
    flight.fly_until(lambda: isinstance(flight.actions[-1], RenewPlan), 20.0)
    flight.give(PlanRenewed())
    flight.fly_for(60.0)
    waits = [text for text in flight.announced if text.startswith("holding: it is ")]
    assert len(waits) == 1, waits


def given_back_low(flight, flies_s=0.0):
    """The pilot flies low for so long, and chooses Hold there."""
    sticks(flight)
    flight.altitude_m = 20.0
    flight.fly_for(flies_s)
    flight.pilot_chooses(FlightMode.HOLD)


def test_a_climb_that_does_not_go_on_is_given_back(flight_in):
    flight = flight_in(State.EXPL)
    given_back_low(flight)
    flight.operator_requests(GoOn())
    for _ in range(200):
        flight.altitude_m = 20.0
        flight.step()
    assert flight.controller.state is State.PASSIVE
    assert any("the climb to the mission's altitude has stopped" in s for s in flight.announced)


def test_a_climb_that_a_pilot_ended_counts_for_nothing_in_the_next_one(flight_in):
    flight = flight_in(State.EXPL)
    for _ in range(2):
        given_back_low(flight, 40.0)
        flight.operator_requests(GoOn())
        flight.step()
        assert flight.controller.state is State.EXPL, flight.announced[-3:]
    assert sum(text.startswith("climbing from 20 to 40 m") for text in flight.announced) == 2


@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("request_", [GOTO, SeekNow("io")], ids=["goto", "seek"])
def test_what_is_requested_before_it_climbs_is_flown_once_it_is_up(flight_in, request_, lost):
    """At once after `resume`, while the climb is under way to the vehicle, or was lost."""
    flight = flight_in(State.EXPL)
    given_back_low(flight, 6.0)
    act, decided = flight.act, []
    flight.act, flight.deaf = act if lost else decided.append, lost
    for request in (GoOn(), request_):
        flight.operator_requests(request)
    flight.act, flight.deaf = act, False
    for action in decided:
        act(action)
    state, context = flight.controller.state, flight.controller.context
    flight.fly_until(lambda: context.task.way.progress is Progress.ARRIVED, 120.0)
    assert flight.controller.state is state
    assert flight.altitude_m > 38.0
