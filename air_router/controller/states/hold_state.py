"""Hovering on request: the state HOLD."""

from __future__ import annotations

import math

from air_router.controller.model.actions import FlyToNode, FlyToPoint
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import stopping_point


class HoldState:
    """Stops, and stays there; or at the end of the leg, where that is as near.

    Args:
        context: How fast the vehicle is, and where.
        gate: Stops it.
    """

    def __init__(self, context: MissionContext, gate: CommandGate) -> None:
        self._context = context
        self._gate = gate

    def begin(self) -> None:
        """Stop."""
        ending = self._stops_anyway()
        self._gate.navigator.stop()
        if not ending:
            self._gate.hold("hold was requested")

    def arrived(self) -> None:
        """Stay."""

    def no_route(self, refusal: str) -> None:
        """Stay."""
        if not self._context.schedule.retrying:
            self._gate.wait_here(refusal)

    def retry(self) -> None:
        """It did not stop."""
        self.begin()

    def replan(self) -> None:
        """Stay."""

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
