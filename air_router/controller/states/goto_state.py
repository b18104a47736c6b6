"""Flying to requested points: the state GOTO."""

from __future__ import annotations

import math
from typing import Final

from air_router.controller.model.behaviour import Signal
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import STANDING_M_S
from air_router.controller.states.goto_task import GotoTask

SETTLING_S: Final = 10.0
"""So long a vehicle may take at a point until it stands; in gusts it perhaps never does."""


class GotoState:
    """Flies to one point after the other, and hovers at the last.

    Args:
        context: Where it signals that it sets out, and that no point is left to fly to.
        gate: Flies there.

    Attributes:
        goto_task: The points that it was sent to on request, last.
    """

    def __init__(self, context: MissionContext, gate: CommandGate) -> None:
        self.goto_task: GotoTask | None = None
        self._context = context
        self._gate = gate
        self._there_since_s: float | None = None

    def set_out(self, goto_task: GotoTask, left_s: float | None = None) -> None:
        """Fly a task, and hover for `left_s` at its end; None: as long as it says."""
        self.goto_task = goto_task
        self._context.schedule.carry(goto_task.hold_s if left_s is None else left_s)
        self._context.signal(Signal.GOTO)

    def begin(self) -> None:
        """Fly to the point whose turn it is."""
        self._there_since_s = None
        if self.goto_task is not None:
            self._gate.fly_to(self.goto_task.goal)

    def arrived(self) -> None:
        """On to the next point once it stands here; the state's timer runs at the last."""
        if self._context.schedule.running or not self._settled:
            return
        if not self._next():
            self._context.schedule.start()
            self._context.say("at the last point")

    def no_route(self, refusal: str) -> None:
        """On to the next point, without this one."""
        if self.goto_task is not None:
            self._context.say(f"point {self.goto_task.done + 1} left out: {refusal}")
        if not self._next():
            self._context.signal(Signal.NO_WAY)

    def retry(self) -> None:
        """To the same point."""
        self._gate.fly_again()

    def replan(self) -> None:
        """To the same point, by a way planned anew."""
        self.begin()

    def _next(self) -> bool:
        """Fly to the next point, if there is one."""
        if self.goto_task is None or not self.goto_task.next():
            return False
        self.begin()
        return True

    @property
    def _settled(self) -> bool:
        """Whether the vehicle stands at its point, or gusts have not let it for long enough."""
        telemetry, now_s = self._context.telemetry, self._context.now_s
        if self._there_since_s is None:
            self._there_since_s = now_s
        stands = telemetry is not None and math.hypot(*telemetry.velocity_m_s) < STANDING_M_S
        return stands or now_s - self._there_since_s >= SETTLING_S
