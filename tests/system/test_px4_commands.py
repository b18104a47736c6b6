"""No pilot is commanded over: what moves the vehicle leaves once, and again only on evidence.

Real MAVSDK over UDP against a vehicle that swallows acknowledgements, and does what a test says.
"""

import asyncio
import contextlib
import itertools

import pytest

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere
from air_router.controller.model.events import CommandConfirmed
from air_router.errors import ArmingRefusedError, NotConfirmedError
from air_router.flight.motions import MotionSender
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.loading import load_mission
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.px4 import px4_commands
from air_router.vehicle.px4.px4 import Px4Vehicle
from air_router.vehicle.px4.px4_motions import ATTEMPTS
from air_router.vehicle.vehicle import FlightMode
from geo.frame import Point
from tests.system.scripted_px4 import (
    ARM_DISARM,
    CHANGE_SPEED,
    GROUND,
    HOLD,
    LAND,
    LAND_NOW,
    MISSION,
    POSITION,
    REPOSITION,
    SET_MODE,
    ScriptedPx4,
)

LIMIT_S = 60
ITEM = 5
THERE, ELSEWHERE = Point(40.0, 30.0), Point(-60.0, 30.0)
ACCEPTED, TEMPORARILY_REJECTED, DENIED, IN_PROGRESS = 0, 1, 2, 5


@pytest.fixture
def mission(short_mission):
    return load_mission(short_mission)


@pytest.fixture
def patient(monkeypatch):
    """A test in which something was waited for to the end does not end."""
    monkeypatch.setattr(px4_commands, "CONFIRM_S", 2.0 * LIMIT_S)
    monkeypatch.setattr(px4_commands, "LONGEST_S", 2.0 * LIMIT_S)


@pytest.fixture
def run(mission, udp_port):
    """Runs `script(vehicle, px4)` against a vehicle that does `answer(px4, order)`."""

    def degrees(point):
        return mission.frame.to_geodetic(point)

    def start(answer, script, **state):
        px4 = ScriptedPx4(udp_port, degrees(mission.home), answer)
        px4.places = degrees

        async def main():
            vehicle = Px4Vehicle(mission, f"udpin://127.0.0.1:{udp_port}", VehicleClock())
            try:
                async with asyncio.timeout(LIMIT_S):
                    await vehicle.connect()
                    for name, value in state.items():
                        setattr(px4, name, value)
                    await vehicle.telemetry.wait_for(lambda: seen(vehicle.telemetry, px4))
                    await script(vehicle)
            finally:
                await vehicle.close()

        with contextlib.closing(px4):
            asyncio.run(main())
        return px4

    return start


def seen(telemetry, px4):
    modes = {HOLD: FlightMode.HOLD, MISSION: FlightMode.MISSION}
    target = px4.target is None or telemetry.target is not None
    return (
        telemetry.mode is modes[px4.mode]
        and telemetry.armed == px4.armed
        and telemetry.item == px4.item
        and telemetry.in_air == (px4.landed != GROUND)
        and target
    )


@pytest.fixture
def hovering(mission):
    """A vehicle in Hold that says where it hovers."""
    return {"mode": HOLD, "target": mission.frame.to_geodetic(ELSEWHERE)}


def fails(verb, match=None):
    async def script(vehicle):
        with pytest.raises(NotConfirmedError, match=match):
            await verb(vehicle)

    return script


def hold(vehicle):
    return vehicle.hold()


def land(vehicle):
    return vehicle.land()


def start(vehicle):
    return vehicle.start()


def jump(vehicle):
    return vehicle.jump(ITEM)


def reposition(vehicle):
    return vehicle.reposition(THERE, 30.0)


WAITING = {"mode": HOLD, "landed": GROUND}
ORDERS = {
    hold: [("COMMAND_LONG", SET_MODE)],
    land: [("COMMAND_LONG", LAND_NOW)],
    start: [("COMMAND_LONG", SET_MODE)],
    reposition: [("COMMAND_INT", REPOSITION)],
}
JUMP = [("MISSION_SET_CURRENT", None), ("COMMAND_LONG", SET_MODE)]
STOP = [("COMMAND_INT", REPOSITION)]


def state_for(verb):
    return WAITING if verb is start else {}


def silent(px4, _order):
    px4.talks = False


def deaf(_px4, _order):
    pass


def set_item(px4, order):
    if order.get_type() == "MISSION_SET_CURRENT":
        px4.item = order.seq


@pytest.mark.parametrize("verb", ORDERS)
def test_an_order_arrives_once_when_nothing_answers(run, verb):
    # It may be taking off: only the flight that goes on listening will know.
    px4 = run(silent, start if verb is start else fails(verb), **state_for(verb))
    assert px4.commands() == ORDERS[verb]


