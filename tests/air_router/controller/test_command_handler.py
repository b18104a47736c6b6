"""What is requested in flight: done or refused, always answered, never an unchecked leg."""

import dataclasses
import itertools
import math

import pytest

from air_router.controller.limits import FOREIGN_TARGET_M
from air_router.controller.model.actions import (
    CommandAck,
    FlyToNode,
    FlyToPoint,
    HoldHere,
    LandHere,
    Refusal,
    RenewPlan,
)
from air_router.controller.model.events import (
    AirspaceChanged,
    CommandFailed,
    PlanRenewed,
    RobotPose,
    RobotSought,
)
from air_router.controller.model.requests import (
    ComeHome,
    ExploreNow,
    GoOn,
    GoTo,
    HoldNow,
    LandNow,
    SeekNow,
)
from air_router.controller.model.states import State
from air_router.vehicle.vehicle import (
    Ages,
    FlightMode,
    LinkSilent,
    PlanCompared,
    PlanReplaced,
)
from geo.frame import Point
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted

ROBOT = Point(64.0, 0.0)
FAR = (Point(75.0, -150.0), Point(-150.0, 60.0))
MOVES = FlyToNode | FlyToPoint | LandHere


def send(flight, request):
    """Send the request; return the answer, and what was commanded because of it."""
    before = len(flight.actions)
    flight.give(dataclasses.replace(request, request_id="7"))
    fresh = flight.actions[before:]
    (answer,) = [a for a in fresh if isinstance(a, CommandAck)]
    assert answer.request_id == "7"
    assert answer.accepted == (answer.code is None)
    assert answer.why
    return answer, [a for a in fresh if isinstance(a, MOVES | HoldHere)]


def fly_to(flight, at_least_m=0.0, at_most_m=math.inf):
    """Until the leg's end is so far."""

    def there():
        left_m = math.dist(flight.position, flight.target or flight.position)
        return at_least_m <= left_m <= at_most_m and math.hypot(*flight.velocity) > 1.0

    flight.fly_until(there)


def find(flight):
    send(flight, SeekNow("callisto"))
    flight.give(RobotPose("callisto", ROBOT, 1.0, "callisto"))


def find_and_sync(flight):
    find(flight)
    syncs(flight)


def explore_and_meet_all(flight):
    exploration = flight.controller.exploration
    find(flight)
    while exploration.remaining:
        exploration.visited()
    for robot in ("europa", "io", "callisto"):  # the last one ends COMM
        for direction in Direction:
            flight.give(SyncStarted(robot, 0.0, direction))
            flight.give(SyncEnded(robot, 0.0, direction, 1, 1, 0.1))
    flight.fly_to_state(State.IDLE)


def end_in(state):
    def end(flight):
        send(flight, ComeHome())
        flight.fly_to_state(state)

    return end


WAYS = {
    State.INIT: lambda _: None,
    State.SEARCH: lambda flight: send(flight, SeekNow("callisto")),
    State.COMM: find,
    State.EXPL: find_and_sync,
    State.IDLE: explore_and_meet_all,
    State.GOTO: lambda flight: send(flight, GoTo(FAR)),
    State.HOLD: lambda flight: send(flight, HoldNow()),
    State.PASSIVE: lambda flight: flight.pilot_chooses(FlightMode.OTHER),
    **{state: end_in(state) for state in (State.HOME, State.LAND, State.DONE)},
}


@pytest.fixture
def in_state(pretend, flown):
    """A flight in a state."""

    def make(state, **changes):
        return flown((state, *changes.items()), lambda: fly(state, changes))

    def fly(state, changes):
        flight = pretend(**changes)
        if state is State.READY:
            flight.step()
            return flight
        flight.take_off()
        flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) > 60.0)
        WAYS[state](flight)
        assert flight.controller.state is state
        return flight

    return make


