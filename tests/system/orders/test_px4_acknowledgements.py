"""Which acknowledgement is that of which order; and a hold that leaves before the last one's came.

Real MAVSDK over UDP against a vehicle that acknowledges late, twice, or to another station.
"""

import asyncio
import contextlib

import pytest

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere
from air_router.controller.model.events import CommandConfirmed
from air_router.errors import ArmingRefusedError, NotConfirmedError
from air_router.flight.motions import MotionSender
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.px4 import px4_commands
from air_router.vehicle.vehicle import FlightMode, TakenOverError
from geo.frame import Point
from tests.system.orders.verbs import (
    ACCEPTED,
    DENIED,
    ELSEWHERE,
    IN_PROGRESS,
    ITEM,
    JUMP,
    LIMIT_S,
    ORDERS,
    STOP,
    TEMPORARILY_REJECTED,
    THERE,
    deaf,
    fails,
    follows,
    hold,
    jump,
    reposition,
    set_item,
    silent,
    start,
    state_for,
)
from tests.system.scripted_px4 import (
    ARM_DISARM,
    CHANGE_SPEED,
    GROUND,
    HOLD,
    LAND,
    MISSION,
    POSITION,
    REPOSITION,
)

pytestmark = [pytest.mark.patient, pytest.mark.xdist_group("orders")]

OURS = frozenset({FlightMode.HOLD, FlightMode.MISSION})


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


@pytest.mark.parametrize("verb", [reposition, hold])
@pytest.mark.parametrize(("version", "changes_mode"), [((1, 17), 1.0), ((1, 18), 0.0)])
def test_from_1_18_on_no_place_in_hold_changes_the_mode(run, hovering, verb, version, changes_mode):
    px4 = run(
        lambda px4, order: px4.acknowledge(order, ACCEPTED), verb, version=version, **hovering
    )
    (order,) = px4.orders
    assert (order.get_type(), order.param2) == ("COMMAND_INT", changes_mode)


@pytest.mark.parametrize("verb", [reposition, hold])
def test_a_place_that_finds_another_mode_is_refused_by_px4_and_is_the_pilot_s(run, hovering, verb):
    """The pilot chose it while the order was on its way: no look of ours could know that."""

    def taken(px4, order):
        px4.mode = LAND
        px4.acknowledge(order, DENIED)

    async def script(vehicle):
        with pytest.raises(TakenOverError, match="the pilot chose Land mode") as caught:
            await verb(vehicle)
        assert caught.value.mode is FlightMode.LAND

    px4 = run(taken, script, version=(1, 18), **hovering)
    assert px4.commands() == STOP


def test_what_calls_off_a_jump_out_of_hold_changes_the_mode_in_1_18_too(run, hovering):
    """The jump's Mission mode may yet come: a stop that changes no mode would not end it."""

    def answer(px4, order):
        set_item(px4, order)
        if px4.commands() == JUMP:
            loop.call_soon_threadsafe(jumped.set)
        if getattr(order, "command", None) == REPOSITION:
            px4.acknowledge(order, ACCEPTED)

    async def script(vehicle):
        nonlocal loop
        loop = asyncio.get_running_loop()
        jumps = asyncio.create_task(vehicle.jump(ITEM))
        await jumped.wait()
        jumps.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await jumps
        await vehicle.hold()

    loop, jumped = None, asyncio.Event()
    px4 = run(answer, script, version=(1, 18), **hovering)
    assert px4.orders[-1].param2 == 1.0


def test_out_of_another_mode_a_place_changes_it_in_1_18_too(run):
    px4 = run(follows, reposition, version=(1, 18))
    (order,) = px4.orders
    assert order.param2 == 1.0


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


@pytest.mark.parametrize("first", [(), (ACCEPTED,)])  # as PX4 1.16 and 1.17 answer at once
def test_what_is_refused_for_now_is_requested_again(run, first):
    """Also if nothing is answered to that: the acceptance of before does not cover it."""

    def later(px4, order):
        if len(px4.orders) == 1:
            for result in (*first, TEMPORARILY_REJECTED):
                px4.acknowledge(order, result)
        elif len(px4.orders) == 3:
            follows(px4, order)

    assert run(later, hold).commands() == ORDERS[hold] * 3


def test_a_vehicle_that_is_about_it_is_waited_for(run, hovering, monkeypatch):
    monkeypatch.setattr(px4_commands, "ORDER_CONFIRM_S", 2.0)
    monkeypatch.setattr(px4_commands, "ORDER_LONGEST_S", 2.0 * LIMIT_S)

    class Slow:
        """Reports it with each of its next hundred heartbeats: five seconds."""

        def __call__(self, px4, order):
            report, left = px4.report, iter(range(100))

            def busy():
                report()
                if next(left, None) is not None:
                    px4.acknowledge(order, IN_PROGRESS)
                else:
                    px4.acknowledge(order, ACCEPTED)

            px4.report = busy

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


def test_the_speed_is_sent_beside_and_until_it_is_acknowledged(run, hovering):
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

            sender = MotionSender(
                vehicle, FlightPlan.of(mission), lambda _: None, lambda: OURS, report
            )
            sending = asyncio.create_task(sender.run())
            sender.give(motion)
            await arrived.wait()
            sender.give(HoldHere("requested"))
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
    assert reports == [CommandConfirmed(HoldHere("requested"))]


@pytest.mark.usefixtures("patient")
def test_a_hold_stops_a_jump_that_shows_only_after_it(hold_over, hovering, mission):
    """The mode of the jump is reported in a heartbeat sent before the hold was received."""

    def answer(px4, order):
        set_item(px4, order)
        if is_stop(order):
            px4.mode = MISSION
            px4.report()
            px4.mode, px4.target = HOLD, px4.places(Point(0.5, 0.5))
            px4.acknowledge(order, ACCEPTED)

    node = FlightPlan.of(mission).node_of(ITEM)
    jump_there = FlyToNode(node, mission.waypoints[node - 1].position)
    px4, reports = hold_over(answer, jump_there, 2, **hovering)
    assert px4.commands() == JUMP + STOP
    assert reports == [CommandConfirmed(HoldHere("requested"))]


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
    assert run(answer, refuses("the vehicle stays in Hold mode"), **STANDING).commands() == ARM


def test_an_arming_that_shows_needs_no_answer(run):
    def arms(px4, order):
        px4.armed = True
        follows(px4, order)

    assert run(arms, arm_and_start, **STANDING).commands() == ARM + ORDERS[start]


@pytest.mark.parametrize(
    ("choice", "message"),
    [({"mode": POSITION}, "the pilot chose Position"), ({"armed": False}, "disarmed")],
)
def test_what_the_pilot_chose_since_the_arming_is_not_taken_back(run, choice, message):
    def arms(px4, _order):
        px4.armed = True

    async def script(vehicle):
        await vehicle.arm()
        for name, value in choice.items():
            setattr(px4s[0], name, value)
        assert await vehicle.telemetry.shows(
            lambda: vehicle.telemetry.mode is FlightMode.POSITION or not vehicle.telemetry.armed,
            LIMIT_S,
        )
        with pytest.raises(ArmingRefusedError, match=message):
            await vehicle.start()

    px4s = []

    def answer(px4, order):
        px4s.append(px4)
        arms(px4, order)

    assert run(answer, script, **STANDING).commands() == ARM
