"""What happens leads to what: events in, and of each telemetry message the gravest matter first.

Who has the vehicle comes before everything else: a pilot, a failsafe, or one who is about to get
it. Then what is wrong with the flight, and only then the mission.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.command_handler import CommandHandler
from air_router.controller.control_authority import ControlAuthority, SilenceReminder
from air_router.controller.deviations import Deviations, ReturnMonitor
from air_router.controller.model.actions import (
    Action,
    ControlHolder,
    Finish,
    FlyToNode,
    HoldHere,
    Seeking,
    StateChanged,
)
from air_router.controller.model.events import CommandConfirmed, Event, FlownBefore
from air_router.controller.model.mission_context import MissionContext, Progress, StateHandler
from air_router.controller.model.states import From, Requests, Signal, State
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.initial_climb import ClimbWatch, InitialClimb
from air_router.controller.motion.navigator import Navigator
from air_router.controller.safety_monitor import (
    HELD,
    FlightPhase,
    HomeWatch,
    Response,
    SafetyMonitor,
    TakeOff,
    take_off,
)
from air_router.controller.states.explore_state import PASSING_M, Exploration
from air_router.controller.states.table import STATES
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.input_limits import CALM, InputStatus, Stop
from air_router.vehicle.vehicle import FlightMode, ItemReached, LinkSilent, Telemetry


class MissionLoop:
    """Takes events in; its parts, which `Controller` puts together, share one context.

    Attributes:
        context: What is known now; others read it.
        gate: What the vehicle was told.
        navigator: Takes the vehicle to one goal at a time.
        exploration: Which waypoint is next.
        airspace_update: Zones that change.
    """

    context: MissionContext
    gate: CommandGate
    navigator: Navigator
    exploration: Exploration
    airspace_update: AirspaceUpdate
    _plan: FlightPlan  # on board
    _pilot_arms: bool  # if it is disarmed again on the ground, wait on
    _transitions: Mapping[State, Mapping[Signal, State]]
    _handlers: Mapping[State, StateHandler]  # what is flown in each state
    _reactions: Mapping[type, Callable[[Any], None]]  # who takes which event in
    _phase: FlightPhase
    _home: HomeWatch
    _monitor: SafetyMonitor
    _deviations: Deviations
    _returns: ReturnMonitor
    _authority: ControlAuthority
    _commands: CommandHandler
    _climb: InitialClimb  # of a vehicle that was taken over
    _rise: ClimbWatch  # of the take-off
    _silence: SilenceReminder
    _left: State = State.READY  # the state before this one
    _told_sought: str | None = None  # the robot in the last `Seeking`

    def handle(self, event: Event, now_s: float) -> list[Action]:
        """Take one event in at vehicle time `now_s`; returns what to do about it, in order."""
        context = self.context
        context.actions = []
        context.now_s = max(context.now_s, now_s)
        reaction = self._reactions.get(type(event))
        if reaction is not None:
            reaction(event)
        sought = context.robot if context.spec.seeks else None
        if sought != self._told_sought:
            self._told_sought = sought
            context.actions.append(Seeking(sought))
        return context.actions

    # The vehicle, the gravest matter first.

    def _vehicle_heard(self, telemetry: Telemetry) -> None:
        context, gate, authority, phase = self.context, self.gate, self._authority, self._phase
        context.telemetry = telemetry
        context.silent_s = self._silence.told_s = 0.0
        if phase.note(telemetry):
            gate.assume(FlightMode.MISSION)
        moved = self._home.look(telemetry) if telemetry.in_air else None
        ours = context.handed_over if context.state is State.READY else context.spec.ours
        # On the ground the autopilot changes its mode by itself, when it disarms. A failsafe may
        # act in the very mode that we asked for: a fence holds a vehicle that hovers in Hold.
        flies = telemetry.in_air and telemetry.armed
        chosen = telemetry.failsafe or telemetry.mode not in gate.modes
        grounded = Signal.GROUNDED in context.spec.on
        if grounded and not phase.flies and phase.over(telemetry):
            self._grounded()
        elif not phase.flies and (killed := phase.killed_now()) is not None:
            authority.fallen(killed)
        elif ours and flies and chosen:
            authority.taken(telemetry)
        elif context.giving_up is not None or context.compares is not None:
            authority.check()
        elif context.state is State.READY:
            self._take_off(telemetry)
            if moved is Response.HOLD and context.in_charge:
                context.come_home("home was moved in the climb")
        elif context.state is State.PASSIVE:
            authority.look_on(telemetry)
        elif ours:
            self._go_on(telemetry, moved)

    def _grounded(self) -> None:
        if self._pilot_arms and self.context.state is State.READY and self._phase.again():
            self._rise = ClimbWatch()
            self.context.say("disarmed before take-off: waiting on")
        else:
            self.context.signal(Signal.GROUNDED)

    def _take_off(self, telemetry: Telemetry) -> None:
        context, gate = self.context, self.gate
        if context.handed_over and telemetry.in_air:
            status = context.inputs.look(telemetry)
            if status is not CALM:
                self._missing(status, telemetry)  # the climb ends above home by itself
            if context.state is not State.READY:
                return
        stage = take_off(context, telemetry)
        if stage is TakeOff.COMPLETE:
            gate.assume(FlightMode.MISSION)
            context.ours_again()
            context.signal(Signal.AIRBORNE)
        elif stage in HELD and gate.pending is None:
            context.say(f"holding: {HELD[stage]}")
            gate.command(HoldHere(stage.value))
        elif self._rise_stuck(telemetry) and gate.pending is None:
            context.come_home("the climb does not go on")

    def _rise_stuck(self, telemetry: Telemetry) -> bool:
        """Whether the climb that was handed over to us has not gone on for some time."""
        rises = self.context.handed_over and telemetry.in_air
        return rises and self._rise.stuck(telemetry)

    def _go_on(  # noqa: C901, PLR0912 - the order of what counts, on one screen
        self, telemetry: Telemetry, moved: Response | None
    ) -> None:
        """It is ours: no breach, no other's orders, all inputs; then on with the mission."""
        context, gate, climb = self.context, self.gate, self._climb
        foreign = self._monitor.foreign_order(telemetry)
        breach = None
        if foreign is not None:
            self._authority.take_over(ControlHolder.PILOT, foreign)
        elif (breach := self._monitor.breach(telemetry, context.leaving)) is not None:
            self._authority.give_up(f"{breach} is not resumed by itself")
        if context.put_off and not context.doubts:
            context.put_off = False
            context.retry_in(0.0)
        if foreign is not None or breach is not None:
            return
        status = context.inputs.look(telemetry)
        if status is not CALM and self._missing(status, telemetry):
            return
        if context.spec.cruises and context.zones is None and climb.climb is None:
            self._deviations.keep(telemetry, moved)
        else:
            self._deviations.forget()
        exploration = self.exploration
        exploration.here = telemetry.position
        if exploration.began_s is None:
            exploration.began_s = context.now_s
        for waypoint in exploration.waypoints:
            if math.dist(telemetry.position, waypoint.position) <= PASSING_M:
                exploration.passed(waypoint.number, context.now_s)
        self._returns.check(telemetry)
        if context.zones is not None:
            self.airspace_update.go_on(telemetry)
            return
        if climb.climb is not None and climb.go_on(telemetry):
            if climb.stuck(telemetry):
                self._authority.give_up("the climb to the mission's altitude does not go on")
            return
        if context.jumped:
            return
        if context.ends_s is not None and context.now_s >= context.ends_s:
            context.signal(Signal.TIMER)
        if self._commands.later is not None:
            self._commands.now_what_waited()
        motion = self.navigator.update(telemetry)
        if motion is not None or context.way.progress is not Progress.FLYING:
            self.navigator.advance(motion)
        if context.retry_at_s is not None and not gate.pending and context.take_retry():
            context.handler.retry()

    def _missing(self, status: InputStatus, telemetry: Telemetry) -> bool:
        """Tell which inputs are missing; whether too few of them come to fly on by."""
        context = self.context
        landing = context.state is State.LAND  # PX4 does so without a position too
        for what, then in status.news:
            context.say(f"{what}: {'landing on' if landing else then}" if then else what)
        if status.home_why is not None:
            context.come_home(status.home_why)
        if context.state is State.READY:
            return False
        if status.stop is Stop.NONE:
            if status.back:
                context.retry_in(0.0)
            return False
        may_retry = context.take_retry() or context.retry_at_s is None
        if status.stop is Stop.HOLD and not landing and may_retry:
            self.gate.hold(status.why)  # unless that is what it does
        self._returns.check(telemetry)  # time and charge go on
        if context.left_s == 0.0 and context.zones is None:
            context.signal(Signal.TIMER)
        return True

    def _item_reached(self, event: ItemReached) -> None:
        """The vehicle says that it is at a plan item: perhaps at the end of its leg."""
        context = self.context
        if context.telemetry is None or not context.in_charge or context.zones is not None:
            return
        if isinstance(self.gate.pending, FlyToNode):
            return  # the report may be of the node before; the vehicle has not confirmed the jump
        node = self._plan.node_of(event.item)
        self.navigator.advance(self.navigator.update(context.telemetry, reached_node=node))

    def _nothing_heard(self, event: LinkSilent) -> None:
        """The vehicle says nothing."""
        self.context.silent_s = event.silent_s
        news = self._silence.news(event.silent_s)
        if news is not None:
            self.context.say(news)

    def _confirmed(self, event: CommandConfirmed) -> None:
        """It follows; if that was the hold before hands are off, it is let go."""
        self.gate.confirmed(event)
        self._authority.check()

    # From state to state.

    def _signal(self, signal: Signal) -> None:
        """Something has happened to the mission: another state is entered, or the same anew."""
        context, left = self.context, self.context.state
        target = self._transitions[left].get(signal)
        if target is None:
            return
        self._left = left
        spec, handler = STATES[target], self._handlers[target]
        context.state, context.spec, context.handler = target, spec, handler
        own_s = None if spec.timer is None else getattr(context.mission.timers, spec.timer)
        limit_s = context.limit_s = own_s if context.carried_s is None else context.carried_s
        context.ends_s = None
        if limit_s is not None and spec.timer_from is From.ENTRY:
            context.ends_s = context.now_s + limit_s
        context.carried_s = context.retry_at_s = None
        if spec.requests is Requests.ANY:  # a way home that was flown before is called off
            context.ending = None
        context.actions.append(StateChanged(left, signal, target, context.robot))
        if not spec.keeps_target:
            context.robot = None
        handler.begin()

    def _flown_before(self, event: FlownBefore) -> None:
        self.context.airborne_s = event.airborne_s
        self.exploration.go_on(event.visited, event.left_out)

    def _let_go(self) -> None:
        """Hands are off, or the flight is over."""
        context = self.context
        done = context.state is State.DONE
        context.giving_up = context.compares = None
        if done:
            self.gate.stop()
        self._commands.now_what_waited()
        if not done:
            self.gate.let_go()
            return
        landed_by_us = self._left is State.LAND
        why = self._phase.ending(landed_by_us=landed_by_us)
        context.actions.append(Finish(landed_by_us, why, context.taken_by))