# For every request and every state: the state that follows, or why it is refused.
S, R = State, Refusal
NEITHER = {S.READY: R.NOT_FLYING, S.PASSIVE: R.NOT_OURS, S.DONE: R.FLIGHT_OVER}
IN_THE_AIR = (S.INIT, S.SEARCH, S.COMM, S.EXPL, S.IDLE, S.GOTO, S.HOLD, S.HOME)
EXPECTED = {
    HoldNow(): {**dict.fromkeys(IN_THE_AIR, S.HOLD), S.LAND: R.COMING_HOME, **NEITHER},
    SeekNow("io"): {**dict.fromkeys(IN_THE_AIR, S.SEARCH), S.LAND: R.COMING_HOME, **NEITHER},
    ExploreNow(): {
        **dict.fromkeys(IN_THE_AIR, S.EXPL),
        S.INIT: S.INIT,
        S.IDLE: R.NOTHING_TO_DO,
        S.LAND: R.COMING_HOME,
        **NEITHER,
    },
    GoTo(FAR): {**dict.fromkeys(IN_THE_AIR, S.GOTO), S.LAND: R.COMING_HOME, **NEITHER},
    ComeHome(): {
        **dict.fromkeys(IN_THE_AIR, S.HOME),
        **NEITHER,
        S.READY: S.DONE,
        S.LAND: S.LAND,
    },
    GoOn(): {
        **dict.fromkeys((*IN_THE_AIR, S.LAND), R.NOTHING_TO_DO),
        **NEITHER,
        S.HOLD: S.EXPL,
        S.READY: R.NOT_OURS,
        S.PASSIVE: R.NOT_OURS,  # it flies in another mode than Hold
    },
    LandNow(): {
        **dict.fromkeys(IN_THE_AIR, R.BUSY),
        **NEITHER,
        S.HOLD: R.NO_WAY,  # it still moves
        S.LAND: S.LAND,
    },
}
VERBS = {
    HoldNow: "hold",
    SeekNow: "seek",
    ExploreNow: "explore",
    GoTo: "goto",
    ComeHome: "home",
    GoOn: "resume",
    LandNow: "land",
}


@pytest.mark.parametrize("request_", list(EXPECTED), ids=lambda r: type(r).__name__)
def test_every_request_in_every_state(in_state, request_):
    assert set(EXPECTED[request_]) == set(State)
    for state, expected in EXPECTED[request_].items():
        flight = in_state(state)
        shown = flight.controller.status().refusals.get(VERBS[type(request_)])
        answer, commanded = send(flight, request_)
        assert shown == (None if answer.accepted else answer.why)  # its button shows it before
        if isinstance(expected, State):
            assert answer.accepted, (state, answer)
            assert flight.controller.state is expected, state
        else:
            assert (answer.code, flight.controller.state) == (expected, state)
            assert commanded == []
        for motion in commanded:  # what is commanded is checked from where the vehicle is
            if isinstance(motion, FlyToNode | FlyToPoint):
                assert flight.router.check_leg(flight.position, motion.position)


def lands(flight):
    flight.altitude_m = 0.0
    flight.step()
    flight.armed = flight.in_air = False
    flight.step()


def is_taken_over(flight):
    flight.pilot_chooses(FlightMode.OTHER)


def time_passes(flight):
    flight.now_s += flight.controller.context.left_s or 0.0
    flight.step()


def battery_falls(flight):
    flight.battery = flight.mission.battery_reserve
    flight.step()


def receives(flight):
    flight.give(RobotPose("callisto", ROBOT, 2.0, "callisto"))


def syncs(flight):
    for direction in Direction:
        flight.give(SyncStarted("callisto", 0.0, direction))
        flight.give(SyncEnded("callisto", 0.0, direction, 1, 1, 0.1))


def is_yielded(flight):
    flight.give(RobotSought("aardvark", "callisto", 1.0))


# For every event: the states that it leads out of, and where to. All others stay.
LED = {
    is_taken_over: dict.fromkeys((*IN_THE_AIR, S.LAND), S.PASSIVE),
    lands: dict.fromkeys((*IN_THE_AIR, S.LAND, S.PASSIVE), S.DONE),
    battery_falls: dict.fromkeys(
        (S.INIT, S.SEARCH, S.COMM, S.EXPL, S.IDLE, S.GOTO, S.HOLD), S.HOME
    ),
    time_passes: {S.INIT: S.SEARCH, S.COMM: S.EXPL, S.EXPL: S.SEARCH},
    receives: {S.SEARCH: S.COMM},
    syncs: {S.COMM: S.EXPL},
    is_yielded: {},
}


