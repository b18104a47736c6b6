"""Who commands the vehicle, and whose plan is on board: one part of the mission's context."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from air_router.controller.model.actions import ControlHolder
from air_router.vehicle import Instruction


class PlanOwner(Enum):
    """The owner of the plan on board."""

    OURS = "this mission's"
    REPLACED = "uploaded by a ground station, and not yet compared with this mission's"
    ANOTHER = "another"


@dataclass(frozen=True, slots=True)
class HandoverHold:
    """Why a vehicle that was handed over hovers, with the pilot's action."""

    why: str
    instruction: Instruction


@dataclass(slots=True, eq=False)
class Authority:
    """State only; `ControlAuthority` decides. Only its own methods change it.

    Attributes:
        handed_over: The pilot armed in Mission mode, which hands the flight over to this program.
        taken_by: The pilot or failsafe that commands or last commanded the vehicle; None: this
            program.
        on_board: The owner of the plan on board.
        wrong_vehicle: Why no mission is flown with the vehicle on the link; None: it is the right
            one.
        held: Why a handed-over vehicle hovers where no leg of this mission may start; None: it does
            not.
        releasing: Why the vehicle is released once it holds; None: it is not.
        plan_check: What was replaced on board and is being compared, while the vehicle holds.
        stopped_why: Why it was stopped at take-off; None once it flies or another commands it.
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
        """The pilot hands the flight over."""
        self.handed_over = True

    def fly(self) -> None:
        """From now on this program commands the vehicle in the air."""
        self.handed_over, self.stopped_why, self.held = True, None, None

    def begin_anew(self) -> None:
        """The vehicle was armed and disarmed without flying."""
        self.handed_over, self.plan_check, self.stopped_why = False, None, None

    def take(self, who: ControlHolder | None) -> None:
        """The pilot or a failsafe commands the vehicle; None: this program, or it has fallen."""
        self.taken_by = who

    def release(self, why: str) -> None:
        """Release the vehicle once it holds; a comparison ends."""
        self.releasing, self.plan_check = why, None

    def released(self) -> None:
        """The release is complete: the vehicle holds, or did not follow."""
        self.releasing = None

    def clear_pending(self) -> None:
        """Another commands the vehicle, or the flight is over: nothing is pending anymore."""
        self.releasing = self.plan_check = self.held = None

    def hold(self, held: HandoverHold) -> None:
        """The vehicle hovers where no leg of this mission may start."""
        self.held = held

    def check_plan(self, what: str) -> None:
        """Something on board was replaced: the vehicle holds until it is compared."""
        self.plan_check = what

    def plan_checked(self) -> None:
        """The comparison is over, or not needed."""
        self.plan_check = None

    def plan_is(self, whose: PlanOwner) -> None:
        """Set the owner of the plan on board."""
        self.on_board = whose

    def vehicle_is_wrong(self, why: str | None) -> None:
        """The vehicle on the link is the wrong one; None: it is the right one again."""
        self.wrong_vehicle = why

    def stop(self, why: str) -> None:
        """The vehicle is stopped at take-off."""
        self.stopped_why = why

    def end_stop(self) -> None:
        """The reason for the stop is over."""
        self.stopped_why = None
