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
    """Holds one motion, and sends it to the vehicle.

    Args:
        vehicle: Receives the motions.
        plan: The plan on board.
        objection: Returns why a motion must not be sent anymore; None: it may.
        out_of: Returns the flight modes that the last decided motion may end.
        report: Called with the outcome of a motion, unless it was replaced or canceled.
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
        self._modes: frozenset[FlightMode] = frozenset()  # modes that the waiting motion may end
        self._report = report
        self._waiting: Motion | None = None  # replaced by a newer one
        self._given = asyncio.Event()  # a motion waits to be sent
        self._sending: asyncio.Task[None] | None = None  # until the vehicle follows
        self._objected: str | None = None  # objection to the motion being sent

    def give(self, motion: Motion) -> None:
        """Send this motion next; it replaces a waiting one.

        A hold is sent at once, without waiting for the confirmation of the previous motion. The
        previous motion may still arrive late; controller and vehicle account for that.
        """
        self._waiting, self._modes = motion, self._out_of()
        self._given.set()
        if isinstance(motion, HoldHere) and self._sending is not None:
            self._sending.cancel()

    def call_off(self) -> None:
        """The pilot flies: drop the waiting motion, and do not repeat the one being sent."""
        self._waiting = None
        if self._sending is not None:
            self._sending.cancel()

    async def run(self) -> None:
        """Send motions until canceled."""
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
            # The waiting motion was decided before: the vehicle is in this one's mode by our
            # command.
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