@pytest.mark.parametrize("event", list(LED), ids=lambda event: event.__name__)
def test_every_event_in_every_state(in_state, event):
    for state in State:
        flight = in_state(state)
        event(flight)
        assert flight.controller.state is LED[event].get(state, state), state


def test_held_it_stays_where_it_stopped_and_goes_on_with_the_time_that_was_left(in_state):
    flight = in_state(State.INIT)
    fly_to(flight, at_least_m=15.0)
    left_s = flight.controller.context.left_s
    answer, commanded = send(flight, HoldNow(by="the tower"))
    assert [type(m) for m in commanded] == [HoldHere]
    assert any("holding, requested by the tower" in text for text in flight.announced)
    flight.fly_for(10.0)
    place, moved = flight.position, len(flight.motions)
    flight.fly_for(500.0)
    assert flight.controller.state is State.HOLD
    assert flight.controller.context.left_s is None
    assert math.dist(place, flight.position) < 0.1
    assert len(flight.motions) == moved
    answer, _ = send(flight, GoOn())
    assert answer.accepted
    assert flight.controller.state is State.EXPL
    assert flight.controller.context.left_s == pytest.approx(left_s)
    flight.fly_to_state(State.SEARCH, left_s + 1.0)


def test_near_the_end_of_its_leg_it_is_left_to_stop_there(in_state):
    flight = in_state(State.GOTO)
    fly_to(flight, at_least_m=0.2, at_most_m=1.0)
    end = flight.target
    answer, commanded = send(flight, HoldNow())
    assert answer.accepted
    assert commanded == []
    flight.fly_for(10.0)
    assert flight.controller.state is State.HOLD
    assert math.dist(flight.position, end) < 0.1
    assert send(flight, GoOn())[0].accepted


@pytest.mark.parametrize("state", [State.SEARCH, State.COMM, State.GOTO, State.HOME])
def test_what_was_held_is_gone_on_with(in_state, state):
    flight = in_state(state)
    robot, goto_task = flight.controller.context.task.robot, flight.controller.states.goto.goto_task
    send(flight, HoldNow())
    assert (flight.controller.context.task.robot, flight.controller.context.task.way.goal) == (
        None,
        None,
    )
    send(flight, HoldNow())  # once more changes nothing
    answer, _ = send(flight, GoOn())
    assert answer.accepted
    after = State.SEARCH if state is State.COMM else state
    assert (flight.controller.state, flight.controller.context.task.robot) == (after, robot)
    assert flight.controller.states.goto.goto_task is goto_task


def test_a_hold_that_fails_is_commanded_again(in_state):
    flight = in_state(State.INIT)
    fly_to(flight, at_least_m=15.0)
    flight.deaf = True
    send(flight, HoldNow())
    flight.deaf = False
    flight.fly_until(lambda: flight.mode is FlightMode.HOLD, 10.0)
    assert flight.controller.state is State.HOLD


def test_held_it_comes_home_for_its_battery_and_that_way_is_not_called_off(in_state):
    flight = in_state(State.HOLD)
    flight.battery = flight.mission.battery_reserve
    flight.step()
    assert flight.controller.state is State.HOME
    for request in (HoldNow(), SeekNow("io"), ExploreNow(), GoTo(FAR)):
        answer, commanded = send(flight, request)
        assert (answer.code, commanded) == (Refusal.COMING_HOME, [])
        assert "battery" in answer.why
    flight.lands()


def test_a_way_home_on_request_can_be_called_off_until_something_else_demands_it(
    in_state,
):
    flight = in_state(State.HOME, duration_s=100.0)
    assert flight.controller.context.ending_why == "the operator's request"
    assert send(flight, ExploreNow())[0].accepted
    assert flight.controller.context.ending_why is None
    send(flight, ComeHome())
    send(flight, HoldNow())
    flight.fly_to_state(State.HOME, 120.0)  # its time is over
    assert send(flight, HoldNow())[0].code is Refusal.COMING_HOME


