"""Requests about the vehicle itself: going on, coming home, landing, and other zones."""

from __future__ import annotations

from dataclasses import dataclass

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.command_handler import CommandHandler, RequestHandler
from air_router.controller.model.actions import ReadAgain, Refusal
from air_router.controller.model.mission_context import Ending, OnBoard, ZoneChange
from air_router.controller.model.requests import ComeHome, GoOn, LandNow, Reload
from air_router.controller.model.states import Signal, State
from air_router.controller.states.goto_state import Accepted, Refused
from air_router.controller.states.return_state import LandState


@dataclass(slots=True, eq=False)
class VehicleRequests(RequestHandler):
    """Takes the vehicle back, ends the mission, and has its file read again.

    Args:
        commands: What was held for, and how it is gone on with.
        land_state: Says whether it may land where it hovers.
        airspace_update: Puts the plan on board again.
    """

    _commands: CommandHandler
    _land_state: LandState
    _airspace_update: AirspaceUpdate

    def _asked_to_go_on(self, request: GoOn) -> Accepted | Refused:
        context, state = self._context, self._context.state
        objection = self._not_to_decide()
        if objection is not None:
            return objection
        if state in {State.READY, State.PASSIVE}:
            if context.in_air and (silent := self._not_unheard()) is not None:
                return silent
            upload = request.upload
            if upload and self._authority.why_not_back(flies_plan=False) is None:
                self._airspace_update.upload_again()
            why = self._authority.resume(upload=upload)
            if why is not None:
                return Refused(self._why_ours_not(), why)
            first = "the plan is put on board again, then " if upload else ""
            return Accepted(f"{first}the mission goes on from here")
        if state is not State.HOLD:
            return self._not_in_the_air() or Refused(
                Refusal.NOTHING_TO_DO, f"nothing is held: it is in {state.name}"
            )
        return self._not_to_move() or self._go_on(request.by)

    def _why_ours_not(self) -> Refusal:
        """Whether all that keeps a vehicle from being taken back is the plan on board."""
        other = self._context.on_board is OnBoard.ANOTHER
        only = other and self._authority.why_not_back(flies_plan=False) is None
        return Refusal.OTHER_PLAN if only else Refusal.NOT_OURS

    def _go_on(self, by: str) -> Accepted:
        held, self._commands.held = self._commands.held, None
        assert held is not None  # noqa: S101 - what HOLD is entered with
        if held.state is State.HOME:
            self._context.come_home(f"{by}'s request", by_request=True)
            return Accepted("it comes home")
        if held.state is State.GOTO and held.goto_task is not None:
            self._commands.goto_state.set_out(held.goto_task, held.left_s)
            return Accepted("it flies on to the points that are left")
        if held.robot is not None:
            self._commands.search_state.seek(held.robot)
            return Accepted(f"it seeks {held.robot} again")
        if held.explores and held.left_s is not None:
            self._context.carried_s = held.left_s
        self._context.signal(Signal.RESUMED)
        return Accepted("it goes on")

    def _asked_to_come_home(self, request: ComeHome) -> Accepted | Refused:
        context, state = self._context, self._context.state
        objection = self._not_to_decide()
        if objection is not None:
            return objection
        if state in {State.HOME, State.LAND}:
            return Accepted(f"it {'comes home' if state is State.HOME else 'lands'} already")
        if context.in_air and not context.in_charge and state is not State.DONE:
            if (silent := self._not_unheard()) is not None:
                return silent
            why = self._authority.take_home()
            if why is not None:
                return Refused(Refusal.NOT_OURS, why)
        elif state is not State.READY and (gone := self._not_in_the_air()) is not None:
            return gone
        answer = Accepted(self._how_it_comes_home())
        context.come_home(f"{request.by}'s request", by_request=state is not State.READY)
        return answer

    def _asked_to_land(self, request: LandNow) -> Accepted | Refused:
        context, state = self._context, self._context.state
        if state is State.LAND:
            return Accepted("it lands already")
        objection = self._not_to_move()
        if objection is not None:
            return objection
        if state is not State.HOLD:
            return Refused(Refusal.BUSY, "it lands where it hovers: have it hold first")
        why = self._land_state.why_no_landing()
        if why is not None:
            return Refused(Refusal.NO_WAY, why)
        context.say(f"landing here, as {request.by} asked")
        place = f"where it hovered, as {request.by} asked"
        context.ending = Ending(f"{request.by} asked to land here", place=place)
        context.signal(Signal.LAND_HERE)
        return Accepted("it lands where it hovers")

    def _how_it_comes_home(self) -> str:
        """What follows when it is told to, in words."""
        if self._context.telemetry is None:
            return "the mission ends before it begins; the vehicle is left as it is"
        if not self._context.in_air:
            return "the mission ends on the ground"
        unknown = self._not_without_position()
        if unknown is not None:
            return f"it comes home as soon as it is known where it is: {unknown.why}"
        return "it comes home"

    def _asked_to_reload(self, request: Reload) -> Accepted | Refused:
        del request
        if self._context.state is State.DONE:
            return Refused(Refusal.FLIGHT_OVER, "the flight is over")
        objection = self._not_to_decide()
        if objection is not None:
            return objection
        if self._context.zones is ZoneChange.UPLOADING:
            return Refused(Refusal.BUSY, "zones are being changed just now; ask again")
        self._context.actions.append(ReadAgain())
        later = "; what has changed goes on board after the plan"
        return Accepted(f"the mission file is read again{'' if self._context.telemetry else later}")

    _answers = {  # noqa: RUF012 - of the class, as the base class says
        GoOn: _asked_to_go_on,
        ComeHome: _asked_to_come_home,
        LandNow: _asked_to_land,
        Reload: _asked_to_reload,
    }
