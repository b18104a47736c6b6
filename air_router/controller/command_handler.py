"""Handles requests in flight: each is carried out or refused, and always answered.

A request is checked against the state of the mission. If the vehicle would fly somewhere, it is
also checked against the airspace and the battery. Only then does the state change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.control_authority import ControlAuthority
from air_router.controller.envelope import ReturnMonitor
from air_router.controller.limits import VEHICLE_SILENT_S
from air_router.controller.model import (
    AnyRequest,
    ChangeAltitude,
    ComeHome,
    CommandAck,
    CommandPolicy,
    EndReason,
    ExploreNow,
    Goal,
    GoOn,
    GoTo,
    HoldNow,
    LandNow,
    MissionContext,
    PlanOwner,
    ReadAgain,
    Refusal,
    Reload,
    RequestRefusedError,
    SeekNow,
    Signal,
    State,
    ZoneChange,
)
from air_router.controller.standstill import Standstill
from air_router.controller.states import Accepted, GotoValidator, StateHandlers
from air_router.vehicle import NO_FIX

_NOT_IN_THE_AIR: Final = {
    CommandPolicy.NOT_YET: Refusal.NOT_FLYING,
    CommandPolicy.NOT_OURS: Refusal.NOT_OURS,
    CommandPolicy.OVER: Refusal.FLIGHT_OVER,
}
"""Refusals while the vehicle does not fly this mission."""


@dataclass(slots=True, eq=False)
class CommandHandler:
    """Carries out or refuses every request.

    Args:
        context: State of the flight; receives the answers.
        returns: Knows which return may not be canceled.
        authority: Takes the vehicle back.
        validator: Checks that the vehicle can fly somewhere, and home from there.
        states: Handlers that seek a robot, fly to points, hold and resume.
        airspace_update: Uploads the plan again.
        standstill: Knows why the vehicle does not move as commanded.

    Attributes:
        deferred: A deferred request for points; None: there is none.
    """

    _context: MissionContext
    _returns: ReturnMonitor
    _authority: ControlAuthority
    _validator: GotoValidator
    _states: StateHandlers
    _airspace_update: AirspaceUpdate
    _standstill: Standstill
    deferred: GoTo | None = None
    _until_s: float = math.inf  # when `deferred` expires, vehicle's clock

    def handle(self, request: AnyRequest) -> None:
        """Handle a request of the pilot, the operator or a program; points may be deferred."""
        if isinstance(request, GoTo) and request.waits and self._context.task.spec.defers:
            self._defer(request)
            return
        context, number, by = self._context, request.request_id, request.by
        try:
            what, points = self._handlers[type(request)](self, request)
        except RequestRefusedError as refused:
            context.actions.append(CommandAck(number, by, False, str(refused), refused.code))
            return
        # A hold starts at once, and the upload of a plan has its own announcement.
        moves = SeekNow | ExploreNow | ComeHome | GoTo | ChangeAltitude | LandNow
        sets_out = isinstance(request, moves) or (isinstance(request, GoOn) and not request.upload)
        if sets_out and context.airspace.change is not None and context.in_air:
            what = f"{what}; it sets out once the changed zones are on board"
        context.actions.append(CommandAck(number, by, True, what, None, points))

    def refusals(self) -> dict[str, str]:
        """Why each request would be refused now, by verb; all others may be accepted.

        Pages disable their buttons by it. Routes and battery are checked only with the request
        itself. The only side effect is the way home planned by the return monitor, so pass another
        monitor than the flight's.
        """
        refused = {}
        for verb, check in self._checks.items():
            try:
                check(self)
            except RequestRefusedError as refusal:
                if refusal.code is not Refusal.OTHER_PLAN:  # accepted with an upload of the plan
                    refused[verb] = str(refusal)
        return refused

    # Checks: each raises RequestRefusedError.

    def _check_may_stop(self) -> None:
        """The vehicle is ours, in the air, and not on a return that may not be canceled.

        A return is canceled only if it was requested and nothing else demands it.
        """
        context, requests = self._context, self._context.task.spec.requests
        self._check_not_releasing()
        if requests is CommandPolicy.ANY:
            return
        if requests is not CommandPolicy.CALL_OFF:
            self._check_in_the_air()
        ending = context.task.ending
        by_request = context.task.state is State.HOME and ending is not None and ending.by_request
        why = context.ending_why
        if by_request:
            due = self._returns.due(context.last_telemetry)
            why = None if due is None else due.why
        if why is not None:
            raise self._ends(why)

    def _ends(self, why: str) -> RequestRefusedError:
        """The refusal of requests while the vehicle comes home or lands, for this reason."""
        does = "lands" if self._context.task.state is State.LAND else "comes home"
        return RequestRefusedError(Refusal.COMING_HOME, f"it {does}: {why}")

    def _check_may_move(self) -> None:
        """In addition, the position is known."""
        self._check_may_stop()
        self._check_position()

    def _check_position(self) -> None:
        """The position is known: legs are checked from there."""
        context = self._context
        if context.telemetry is not None and not context.telemetry.fix:
            raise RequestRefusedError(Refusal.NO_FIX, NO_FIX)
        missing = next(iter(context.inputs.stopped), None)
        if missing is not None:
            raise RequestRefusedError(Refusal.NOT_HEARD, missing)
        self._check_received()

    def _check_received(self) -> None:
        """The vehicle was received recently."""
        telemetry = self._context.telemetry
        assert telemetry is not None  # noqa: S101 - a vehicle in the air has sent telemetry
        # The vehicle's clock stops while nothing is received; the link has the duration.
        silent_s = max(self._context.now_s - telemetry.time_s, self._context.silent_s)
        if silent_s > VEHICLE_SILENT_S:
            what = "no position" if telemetry.received_s > telemetry.time_s else "nothing"
            silent = f"{what} received from it for {silent_s:.0f} s"
            raise RequestRefusedError(Refusal.NOT_HEARD, silent)

    def _check_not_releasing(self) -> None:
        """The vehicle is not being released."""
        why = self._context.authority.releasing
        if why is not None:
            raise RequestRefusedError(Refusal.HANDS_OFF, f"hands off in a moment: {why}")

    def _check_in_the_air(self) -> None:
        """The vehicle flies this mission."""
        requests = self._context.task.spec.requests
        code, why = _NOT_IN_THE_AIR.get(requests), requests.value
        if code is Refusal.NOT_OURS:
            taker = self._context.authority.taken_by
            who = taker.value if taker else "the pilot"
            why = f"{who} has the vehicle; {self._authority.way_back}"
        if code is not None:
            raise RequestRefusedError(code, why)

    def _check_may_hold(self) -> None:
        """The vehicle holds already, or may be stopped."""
        if self._context.task.state is not State.HOLD:
            self._check_may_stop()

    def _check_may_explore(self) -> None:
        """Waypoints are left, and the vehicle may fly there."""
        exploration = self._states.search.search.to_explore
        if exploration is None:
            raise RequestRefusedError(Refusal.ONLY_SEARCHES, "this vehicle only searches")
        self._check_may_move()
        if not exploration.remaining:
            raise RequestRefusedError(Refusal.NOTHING_TO_DO, "every waypoint has been visited")

    def _check_may_climb(self, altitude_m: float) -> None:
        """The vehicle may hold at this altitude above home."""
        self._check_may_move()
        why = self._states.hold.why_no_climb(altitude_m)
        if why is not None:
            raise RequestRefusedError(*why)

    def _check_has_altitudes(self) -> None:
        """The mission allows several altitudes, and the vehicle may change its altitude."""
        low_m, high_m = self._context.airspace.mission.altitudes_m
        if low_m == high_m:
            raise RequestRefusedError(Refusal.ALTITUDE, self._states.hold.only_altitudes)
        self._check_may_climb(high_m)

    def _check_may_go_on(self) -> None:
        """A flight is held or was released; whether it can be taken back is not checked."""
        context, state = self._context, self._context.task.state
        self._check_not_releasing()
        if state in {State.READY, State.PASSIVE}:
            if context.in_air:
                self._check_received()
            return
        if state is not State.HOLD:
            self._check_in_the_air()
            nothing = f"nothing is held: it is in {state.name}"
            raise RequestRefusedError(Refusal.NOTHING_TO_DO, nothing)
        self._check_may_move()

    def _check_may_go_on_now(self) -> None:
        """A flight is held, or can be taken back with the plan on board."""
        self._check_may_go_on()
        if self._context.task.state in {State.READY, State.PASSIVE}:
            why = self._authority.why_not_back()
            if why is not None:
                raise RequestRefusedError(self._why_ours_not(), why)

    @property
    def _is_given_away(self) -> bool:
        """The vehicle flies, and another commands it or no leg may start here."""
        context = self._context
        not_ours = context.authority.held is not None or not context.in_charge
        ends = context.task.state in {State.HOME, State.LAND, State.DONE}
        return context.in_air and not_ours and not ends

    def _check_may_come_home(self) -> None:
        """The vehicle comes home already, can be taken back for it, or has not taken off."""
        self._check_not_releasing()
        if self._is_given_away:
            self._check_received()
            why = self._authority.why_not_back(flies_plan=False)
            if why is not None:
                raise RequestRefusedError(Refusal.NOT_OURS, why)
        elif self._context.task.state is not State.READY:
            self._check_in_the_air()

    def _check_may_land(self) -> None:
        """The vehicle lands already, or holds where it may land."""
        state = self._context.task.state
        if state is State.LAND:
            return
        self._check_may_move()
        if state is not State.HOLD:
            raise RequestRefusedError(
                Refusal.BUSY, "it lands where it hovers: request 'hold' first"
            )
        why = self._states.land.why_no_landing()
        if why is not None:
            raise RequestRefusedError(Refusal.NO_WAY, why)

    # the check of each request, by its verb
    _checks: ClassVar[Mapping[str, Callable[[Any], None]]] = {
        "hold": _check_may_hold,
        "resume": _check_may_go_on_now,
        "seek": _check_may_move,
        "explore": _check_may_explore,
        "goto": _check_may_move,
        "altitude": _check_has_altitudes,
        "home": _check_may_come_home,
        "land": _check_may_land,
    }

    # Handlers of the requests.

    def _handle_hold(self, request: HoldNow) -> Accepted:
        self._check_may_hold()
        if self._context.task.state is State.HOLD:
            stops = self._states.hold.stay()
            return Accepted("it stops and hovers" if stops else "it holds already")
        self._states.hold.stop(request.by)
        return Accepted("it stops and hovers")

    def _handle_seek(self, request: SeekNow) -> Accepted:
        robot, search = request.robot, self._states.search.search
        names = search.targets.names
        if robot not in names:
            known = ", ".join(names) or "none"
            unknown = f"no robot '{robot}' is sought in this mission: {known}"
            raise RequestRefusedError(Refusal.UNKNOWN_ROBOT, unknown)
        if robot == self._context.task.robot and self._context.task.state is State.COMM:
            return Accepted(f"it hovers over {robot} already")
        self._check_may_move()
        point = search.search_point(robot, self._context.now_s)
        self._validator.check_way([point.goal])
        self._states.search.seek(robot)
        return Accepted(f"it seeks {robot}: {point.reason}")

    def _handle_explore(self, request: ExploreNow) -> Accepted:
        del request
        self._check_may_explore()
        exploration = self._states.search.search.exploration
        left = f"{exploration.remaining} waypoints are left"
        if self._context.task.spec.explores:
            return Accepted(f"it explores already: {left}")
        self._context.signal(Signal.EXPLORE)
        return Accepted(f"it explores: {left}")

    def _handle_goto(self, request: GoTo) -> Accepted:
        context = self._context
        if request.waits and context.task.state is State.HOME:  # requested by the operator
            raise self._ends(str(context.ending_why))
        self._check_may_move()
        hold_s = (
            context.airspace.mission.timers.hold_s if request.hold_s is None else request.hold_s
        )
        task = self._validator.goto_task(request.points, hold_s, request.by)
        self._states.goto.set_out(task)
        count = len(task.stops)
        what = f"it flies to {'the point' if count == 1 else f'{count} points'}"
        return Accepted("; ".join((what, *task.notes)), task.stops)

    def _handle_altitude(self, request: ChangeAltitude) -> Accepted:
        context, hold, altitude_m = self._context, self._states.hold, request.altitude_m
        self._check_may_climb(altitude_m)
        self._validator.check_way([Goal(context.last_telemetry.position)])
        hold.climb(altitude_m)
        verb = "climbs" if altitude_m > context.last_telemetry.altitude_m else "descends"
        return Accepted(f"it {verb} to {altitude_m:g} m above home, and holds there")

    def _handle_go_on(self, request: GoOn) -> Accepted:
        context = self._context
        self._check_may_go_on()
        if context.task.state in {State.READY, State.PASSIVE}:
            upload = request.upload
            if upload and context.authority.on_board is PlanOwner.REPLACED:
                reading = "the plan on board is being read: request it again in a moment"
                raise RequestRefusedError(Refusal.BUSY, reading)
            if upload and self._authority.why_not_back(flies_plan=False) is None:
                self._airspace_update.upload_again()
            why = self._authority.resume(upload=upload)
            if why is not None:
                raise RequestRefusedError(self._why_ours_not(), why)
            first = "the plan is uploaded again, then " if upload else ""
            return Accepted(f"{first}the mission continues from here")
        return Accepted(self._states.hold.resume(request.by))

    def _why_ours_not(self) -> Refusal:
        """The code of a refused resume: whether only the plan on board is the reason."""
        other = self._context.authority.on_board is PlanOwner.ANOTHER
        only = other and self._authority.why_not_back(flies_plan=False) is None
        return Refusal.OTHER_PLAN if only else Refusal.NOT_OURS

    def _handle_come_home(self, request: ComeHome) -> Accepted:
        context, state = self._context, self._context.task.state
        self._check_may_come_home()
        if state is State.HOME and self._airspace_update.trust_altitude(
            f"requested by {request.by}"
        ):
            how = "by a way that is clear at PX4's altitude"
            return Accepted(f"it comes home {how}; it sets out once the changed zones are on board")
        if state in {State.HOME, State.LAND}:
            does = "comes home" if state is State.HOME else "lands"
            return Accepted(self._unless_still(f"it {does} already"))
        if self._is_given_away:
            self._authority.take_home()
        answer = Accepted(self._how_it_comes_home())
        context.come_home(f"{request.by}'s request", by_request=state is not State.READY)
        return answer

    def _handle_land(self, request: LandNow) -> Accepted:
        context, state = self._context, self._context.task.state
        if state is State.LAND:
            return Accepted(self._unless_still("it lands already"))
        self._check_may_land()
        context.inform(f"landing here, requested by {request.by}")
        place = f"where it hovered, requested by {request.by}"
        context.task.end(EndReason(f"{request.by} requested to land here", place=place))
        context.signal(Signal.LAND_HERE)
        return Accepted("it lands where it hovers")

    def _unless_still(self, what: str) -> str:
        """What the vehicle does already, and why it does not move if it does not."""
        why = self._standstill.why
        return what if why is None else f"{what}, and does not move: {why}"

    def _how_it_comes_home(self) -> str:
        """What the vehicle does after a request to come home, as text."""
        if self._context.telemetry is None:
            return "the mission ends before take-off; nothing is sent to the vehicle"
        if not self._context.in_air:
            return "the mission ends on the ground"
        try:
            self._check_position()
        except RequestRefusedError as unknown:
            return f"it comes home as soon as its position is known: {unknown}"
        return "it comes home"

    def _handle_reload(self, request: Reload) -> Accepted:
        del request
        if self._context.task.state is State.DONE:
            raise RequestRefusedError(Refusal.FLIGHT_OVER, "the flight is over")
        self._check_not_releasing()
        if self._context.airspace.change is ZoneChange.UPLOADING:
            raise RequestRefusedError(
                Refusal.BUSY, "zones are being changed just now; request it again"
            )
        self._context.actions.append(ReadAgain())
        later = "; changes are uploaded after the plan"
        return Accepted(f"the mission file is read again{'' if self._context.telemetry else later}")

    # the handler of each request, by its type
    _handlers: ClassVar[Mapping[type, Callable[[Any, Any], Accepted]]] = {
        HoldNow: _handle_hold,
        SeekNow: _handle_seek,
        ExploreNow: _handle_explore,
        GoTo: _handle_goto,
        ChangeAltitude: _handle_altitude,
        GoOn: _handle_go_on,
        ComeHome: _handle_come_home,
        LandNow: _handle_land,
        Reload: _handle_reload,
    }

    # Deferred requests.

    def _defer(self, request: GoTo) -> None:
        """Defer a request until the vehicle flies its mission; a newer one replaces it."""
        if (before := self.deferred) is not None:
            self._context.actions.append(CommandAck.replaced(before.request_id, before.by))
        self.deferred, self._until_s = request, self._context.now_s + request.waits_s
        self._context.inform(f"points from {request.by} wait until the vehicle flies on")

    def handle_deferred(self) -> None:
        """Handle a deferred request, unless the state defers it still."""
        request = self.deferred
        if request is not None and not self._context.task.spec.defers:
            self.deferred = None
            self.handle(request)

    def expire_deferred(self) -> None:
        """Refuse a deferred request whose time is over, in any state."""
        request = self.deferred
        if request is not None and self._context.now_s > self._until_s:
            self.deferred, why = None, "it expired before the vehicle flew on"
            ack = CommandAck(request.request_id, request.by, False, why, Refusal.TOO_LATE)
            self._context.actions.append(ack)