def test_a_stop_arrives_once_when_nothing_answers(run, hovering):
    px4 = run(silent, fails(hold), **hovering)
    assert px4.commands() == STOP


@pytest.mark.parametrize("answer", [silent, deaf])
def test_a_jump_and_its_mode_arrive_once(run, hovering, answer):
    def item_only(px4, order):
        set_item(px4, order)
        if order.get_type() == "COMMAND_LONG":
            answer(px4, order)

    px4 = run(item_only, fails(jump), **hovering)
    assert px4.commands() == JUMP


def test_a_reposition_is_not_repeated_even_if_nothing_changes(run, hovering):
    assert run(deaf, fails(reposition), **hovering).commands() == STOP


@pytest.mark.parametrize("verb", [hold, land, start])
def test_what_leads_to_no_place_is_repeated_while_nothing_changes(run, verb):
    heartbeats = []
    px4 = run(lambda px4, _order: heartbeats.append(px4.heartbeats), fails(verb), **state_for(verb))
    assert px4.commands() == ORDERS[verb] * ATTEMPTS
    assert [order.confirmation for order in px4.orders] == list(range(ATTEMPTS))
    assert all(later > sooner for sooner, later in itertools.pairwise(heartbeats))


def test_a_stop_is_repeated_while_nothing_changes(run, hovering):
    assert run(deaf, fails(hold), **hovering).commands() == STOP * ATTEMPTS


def takes_over(px4, _order):
    px4.mode = POSITION


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("verb", ORDERS)
def test_a_pilot_s_mode_ends_it_at_once(run, verb):
    px4 = run(takes_over, fails(verb, "the pilot chose Position mode"), **state_for(verb))
    assert px4.commands() == ORDERS[verb]


@pytest.mark.usefixtures("patient")
def test_a_pilot_s_mode_ends_a_stop_at_once(run, hovering):
    assert run(takes_over, fails(hold, "the pilot chose"), **hovering).commands() == STOP


def other_item(px4, _order):
    px4.item = 7


def disarms(px4, _order):
    px4.armed = False


@pytest.mark.parametrize(
    ("verb", "choice"), [(hold, other_item), (land, other_item), (start, disarms)]
)
def test_a_pilot_s_choice_in_the_same_mode_is_not_followed_by_another_order(run, verb, choice):
    px4 = run(choice, fails(verb), **state_for(verb))
    assert px4.commands() == ORDERS[verb]


def test_a_place_that_a_pilot_chooses_in_hold_is_not_followed_by_another_stop(run, hovering):
    def diverts(px4, _order):
        px4.target = px4.places(Point(90.0, 90.0))

    assert run(diverts, fails(hold), **hovering).commands() == STOP


def test_what_is_called_off_does_not_leave_again(run):
    async def script(vehicle):
        order = asyncio.create_task(vehicle.hold())
        await first.wait()
        order.cancel()
        await asyncio.to_thread(px4s[0].wait_for_heartbeats, 60)  # MAVSDK repeats for 1.5 s

    first, px4s = asyncio.Event(), []

    def answer(px4, _order):
        px4s.append(px4)
        loop.call_soon_threadsafe(first.set)

    async def with_loop(vehicle):
        nonlocal loop
        loop = asyncio.get_running_loop()
        await script(vehicle)

    loop = None
    assert run(answer, with_loop).commands() == ORDERS[hold]


def follows(px4, order):
    """It does what it is told and acknowledges nothing."""
    set_item(px4, order)
    match getattr(order, "command", None):
        case 176:
            px4.mode = (int(order.param2) << 16) | (int(order.param3) << 24)
        case 21:
            px4.mode = LAND
        case 192 if order.x == 2**31 - 1:
            px4.target = px4.places(Point(0.5, 0.5))
        case 192:
            px4.mode, px4.target = HOLD, (order.x / 1e7, order.y / 1e7)


@pytest.mark.parametrize("verb", ORDERS)
def test_lost_acknowledgements_do_no_harm_where_telemetry_shows_it(run, verb):
    px4 = run(follows, verb, **state_for(verb))
    assert px4.commands() == ORDERS[verb]


def test_lost_acknowledgements_of_a_jump_and_a_stop_do_no_harm_either(run, hovering):
    async def script(vehicle):
        await vehicle.hold()
        await vehicle.jump(ITEM)

    px4 = run(follows, script, **hovering)
    assert [entry for entry in px4.commands() if entry[1] != CHANGE_SPEED] == STOP + JUMP