def test_a_page_that_shows_what_is_refused_changes_no_flight(in_state):
    watched, alone = (
        in_state(State.HOME, duration_s=100.0, endurance_s=900.0, battery_reserve=0.08)
        for _ in range(2)
    )
    for flight, looks in ((watched, True), (alone, False)):
        for _ in range(60):
            flight.step()
            assert not looks or "hold" not in flight.controller.status().refusals
        send(flight, HoldNow())
    needs = [flight.controller.returns.need_home for flight in (watched, alone)]
    assert needs[0] == needs[1] > 0.0  # what it comes home by
    assert watched.track == alone.track
    assert [*map(repr, watched.actions)] == [*map(repr, alone.actions)]


def test_a_resume_that_takes_an_upload_is_not_shown_as_refused(in_state):
    flight = in_state(State.INIT)
    flight.give(PlanReplaced(flight.now_s))
    flight.give(PlanCompared(flight.now_s, "8 items"))
    flight.fly_to_state(State.PASSIVE, 30.0)
    assert "resume" not in flight.controller.status().refusals
    assert send(flight, GoOn())[0].code is Refusal.OTHER_PLAN  # and the page offers the upload


def test_a_requested_robot_is_sought_at_once_and_not_left_to_another(in_state):
    flight = in_state(State.GOTO)
    flight.give(RobotPose("io", ROBOT, 1.0, "europa"))
    answer, _ = send(flight, SeekNow("io"))
    assert answer.why == "it seeks io: its last position"
    assert (flight.controller.state, flight.controller.context.task.robot) == (State.SEARCH, "io")
    assert flight.controller.context.task.way.goal.position == ROBOT
    flight.give(RobotSought("aardvark", "io", 1.0))
    assert flight.controller.context.task.robot == "io"
    flight.fly_to_state(State.EXPL)  # no robot was met there
    assert send(flight, SeekNow("oi"))[0].code is Refusal.UNKNOWN_ROBOT


def test_a_robot_that_is_found_as_soon_as_it_is_sought_costs_one_command(in_state):
    flight = in_state(State.HOLD)
    flight.give(RobotPose("io", ROBOT, 1.0, "europa"))
    events = SeekNow("io"), RobotPose("io", ROBOT, 2.0, "io")  # before the vehicle confirms
    actions = [a for event in events for a in flight.controller.handle(event, flight.now_s)]
    assert flight.controller.state is State.COMM
    assert len([action for action in actions if isinstance(action, MOVES | HoldHere)]) == 1


@pytest.mark.parametrize("ours", [True, False])
def test_nothing_leaves_while_it_is_not_certain_whose_the_vehicle_is(in_state, ours):
    flight = in_state(State.GOTO)
    flight.fly_until(lambda: isinstance(flight.motions[-1], FlyToPoint))
    commanded, goal = len(flight.motions), flight.motions[-1].position
    strange = goal._replace(east_m=goal.east_m + 2 * FOREIGN_TARGET_M)

    def flies_to(target):
        flight.now_s += 0.1
        stands = dataclasses.replace(flight.telemetry(), velocity_m_s=(0.0, 0.0))
        flight.give(dataclasses.replace(stands, target=target))

    flies_to(strange)  # a message of before, or a station's order
    flight.give(ComeHome())
    flies_to(strange)
    assert flight.controller.state is State.HOME
    assert flight.motions[commanded:] == []
    if ours:
        flies_to(goal)
        flight.step()
        assert flight.motions[commanded:] != []
        flight.lands()
    else:
        while flight.controller.state is State.HOME:
            flies_to(strange)
        assert flight.controller.state is State.PASSIVE
        assert flight.motions[commanded:] == []


def test_points_are_flown_to_one_after_the_other_and_then_it_explores_on(in_state):
    flight = in_state(State.SEARCH)
    left = flight.controller.exploration.remaining
    answer, _ = send(flight, GoTo(FAR, hold_s=30.0))
    assert answer.why == "it flies to 2 points"
    assert answer.points == FAR
    for point in FAR:
        flight.fly_until(lambda p=point: math.dist(flight.position, p) < 2.0, 300.0)
        assert flight.controller.state is State.GOTO
    flight.fly_until(lambda: flight.controller.context.left_s is not None, 30.0)
    began_s = flight.now_s
    flight.fly_to_state(State.EXPL)
    assert flight.now_s - began_s == pytest.approx(30.0, abs=0.3)
    assert math.dist(flight.position, FAR[-1]) < 2.0
    assert flight.controller.exploration.remaining == left
    closest_m, _ = flight.mission.airspace.track_distance_m(flight.track)
    assert closest_m >= flight.mission.planner.clearance_m


