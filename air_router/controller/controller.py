"""The mission controller: what happened and the vehicle's time in, what to do out.

Pure: no sockets, no clocks, no files. The same object flies a real PX4, the simulated one, and
the discrete-event world, and a recorded flight replays to the same decisions.

`Assembly` puts its parts together, each with a state of its own. Here stands, as tables beside the
transitions of `behaviour`, when each is asked: what is flown in a state, what is done when one is
entered, who takes an event in, and what may veto a motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, get_args

from air_router.controller.assembly import Assembly
from air_router.controller.model.actions import Action, Finish, Motion, Seeking, StateChanged
from air_router.controller.model.behaviour import Signal, State, next_state
from air_router.controller.model.events import (
    AirspaceChanged,
    CommandConfirmed,
    CommandFailed,
    Event,
    FlownBefore,
    PlanRenewed,
    RobotPath,
    RobotPose,
    RobotSought,
)
from air_router.controller.model.requests import AnyRequest
from air_router.controller.model.state_handler import NO_HANDLER, StateHandler
from air_router.controller.motion.command_gate import Interlock
from air_router.controller.states.goto_task import GotoTask
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.routing.router import Router
from air_router.vehicle.vehicle import (
    ItemReached,
    LinkSilent,
    PlanCompared,
    PlanReplaced,
    Telemetry,
)
from mocha_link.links.metrics import ContactBegan, ContactEnded, SyncEnded, SyncStarted

_NO_TARGET: Final = frozenset({State.INIT, State.EXPL, State.GOTO, State.HOLD, State.HOME})
"""States that forget who was sought; while others fly it is remembered."""


class Controller:
    """Flies one mission.

    Args:
        mission: What to fly.
        plan: The plan on board, for the autopilot's item numbers.
        router: Routes over the mission's graph.
        seek: Names of the robots to seek, in order.
        patient: The pilot arms: if it is disarmed again on the ground, wait on.
        explore: Explore between two searches; otherwise only search.
        name: The UAV's name in the team: of two that seek the same robot, the lower name keeps it.

    Attributes:
        navigator: Takes the vehicle to one goal at a time.
        commanded_mode: Who has the vehicle, and what it was told last.
        exploration: Which waypoint is next.
        search: Whom to seek, and where.
    """

    def __init__(  # noqa: PLR0913 - what a flight is decided with
        self,
        mission: Mission,
        plan: FlightPlan,
        router: Router,
        seek: tuple[str, ...],
        *,
        patient: bool = False,
        explore: bool = True,
        name: str = "",
    ) -> None:
        parts = self._parts = Assembly(
            mission,
            plan,
            router,
            seek,
            patient=patient,
            explore=explore,
            name=name,
            signal=self._signal,
        )
        self._context = parts.context
        self.navigator = parts.gate.navigator
        self.commanded_mode = parts.gate.commanded_mode
        self.exploration = parts.exploration
        self.search = parts.search
        self._explores = explore
        self._left = State.READY
        self._told_sought: str | None = None
        self._handlers = self._table_of_handlers()
        self._entries = self._table_of_entries()
        self._reactions = self._table_of_reactions()
        parts.gate.interlocks = self._table_of_interlocks()

    # The tables.

    def _table_of_interlocks(self) -> tuple[Interlock, ...]:
        """Who may veto a motion, or replace it, in this order; a hold passes all of them."""
        parts = self._parts
        return (
            parts.telemetry_handler.wait_for_inputs,  # where is it, or whose?
            parts.gate.stop_if_doubtful,  # which of several orders would it follow? Hold first
            parts.authority.only_hold,  # hands are off in a moment
            parts.airspace_update.only_hold,  # zones are being changed
            parts.levelling.first,  # it is lower than legs are checked for
        )

    def _table_of_handlers(self) -> Mapping[State, StateHandler]:
        """What is flown in each state."""
        parts = self._parts
        return {
            State.READY: NO_HANDLER,
            State.INIT: parts.explore_state,
            State.EXPL: parts.explore_state,
            State.SEARCH: parts.search_state,
            State.COMM: parts.comm_state,
            State.GOTO: parts.goto_state,
            State.HOLD: parts.hold_state,
            State.HOME: parts.return_state,
            State.LAND: parts.land_state,
            State.PASSIVE: NO_HANDLER,
            State.DONE: NO_HANDLER,
        }

    def _table_of_entries(self) -> Mapping[State, Callable[[], None]]:
        """What is done when a state is entered; nothing leads back to READY."""
        parts = self._parts
        return {
            State.INIT: parts.explore_state.begin,
            State.EXPL: parts.explore_state.begin,
            State.SEARCH: parts.search_state.begin,
            State.COMM: parts.comm_state.begin,
            State.GOTO: parts.goto_state.begin,
            State.HOLD: parts.hold_state.begin,
            State.HOME: parts.return_state.begin,
            State.LAND: parts.land_state.begin,
            State.PASSIVE: self._let_go,
            State.DONE: self._finish,
        }

    def _table_of_reactions(self) -> Mapping[type, Callable[[Any], None]]:
        """Who takes which event in; others (links of others, metrics) only concern the record."""
        parts = self._parts
        return {
            Telemetry: parts.telemetry_handler.vehicle_heard,
            ItemReached: parts.telemetry_handler.item_reached,
            LinkSilent: parts.telemetry_handler.nothing_heard,
            CommandConfirmed: parts.telemetry_handler.confirmed,
            CommandFailed: parts.gate.failed,
            RobotPose: parts.search_state.pose_heard,
            RobotPath: parts.search_state.path_heard,
            RobotSought: parts.search_state.sought_by_other,
            ContactBegan: parts.search_state.radio_heard,
            ContactEnded: parts.search_state.radio_heard,
            SyncStarted: parts.comm_state.sync_started,
            SyncEnded: parts.comm_state.sync_ended,
            AirspaceChanged: parts.airspace_update.airspace_changed,
            PlanRenewed: parts.airspace_update.plan_renewed,
            FlownBefore: self._flown_before,
            PlanReplaced: parts.authority.plan_replaced,
            PlanCompared: parts.authority.plan_compared,
            **dict.fromkeys(get_args(AnyRequest), parts.command_handler.asked),
        }

    # From state to state.

    def _signal(self, signal: Signal) -> None:
        """Something has happened to the mission: another state is entered, or the same anew."""
        left = self._left = self.state
        target = next_state(left, signal, explores=self._explores)
        self._context.enter(target, self._handlers[target])
        self._context.do(StateChanged(left, signal, target, self.robot))
        if target in _NO_TARGET:
            self._parts.search_state.forget()
        self._entries[target]()

    def _flown_before(self, event: FlownBefore) -> None:
        self._parts.flight_phase.airborne_s = event.airborne_s
        self.exploration.go_on(event.visited, event.left_out)

    def _let_go(self) -> None:
        self._parts.authority.settled()
        self._parts.command_handler.now_what_waited()
        self._parts.gate.let_go()

    def _finish(self) -> None:
        self._parts.authority.settled()
        self.navigator.stop()
        self._parts.command_handler.now_what_waited()
        landed_by_us = self._left is State.LAND
        why = self._parts.flight_phase.ending(landed_by_us=landed_by_us)
        self._context.do(Finish(landed_by_us, why, self._parts.authority.taken_by))

    # What others do.

    def handle(self, event: Event, now_s: float) -> list[Action]:
        """Take one event in at vehicle time `now_s`; returns what to do about it, in order."""
        self._context.begin(now_s)
        reaction = self._reactions.get(type(event))
        if reaction is not None:
            reaction(event)
        if self.sought != self._told_sought:
            self._told_sought = self.sought
            self._context.do(Seeking(self.sought))
        return self._context.actions

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion that was decided a moment ago must not be commanded now; None if it may."""
        return self._parts.gate.objection(motion, now_s)

    def prepare(self, router: Router) -> None:
        """The router among changed zones, made elsewhere because it takes a while.

        The same is made here if there is none when the change comes.
        """
        self._parts.airspace_update.prepare(router)

    # What others read.

    @property
    def mission(self) -> Mission:
        """The mission, with the zones and fences of now."""
        return self._context.mission

    @property
    def router(self) -> Router:
        """Plans among the zones and fences of now."""
        return self._context.router

    @property
    def telemetry(self) -> Telemetry | None:
        """What the vehicle said last."""
        return self._context.telemetry

    @property
    def flown(self) -> FlownBefore | None:
        """What another companion has to know to go on with this flight; None if there is none."""
        airborne_s = self._parts.flight_phase.airborne_s
        if airborne_s is None or self.state is State.DONE:
            return None
        visited, _ = self.exploration.mark()
        return FlownBefore(airborne_s, visited, tuple(self.exploration.left_out))

    @property
    def state(self) -> State:
        """What the mission is doing."""
        return self._context.state

    @property
    def time_left_s(self) -> float | None:
        """Seconds until the state's timer, None while it does not run."""
        return self._context.schedule.left_s

    @property
    def robot(self) -> str | None:
        """Who is sought or hovered over, or was when the vehicle was given away."""
        return self._parts.search_state.robot

    @property
    def sought(self) -> str | None:
        """The robot that is sought or hovered over now; None while it does something else."""
        return self._parts.search_state.sought

    @property
    def goto_task(self) -> GotoTask | None:
        """The points that it was sent to on request."""
        return self._parts.goto_state.goto_task

    @property
    def came_home_why(self) -> str | None:
        """Why the vehicle comes home, once it does."""
        return self._parts.return_state.why

    @property
    def need_home(self) -> float | None:
        """The charge that flying home from here takes; None when unknown, or on the way already."""
        return self._parts.return_state.need_home

    @property
    def walled_in(self) -> bool:
        """Whether zones that were drawn in flight leave no clear way home from here."""
        return self._parts.reachability.walled_in

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        return self._parts.authority.in_charge
