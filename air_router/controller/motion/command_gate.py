"""The one way to command the vehicle: past the interlocks, leg by leg, or to hold and wait.

The mode that the autopilot reports is the only truth about who has the vehicle. While a command is
under way (or has failed) the vehicle may be in the mode before it or in the one that it asks for;
once it is confirmed only in that one. Any other mode was chosen by a pilot or a failsafe.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.model.actions import FlyToNode, HoldHere, LandHere, Motion
from air_router.controller.model.events import CommandFailed
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.motion.navigator import Goal, Navigator, Progress
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.vehicle import FlightMode, Telemetry

RETRY_S: Final = 3.0
"""Pause before something that could not be done is tried again."""

TELL_AGAIN_S: Final = 10.0
"""Pause before another reason to hover is told."""

JUMPS: Final = 4
"""After so many jumps that the vehicle did not follow, its plan is left alone."""

Interlock = Callable[[Motion], Motion | None]
"""Looks at a motion before it is commanded: the same or another goes on, None drops it."""


@dataclass(slots=True)
class CommandedMode:
    """The last command to the vehicle and the modes that it implies.

    Attributes:
        pending: The command that the vehicle has neither confirmed nor failed to follow.
        last: The command that the vehicle follows or is asked to; None when it did not.
        refused_jumps: How many jumps within the plan it did not follow, one after the other.
    """

    pending: Motion | None = None
    last: Motion | None = None
    refused_jumps: int = 0
    _modes: frozenset[FlightMode] = frozenset()  # that our commands explain

    def assume(self, mode: FlightMode) -> None:
        """Take the vehicle in the mode that the pilot (or the start) put it in."""
        self.pending = None
        self._modes = frozenset({mode})

    def commanded(self, motion: Motion) -> None:
        """A motion was asked for; it is pending until confirmed or failed."""
        self.pending = self.last = motion
        self._modes |= {mode_of(motion)}

    def confirmed(self, motion: Motion) -> None:
        """The vehicle follows; an older command's late confirmation changes nothing."""
        if motion is self.pending:
            self.assume(mode_of(motion))
            if isinstance(motion, FlyToNode):
                self.refused_jumps = 0

    def failed(self, motion: Motion) -> bool:
        """The vehicle did not follow; True if that was the last command."""
        if motion is not self.pending:
            return False
        self.pending = self.last = None
        self.refused_jumps += isinstance(motion, FlyToNode)
        return True

    def release(self) -> None:
        """Hands off."""
        self.pending = self.last = None
        self._modes = frozenset()

    def taken(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle in the air flies in a mode that we did not ask for, or by a failsafe.

        A failsafe may act in the very mode that we asked for: a fence holds a vehicle that hovers
        in Hold. On the ground the autopilot changes its mode by itself, when it disarms.
        """
        flies = telemetry.in_air and telemetry.armed
        return flies and (telemetry.failsafe or telemetry.mode not in self._modes)


def mode_of(motion: Motion) -> FlightMode:
    """The flight mode in which a motion is flown."""
    match motion:
        case FlyToNode():
            return FlightMode.MISSION
        case LandHere():
            return FlightMode.LAND
        case _:
            return FlightMode.HOLD


@dataclass(slots=True, eq=False)
class CommandGate:
    """Commands motions, and keeps what became of them. Where to, its callers know.

    Args:
        context: What the vehicle says, and what is flown now.
        navigator: Plans and checks.
        plan: The plan on board, for the autopilot's item numbers.

    Attributes:
        navigator: Takes the vehicle to one goal at a time.
        commanded_mode: Who has the vehicle, and what it was told last.
        interlocks: Asked in this order about every motion but a hold, which is always allowed.
    """

    _context: MissionContext
    navigator: Navigator
    _plan: FlightPlan
    commanded_mode: CommandedMode = field(default_factory=CommandedMode)
    interlocks: tuple[Interlock, ...] = ()
    _waits_why: str | None = None  # reason announced last
    _wait_told_s: float = -math.inf  # when, vehicle's clock

    # Commands.

    def command(self, motion: Motion) -> None:
        """Have the vehicle do this, if no interlock objects."""
        wanted: Motion | None = motion
        for interlock in self.interlocks:
            if wanted is None or isinstance(wanted, HoldHere):
                break
            wanted = interlock(wanted)
        if wanted is not None:
            self.send(wanted)

    def send(self, motion: Motion) -> None:
        """The same, whatever the interlocks say."""
        pending = self.commanded_mode.pending
        if motion == pending or (isinstance(motion, HoldHere) and isinstance(pending, HoldHere)):
            return  # that is under way
        self.commanded_mode.commanded(motion)
        self.navigator.setpoints.sent(motion)
        self._context.do(motion)

    def hold(self, why: str) -> None:
        """Stop, unless that is what the vehicle was told last."""
        if not isinstance(self.commanded_mode.last, HoldHere):
            self.command(HoldHere(why))

    def stop_if_doubtful(self, motion: Motion) -> Motion:
        """An interlock: a jump that would not show which of several orders is followed waits."""
        if isinstance(motion, FlyToNode) and self._doubtful(motion):
            return self.navigator.hold_first()
        return motion

    def _doubtful(self, jump: FlyToNode) -> bool:
        telemetry = self._context.telemetry
        shows = (
            telemetry is not None
            and telemetry.mode is FlightMode.MISSION
            and telemetry.item == self._plan.item_of(jump.node)
        )
        return self.navigator.setpoints.doubtful(jump, shows=shows)

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion that was decided a moment ago must not be commanded now; None if it may."""
        telemetry = self._context.telemetry
        if motion is not self.commanded_mode.pending or telemetry is None:
            return "it was called off"
        return self.navigator.objection(motion, telemetry, now_s)

    # What became of them.

    def confirmed(self, motion: Motion) -> None:
        """The vehicle follows."""
        self.commanded_mode.confirmed(motion)
        self.navigator.setpoints.confirmed(motion)

    def failed(self, event: CommandFailed) -> None:
        """The vehicle did not follow: once more in a moment, unless it was told another since."""
        if not self.commanded_mode.failed(event.action):
            return
        self._context.say(f"the vehicle did not follow: {event.reason}")
        if self.commanded_mode.refused_jumps >= JUMPS and not self.navigator.by_points:
            self.navigator.by_points = True
            self._context.say("the plan on board is not flown: flying to points instead")
        self._context.retry_in(RETRY_S)

    def let_go(self) -> None:
        """The pilot flies."""
        self.navigator.stop()
        self.navigator.setpoints.forget()
        self.commanded_mode.release()

    # Ways.

    def plan_to(self, goal: Goal) -> Motion | None:
        """The first motion of a way to a goal; `navigator.progress` says whether there is one."""
        return self.navigator.go(goal, self._context.heard)

    @property
    def refusal(self) -> str:
        """Why there was no way."""
        refusal = self.navigator.refusal
        return refusal.reason if refusal is not None else "no clear way"

    def advance(self, motion: Motion | None) -> None:
        """Command the next motion, if any, and tell the state's handler where it stands."""
        if motion is not None:
            self.command(motion)
            if not isinstance(motion, HoldHere):
                self._waits_why = None
        progress = self.navigator.progress
        if progress is Progress.ARRIVED:
            self._context.handler.arrived()
        elif progress is Progress.NO_ROUTE:
            self._context.handler.no_route(self.refusal)

    def fly_to(self, goal: Goal) -> None:
        """Set out for a goal."""
        self.advance(self.plan_to(goal))

    def fly_again(self) -> None:
        """Set out for the same goal once more."""
        self.advance(self.navigator.again(self._context.heard))

    def wait_for_way(self, refusal: str) -> None:
        """Hover where no way is clear, unless it waits for another already."""
        if self._context.retry_at_s is None:
            self.wait_here(refusal)

    def wait_here(self, why: str) -> None:
        """Hover where no way is clear, say so once, and look again in a moment."""
        now_s = self._context.now_s
        if why != self._waits_why and now_s >= self._wait_told_s + TELL_AGAIN_S:
            self._waits_why, self._wait_told_s = why, now_s
            self._context.say(f"holding: {why}")
        self.hold(why)
        self._context.retry_in(RETRY_S)
