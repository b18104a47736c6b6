"""Hovering because somebody asked for it: the state HOLD."""

from __future__ import annotations

import math

from air_router.controller.model.actions import FlyToNode, FlyToPoint
from air_router.controller.model.mission_context import Cockpit
from air_router.controller.motion.command_gate import Helm
from air_router.controller.motion.navigator import stopping_point


class Hovering:
    """Stops, and stays there; or at the end of the leg, where that is as near.

    Args:
        cockpit: How fast the vehicle is, and where.
        helm: Stops it.
    """

    def __init__(self, cockpit: Cockpit, helm: Helm) -> None:
        self._cockpit = cockpit
        self._helm = helm

    def begin(self) -> None:
        """Stop."""
        ending = self._stops_anyway()
        self._helm.navigator.stop()
        if not ending:
            self._helm.hold("somebody asked for it")

    def arrived(self) -> None:
        """Stay."""

    def stranded(self, refusal: str) -> None:
        """Stay."""
        if not self._cockpit.schedule.retrying:
            self._helm.wait_here(refusal)

    def try_again(self) -> None:
        """It did not stop."""
        self.begin()

    def fly_on(self) -> None:
        """Stay."""

    def _stops_anyway(self) -> bool:
        """Whether the leg under way ends no farther off than braking now would.

        To brake once more there makes a vehicle stop later, perhaps beyond what was checked.
        """
        custody, telemetry = self._helm.custody, self._cockpit.telemetry
        last = custody.last
        if custody.pending or telemetry is None or not isinstance(last, FlyToNode | FlyToPoint):
            return False
        here = telemetry.position
        rest = stopping_point(telemetry, self._helm.navigator.reaction_s)
        return math.dist(here, last.position) <= math.dist(here, rest)
