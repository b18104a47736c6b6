"""The one way to command the vehicle: past the guards, leg by leg, or to hold and wait."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from air_router.controller.model.actions import FlyToNode, HoldHere, Motion
from air_router.controller.model.events import CommandFailed
from air_router.controller.model.mission_context import Cockpit
from air_router.controller.motion.commanded_mode import Custody
from air_router.controller.motion.navigator import Goal, Navigator, Progress
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.vehicle import FlightMode

RETRY_S: Final = 3.0
"""Pause before something that could not be done is tried again."""

TELL_AGAIN_S: Final = 10.0
"""Pause before another reason to hover is told."""

JUMPS: Final = 4
"""After so many jumps that the vehicle did not follow, its plan is left alone."""

Guard = Callable[[Motion], Motion | None]
"""Looks at a motion before it is commanded: the same or another goes on, None drops it."""


class Helm:
    """Commands motions, and keeps what became of them. Where to, its callers know.

    Args:
        cockpit: What the vehicle says, and what is flown now.
        navigator: Plans and checks.
        plan: The plan on board, for the autopilot's item numbers.

    Attributes:
        navigator: Takes the vehicle to one goal at a time.
        custody: Who has the vehicle, and what it was told last.
        guards: Asked in this order about every motion but a hold, which is always allowed.
    """

    def __init__(self, cockpit: Cockpit, navigator: Navigator, plan: FlightPlan) -> None:
        self.navigator = navigator
        self.custody = Custody()
        self.guards: tuple[Guard, ...] = ()
        self._cockpit = cockpit
        self._plan = plan
        self._waits_why: str | None = None
        self._wait_told_s = -math.inf

    # Commands.

    def command(self, motion: Motion) -> None:
        """Have the vehicle do this, if no guard objects."""
        wanted: Motion | None = motion
        for guard in self.guards:
            if wanted is None or isinstance(wanted, HoldHere):
                break
            wanted = guard(wanted)
        if wanted is not None:
            self.send(wanted)

    def send(self, motion: Motion) -> None:
        """The same, whatever the guards say."""
        if isinstance(motion, HoldHere) and isinstance(self.custody.pending, HoldHere):
            return  # that is under way
        self.custody.commanded(motion)
        self.navigator.commanded.sent(motion)
        self._cockpit.do(motion)

    def hold(self, why: str) -> None:
        """Stop, unless that is what the vehicle was told last."""
        if not isinstance(self.custody.last, HoldHere):
            self.command(HoldHere(why))

    def stop_if_doubtful(self, motion: Motion) -> Motion:
        """A guard: a jump that would not show which of several orders is followed waits."""
        if isinstance(motion, FlyToNode) and self._doubtful(motion):
            return self.navigator.hold_first()
        return motion

    def _doubtful(self, jump: FlyToNode) -> bool:
        telemetry = self._cockpit.telemetry
        shows = (
            telemetry is not None
            and telemetry.mode is FlightMode.MISSION
            and telemetry.item == self._plan.item_of(jump.node)
        )
        return self.navigator.commanded.doubtful(jump, shows=shows)

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion that was decided a moment ago must not be commanded now; None if it may."""
        telemetry = self._cockpit.telemetry
        if motion is not self.custody.pending or telemetry is None:
            return "it was called off"
        return self.navigator.objection(motion, telemetry, now_s)

    # What became of them.

    def confirmed(self, motion: Motion) -> None:
        """The vehicle follows."""
        self.custody.confirmed(motion)
        self.navigator.commanded.confirmed(motion)

    def failed(self, event: CommandFailed) -> None:
        """The vehicle did not follow: once more in a moment, unless it was told another since."""
        if not self.custody.failed(event.action):
            return
        self._cockpit.say(f"the vehicle did not follow: {event.reason}")
        if self.custody.refused_jumps >= JUMPS and not self.navigator.by_points:
            self.navigator.by_points = True
            self._cockpit.say("the plan on board is not flown: flying to points instead")
        self._cockpit.schedule.retry_in(RETRY_S)

    def let_go(self) -> None:
        """Somebody else flies."""
        self.navigator.stop()
        self.navigator.commanded.forget()
        self.custody.release()

    # Ways.

    def plan_to(self, goal: Goal) -> Motion | None:
        """The first motion of a way to a goal; `navigator.progress` says whether there is one."""
        return self.navigator.go(goal, self._cockpit.heard)

    @property
    def refusal(self) -> str:
        """Why there was no way."""
        refusal = self.navigator.refusal
        return refusal.reason if refusal is not None else "no clear way"

    def advance(self, motion: Motion | None) -> None:
        """Command the next motion, if any, and tell the journey where it stands."""
        if motion is not None:
            self.command(motion)
            if not isinstance(motion, HoldHere):
                self._waits_why = None
        progress = self.navigator.progress
        if progress is Progress.ARRIVED:
            self._cockpit.journey.arrived()
        elif progress is Progress.STRANDED:
            self._cockpit.journey.stranded(self.refusal)

    def fly_to(self, goal: Goal) -> None:
        """Set out for a goal."""
        self.advance(self.plan_to(goal))

    def fly_again(self) -> None:
        """Set out for the same goal once more."""
        self.advance(self.navigator.again(self._cockpit.heard))

    def wait_here(self, why: str) -> None:
        """Hover where no way is clear, say so once, and look again in a moment."""
        now_s = self._cockpit.now_s
        if why != self._waits_why and now_s >= self._wait_told_s + TELL_AGAIN_S:
            self._waits_why, self._wait_told_s = why, now_s
            self._cockpit.say(f"holding: {why}")
        self.hold(why)
        self._cockpit.schedule.retry_in(RETRY_S)
