"""What somebody asks for in flight: done or refused, and always answered.

A request is looked at against the state of the mission first, then, where the vehicle would be sent
somewhere, against the airspace and the battery. Only then the state changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from air_router.controller.airspace_update import Phase, Renewal
from air_router.controller.control_authority import Handing, OnBoard
from air_router.controller.model.actions import Answered, ReadAgain, Refusal
from air_router.controller.model.behaviour import EXPLORING, Signal, State
from air_router.controller.model.mission_context import Cockpit
from air_router.controller.model.requests import (
    AnyRequest,
    ComeHome,
    ExploreNow,
    GoOn,
    GoTo,
    HoldNow,
    Reload,
    SeekNow,
)
from air_router.controller.preconditions import Permission, comes_home
from air_router.controller.states.goto_state import Errands
from air_router.controller.states.goto_task import Errand, Judge, Refused
from air_router.controller.states.return_state import Homecoming
from air_router.controller.states.search_state import Pursuit
from air_router.controller.targets.exploration import Exploration
from air_router.controller.targets.search_points import Search
from geo.frame import Point


class Accepted(NamedTuple):
    """What is done."""

    what: str
    points: tuple[Point, ...] = ()


@dataclass(frozen=True, slots=True)
class Held:
    """What the vehicle did before somebody had it hold.

    Attributes:
        state: The state of the mission.
        robot: Who was sought or hovered over.
        errand: The points that were left.
        left_s: What the state's timer had left; None if it did not run.
    """

    state: State
    robot: str | None
    errand: Errand | None
    left_s: float | None


class Answering:
    """Takes orders: what was held for one, and which one waits, it remembers itself.

    Args:
        cockpit: What the mission is doing; where answers go.
        permission: Whether the vehicle may be told anything just now.
        judge: Whether it may be sent somewhere, and comes home from there.
        search: Which robots there are, and where.
        exploration: What is left to explore; None: this vehicle only searches.
        pursuit: Seeks a robot.
        errands: Flies to points.
        homecoming: Comes home, and says what nobody may call off.
        handing: Takes a vehicle back that was given away.
        renewal: Whether zones are being changed.
    """

    def __init__(  # noqa: PLR0913 - whoever does what can be asked for
        self,
        cockpit: Cockpit,
        permission: Permission,
        judge: Judge,
        search: Search,
        exploration: Exploration | None,
        *,
        pursuit: Pursuit,
        errands: Errands,
        homecoming: Homecoming,
        handing: Handing,
        renewal: Renewal,
    ) -> None:
        self._cockpit = cockpit
        self._judge = judge
        self._permission = permission
        self._search = search
        self._exploration = exploration
        self._pursuit = pursuit
        self._errands = errands
        self._homecoming = homecoming
        self._handing = handing
        self._renewal = renewal
        self._held: Held | None = None
        self._later: GoTo | None = None

    def asked(self, request: AnyRequest) -> None:
        """Somebody asks for something."""
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
            self._renewal.phase is not None
            and isinstance(request, GoOn | SeekNow | ExploreNow | ComeHome | GoTo)
            and not (isinstance(request, GoOn) and request.upload)  # that says so itself
            and self._cockpit.in_air
        )

    def _answer(self, request: AnyRequest, answer: Accepted | Refused) -> None:
        accepted = isinstance(answer, Accepted)
        self._cockpit.do(
            Answered(
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
        cockpit = self._cockpit
        if cockpit.state is State.HOLD:
            return Accepted("it holds already")
        objection = self._permission.to_stop()
        if objection is not None:
            return objection
        # A robot is sought again, a way home flown on; time does not run meanwhile.
        errand, left_s = self._errands.errand, cockpit.schedule.left_s
        self._held = Held(cockpit.state, self._pursuit.robot, errand, left_s)
        self._homecoming.call_off()
        cockpit.say(f"holding, as {request.by} asked")
        cockpit.signal(Signal.HOLD)
        return Accepted("it stops and hovers")

    def _asked_to_go_on(self, request: GoOn) -> Accepted | Refused:
        state = self._cockpit.state
        objection = self._permission.to_decide()
        if objection is not None:
            return objection
        if state in {State.READY, State.PASSIVE}:
            if self._cockpit.in_air and (silent := self._permission.not_heard()) is not None:
                return silent
            upload = request.upload
            if upload and self._handing.why_not_back(flies_plan=False) is None:
                self._renewal.board_again()
            why = self._handing.resume(upload=upload)
            if why is not None:
                return Refused(self._why_ours_not(), why)
            self._homecoming.call_off()
            first = "the plan is put on board again, then " if upload else ""
            return Accepted(f"{first}the mission goes on from here")
        if state is not State.HOLD:
            return self._permission.in_the_air() or Refused(
                Refusal.NOTHING_TO_DO, f"nothing is held: it is in {state.name}"
            )
        return self._permission.to_move() or self._go_on(request.by)

    def _why_ours_not(self) -> Refusal:
        """Whether all that keeps a vehicle from being taken back is the plan on board."""
        other = self._handing.on_board is OnBoard.ANOTHER
        only = other and self._handing.why_not_back(flies_plan=False) is None
        return Refusal.OTHER_PLAN if only else Refusal.NOT_OURS

    def _go_on(self, by: str) -> Accepted:
        held, self._held = self._held, None
        assert held is not None  # noqa: S101 - what HOLD is entered with
        if held.state is State.HOME:
            self._homecoming.come_home_by_word(by)
            return Accepted("it comes home")
        if held.state is State.GOTO and held.errand is not None:
            self._errands.set_out(held.errand, held.left_s)
            return Accepted("it flies on to the points that are left")
        if held.state in {State.SEARCH, State.COMM} and held.robot is not None:
            self._pursuit.seek(held.robot)
            return Accepted(f"it seeks {held.robot} again")
        if held.state in EXPLORING and held.left_s is not None:
            self._cockpit.schedule.carry(held.left_s)
        self._cockpit.signal(Signal.RESUMED)
        return Accepted("it goes on")

    def _asked_to_seek(self, request: SeekNow) -> Accepted | Refused:
        robot, names = request.robot, self._search.roster.names
        if robot not in names:
            known = ", ".join(names) or "nobody"
            return Refused(
                Refusal.UNKNOWN_ROBOT, f"no robot '{robot}' is sought in this mission: {known}"
            )
        if robot == self._pursuit.robot and self._cockpit.state is State.COMM:
            return Accepted(f"it hovers over {robot} already")
        objection = self._permission.to_move()
        if objection is not None:
            return objection
        aim = self._search.aim(robot, self._cockpit.now_s)
        refused = self._judge.way(self._cockpit.heard, [aim.goal])
        if refused is not None:
            return refused
        self._homecoming.call_off()
        self._pursuit.seek(robot)
        return Accepted(f"it seeks {robot}: {aim.reason}")

    def _asked_to_explore(self, request: ExploreNow) -> Accepted | Refused:
        del request
        exploration = self._exploration
        if exploration is None:
            return Refused(Refusal.ONLY_SEARCHES, "this vehicle only searches")
        objection = self._permission.to_move()
        if objection is not None:
            return objection
        if not exploration.remaining:
            return Refused(Refusal.NOTHING_TO_DO, "every waypoint has been visited")
        left = f"{exploration.remaining} waypoints are left"
        if self._cockpit.state in EXPLORING:
            return Accepted(f"it explores already: {left}")
        self._homecoming.call_off()
        self._cockpit.signal(Signal.EXPLORE)
        return Accepted(f"it explores: {left}")

    def _asked_to_come_home(self, request: ComeHome) -> Accepted | Refused:
        state = self._cockpit.state
        objection = self._permission.to_decide()
        if objection is not None:
            return objection
        if state in {State.HOME, State.LAND}:
            return Accepted("it comes home already")
        if self._cockpit.in_air and not self._handing.in_charge and state is not State.DONE:
            if (silent := self._permission.not_heard()) is not None:
                return silent
            why = self._handing.take_home()
            if why is not None:
                return Refused(Refusal.NOT_OURS, why)
        elif state is not State.READY and (gone := self._permission.in_the_air()) is not None:
            return gone
        answer = Accepted(self._how_it_comes_home())
        self._homecoming.come_home_by_word(request.by)
        return answer

    def _how_it_comes_home(self) -> str:
        """What follows when it is told to, in words."""
        if self._cockpit.telemetry is None:
            return "the mission ends before it begins; the vehicle is left as it is"
        if not self._cockpit.in_air:
            return "the mission ends on the ground"
        unknown = self._permission.without_position()
        if unknown is not None:
            return f"it comes home as soon as it is known where it is: {unknown.why}"
        return "it comes home"

    def _asked_to_go_to(self, request: GoTo) -> Accepted | Refused:
        objection = self._permission.to_move()
        if objection is not None:
            return objection
        if request.waits and self._cockpit.state is State.HOME:  # somebody here asked for that
            return comes_home(self._homecoming.why)
        hold_s = request.hold_s
        if hold_s is None:
            hold_s = self._cockpit.mission.timers.hold_s
        errand = self._judge.errand(self._cockpit.heard, request.points, hold_s, request.by)
        if isinstance(errand, Refused):
            return errand
        self._homecoming.call_off()
        self._errands.set_out(errand)
        count = len(errand.stops)
        what = f"it flies to {'the point' if count == 1 else f'{count} points'}"
        return Accepted("; ".join((what, *errand.notes)), errand.stops)

    def _asked_to_reload(self, request: Reload) -> Accepted | Refused:
        del request
        if self._cockpit.state is State.DONE:
            return Refused(Refusal.FLIGHT_OVER, "the flight is over")
        objection = self._permission.to_decide()
        if objection is not None:
            return objection
        if self._renewal.phase is Phase.BOARDING:
            return Refused(Refusal.BUSY, "zones are being changed just now; ask again")
        self._cockpit.do(ReadAgain())
        if self._cockpit.telemetry is None:
            return Accepted(
                "the mission file is read again; what has changed goes on board after the plan"
            )
        return Accepted("the mission file is read again")

    _to_requests: Final[dict[type, Callable[[Answering, Any], Accepted | Refused]]] = {
        HoldNow: _asked_to_hold,
        GoOn: _asked_to_go_on,
        SeekNow: _asked_to_seek,
        ExploreNow: _asked_to_explore,
        ComeHome: _asked_to_come_home,
        GoTo: _asked_to_go_to,
        Reload: _asked_to_reload,
    }

    # What is not done at once.

    def _put_off(self, request: GoTo) -> bool:
        """Keep a request that waits until the vehicle flies its mission; of several the newest."""
        if self._cockpit.state not in {State.READY, State.HOLD}:
            return False
        if self._later is not None:
            self._answer(self._later, Refused(Refusal.REPLACED, "a newer request came"))
        self._later = request
        self._cockpit.say(f"points from {request.by} wait until the vehicle flies on")
        return True

    def now_what_waited(self) -> None:
        """The time of a request that waited has come, or will not come any more."""
        state = self._cockpit.state
        if self._later is None or state in {State.READY, State.HOLD}:
            return
        request, self._later = self._later, None
        if state is State.HOME:  # whoever asked for that did so later
            self._answer(request, comes_home(self._homecoming.why))
        else:
            self._answer(request, self._asked_to_go_to(request))
