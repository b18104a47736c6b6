"""Giving the vehicle away, to a pilot or a failsafe, and taking it back when somebody asks.

Before hands are off for a reason of ours (it is in a zone, the fence on board is another) it is
told to hold, because it flies a leg of ours; and again, until it does, or somebody takes it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from air_router.actions import HoldHere, Motion, Taker
from air_router.behaviour import Signal, State, knows
from air_router.helm import RETRY_S
from air_router.watch import why_not_resumed

if TYPE_CHECKING:
    from air_router.cockpit import Cockpit
    from air_router.helm import Helm
    from air_router.launch import Launch
    from air_router.vehicle import PlanReplaced

HOLDS: Final = 6
"""How often a vehicle is told to hold before hands are off though it does not."""


class Handing:
    """Knows whose the vehicle is.

    Args:
        cockpit: Where it signals that somebody else flies, and that we do again.
        helm: Has it hold.
        launch: Whether it was handed over to us on the ground.

    Attributes:
        giving_up: Why hands will be off as soon as it holds; None if they will not.
        taken_by: Who has, or had, the vehicle; None if nobody else.
    """

    def __init__(self, cockpit: Cockpit, helm: Helm, launch: Launch) -> None:
        self.giving_up: str | None = None
        self.taken_by: Taker | None = None
        self._cockpit = cockpit
        self._helm = helm
        self._launch = launch
        self._plan_is_ours = True
        self._holds = 0
        self._hold_again_s = 0.0

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        if self._cockpit.state is State.READY:
            return self._launch.handed_over
        return self._cockpit.state not in {State.PASSIVE, State.DONE}

    def only_hold(self, motion: Motion) -> Motion | None:
        """A guard: what is about to be given away is sent nowhere."""
        return motion if self.giving_up is None else None

    # Away.

    def give_up(self, why: str) -> None:
        """Have it hold, then hands off."""
        self.giving_up = why
        self._holds = 0
        self._hold_at_last(why)

    def _hold_at_last(self, why: str) -> None:
        self._holds += 1
        self._hold_again_s = self._cockpit.now_s + RETRY_S
        self._helm.command(HoldHere(why))

    def check(self) -> None:
        """Say the hold again that was lost, or let go at last."""
        custody = self._helm.custody
        if self.giving_up is None or custody.pending is not None:
            return
        if isinstance(custody.last, HoldHere):
            self._let_go(self.giving_up)
        elif self._holds >= HOLDS:
            self._let_go(f"{self.giving_up}; it was told to hold and did not")
        elif self._cockpit.now_s >= self._hold_again_s:
            self._hold_at_last(self.giving_up)

    def _let_go(self, why: str) -> None:
        self.giving_up = None
        self.take_over(Taker.PILOT, why)

    def take_over(self, who: Taker, why: str) -> None:
        """Somebody else flies from now on."""
        if knows(self._cockpit.state, Signal.TAKEN_OVER):
            self.taken_by = who
            self._cockpit.say(f"hands off: {why}")
            self._cockpit.signal(Signal.TAKEN_OVER)

    def settled(self) -> None:
        """Hands are off, or the flight is over: nothing is left to give up."""
        self.giving_up = None

    def plan_replaced(self, event: PlanReplaced) -> None:
        """Somebody else has put another plan, or fence, on board."""
        why = f"the {'fence' if event.only_fence else 'plan'} on board was replaced"
        self._plan_is_ours = False
        telemetry = self._cockpit.telemetry
        if self._cockpit.state is State.READY and telemetry is not None and not telemetry.armed:
            self._launch.stayed_why = why
            self._cockpit.signal(Signal.GROUNDED)
        elif event.only_fence and self.in_charge:
            if self.giving_up is None:
                self.give_up(why)  # the leg under way is ours, and leads where a zone may be now
        else:
            self.take_over(Taker.PILOT, why)

    # And back.

    def resume(self) -> str | None:
        """Go on with a flight that was given away, or that a companion before us has left.

        Returns why not, if not.
        """
        telemetry = self._cockpit.telemetry
        why = why_not_resumed(self._cockpit.mission, telemetry)
        if why is None and not self._plan_is_ours:
            why = "another plan is on board: start the flight anew with --resume"
        if why is not None or telemetry is None:
            why = why or "nothing was heard of the vehicle"
            self._cockpit.say(f"not resumed: {why}")
            return why
        self._cockpit.say("resumed: the mission goes on from here")
        self._launch.resumed(self._cockpit.now_s)
        self.taken_by = None
        self._helm.custody.assume(telemetry.mode)
        ready = self._cockpit.state is State.READY
        self._cockpit.signal(Signal.AIRBORNE if ready else Signal.RESUMED)
        return None