def test_a_new_place_in_hold_is_confirmed_by_its_acknowledgement_alone(run, hovering):
    px4 = run(lambda px4, order: px4.acknowledge(order, ACCEPTED), reposition, **hovering)
    (order,) = px4.orders
    assert (order.frame, order.param2) == (5, 1.0)
    assert order.z == pytest.approx(40.0)  # 30 m above home, which is at 10 m here


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("verb", ORDERS)
def test_a_refusal_is_reported_at_once(run, verb):
    px4 = run(
        lambda px4, order: px4.acknowledge(order, DENIED),
        fails(verb, "DENIED"),
        **state_for(verb),
    )
    assert px4.commands() == ORDERS[verb]


@pytest.mark.usefixtures("patient")
def test_of_the_two_acknowledgements_of_a_mode_the_second_counts(run, hovering):
    def refuses(px4, order):
        set_item(px4, order)
        if order.get_type() == "COMMAND_LONG":
            px4.acknowledge(order, ACCEPTED)
            px4.acknowledge(order, TEMPORARILY_REJECTED)

    px4 = run(refuses, fails(jump, "TEMPORARILY_REJECTED"), **hovering)
    assert px4.commands() == JUMP


def test_what_is_refused_for_now_is_asked_for_again(run):
    def later(px4, order):
        if len(px4.orders) < 2:
            px4.acknowledge(order, TEMPORARILY_REJECTED)
        else:
            follows(px4, order)

    assert run(later, hold).commands() == ORDERS[hold] * 2


def test_a_vehicle_that_is_about_it_is_waited_for(run, hovering, monkeypatch):
    monkeypatch.setattr(px4_commands, "CONFIRM_S", 2.0)
    monkeypatch.setattr(px4_commands, "LONGEST_S", 2.0 * LIMIT_S)

    class Slow:
        """Says so with each of its next hundred heartbeats: five seconds."""

        def __call__(self, px4, order):
            tell, left = px4._tell, iter(range(100))

            def busy():
                tell()
                if next(left, None) is not None:
                    px4.acknowledge(order, IN_PROGRESS)
                else:
                    px4.acknowledge(order, ACCEPTED)

            px4._tell = busy

    assert run(Slow(), hold, **hovering).commands() == STOP


@pytest.mark.parametrize("to", [(255, 190), (1, 190), (0, 0)])
def test_an_acknowledgement_for_another_is_not_ours(run, hovering, to):
    def for_another(px4, order):
        px4.acknowledge(order, ACCEPTED, to)

    assert run(for_another, fails(reposition), **hovering).commands() == STOP


@pytest.mark.parametrize(("acknowledged", "confirmed"), [(1, False), (2, True)])
def test_a_late_acknowledgement_is_that_of_the_order_before(run, hovering, acknowledged, confirmed):
    def late(px4, order):
        if len(px4.orders) == 2:
            for _ in range(acknowledged):
                px4.acknowledge(order, ACCEPTED)

    async def script(vehicle):
        with pytest.raises(NotConfirmedError):
            await vehicle.reposition(ELSEWHERE, 30.0)
        again = reposition if confirmed else fails(reposition)
        await again(vehicle)

    assert run(late, script, **hovering).commands() == STOP * 2


def after_one_that_is_lost(verb, target=None):
    """Answers to the second order with one acknowledgement, and by flying somewhere."""

    def answer(px4, order):
        if len(px4.orders) == 2:
            px4.target = px4.places(target) if target else px4.target
            px4.acknowledge(order, ACCEPTED)

    async def script(vehicle):
        with pytest.raises(NotConfirmedError):
            await vehicle.reposition(THERE, 30.0)
        await verb(vehicle)

    return answer, script


def test_a_stop_after_an_order_that_was_lost_shows_by_where_it_hovers(run, mission):
    here = {"mode": HOLD, "target": mission.frame.to_geodetic(mission.home)}
    answer, script = after_one_that_is_lost(hold)
    assert run(answer, script, **here).commands() == STOP * 2


def test_an_order_from_before_that_is_late_is_no_stop(run, mission):
    here = {"mode": HOLD, "target": mission.frame.to_geodetic(mission.home)}
    answer, script = after_one_that_is_lost(fails(hold), THERE)
    assert run(answer, script, **here).commands() == STOP * 2


def test_the_speed_is_told_beside_and_until_it_is_acknowledged(run, hovering):
    def answer(px4, order):
        follows(px4, order)
        speeds = [entry for entry in px4.commands() if entry[1] == CHANGE_SPEED]
        if getattr(order, "command", None) == CHANGE_SPEED and len(speeds) == 2:
            px4.acknowledge(order, ACCEPTED)
            loop.call_soon_threadsafe(known.set)

    async def script(vehicle):
        nonlocal loop
        loop = asyncio.get_running_loop()
        await vehicle.jump(ITEM)
        await known.wait()

    loop, known = None, asyncio.Event()
    px4 = run(answer, script, **hovering)
    assert px4.commands() == [*JUMP, *[("COMMAND_LONG", CHANGE_SPEED)] * 2]


