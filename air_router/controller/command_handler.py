"""What is requested in flight: done or refused, and always answered.

A request is looked at against the state of the mission first, then, where the vehicle would be sent
somewhere, against the airspace and the battery. Only then the state changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.control_authority import ControlAuthority
from air_router.controller.deviations import ReturnMonitor
from air_router.controller.model.actions import Announce, CommandAck, ReadAgain, Refusal
from air_router.controller.model.events import (
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
from air_router.controller.model.mission_context import (
    Ending,
    MissionContext,
    OnBoard,
    ZoneChange,
)
from air_router.controller.model.states import Requests, Signal, State
from air_router.controller.states.explore_state import Exploration
from air_router.controller.states.goto_state import GotoState, GotoTask, GotoValidator, Refused
from air_router.controller.states.return_state import LandState
from air_router.controller.states.search_state import SearchState
from air_router.vehicle.input_limits import NO_FIX
from geo.frame import Point

NOT_HEARD_S: Final = 3.0
"""A vehicle that was not heard for so long is not sent anywhere: its position is unknown."""


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
        validator: Whether it may be sent somewhere, and comes home from there.
        exploration: What is left to explore; None: this vehicle only searches.
        search_state: Seeks a robot.
        goto_state: Flies to points.
        land_state: Says whether it may land where it hovers.
        returns: Says which way home may not be called off.
        authority: Takes a vehicle back that was given away.
        airspace_update: Puts the plan on board again.

    Attributes:
        later: Points that wait until the vehicle flies on; None: none do.
    """

    _context: MissionContext
    _validator: GotoValidator
    _exploration: Exploration | None
    _search_state: SearchState
    _goto_state: GotoState
    _land_state: LandState
    _returns: ReturnMonitor
    _authority: ControlAuthority
    _airspace_update: AirspaceUpdate
    _held: Held | None = None
    later: GoTo | None = None

    def asked(self, request: AnyRequest) -> None:
        """A request of the pilot, the operator or a program."""
        if isinstance(request, GoTo) and request.waits and self._context.spec.puts_off:
            self._put_off(request)
            return
        answer = self._to_requests[type(request)](self, request)
        zones_change = self._context.zones is not None and self._context.in_air
        # A hold is begun at once, and a plan that is put on board says so itself.
        sets_out = isinstance(request, SeekNow | ExploreNow | ComeHome | GoTo) or (
            isinstance(request, GoOn) and not request.upload
        )
        if isinstance(answer, Accepted) and zones_change and sets_out:
            what = f"{answer.what}; it sets out once the changed zones are on board"
            answer = answer._replace(what=what)
        self._context.actions.append(_ack(request, answer))

    # Whether the vehicle may be told anything just now; None: nothing stands against it.

    def _not_to_stop(self) -> Refused | None:
        """It is ours, in the air, and not on a way home that may not be called off.

        A way home is only called off if it was requested, and nothing else demands it.
        """
        context, requests = self._context, self._context.spec.requests
        if context.giving_up is not None:
            return self._not_to_decide()
        if requests is Requests.ANY:
            return None
        if requests is not Requests.CALL_OFF:
            return self._not_in_the_air()
        ending = context.ending
        if context.state is State.HOME and ending is not None and ending.by_request:
            why = self._returns.due(context.heard)
        else:
            why = None if ending is None else ending.why
        return None if why is None else _comes_home(why)

    def _not_to_move(self) -> Refused | None:
        """And beside that it is known where it is."""
        return self._not_to_stop() or self._not_without_position()

    def _not_without_position(self) -> Refused | None:
        """It is known where it is: legs are checked from there."""
        context = self._context
        if context.telemetry is not None and not context.telemetry.fix:
            return Refused(Refusal.NO_FIX, NO_FIX)
        missing = next(iter(context.inputs.stopped), None)
        if missing is not None:
            return Refused(Refusal.NOT_HEARD, missing)
        return self._not_unheard()

    def _not_unheard(self) -> Refused | None:
        """It was heard just now."""
        telemetry = self._context.telemetry
        assert telemetry is not None  # noqa: S101 - in the air there was telemetry
        # Its clock stands still while nothing is heard of it: then the link says for how long.
        silent_s = max(self._context.now_s - telemetry.time_s, self._context.silent_s)
        if silent_s <= NOT_HEARD_S:
            return None
        what = "no position" if telemetry.told_s > telemetry.time_s else "nothing"
        return Refused(Refusal.NOT_HEARD, f"{what} heard from it for {silent_s:.0f} s")

    def _not_to_decide(self) -> Refused | None:
        """It is not about to be given away."""
        why = self._context.giving_up
        if why is None:
            return None
        return Refused(Refusal.HANDS_OFF, f"hands off in a moment: {why}")

    def _not_in_the_air(self) -> Refused | None:
        """It flies this mission."""
        requests = self._context.spec.requests
        if requests is Requests.NOT_YET:
            return Refused(Refusal.NOT_FLYING, requests.value)
        if requests is Requests.OVER:
            return Refused(Refusal.FLIGHT_OVER, requests.value)
        if requests is Requests.NOT_OURS:
            taker = self._context.taken_by
            who = taker.value if taker else "the pilot"
            return Refused(Refusal.NOT_OURS, f"{who} has the vehicle; {self._authority.way_back}")
        return None

    # What can be asked for.

    def _asked_to_hold(self, request: HoldNow) -> Accepted | Refused:
        context = self._context
        if context.state is State.HOLD:
            return Accepted("it holds already")
        objection = self._not_to_stop()
        if objection is not None:
            return objection
        # A robot is sought again, a way home flown on; time does not run meanwhile.
        left_s = None if context.ends_s is None else max(0.0, context.ends_s - context.now_s)
        goto_task, explores = self._goto_state.goto_task, context.spec.explores
        self._held = Held(context.state, explores, context.robot, goto_task, left_s)
        context.actions.append(Announce(f"holding, as {request.by} asked"))
        context.signal(Signal.HOLD)
        return Accepted("it stops and hovers")

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
        held, self._held = self._held, None
        assert held is not None  # noqa: S101 - what HOLD is entered with
        if held.state is State.HOME:
            self._context.come_home(f"{by}'s request", by_request=True)
            return Accepted("it comes home")
        if held.state is State.GOTO and held.goto_task is not None:
            self._goto_state.set_out(held.goto_task, held.left_s)
            return Accepted("it flies on to the points that are left")
        if held.robot is not None:
            self._search_state.seek(held.robot)
            return Accepted(f"it seeks {held.robot} again")
        if held.explores and held.left_s is not None:
            self._context.carried_s = held.left_s
        self._context.signal(Signal.RESUMED)
        return Accepted("it goes on")

    def _asked_to_seek(self, request: SeekNow) -> Accepted | Refused:
        robot, search = request.robot, self._search_state.search
        names = search.targets.names
        if robot not in names:
            known = ", ".join(names) or "none"
            return Refused(
                Refusal.UNKNOWN_ROBOT, f"no robot '{robot}' is sought in this mission: {known}"
            )
        if robot == self._context.robot and self._context.state is State.COMM:
            return Accepted(f"it hovers over {robot} already")
        objection = self._not_to_move()
        if objection is not None:
            return objection
        point = search.search_point(robot, self._context.now_s)
        refused = self._validator.way([point.goal])
        if refused is not None:
            return refused
        self._search_state.seek(robot)
        return Accepted(f"it seeks {robot}: {point.reason}")

    def _asked_to_explore(self, request: ExploreNow) -> Accepted | Refused:
        del request
        exploration = self._exploration
        if exploration is None:
            return Refused(Refusal.ONLY_SEARCHES, "this vehicle only searches")
        objection = self._not_to_move()
        if objection is not None:
            return objection
        if not exploration.remaining:
            return Refused(Refusal.NOTHING_TO_DO, "every waypoint has been visited")
        left = f"{exploration.remaining} waypoints are left"
        if self._context.spec.explores:
            return Accepted(f"it explores already: {left}")
        self._context.signal(Signal.EXPLORE)
        return Accepted(f"it explores: {left}")

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

    def _asked_to_go_to(self, request: GoTo) -> Accepted | Refused:
        context = self._context
        objection = self._not_to_move()
        if objection is not None:
            return objection
        if request.waits and context.state is State.HOME:  # the operator asked for that
            return _comes_home(context.ending.why if context.ending else None)
        hold_s = context.mission.timers.hold_s if request.hold_s is None else request.hold_s
        goto_task = self._validator.goto_task(request.points, hold_s, request.by)
        if isinstance(goto_task, Refused):
            return goto_task
        self._goto_state.set_out(goto_task)
        count = len(goto_task.stops)
        what = f"it flies to {'the point' if count == 1 else f'{count} points'}"
        return Accepted("; ".join((what, *goto_task.notes)), goto_task.stops)

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

    def _put_off(self, request: GoTo) -> None:
        """Keep a request that waits until the vehicle flies its mission; of several the newest."""
        if self.later is not None:
            replaced = Refused(Refusal.REPLACED, "a newer request came")
            self._context.actions.append(_ack(self.later, replaced))
        self.later = request
        self._context.say(f"points from {request.by} wait until the vehicle flies on")

    def now_what_waited(self) -> None:
        """The time of a request that waited has come, or will not come any more."""
        if self.later is None or self._context.spec.puts_off:
            return
        request, self.later = self.later, None
        ending = self._context.ending
        if self._context.state is State.HOME:  # that was asked for later
            answer: Accepted | Refused = _comes_home(ending.why if ending else None)
        else:
            answer = self._asked_to_go_to(request)
        self._context.actions.append(_ack(request, answer))


def _comes_home(why: str | None) -> Refused:
    """A request or a trigger had it come home, and that counts."""
    return Refused(Refusal.COMING_HOME, f"it comes home: {why}")


def _ack(request: AnyRequest, answer: Accepted | Refused) -> CommandAck:
    if isinstance(answer, Refused):
        return CommandAck(request.request_id, request.by, False, answer.why, answer.code)
    return CommandAck(request.request_id, request.by, True, answer.what, None, answer.points)