def test_points_left_are_those_not_reached_yet_also_at_the_last_and_after_a_hold(in_state):
    flight = in_state(State.GOTO)
    controller = flight.controller
    assert controller.status().points_left == 2
    flight.fly_until(lambda: controller.status().points_left == 1, 200.0)
    assert math.dist(flight.position, FAR[0]) < 3.0
    flight.fly_until(lambda: controller.context.left_s is not None, 200.0)
    assert controller.status().points_left == 0  # it hovers at the last one
    send(flight, HoldNow())
    assert send(flight, GoOn())[0].accepted
    flight.fly_for(2.0)
    assert (controller.state, controller.status().points_left) == (State.GOTO, 0)
    flight.fly_to_state(State.EXPL, 30.0)


def test_gusts_do_not_keep_it_at_a_point_for_ever(in_state):
    flight = in_state(State.GOTO)
    flight.fly_until(lambda: math.dist(flight.position, FAR[0]) < 1.0, 300.0)
    shaken = dataclasses.replace(flight.telemetry(), velocity_m_s=(0.6, 0.0))
    for second in range(12):
        flight.give(dataclasses.replace(shaken, time_s=flight.now_s + second))
        flight.now_s += 1.0
    assert flight.controller.states.goto.goto_task.done == 1


def test_a_point_in_a_zone_is_hovered_beside_and_one_outside_of_the_fence_refused(in_state):
    flight = in_state(State.INIT)
    ring = flight.mission.zones[0].shape.ring
    inside = Point(*(sum(axis) / len(axis) for axis in zip(*ring, strict=True)))
    answer, _ = send(flight, GoTo((inside,)))
    (hover,) = answer.points
    assert "the point: it is inside no-fly zone" in answer.why
    assert flight.mission.planning_airspace.point_clear(hover)
    flight.fly_until(lambda: math.dist(flight.position, hover) < 2.0, 300.0)
    for points, why in (
        ((Point(0.0, 5000.0),), "the point lies outside the fence"),
        ((FAR[0], Point(0.0, 5000.0)), "point 2 lies outside the fence"),
        ((Point(1e6, 0.0),), "the point is more than 10 km away"),
        ((Point(math.nan, 0.0),), "the point is more than 10 km away"),
    ):
        answer, commanded = send(flight, GoTo(points))
        assert (answer.why, answer.code, commanded) == (why, Refusal.OUTSIDE_FENCE, [])


def test_a_way_that_the_battery_does_not_last_for_is_refused(in_state):
    flight = in_state(State.INIT, endurance_s=480.0, battery_reserve=0.08)
    flight.battery = 0.45
    flight.step()
    answer, commanded = send(flight, GoTo(FAR))
    assert (answer.code, commanded) == (Refusal.RESERVE, [])
    assert "the battery would be at" in answer.why
    assert send(flight, GoTo((flight.position,)))[0].accepted
    assert send(flight, GoTo((flight.position,), hold_s=300.0))[0].code is Refusal.RESERVE


def test_without_a_fix_or_telemetry_the_vehicle_is_only_commanded_to_hold(in_state):
    flight = in_state(State.INIT)
    for request in (SeekNow("io"), GoTo(FAR)):
        answer = flight.controller.handle(request, flight.now_s + 5.0)[-1]
        assert (answer.code, answer.why) == (Refusal.NOT_HEARD, "nothing received from it for 5 s")
    flight = in_state(State.INIT)
    flight.give(LinkSilent(flight.now_s, 3.5))  # the vehicle's clock, which we read, stands still
    assert send(flight, GoTo(FAR))[0].why == "nothing received from it for 4 s"
    flight.step()
    flight.fix = False
    flight.step()
    for request in (SeekNow("io"), GoTo(FAR)):
        assert send(flight, request)[0].code is Refusal.NO_FIX
    assert send(flight, HoldNow())[0].accepted
    assert send(flight, GoOn())[0].code is Refusal.NO_FIX
    flight.fix = True
    flight.fly_until(lambda: any("its fix again" in text for text in flight.announced), 10.0)
    flight.step()
    assert flight.controller.state is State.HOLD
    assert send(flight, GoOn())[0].accepted


