"""What is requested in flight: done or refused, and always answered.

A request is looked at against the state of the mission first, then, where the vehicle would be sent
somewhere, against the airspace and the battery. Only then the state changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from air_router.controller.airspace_update import AirspaceUpdate, Phase
from air_router.controller.control_authority import ControlAuthority, OnBoard
from air_router.controller.model.actions import CommandAck, ReadAgain, Refusal
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.requests import (
    AnyRequest,
    ComeHome,
    ExploreNow,
    GoOn,
    GoTo,
    HoldNow,
    LandNow,
    Reload,
    SeekNow,
)
from air_router.controller.model.states import Signal, State
from air_router.controller.preconditions import Preconditions, comes_home
from air_router.controller.states.goto_state import GotoState, GotoTask, GotoValidator, Refused
from air_router.controller.states.return_state import ReturnState
from air_router.controller.states.search_state import SearchState
from air_router.controller.targets.exploration import Exploration
from air_router.controller.targets.search_points import Search
from geo.frame import Point


class Accepted(NamedTuple):
    """What is done."""

    what: str  # in words, for the answer
    points: tuple[Point, ...] = ()  # where it flies, of a go-to


@dataclass(frozen=True, slots=True)
class Held:
    """What the vehicle did before it was told to hold.

    Attributes:
        state: The state of the mission.
        explores: It flew the waypoints in order.
        robot: Who was sought or hovered over; None in other states.
        goto_task: The points that were left.
        left_s: What the state's timer had left; None if it did not run.
    """

    state: State
    explores: bool
    robot: str | None
    goto_task: GotoTask | None
    left_s: float | None


@dataclass(slots=True, eq=False)
class CommandHandler:
    """Takes orders: what was held for one, and which one waits, it remembers itself.

    Args:
        context: What the mission is doing; where answers go.
        preconditions: Whether the vehicle may be told anything just now.
        validator: Whether it may be sent somewhere, and comes home from there.
        search: Which robots there are, and where.
        exploration: What is left to explore; None: this vehicle only searches.
        search_state: Seeks a robot.
        goto_state: Flies to points.
        return_state: Comes home, and says which way home may not be called off.
        authority: Takes a vehicle back that was given away.
        airspace_update: Whether zones are being changed.

    Attributes:
        later: Points that wait until the vehicle flies on; None: none do.
    """

    _context: MissionContext
    _preconditions: Preconditions
    _validator: GotoValidator
    _search: Search
    _exploration: Exploration | None
    _search_state: SearchState
    _goto_state: GotoState
    _return_state: ReturnState
    _authority: ControlAuthority
    _airspace_update: AirspaceUpdate
    _held: Held | None = None
    later: GoTo | None = None

    def asked(self, request: AnyRequest) -> None:
        """A request of the pilot, the operator or a program."""
        if isinstance(request, GoTo) and request.waits and self._put_off(request):
            return
        answer = self._to_requests[type(request)](self, request)
        if isinstance(answer, Accepted) and self._waits_for_zones(request):
            what = f"{answer.what}; it sets out once the changed zones are on board"
            answer = answer._replace(what=what)
        self._answer(request, answer)

    def _waits_for_zones(self, request: AnyRequest) -> bool:
        """Whether what was just accepted is not begun before zones have changed."""
        return (
            self._airspace_update.phase is not None
            and isinstance(request, GoOn | SeekNow | ExploreNow | ComeHome | GoTo)
            and not (isinstance(request, GoOn) and request.upload)  # that says so itself
            and self._context.in_air
        )

    def _answer(self, request: AnyRequest, answer: Accepted | Refused) -> None:
        accepted = isinstance(answer, Accepted)
        self._context.do(
            CommandAck(
                request.request_id,
                request.by,
                accepted,
                answer.what if isinstance(answer, Accepted) else answer.why,
                None if isinstance(answer, Accepted) else answer.code,
                answer.points if isinstance(answer, Accepted) else (),
            )
        )

    # What can be asked for.

    def _asked_to_hold(self, request: HoldNow) -> Accepted | Refused:
        context = self._context
        if context.state is State.HOLD:
            return Accepted("it holds already")
        objection = self._preconditions.to_stop()
        if objection is not None:
            return objection
        # A robot is sought again, a way home flown on; time does not run meanwhile.
        goto_task, left_s = self._goto_state.goto_task, context.left_s
        robot, explores = self._search_state.robot, context.spec.explores
        self._held = Held(context.state, explores, robot, goto_task, left_s)
        self._return_state.call_off()
        context.say(f"holding, as {request.by} asked")
        context.signal(Signal.HOLD)
        return Accepted("it stops and hovers")

    def _asked_to_go_on(self, request: GoOn) -> Accepted | Refused:
        state = self._context.state
        objection = self._preconditions.to_decide()
        if objection is not None:
            return objection
        if state in {State.READY, State.PASSIVE}:
            if self._context.in_air and (silent := self._preconditions.not_heard()) is not None:
                return silent
            upload = request.upload
            if upload and self._authority.why_not_back(flies_plan=False) is None:
                self._airspace_update.upload_again()
            why = self._authority.resume(upload=upload)
            if why is not None:
                return Refused(self._why_ours_not(), why)
            self._return_state.call_off()
            first = "the plan is put on board again, then " if upload else ""
            return Accepted(f"{first}the mission goes on from here")
        if state is not State.HOLD:
            return self._preconditions.in_the_air() or Refused(
                Refusal.NOTHING_TO_DO, f"nothing is held: it is in {state.name}"
            )
        return self._preconditions.to_move() or self._go_on(request.by)

    def _why_ours_not(self) -> Refusal:
        """Whether all that keeps a vehicle from being taken back is the plan on board."""
        other = self._authority.on_board is OnBoard.ANOTHER
        only = other and self._authority.why_not_back(flies_plan=False) is None
        return Refusal.OTHER_PLAN if only else Refusal.NOT_OURS

    def _go_on(self, by: str) -> Accepted:
        held, self._held = self._held, None
        assert held is not None  # noqa: S101 - what HOLD is entered with
        if held.state is State.HOME:
            self._return_state.come_home_on_request(by)
            return Accepted("it comes home")
        if held.state is State.GOTO and held.goto_task is not None:
            self._goto_state.set_out(held.goto_task, held.left_s)
            return Accepted("it flies on to the points that are left")
        if held.robot is not None:
            self._search_state.seek(held.robot)
            return Accepted(f"it seeks {held.robot} again")
        if held.explores and held.left_s is not None:
            self._context.carry(held.left_s)
        self._context.signal(Signal.RESUMED)
        return Accepted("it goes on")

    def _asked_to_seek(self, request: SeekNow) -> Accepted | Refused:
        robot, names = request.robot, self._search.targets.names
        if robot not in names:
            known = ", ".join(names) or "none"
            return Refused(
                Refusal.UNKNOWN_ROBOT, f"no robot '{robot}' is sought in this mission: {known}"
            )
        if robot == self._search_state.robot and self._context.state is State.COMM:
            return Accepted(f"it hovers over {robot} already")
        objection = self._preconditions.to_move()
        if objection is not None:
            return objection
        point = self._search.search_point(robot, self._context.now_s)
        refused = self._validator.way(self._context.heard, [point.goal])
        if refused is not None:
            return refused
        self._return_state.call_off()
        self._search_state.seek(robot)
        return Accepted(f"it seeks {robot}: {point.reason}")

    def _asked_to_explore(self, request: ExploreNow) -> Accepted | Refused:
        del request
        exploration = self._exploration
        if exploration is None:
            return Refused(Refusal.ONLY_SEARCHES, "this vehicle only searches")
        objection = self._preconditions.to_move()
        if objection is not None:
            return objection
        if not exploration.remaining:
            return Refused(Refusal.NOTHING_TO_DO, "every waypoint has been visited")
        left = f"{exploration.remaining} waypoints are left"
        if self._context.spec.explores:
            return Accepted(f"it explores already: {left}")
        self._return_state.call_off()
        self._context.signal(Signal.EXPLORE)
        return Accepted(f"it explores: {left}")

    def _asked_to_come_home(self, request: ComeHome) -> Accepted | Refused:
        state = self._context.state
        objection = self._preconditions.to_decide()
        if objection is not None:
            return objection
        if state in {State.HOME, State.LAND}:
            return Accepted(f"it {'comes home' if state is State.HOME else 'lands'} already")
        if self._context.in_air and not self._authority.in_charge and state is not State.DONE:
            if (silent := self._preconditions.not_heard()) is not None:
                return silent
            why = self._authority.take_home()
            if why is not None:
                return Refused(Refusal.NOT_OURS, why)
        elif state is not State.READY and (gone := self._preconditions.in_the_air()) is not None:
            return gone
        answer = Accepted(self._how_it_comes_home())
        self._return_state.come_home_on_request(request.by)
        return answer

    def _asked_to_land(self, request: LandNow) -> Accepted | Refused:
        state = self._context.state
        if state is State.LAND:
            return Accepted("it lands already")
        objection = self._preconditions.to_move()
        if objection is not None:
            return objection
        if state is not State.HOLD:
            return Refused(Refusal.BUSY, "it lands where it hovers: have it hold first")
        why = self._return_state.why_no_landing()
        if why is not None:
            return Refused(Refusal.NO_WAY, why)
        self._context.say(f"landing here, as {request.by} asked")
        self._return_state.land_on_request(request.by)
        return Accepted("it lands where it hovers")

    def _how_it_comes_home(self) -> str:
        """What follows when it is told to, in words."""
        if self._context.telemetry is None:
            return "the mission ends before it begins; the vehicle is left as it is"
        if not self._context.in_air:
            return "the mission ends on the ground"
        unknown = self._preconditions.without_position()
        if unknown is not None:
            return f"it comes home as soon as it is known where it is: {unknown.why}"
        return "it comes home"

    def _asked_to_go_to(self, request: GoTo) -> Accepted | Refused:
        objection = self._preconditions.to_move()
        if objection is not None:
            return objection
        if request.waits and self._context.state is State.HOME:  # the operator asked for that
            return comes_home(self._return_state.why)
        hold_s = request.hold_s
        if hold_s is None:
            hold_s = self._context.mission.timers.hold_s
        goto_task = self._validator.goto_task(
            self._context.heard, request.points, hold_s, request.by
        )
        if isinstance(goto_task, Refused):
            return goto_task
        self._return_state.call_off()
        self._goto_state.set_out(goto_task)
        count = len(goto_task.stops)
        what = f"it flies to {'the point' if count == 1 else f'{count} points'}"
        return Accepted("; ".join((what, *goto_task.notes)), goto_task.stops)

    def _asked_to_reload(self, request: Reload) -> Accepted | Refused:
        del request
        if self._context.state is State.DONE:
            return Refused(Refusal.FLIGHT_OVER, "the flight is over")
        objection = self._preconditions.to_decide()
        if objection is not None:
            return objection
        if self._airspace_update.phase is Phase.UPLOADING:
            return Refused(Refusal.BUSY, "zones are being changed just now; ask again")
        self._context.do(ReadAgain())
        if self._context.telemetry is None:
            return Accepted(
                "the mission file is read again; what has changed goes on board after the plan"
            )
        return Accepted("the mission file is read again")

    # what answers a request, by its type
    _to_requests: ClassVar[dict[type, Callable[[CommandHandler, Any], Accepted | Refused]]] = {
        HoldNow: _asked_to_hold,
        GoOn: _asked_to_go_on,
        SeekNow: _asked_to_seek,
        ExploreNow: _asked_to_explore,
        ComeHome: _asked_to_come_home,
        LandNow: _asked_to_land,
        GoTo: _asked_to_go_to,
        Reload: _asked_to_reload,
    }

    # What is not done at once.

    def _put_off(self, request: GoTo) -> bool:
        """Keep a request that waits until the vehicle flies its mission; of several the newest."""
        if not self._context.spec.puts_off:
            return False
        if self.later is not None:
            self._answer(self.later, Refused(Refusal.REPLACED, "a newer request came"))
        self.later = request
        self._context.say(f"points from {request.by} wait until the vehicle flies on")
        return True

    def now_what_waited(self) -> None:
        """The time of a request that waited has come, or will not come any more."""
        if self.later is None or self._context.spec.puts_off:
            return
        request, self.later = self.later, None
        if self._context.state is State.HOME:  # that was asked for later
            self._answer(request, comes_home(self._return_state.why))
        else:
            self._answer(request, self._asked_to_go_to(request))
