"""No pilot is commanded over: what moves the vehicle leaves once, and again only on evidence.

Real MAVSDK over UDP against a vehicle that swallows acknowledgements, and does what a test scripts.
"""

import asyncio
import itertools

import pytest

from air_router.errors import PlanRefusedError
from air_router.vehicle.px4.limits import ORDER_ATTEMPTS
from geo.frame import Point
from tests.system.orders.verbs import (
    ACCEPTED,
    JUMP,
    ORDERS,
    STOP,
    deaf,
    fails,
    hold,
    jump,
    land,
    reposition,
    set_item,
    silent,
    start,
    state_for,
)
from tests.system.scripted_px4 import HOLD, LAND, POSITION

pytestmark = [pytest.mark.patient, pytest.mark.xdist_group("orders")]


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
    assert px4.commands() == ORDERS[verb] * ORDER_ATTEMPTS
    assert [order.confirmation for order in px4.orders] == list(range(ORDER_ATTEMPTS))
    assert all(later > sooner for sooner, later in itertools.pairwise(heartbeats))


def test_mission_mode_is_not_chosen_again_once_another_plan_is_on_board(run):
    def replaced(px4, _order):
        px4.plan_id = 2

    async def refused(vehicle):
        with pytest.raises(PlanRefusedError, match="start the mission again"):
            await start(vehicle)

    px4 = run(replaced, refused, **state_for(start))
    assert px4.commands() == ORDERS[start]


def test_a_stop_is_repeated_while_nothing_changes(run, hovering):
    assert run(deaf, fails(hold), **hovering).commands() == STOP * ORDER_ATTEMPTS


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


def chosen_back(px4, order):
    """It follows the command, and a pilot has chosen the mode of before when the next one comes."""
    set_item(px4, order)
    if order.get_type() != "MISSION_SET_CURRENT":
        px4.acknowledge(order, ACCEPTED)


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("verb", ORDERS)
def test_the_mode_of_before_that_a_pilot_chose_before_ours_has_shown_is_not_ended(run, verb):
    px4 = run(chosen_back, fails(verb, "the pilot chose"), **state_for(verb))
    assert px4.commands() == ORDERS[verb]


@pytest.mark.usefixtures("patient")
def test_a_hold_that_a_pilot_chose_before_a_jump_has_shown_is_not_ended(run, hovering):
    assert run(chosen_back, fails(jump, "the pilot chose Hold"), **hovering).commands() == JUMP


@pytest.mark.parametrize("verb", [hold, land])
def test_a_vehicle_slower_than_its_companion_is_given_its_own_time_to_follow(run, verb):
    """A simulation under load: its 15 ms are half a second here, and no pilot has chosen."""

    def follows_slowly(px4, order):
        px4.acknowledge(order, ACCEPTED)
        px4.rate = 0.03
        mode = LAND if verb is land else HOLD
        px4.later.append((px4.boot_ms() + 15, lambda: setattr(px4, "mode", mode)))

    px4 = run(follows_slowly, verb, **state_for(verb))
    assert px4.commands() == ORDERS[verb]


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
