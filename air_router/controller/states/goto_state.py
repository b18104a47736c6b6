"""Flying to points that somebody asked for: the state GOTO."""

from __future__ import annotations

import math
from typing import Final

from air_router.controller.model.behaviour import Signal
from air_router.controller.model.mission_context import Cockpit
from air_router.controller.motion.command_gate import Helm
from air_router.controller.motion.navigator import STANDING_M_S
from air_router.controller.states.goto_task import Errand

SETTLING_S: Final = 10.0
"""So long a vehicle may take at a point until it stands; in gusts it perhaps never does."""


class Errands:
    """Flies to one point after the other, and hovers at the last.

    Args:
        cockpit: Where it signals that it sets out, and that no point is left to fly to.
        helm: Flies there.

    Attributes:
        errand: The points that somebody has sent it to, last.
    """

    def __init__(self, cockpit: Cockpit, helm: Helm) -> None:
        self.errand: Errand | None = None
        self._cockpit = cockpit
        self._helm = helm
        self._there_since_s: float | None = None

    def set_out(self, errand: Errand, left_s: float | None = None) -> None:
        """Fly an errand, and hover for `left_s` at its end; None: as long as it says."""
        self.errand = errand
        self._cockpit.schedule.carry(errand.hold_s if left_s is None else left_s)
        self._cockpit.signal(Signal.GOTO)

    def begin(self) -> None:
        """Fly to the point whose turn it is."""
        self._there_since_s = None
        if self.errand is not None:
            self._helm.fly_to(self.errand.goal)

    def arrived(self) -> None:
        """On to the next point once it stands here; the state's timer runs at the last."""
        if self._cockpit.schedule.running or not self._settled:
            return
        if not self._next():
            self._cockpit.schedule.start()
            self._cockpit.say("at the last point")

    def stranded(self, refusal: str) -> None:
        """On to the next point, without this one."""
        if self.errand is not None:
            self._cockpit.say(f"point {self.errand.done + 1} left out: {refusal}")
        if not self._next():
            self._cockpit.signal(Signal.NO_WAY)

    def try_again(self) -> None:
        """To the same point."""
        self._helm.fly_again()

    def fly_on(self) -> None:
        """To the same point, by a way planned anew."""
        self.begin()

    def _next(self) -> bool:
        """Fly to the next point, if there is one."""
        if self.errand is None or not self.errand.next():
            return False
        self.begin()
        return True

    @property
    def _settled(self) -> bool:
        """Whether the vehicle stands at its point, or gusts have not let it for long enough."""
        telemetry, now_s = self._cockpit.telemetry, self._cockpit.now_s
        if self._there_since_s is None:
            self._there_since_s = now_s
        stands = telemetry is not None and math.hypot(*telemetry.velocity_m_s) < STANDING_M_S
        return stands or now_s - self._there_since_s >= SETTLING_S
