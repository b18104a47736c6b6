"""The mission controller: what happened and the vehicle's time in, what to do out.

Pure: no sockets, no clocks, no files. The same object flies a real PX4, the simulated one, and
the discrete-event world, and a recorded flight replays to the same decisions.

When it explores, searches and talks stands in one table, `states.table.STATES`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, get_args

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.command_handler import CommandHandler
from air_router.controller.control_authority import ControlAuthority, InitialClimb
from air_router.controller.model.actions import Action, Finish, Motion, Seeking, StateChanged
from air_router.controller.model.events import (
    AirspaceChanged,
    CommandConfirmed,
    CommandFailed,
    Event,
    FlownBefore,
    PeerFault,
    PlanRenewed,
    RobotPath,
    RobotPose,
    RobotSought,
)
from air_router.controller.model.mission_context import MissionContext, StateHandler
from air_router.controller.model.requests import AnyRequest
from air_router.controller.model.states import Signal, State
from air_router.controller.monitor.deviations import Deviations
from air_router.controller.monitor.flight_phase import FlightPhase
from air_router.controller.monitor.safety_monitor import SafetyMonitor
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import Navigator
from air_router.controller.preconditions import Preconditions
from air_router.controller.states.explore_state import ExploreState
from air_router.controller.states.goto_state import GotoState, GotoTask, GotoValidator
from air_router.controller.states.hold_state import HandsOffState, HoldState, LandState
from air_router.controller.states.return_state import HomeReachability, ReturnState
from air_router.controller.states.search_state import CommState, SearchState
from air_router.controller.states.table import STATES, transitions
from air_router.controller.targets.exploration import Exploration
from air_router.controller.targets.search_points import Search
from air_router.controller.telemetry_handler import TelemetryHandler
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.routing.router import Router
from air_router.vehicle.input_limits import InputWatch
from air_router.vehicle.vehicle import (
    ItemReached,
    LinkSilent,
    PlanCompared,
    PlanReplaced,
    Telemetry,
)
from mocha_link.links.metrics import ContactBegan, ContactEnded, SyncEnded, SyncStarted


class Controller:
    """Flies one mission.

    Args:
        mission: What to fly.
        plan: The plan on board, for the autopilot's item numbers.
        router: Routes over the mission's graph.
        seek: Names of the robots to seek, in order.
        pilot_arms: The pilot arms: if it is disarmed again on the ground, wait on.
        explore: Explore between two searches; otherwise only search.
        name: The UAV's name in the team: of two that seek the same robot, the lower name keeps it.

    Attributes:
        navigator: Takes the vehicle to one goal at a time.
        commanded_mode: Who has the vehicle, and what it was told last.
        exploration: Which waypoint is next.
        search: Whom to seek, and where.
        airspace_update: Zones that change.
        return_state: Whether, and why, the vehicle comes home.
    """

    def __init__(  # noqa: PLR0913 - what a flight is decided with
        self,
        mission: Mission,
        plan: FlightPlan,
        router: Router,
        seek: tuple[str, ...],
        *,
        pilot_arms: bool = False,
        explore: bool = True,
        name: str = "",
    ) -> None:
        self._transitions = transitions(explores=explore)
        self._left = State.READY  # the state before this one
        self._told_sought: str | None = None  # the robot in the last `Seeking`
        # What is known and kept.
        context = self._context = MissionContext(
            mission, router, self._signal, spec=STATES[State.READY]
        )
        self.navigator = Navigator(context)
        gate = self.gate = CommandGate(context, self.navigator, plan)  # all motions pass it
        self.commanded_mode = gate.commanded_mode
        # Of a flight that is gone on with some waypoints may be skipped already.
        self.exploration = Exploration(mission.waypoints, mission.skipped)
        self.search = Search(context, seek, self.exploration, explore=explore)
        flight_phase = self._flight_phase = FlightPhase()
        reachability = self._reachability = HomeReachability(context)
        inputs = InputWatch()
        # What is flown.
        to_explore = self.exploration if explore else None
        search = self._search_state = SearchState(context, gate, self.search, to_explore, name)
        comm = CommState(context, gate, search)
        goto = self._goto_state = GotoState(context, gate)
        home = self.return_state = ReturnState(context, gate, flight_phase, reachability)
        self._handlers: Mapping[State, StateHandler] = _by_state(  # what is flown in each state
            StateHandler(),
            ExploreState(context, gate, self.exploration, reachability),
            search,
            comm,
            goto,
            HoldState(context, gate),
            home,
            LandState(gate),
            HandsOffState(self._let_go),
        )
        # What else is decided.
        initial_climb = InitialClimb(context, gate)
        authority = self._authority = ControlAuthority(context, gate, flight_phase, initial_climb)
        self.airspace_update = AirspaceUpdate(context, gate, self.exploration, authority, home)
        commands = self._commands = CommandHandler(
            context,
            Preconditions(context, inputs, home, authority),
            GotoValidator(context, self.search),
            self.search,
            to_explore,
            search,
            goto,
            home,
            authority,
            self.airspace_update,
        )
        telemetry = TelemetryHandler(
            context,
            gate,
            plan,
            self.exploration,
            flight_phase,
            SafetyMonitor(context, plan),
            Deviations(context),
            inputs,
            authority,
            home,
            self.airspace_update,
            initial_climb,
            commands,
            pilot_arms,
        )
        # Who may veto a motion, or replace it, in this order; a hold passes all of them.
        gate.interlocks = (
            telemetry.wait_for_inputs,  # where is it, or whose?
            gate.stop_if_doubtful,  # which of several orders would it follow? Hold first
            authority.only_hold,  # hands are off in a moment
            self.airspace_update.only_hold,  # zones are being changed
            initial_climb.first,  # it is lower than legs are checked for
        )
        # Who takes which event in; others (links of others, metrics) only concern the record.
        self._reactions: Mapping[type, Callable[[Any], None]] = {
            Telemetry: telemetry.vehicle_heard,
            ItemReached: telemetry.item_reached,
            LinkSilent: telemetry.nothing_heard,
            CommandConfirmed: telemetry.confirmed,
            CommandFailed: gate.failed,
            RobotPose: search.pose_heard,
            RobotPath: search.path_heard,
            RobotSought: search.sought_by_other,
            ContactBegan: search.radio_heard,
            ContactEnded: search.radio_heard,
            SyncStarted: comm.sync_started,
            SyncEnded: comm.sync_ended,
            AirspaceChanged: self.airspace_update.airspace_changed,
            PlanRenewed: self.airspace_update.plan_renewed,
            FlownBefore: self._flown_before,
            PeerFault: lambda event: context.say(event.words),
            PlanReplaced: authority.plan_replaced,
            PlanCompared: authority.plan_compared,
            **dict.fromkeys(get_args(AnyRequest), commands.asked),
        }

    # From state to state.

    def _signal(self, signal: Signal) -> None:
        """Something has happened to the mission: another state is entered, or the same anew."""
        context, left = self._context, self._context.state
        target = self._transitions[left].get(signal)
        if target is None:
            return
        self._left = left
        spec, handler = STATES[target], self._handlers[target]
        context.enter(target, spec, handler)
        context.actions.append(StateChanged(left, signal, target, self._search_state.robot))
        if not spec.keeps_target:
            self._search_state.robot = None
        handler.begin()

    def _flown_before(self, event: FlownBefore) -> None:
        self._flight_phase.airborne_s = event.airborne_s
        self.exploration.go_on(event.visited, event.left_out)

    def _let_go(self) -> None:
        """Hands are off, or the flight is over."""
        done = self._context.state is State.DONE
        self._authority.settled()
        if done:
            self.navigator.stop()
        self._commands.now_what_waited()
        if not done:
            self.gate.let_go()
            return
        landed_by_us = self._left is State.LAND
        why = self._flight_phase.ending(landed_by_us=landed_by_us)
        self._context.do(Finish(landed_by_us, why, self._authority.taken_by))

    # What others do.

    def handle(self, event: Event, now_s: float) -> list[Action]:
        """Take one event in at vehicle time `now_s`; returns what to do about it, in order."""
        context = self._context
        context.actions = []
        context.now_s = max(context.now_s, now_s)
        reaction = self._reactions.get(type(event))
        if reaction is not None:
            reaction(event)
        sought = self._search_state.robot if context.spec.seeks else None
        if sought != self._told_sought:
            self._told_sought = sought
            context.do(Seeking(sought))
        return context.actions

    def objection(self, motion: Motion, now_s: float) -> str | None:
        """Why a motion that was decided a moment ago must not be commanded now; None if it may."""
        return self.gate.objection(motion, now_s)

    def prepare(self, router: Router) -> None:
        """The router among changed zones, made elsewhere because it takes a while.

        The same is made here if there is none when the change comes.
        """
        self.airspace_update.prepare(router)

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
        airborne_s = self._flight_phase.airborne_s
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
        return self._context.left_s

    @property
    def robot(self) -> str | None:
        """Who is sought or hovered over, or was when the vehicle was given away."""
        return self._search_state.robot

    @property
    def goto_task(self) -> GotoTask | None:
        """The points that it was sent to on request."""
        return self._goto_state.goto_task

    @property
    def came_home_why(self) -> str | None:
        """Why the vehicle comes home, once it does."""
        return self.return_state.why

    @property
    def need_home(self) -> float | None:
        """The charge that flying home from here takes; None when unknown, or on the way already."""
        return self.return_state.need_home

    @property
    def no_way_home(self) -> bool:
        """Whether zones that were drawn in flight leave no clear way home from here."""
        return self._reachability.walls is not None

    @property
    def in_charge(self) -> bool:
        """Whether the vehicle in the air flies by our commands."""
        return self._authority.in_charge


def _by_state(*handlers: StateHandler) -> Mapping[State, StateHandler]:
    """Of each state its handler: the one of the class that its row names."""
    of_class = {type(handler): handler for handler in handlers}
    return {state: of_class[spec.handler] for state, spec in STATES.items()}
