"""What every state of a mission needs to move the vehicle: plan, command, hold, say why."""

from __future__ import annotations

from typing import TYPE_CHECKING

from air_router.actions import Action, Announce, HoldHere, Motion
from air_router.custody import Custody

if TYPE_CHECKING:
    from air_router.navigator import Goal, Navigator
    from air_router.vehicle import Telemetry


class Steering:
    """The controller's hands; it decides nothing.

    Attributes:
        navigator: Takes the vehicle to one goal at a time.
        custody: Who has the vehicle, and what it was told last.
        telemetry: What the vehicle said last.
    """

    def __init__(self, navigator: Navigator) -> None:
        self.navigator = navigator
        self.custody = Custody()
        self.telemetry: Telemetry | None = None
        self._actions: list[Action] = []

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion that was decided a moment ago must not be commanded now; None if it may."""
        if motion is not self.custody.pending or self.telemetry is None:
            return "it was called off"
        return self.navigator.objection(motion, self.telemetry, now_s)

    def _plan_to(self, goal: Goal) -> Motion | None:
        assert self.telemetry is not None  # noqa: S101 - in the air there was telemetry
        return self.navigator.go(goal, self.telemetry)

    def _hold(self, why: str) -> None:
        """Stop, unless that is what the vehicle was told last."""
        if not isinstance(self.custody.last, HoldHere):
            self._command(HoldHere(why))

    def _command(self, motion: Motion) -> None:
        self.custody.commanded(motion)
        self._actions.append(motion)

    def _refusal(self) -> str:
        refusal = self.navigator.refusal
        return refusal.reason if refusal is not None else "no clear way"

    def _say(self, text: str) -> None:
        self._actions.append(Announce(text))