def silent(flight):
    flight.give(LinkSilent(flight.now_s, 4.0))
    return "nothing received from it for 4 s"


def without_fix(flight):
    flight.fix = False
    flight.step()
    return "GPS has no fix"


def without_positions(flight):
    flight.give(dataclasses.replace(flight.telemetry(), ages=Ages(position_s=2.5)))
    return "position not received"


@pytest.mark.parametrize("lose", [silent, without_fix, without_positions])
def test_home_without_a_position_is_promised_for_when_it_is_known_again(in_state, lose):
    flight = in_state(State.INIT)
    why = lose(flight)
    answer, _ = send(flight, ComeHome())
    assert (answer.accepted, answer.why) == (
        True,
        f"it comes home as soon as its position is known: {why}",
    )
    flight.fix = True
    flight.fly_to_state(State.DONE)
    assert flight.finished.landed_by_us


def test_a_flight_is_not_resumed_while_nothing_is_received_from_it(in_state):
    flight = in_state(State.INIT)
    flight.pilot_chooses(FlightMode.HOLD)
    assert flight.controller.state is State.PASSIVE
    why = silent(flight)
    assert send(flight, GoOn())[0].why == why


def test_what_waits_for_changed_zones_is_answered_so(in_state):
    flight = in_state(State.INIT)
    mission = flight.controller.context.airspace.mission
    flight.give(AirspaceChanged(mission.fences, mission.zones[1:]))
    flight.fly_until(lambda: any(isinstance(a, RenewPlan) for a in flight.actions), 30.0)
    answer, commanded = send(flight, ComeHome())
    assert answer.why == "it comes home; it sets out once the changed zones are on board"
    assert not any(isinstance(motion, MOVES) for motion in commanded)
    flight.give(PlanRenewed())
    flight.fly_to_state(State.DONE)


def test_home_before_any_telemetry_promises_nothing_about_the_vehicle(pretend):
    answer, _ = send(pretend(), ComeHome())
    assert answer.why == "the mission ends before take-off; nothing is sent to the vehicle"


def test_points_that_can_wait_are_flown_to_once_the_mission_is_in_the_air(pretend):
    flight = pretend()
    flight.step()
    for number, points in (("1", FAR[:1]), ("2", FAR[1:])):
        flight.give(GoTo(points, waits=True, by="basestation", request_id=number))
    (replaced,) = [a for a in flight.actions if isinstance(a, CommandAck)]
    assert (replaced.request_id, replaced.code) == ("1", Refusal.REPLACED)
    flight.take_off()
    flight.step()
    accepted = [a for a in flight.actions if isinstance(a, CommandAck)][-1]
    assert (accepted.request_id, accepted.accepted) == ("2", True)
    assert flight.controller.state is State.GOTO
    send(flight, HoldNow())
    flight.give(GoTo(FAR, waits=True, by="basestation", request_id="3"))
    assert flight.controller.state is State.HOLD
    send(flight, GoOn())
    flight.step()
    assert flight.controller.states.goto.goto_task.stops == FAR
    send(flight, HoldNow())
    flight.give(GoTo(FAR, waits=True, request_id="4"))
    flight.pilot_chooses(FlightMode.OTHER)
    answered = [a for a in flight.actions if isinstance(a, CommandAck)][-1]
    assert (answered.request_id, answered.code) == ("4", Refusal.NOT_OURS)


