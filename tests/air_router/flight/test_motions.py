"""What leaves after what: the newest motion, out of the mode that it finds by our own order."""

import asyncio

import pytest

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere
from air_router.controller.model.events import CommandConfirmed, CommandFailed
from air_router.errors import NotConfirmedError
from air_router.flight.motions import MotionSender
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.vehicle import FlightMode
from geo.frame import Point

THERE = Point(10.0, 10.0)
JUMP, GO_TO = FlyToNode(1, THERE), FlyToPoint(THERE, 40.0)


class SlowVehicle:
    """A vehicle that follows a jump once it may, and keeps which modes each order may end."""

    def __init__(self, fault=None):
        self.follow = asyncio.Event()
        self.begun = asyncio.Event()
        self.ends = []
        self._fault = fault

    async def jump(self, item, objection=None, *, out_of=None):
        self.ends.append(out_of)
        self.begun.set()
        await self.follow.wait()
        if self._fault is not None:
            raise self._fault

    async def reposition(self, position, altitude_m, objection=None, *, out_of=None):
        self.ends.append(out_of)

    async def hold(self, *, out_of=None):
        self.ends.append(out_of)


def sent(mission, fault=None, then=GO_TO):
    """A motion that was decided on while the jump before it was under way, and what it may end."""

    async def script():
        reports, vehicle = [], SlowVehicle(fault)
        done = asyncio.Event()

        def report(event):
            reports.append(event)
            if event.action is then:
                done.set()

        sender = MotionSender(
            vehicle,
            FlightPlan.of(mission),
            lambda _: None,
            lambda: frozenset({FlightMode.HOLD}),
            report,
        )
        running = asyncio.create_task(sender.run())
        sender.give(JUMP)
        await vehicle.begun.wait()
        sender.give(then)
        vehicle.follow.set()
        await done.wait()
        running.cancel()
        return vehicle.ends, reports

    return asyncio.run(script())


def test_a_motion_that_waited_leaves_out_of_the_mode_that_our_order_before_it_brought(pennovation):
    (_, ends), (first, second) = sent(pennovation)
    assert isinstance(first, CommandConfirmed)
    assert isinstance(second, CommandConfirmed)
    assert ends == {FlightMode.HOLD, FlightMode.MISSION}


def test_an_order_that_was_not_followed_explains_no_mode(pennovation):
    (_, ends), (first, _) = sent(pennovation, NotConfirmedError("deaf"))
    assert isinstance(first, CommandFailed)
    assert ends == {FlightMode.HOLD}


@pytest.mark.parametrize("then", [GO_TO, HoldHere("why")])
def test_what_left_before_it_ends_only_what_was_decided_on(pennovation, then):
    (before, _), _ = sent(pennovation, then=then)
    assert before == {FlightMode.HOLD}
