"""Who has the vehicle, and whose plan is on board: one part of the mission's context."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from air_router.controller.model.actions import ControlHolder
from air_router.vehicle import Instruction


class PlanOwner(Enum):
    """Whose the plan on board is."""

    OURS = "this mission's"
    REPLACED = "uploaded by a ground station, and not yet compared with this mission's"
    ANOTHER = "another"


@dataclass(frozen=True, slots=True)
class HandoverHold:
    """Why a vehicle that was handed over hovers, and what the pilot does about it."""

    why: str
    instruction: Instruction


@dataclass(slots=True, eq=False)
class Authority:
    """State only; `ControlAuthority` decides what follows from it. Only its methods change it.

    Attributes:
        handed_over: Armed in Mission mode: the pilot who did that gave the flight to us.
        taken_by: The pilot or failsafe that has, or had, the vehicle; None: we do.
        on_board: Whose the plan on board is.
        wrong_vehicle: Why no mission is flown with what is on the link; None: it is right.
        held: Why a vehicle that was handed over hovers where no leg of this mission may begin;
            None: it does not.
        releasing: Why the vehicle is released as soon as it holds; None: it is not.
        plan_check: What was replaced on board, while the vehicle holds until that was compared.
        stopped_why: Why it was stopped as it took off; None once it flies, or another has it.
    """

    handed_over: bool = False
    taken_by: ControlHolder | None = None
    on_board: PlanOwner = PlanOwner.OURS
    wrong_vehicle: str | None = None
    held: HandoverHold | None = None
    releasing: str | None = None
    plan_check: str | None = None
    stopped_why: str | None = None

    def hand_over(self) -> None:
        """The pilot gives the flight to us."""
        self.handed_over = True

    def fly(self) -> None:
        """The vehicle in the air flies by our commands from now on."""
        self.handed_over, self.stopped_why, self.held = True, None, None

    def begin_anew(self) -> None:
        """It was armed, and disarmed again without having flown."""
        self.handed_over, self.plan_check, self.stopped_why = False, None, None

    def take(self, who: ControlHolder | None) -> None:
        """The pilot or a failsafe has the vehicle from now on; None: we do, or it has fallen."""
        self.taken_by = who

    def release(self, why: str) -> None:
        """The vehicle is released as soon as it holds; nothing is compared any more."""
        self.releasing, self.plan_check = why, None

    def released(self) -> None:
        """It holds, or did not follow: it is not waited for any more."""
        self.releasing = None

    def let_go(self) -> None:
        """Another has the vehicle, or the flight is over: what was waited for is void."""
        self.releasing = self.plan_check = self.held = None

    def hold(self, held: HandoverHold) -> None:
        """It hovers where no leg of this mission may begin."""
        self.held = held

    def check_plan(self, what: str) -> None:
        """What is on board was replaced: the vehicle holds until that was compared."""
        self.plan_check = what

    def plan_checked(self) -> None:
        """It was compared, or need not be."""
        self.plan_check = None

    def plan_is(self, whose: PlanOwner) -> None:
        """Whose the plan on board is, from now on."""
        self.on_board = whose

    def vehicle_is_wrong(self, why: str | None) -> None:
        """What is on the link is no vehicle for this mission; None: it is one again."""
        self.wrong_vehicle = why

    def stop(self, why: str) -> None:
        """It is stopped as it takes off."""
        self.stopped_why = why

    def goes_on(self) -> None:
        """What it was stopped for is over."""
        self.stopped_why = None