@pytest.mark.parametrize("state", [State.READY, State.HOLD])
def test_points_that_waited_for_too_long_are_refused_in_time_and_not_flown_to(in_state, state):
    flight = in_state(state)
    flight.give(GoTo(FAR, waits=True, waits_s=30.0, by="basestation", request_id="1"))
    answers = []

    def answered():
        answers[:] = [a for a in flight.actions if isinstance(a, CommandAck) and a.request_id]
        return answers[-1:] and answers[-1].request_id == "1"

    given_s = flight.now_s
    flight.fly_until(answered, 60.0)
    assert flight.now_s - given_s == pytest.approx(30.0, abs=0.5)
    assert (answers[-1].code, flight.controller.state) == (Refusal.TOO_LATE, state)
    if state is State.READY:
        flight.take_off()
    else:
        send(flight, GoOn())
    flight.step()
    assert flight.controller.state in {State.INIT, State.EXPL}
    assert [a.request_id for a in flight.actions if isinstance(a, CommandAck)].count("1") == 1


def test_a_point_that_is_cut_off_on_the_way_is_left_out(in_state, monkeypatch):
    flight = in_state(State.GOTO)
    route = flight.router.route
    closed = FAR[0]

    def without(start, goal, **more):
        return route(start, Point(0.0, 5000.0) if goal == closed else goal, **more)

    monkeypatch.setattr(flight.router, "route", without)
    flight.controller.navigator.again()
    flight.fly_until(lambda: any("point 1 left out" in text for text in flight.announced), 60.0)
    flight.fly_until(lambda: math.dist(flight.position, FAR[1]) < 2.0, 300.0)
    closed = FAR[1]
    flight.fly_to_state(State.EXPL)


def test_whatever_is_requested_whenever_no_zone_is_touched(pretend):
    flight = pretend(duration_s=900.0)
    flight.robots = {"io": ROBOT, "callisto": FAR[1]}
    flight.noise_m = 0.2
    flight.take_off()
    wishes = itertools.cycle(
        (GoTo(FAR), SeekNow("io"), HoldNow(), GoOn(), ExploreNow(), GoTo(FAR[::-1]), SeekNow("io"))
    )
    while flight.finished is None:
        flight.fly_for(9.7)
        if flight.finished is None:
            send(flight, next(wishes))
        assert flight.now_s < 3000.0
    assert flight.finished.landed_by_us
    closest_m, _ = flight.mission.airspace.track_distance_m(flight.track)
    assert closest_m >= flight.mission.planner.clearance_m


def test_points_that_waited_do_not_call_off_a_way_home_that_was_requested_later(in_state):
    flight = in_state(State.HOLD)
    flight.give(GoTo(FAR, waits=True, request_id="old", by="basestation"))
    send(flight, ComeHome())
    flight.step()
    (answer,) = [a for a in flight.actions if isinstance(a, CommandAck) and a.request_id == "old"]
    assert (answer.code, flight.controller.state) == (Refusal.COMING_HOME, State.HOME)


def test_points_that_came_by_gossip_do_not_call_off_a_way_home(in_state):
    flight = in_state(State.HOME)  # the operator requested it
    assert send(flight, GoTo(FAR, waits=True, by="basestation"))[0].code is Refusal.COMING_HOME
    assert flight.controller.state is State.HOME
    assert send(flight, GoTo(FAR))[0].accepted


def test_a_way_home_that_the_pilot_interrupted_does_not_count_for_the_next(in_state):
    flight = in_state(State.HOME)  # the operator requested it
    flight.pilot_chooses(FlightMode.HOLD)
    assert send(flight, GoOn())[0].accepted
    flight.give(CommandFailed(flight.motions[-1], "lost"))
    flight.controller.context.come_home("the climb has stopped")
    assert send(flight, ExploreNow())[0].code is Refusal.COMING_HOME


def test_it_does_not_land_where_an_order_that_is_still_under_way_takes_it(airborne):
    flight = airborne()
    late, act = [], flight.act
    flight.act = lambda a: late.append(a) if isinstance(a, MOVES | HoldHere) else act(a)
    assert send(flight, GoTo(FAR))[0].accepted
    assert send(flight, ComeHome())[0].accepted
    flight.fly_for(0.3)
    assert flight.controller.state is State.HOME
    flight.act = act
    for motion in late:
        act(motion)
        flight.fly_for(1.5)
    flight.lands(200.0)
    assert math.dist(flight.position, flight.mission.home) < 3.0
