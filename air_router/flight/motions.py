"""Sends the controller's motions to the vehicle: one at a time, always the newest."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from air_router.controller.model import (
    CommandConfirmed,
    CommandFailed,
    FlyToNode,
    FlyToPoint,
    HoldHere,
    LandHere,
    Motion,
)
from air_router.controller.motion import MODES
from air_router.errors import NotConfirmedError, NotSentError
from air_router.mission import FlightPlan
from air_router.vehicle import FlightMode, TakenOverError, Vehicle


class MotionSender:
    """A place for one motion, and what takes it to the vehicle.

    Args:
        vehicle: Who is announced.
        plan: The plan on board.
        objection: Why a motion must not be sent now, after all; None if it may.
        out_of: The flight modes that the motion which was decided on last may end.
        report: Takes what became of a motion. One that was replaced or called off is not reported.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        plan: FlightPlan,
        objection: Callable[[Motion], str | None],
        out_of: Callable[[], frozenset[FlightMode]],
        report: Callable[[CommandConfirmed | CommandFailed], None],
    ) -> None:
        self._vehicle = vehicle
        self._plan = plan
        self._objection = objection
        self._out_of = out_of
        self._modes: frozenset[FlightMode] = frozenset()  # that the waiting motion may end
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
        self._waiting, self._modes = motion, self._out_of()
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
        self._sending = asyncio.ensure_future(self._command(motion, self._modes))
        try:
            await asyncio.wait({self._sending})
        finally:
            self._sending.cancel()
        if self._sending.cancelled():
            return
        try:
            self._sending.result()
        except NotConfirmedError as error:
            sent = self._objected is None and not isinstance(error, NotSentError)
            taken = error.mode if isinstance(error, TakenOverError) else None
            sent = sent and not (isinstance(error, TakenOverError) and not error.sent)
            self._report(CommandFailed(motion, str(error), sent=sent, taken=taken))
        else:
            # What waits was decided on before: the vehicle is in the mode of this one by our order.
            self._modes |= {MODES[type(motion)]}
            self._report(CommandConfirmed(motion))

    def _object(self, motion: Motion) -> str | None:
        self._objected = self._objection(motion)
        return self._objected

    async def _command(self, motion: Motion, out_of: frozenset[FlightMode]) -> None:
        match motion:
            case FlyToNode(node=node):
                item = self._plan.item_of(node)
                await self._vehicle.jump(item, lambda: self._object(motion), out_of=out_of)
            case FlyToPoint(position=position, altitude_m=altitude_m):
                await self._vehicle.reposition(
                    position, altitude_m, lambda: self._object(motion), out_of=out_of
                )
            case HoldHere():
                await self._vehicle.hold(out_of=out_of)
            case LandHere():
                await self._vehicle.land(out_of=out_of)
