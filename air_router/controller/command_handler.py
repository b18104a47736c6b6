"""What is requested in flight: done or refused, and always answered.

A request is looked at against the state of the mission first, then, where the vehicle would be sent
somewhere, against the airspace and the battery. Only then the state changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from air_router.controller.control_authority import ControlAuthority
from air_router.controller.deviations import ReturnMonitor
from air_router.controller.model.actions import Announce, CommandAck, Refusal
from air_router.controller.model.mission_context import (
    MissionContext,
)
from air_router.controller.model.requests import (
    AnyRequest,
    ComeHome,
    ExploreNow,
    GoOn,
    GoTo,
    HoldNow,
    SeekNow,
)
from air_router.controller.model.states import Requests, Signal, State
from air_router.controller.states.explore_state import Exploration
from air_router.controller.states.goto_state import (
    Accepted,
    GotoState,
    GotoValidator,
    Held,
    Refused,
)
from air_router.controller.states.search_state import SearchState
from air_router.vehicle.input_limits import NO_FIX

NOT_HEARD_S: Final = 3.0
"""A vehicle that was not heard for so long is not sent anywhere: its position is unknown."""


@dataclass(slots=True, eq=False)
class RequestHandler:
    """Answers requests, and says whether the vehicle may be told anything just now.

    Args:
        context: What the mission is doing; where answers go.
        returns: Says which way home may not be called off.
        authority: What the operator can do about a vehicle that is not ours.
    """

    _context: MissionContext
    _returns: ReturnMonitor
    _authority: ControlAuthority

    # what answers a request, by its type
    _answers: ClassVar[Mapping[type, Callable[[Any, Any], Accepted | Refused]]] = {}

    def asked(self, request: AnyRequest) -> None:
        """A request of the pilot, the operator or a program."""
        answer = self._answers[type(request)](self, request)
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


@dataclass(slots=True, eq=False)
class CommandHandler(RequestHandler):
    """Sends the vehicle elsewhere, or has it hold; what was held for that it remembers itself.

    Args:
        validator: Whether it may be sent somewhere, and comes home from there.
        exploration: What is left to explore; None: this vehicle only searches.
        search_state: Seeks a robot.
        goto_state: Flies to points.

    Attributes:
        held: What it did before it was told to hold; None: it was not, or went on.
        later: Points that wait until the vehicle flies on; None: none do.
    """

    _validator: GotoValidator
    _exploration: Exploration | None
    search_state: SearchState
    goto_state: GotoState
    held: Held | None = None
    later: GoTo | None = None

    def asked(self, request: AnyRequest) -> None:
        """A request; points that came by gossip may wait for their time."""
        if isinstance(request, GoTo) and request.waits and self._context.spec.puts_off:
            self._put_off(request)
        else:
            RequestHandler.asked(self, request)  # of dataclasses with slots super() knows nothing

    def _asked_to_hold(self, request: HoldNow) -> Accepted | Refused:
        context = self._context
        if context.state is State.HOLD:
            return Accepted("it holds already")
        objection = self._not_to_stop()
        if objection is not None:
            return objection
        # A robot is sought again, a way home flown on; time does not run meanwhile.
        left_s = None if context.ends_s is None else max(0.0, context.ends_s - context.now_s)
        goto_task, explores = self.goto_state.goto_task, context.spec.explores
        self.held = Held(context.state, explores, context.robot, goto_task, left_s)
        context.actions.append(Announce(f"holding, as {request.by} asked"))
        context.signal(Signal.HOLD)
        return Accepted("it stops and hovers")

    def _asked_to_seek(self, request: SeekNow) -> Accepted | Refused:
        robot, search = request.robot, self.search_state.search
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
        self.search_state.seek(robot)
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
        self.goto_state.set_out(goto_task)
        count = len(goto_task.stops)
        what = f"it flies to {'the point' if count == 1 else f'{count} points'}"
        return Accepted("; ".join((what, *goto_task.notes)), goto_task.stops)

    _answers = {  # noqa: RUF012 - of the class, as the base class says
        HoldNow: _asked_to_hold,
        SeekNow: _asked_to_seek,
        ExploreNow: _asked_to_explore,
        GoTo: _asked_to_go_to,
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
