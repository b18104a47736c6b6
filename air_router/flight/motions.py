"""Sends the controller's motions to the vehicle: one at a time, always the newest."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere, LandHere, Motion
from air_router.controller.model.events import CommandConfirmed, CommandFailed
from air_router.errors import NotConfirmedError
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.vehicle import Vehicle


class MotionSender:
    """A place for one motion, and what takes it to the vehicle.

    Args:
        vehicle: Who is told.
        plan: The plan on board.
        objection: Why a motion must not be sent now, after all; None if it may.
        report: Takes what became of a motion. One that was replaced or called off is not reported.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        plan: FlightPlan,
        objection: Callable[[Motion], str | None],
        report: Callable[[CommandConfirmed | CommandFailed], None],
    ) -> None:
        self._vehicle = vehicle
        self._plan = plan
        self._objection = objection
        self._report = report
        self._waiting: Motion | None = None  # replaced by a newer one
        self._given = asyncio.Event()  # a motion waits to be sent
        self._sending: asyncio.Task[None] | None = None  # until the vehicle follows
        self._objected: str | None = None  # to what is sent, while it is

    def give(self, motion: Motion) -> None:
        """Send this next; one that still waits is void.

        A hold leaves at once: it does not wait until what was sent before is confirmed. That may
        arrive late all the same: controller and vehicle reckon with it.
        """
        self._waiting = motion
        self._given.set()
        if isinstance(motion, HoldHere) and self._sending is not None:
            self._sending.cancel()

    def call_off(self) -> None:
        """The pilot flies: what waits is void, and what is under way is not repeated."""
        self._waiting = None
        if self._sending is not None:
            self._sending.cancel()

    async def run(self) -> None:
        """Send what is given, until cancelled."""
        while True:
            await self._given.wait()
            self._given.clear()
            motion, self._waiting = self._waiting, None
            if motion is not None:
                await self._send(motion)

    async def _send(self, motion: Motion) -> None:
        objection = self._object(motion)
        if objection is not None:
            self._report(CommandFailed(motion, objection, sent=False))
            return
        self._sending = asyncio.ensure_future(self._command(motion))
        try:
            await asyncio.wait({self._sending})
        finally:
            self._sending.cancel()
        if self._sending.cancelled():
            return
        try:
            self._sending.result()
        except NotConfirmedError as error:
            self._report(CommandFailed(motion, str(error), sent=self._objected is None))
        else:
            self._report(CommandConfirmed(motion))

    def _object(self, motion: Motion) -> str | None:
        self._objected = self._objection(motion)
        return self._objected

    async def _command(self, motion: Motion) -> None:
        match motion:
            case FlyToNode(node=node):
                item = self._plan.item_of(node)
                await self._vehicle.jump(item, lambda: self._object(motion))
            case FlyToPoint(position=position, altitude_m=altitude_m):
                await self._vehicle.reposition(position, altitude_m)
            case HoldHere():
                await self._vehicle.hold()
            case LandHere():
                await self._vehicle.land()