# A hold calls off what waits for its confirmation.


@pytest.fixture
def hold_over(run, mission):
    """Gives a motion, and a hold as soon as `number` orders have arrived; both as a flight does."""

    def fly(answer, motion, number, **state):
        reports = []

        async def script(vehicle):
            nonlocal loop
            loop = asyncio.get_running_loop()
            done = asyncio.Event()

            def report(event):
                reports.append(event)
                done.set()

            sender = MotionSender(vehicle, FlightPlan.of(mission), lambda _: None, report)
            sending = asyncio.create_task(sender.run())
            sender.give(motion)
            await arrived.wait()
            sender.give(HoldHere("asked for"))
            await done.wait()
            sending.cancel()

        def take(px4, order):
            answer(px4, order)
            if len(px4.orders) == number:
                loop.call_soon_threadsafe(arrived.set)

        loop, arrived = None, asyncio.Event()
        return run(take, script, **state), reports

    return fly


def is_stop(order):
    return getattr(order, "command", None) == REPOSITION and order.x == 2**31 - 1


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("mode", [HOLD, MISSION])
def test_a_hold_does_not_wait_for_a_go_to_that_was_lost(hold_over, hovering, mode):
    def answer(px4, order):
        if is_stop(order):
            px4.mode, px4.target = HOLD, px4.places(Point(0.5, 0.5))
            px4.acknowledge(order, ACCEPTED)

    state = {**hovering, "mode": mode}
    px4, reports = hold_over(answer, FlyToPoint(THERE, 30.0), 1, **state)
    assert px4.commands() == STOP * 2
    assert reports == [CommandConfirmed(HoldHere("asked for"))]


@pytest.mark.usefixtures("patient")
def test_a_hold_stops_a_jump_that_shows_only_after_it(hold_over, hovering, mission):
    """The mode of the jump arrives, and is told in a heartbeat that the hold has not reached."""

    def answer(px4, order):
        set_item(px4, order)
        if is_stop(order):
            px4.mode = MISSION
            px4._tell()
            px4.mode, px4.target = HOLD, px4.places(Point(0.5, 0.5))
            px4.acknowledge(order, ACCEPTED)

    node = ITEM - FlightPlan.of(mission).first_node_item
    jump_there = FlyToNode(node, mission.waypoints[node - 1].position)
    px4, reports = hold_over(answer, jump_there, 2, **hovering)
    assert px4.commands() == JUMP + STOP
    assert reports == [CommandConfirmed(HoldHere("asked for"))]


# Arming.

STANDING = {"mode": HOLD, "landed": GROUND, "armed": False}
ARM = [("COMMAND_LONG", ARM_DISARM)]


async def arm_and_start(vehicle):
    await vehicle.arm()
    await vehicle.start()


def refuses(match):
    async def script(vehicle):
        with pytest.raises(ArmingRefusedError, match=match):
            await arm_and_start(vehicle)

    return script


def test_a_vehicle_that_is_disarmed_as_soon_as_it_was_armed_is_not_armed_again(run):
    def disarmed_at_once(px4, order):
        px4.acknowledge(
            order, ACCEPTED
        )  # and a ground station disarms it before the next HEARTBEAT

    assert run(disarmed_at_once, refuses("disarmed again"), **STANDING).commands() == ARM


@pytest.mark.parametrize("answer", [silent, deaf])
def test_an_arming_that_is_not_answered_is_not_repeated(run, answer):
    assert run(answer, refuses("does not show"), **STANDING).commands() == ARM


def test_an_arming_that_shows_needs_no_answer(run):
    def arms(px4, order):
        px4.armed = True
        follows(px4, order)

    assert run(arms, arm_and_start, **STANDING).commands() == ARM + ORDERS[start]


@pytest.mark.parametrize(
    ("choice", "said"),
    [({"mode": POSITION}, "the pilot chose Position"), ({"armed": False}, "disarmed")],
)
def test_what_the_pilot_chose_since_the_arming_is_not_taken_back(run, choice, said):
    def arms(px4, _order):
        px4.armed = True

    async def script(vehicle):
        await vehicle.arm()
        for name, value in choice.items():
            setattr(px4s[0], name, value)
        await vehicle.telemetry.wait_for(
            lambda: vehicle.telemetry.mode is FlightMode.POSITION or not vehicle.telemetry.armed
        )
        with pytest.raises(ArmingRefusedError, match=said):
            await vehicle.start()

    px4s = []

    def answer(px4, order):
        px4s.append(px4)
        arms(px4, order)

    assert run(answer, script, **STANDING).commands() == ARM
