"""Going nowhere: HOLD, on request; LAND, the descent at home; PASSIVE and DONE."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from air_router.controller.model.actions import FlyToNode, FlyToPoint, LandHere
from air_router.controller.model.mission_context import MissionContext, StateHandler
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.pending_setpoints import stopping_point


@dataclass(slots=True, eq=False)
class HoldState(StateHandler):
    """Stops, and stays there; or at the end of the leg, where that is as near.

    Args:
        context: How fast the vehicle is, and where.
        gate: Stops it.
    """

    _context: MissionContext
    _gate: CommandGate

    def begin(self) -> None:
        """Stop."""
        ending = self._stops_anyway()
        self._gate.navigator.stop()
        if not ending:
            self._gate.hold("hold was requested")

    def no_route(self, refusal: str) -> None:
        """Stay."""
        self._gate.wait_for_way(refusal)

    retry = begin

    def _stops_anyway(self) -> bool:
        """Whether the leg under way ends no farther off than braking now would.

        To brake once more there makes a vehicle stop later, perhaps beyond what was checked.
        """
        commanded_mode, telemetry = self._gate.commanded_mode, self._context.telemetry
        last = commanded_mode.last
        if (
            commanded_mode.pending
            or telemetry is None
            or not isinstance(last, FlyToNode | FlyToPoint)
        ):
            return False
        here = telemetry.position
        rest = stopping_point(telemetry, self._gate.navigator.reaction_s)
        return math.dist(here, last.position) <= math.dist(here, rest)


@dataclass(slots=True, eq=False)
class LandState(StateHandler):
    """Descends at home.

    Args:
        gate: Lands it.
    """

    _gate: CommandGate

    def begin(self) -> None:
        """Descend."""
        self._gate.command(LandHere())

    def no_route(self, refusal: str) -> None:
        """It stays above home."""
        self._gate.wait_for_way(refusal)

    def replan(self) -> None:
        """Descend, unless it does, or was told to and has not failed."""
        if not isinstance(self._gate.commanded_mode.last, LandHere):
            self.begin()

    retry = replan


@dataclass(slots=True, eq=False)
class HandsOffState(StateHandler):
    """PASSIVE and DONE: the vehicle is not ours any more, or down. Nothing is flown."""

    _begin: Callable[[], None]  # ends what is commanded

    def begin(self) -> None:
        """Leave nothing behind that would still be commanded."""
        self._begin()
