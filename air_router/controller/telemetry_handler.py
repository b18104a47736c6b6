"""What each telemetry message leads to, and in which order: take-off, hands off, flying on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.command_handler import CommandHandler
from air_router.controller.control_authority import ControlAuthority, InitialClimb
from air_router.controller.model.actions import ControlHolder, FlyToNode, HoldHere, Motion
from air_router.controller.model.events import CommandConfirmed
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.states import Signal, State
from air_router.controller.monitor.deviations import Deviation, Deviations, Response
from air_router.controller.monitor.flight_phase import (
    HELD,
    FlightPhase,
    Reminder,
    SilenceReminder,
    TakeOff,
    take_off,
)
from air_router.controller.monitor.safety_monitor import EventKind, SafetyMonitor
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import Progress
from air_router.controller.states.return_state import ReturnState
from air_router.controller.targets.exploration import Exploration
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.input_limits import InputWatch, Stop
from air_router.vehicle.vehicle import FlightMode, ItemReached, LinkSilent, Telemetry

HOLD_S: Final = 2.0
"""A vehicle that holds for a deviation stands after so long, and goes on."""

LATE_S: Final = 2.5
"""A failsafe may show so long after the mode that it chose: HEARTBEAT comes once a second."""


@dataclass(slots=True, eq=False)
class TelemetryHandler:
    """Asks the other parts in turn, the gravest matter first.

    Args:
        context: Where telemetry is kept.
        gate: Flies on.
        plan: The plan on board, for the autopilot's item numbers.
        exploration: Told where the vehicle passes.
        flight_phase: What has been seen of take-off and landing.
        monitor: What is found wrong in flight.
        deviations: What is off what was planned.
        inputs: Which inputs are missing.
        authority: Whose the vehicle is.
        return_state: Whether the mission ends.
        airspace_update: Whether zones are being changed.
        initial_climb: Whether it climbs before its first leg.
        command_handler: Whether a request waits for its time.
        pilot_arms: The pilot arms: if it is disarmed again on the ground, wait on.
    """

    _context: MissionContext
    _gate: CommandGate
    _plan: FlightPlan
    _exploration: Exploration
    _flight_phase: FlightPhase
    _monitor: SafetyMonitor
    _deviations: Deviations
    _inputs: InputWatch
    _authority: ControlAuthority
    _return_state: ReturnState
    _airspace_update: AirspaceUpdate
    _initial_climb: InitialClimb
    _command_handler: CommandHandler
    _pilot_arms: bool
    _silence: SilenceReminder = field(default_factory=SilenceReminder)
    _breaches: Reminder = field(default_factory=Reminder)  # while another flies
    _chosen: tuple[FlightMode, float] | None = None  # the mode it was taken by, and when
    _put_off: bool = False  # a motion, while it is not certain who has the vehicle

    def wait_for_inputs(self, motion: Motion) -> Motion | None:
        """An interlock: where it is, how high, or whose, is not known: it is sent nowhere."""
        missing = self._inputs.why_no_leg(self._context.telemetry) is not None
        self._put_off = self._put_off or self._monitor.doubts
        return None if missing or self._deviations.waits or self._monitor.doubts else motion

    def vehicle_heard(self, telemetry: Telemetry) -> None:  # noqa: C901 - the order of what counts
        """The vehicle says how it is."""
        context, authority, phase = self._context, self._authority, self._flight_phase
        context.telemetry = telemetry
        context.silent_s = self._silence.told_s = 0.0
        if phase.note(telemetry):
            self._gate.commanded_mode.assume(FlightMode.MISSION)
        moved = self._deviations.home(telemetry) if telemetry.in_air else None
        if moved is not None:
            context.say(moved.words)
        if not phase.flies and phase.over(telemetry) and context.knows(Signal.GROUNDED):
            self._grounded()
        elif not phase.flies and (killed := phase.killed_now()) is not None:
            authority.fallen(killed)
        elif (ours := authority.in_charge) and self._gate.commanded_mode.taken(telemetry):
            who = ControlHolder.FAILSAFE if telemetry.failsafe else ControlHolder.PILOT
            self._chosen = (telemetry.mode, context.now_s)
            authority.take_over(who, f"{who.value} chose {telemetry.mode.value} mode")
        elif authority.giving_up is not None or authority.compares is not None:
            authority.check()
        elif context.state is State.READY:
            self._take_off(telemetry)
            if moved is not None and moved.response is Response.HOLD and authority.in_charge:
                self._return_state.come_home("home was moved in the climb")
        elif context.state is State.PASSIVE:
            self._look_on(telemetry)
        elif ours and self._fit(telemetry):
            self._go_on(telemetry, moved)

    def _grounded(self) -> None:
        if self._pilot_arms and self._context.state is State.READY and self._flight_phase.again():
            self._context.say("disarmed before take-off: waiting on")
        else:
            self._context.signal(Signal.GROUNDED)

    def _take_off(self, telemetry: Telemetry) -> None:
        context, commanded_mode = self._context, self._gate.commanded_mode
        if self._flight_phase.handed_over and telemetry.in_air:
            self._hear(telemetry)  # the climb ends above home by itself
            if context.state is not State.READY:
                return
        stage = take_off(context.mission, telemetry)
        if stage is TakeOff.COMPLETE:
            commanded_mode.assume(FlightMode.MISSION)
            self._flight_phase.resumed(context.now_s)
            context.signal(Signal.AIRBORNE)
        elif stage in HELD and commanded_mode.pending is None:
            context.say(f"holding: {HELD[stage]}")
            self._gate.command(HoldHere(stage.value))
        elif self._flight_phase.stuck(telemetry) and commanded_mode.pending is None:
            self._return_state.come_home("the climb does not go on")

    def _fit(self, telemetry: Telemetry) -> bool:
        """Whether the mission may go on: no breach, no other's orders, and all inputs."""
        gate = self._gate
        found = self._monitor.look(telemetry, gate.commanded_mode, self._airspace_update.leaving)
        match found.kind:
            case EventKind.FOREIGN_ORDER:
                self._authority.take_over(ControlHolder.PILOT, found.words)
            case EventKind.BREACH:
                self._authority.give_up(f"{found.words} is not resumed by itself")
        if self._put_off and not self._monitor.doubts:
            self._put_off = False
            self._context.retry_in(0.0)
        return found.kind is EventKind.GOOD and self._hear(telemetry)

    def _hear(self, telemetry: Telemetry) -> bool:
        """Whether enough of the vehicle is heard to fly on by; what is missing is told."""
        context, gate = self._context, self._gate
        status = self._inputs.look(telemetry)
        landing = context.state is State.LAND  # PX4 does so without a position too
        for what, then in status.news:
            context.say(f"{what}: {'landing on' if landing else then}" if then else what)
        if status.home_why is not None:
            self._return_state.come_home(status.home_why)
        if context.state is State.READY:
            return True
        if status.stop is Stop.NONE:
            if status.back:
                context.retry_in(0.0)
            return True
        if status.stop is Stop.HOLD and not landing and self._may_retry():
            gate.hold(status.why)  # unless that is what it does
        self._return_state.check(telemetry)  # time and charge go on
        if context.left_s == 0.0 and self._airspace_update.phase is None:
            context.signal(Signal.TIMER)
        return False

    def _look_on(self, telemetry: Telemetry) -> None:
        """Another flies: tell what a pilot may not see, and who took it if that shows late."""
        context, authority = self._context, self._authority
        mode, taken_s = self._chosen or (telemetry.mode, -math.inf)
        late = telemetry.mode is mode and context.now_s - taken_s <= LATE_S
        if telemetry.failsafe and late and authority.taken_by is ControlHolder.PILOT:
            authority.taken_by = ControlHolder.FAILSAFE
            context.say(f"it was {ControlHolder.FAILSAFE.value} that chose {mode.value} mode")
        for what, _ in self._inputs.look(telemetry).news:
            context.say(what)
        news = self._breaches.news(self._monitor.breach(telemetry), context.now_s)
        if news is not None:
            context.say(news)

    def _keep(self, telemetry: Telemetry, moved: Deviation | None) -> None:
        """Have it keep to what was planned; see `deviations`."""
        if moved is not None:
            self._respond(*moved, said=True)
        for deviation in self._deviations.look(telemetry, self._gate.commanded_mode):
            self._respond(*deviation)

    def _respond(self, response: Response, words: str, *, said: bool = False) -> None:
        context = self._context
        if response is Response.HOME and context.knows(Signal.COME_HOME):
            self._return_state.come_home(words)
            return
        holds = response in {Response.HOLD, Response.WAIT, Response.HOME}
        if not said:
            context.say(f"{words}: holding" if holds else words)
        if holds:
            self._gate.hold(words)
        if response is not Response.TELL:
            context.retry_in(0.0 if response is Response.BACK else HOLD_S)

    def _may_retry(self) -> bool:
        """Whether nothing waits to be tried again, or its time has come."""
        return self._context.take_retry() or self._context.retry_at_s is None

    def _go_on(self, telemetry: Telemetry, moved: Deviation | None) -> None:
        """Back to what was planned; home if it is time; zones that change; the state's handler."""
        context, gate, navigator = self._context, self._gate, self._gate.navigator
        update, initial_climb = self._airspace_update, self._initial_climb
        if context.spec.cruises and update.phase is None and initial_climb.climb is None:
            self._keep(telemetry, moved)
        else:
            self._deviations.forget()
        self._exploration.passing(telemetry.position, context.now_s)
        self._return_state.check(telemetry)
        if update.phase is not None:
            update.go_on(telemetry)
            return
        if initial_climb.climb is not None and initial_climb.go_on(telemetry):
            if initial_climb.stuck:
                self._authority.give_up("the climb to the mission's altitude does not go on")
            return
        if self._deviations.waits:
            return
        if context.left_s == 0.0:
            context.signal(Signal.TIMER)
        if self._command_handler.later is not None:
            self._command_handler.now_what_waited()
        motion = navigator.update(telemetry)
        if motion is not None or navigator.progress is not Progress.FLYING:
            gate.advance(motion)
        waits = context.retry_at_s is not None and not gate.commanded_mode.pending
        if waits and context.take_retry():
            context.handler.retry()

    def item_reached(self, event: ItemReached) -> None:
        """The vehicle says that it is at a plan item: perhaps at the end of its leg."""
        telemetry, gate = self._context.telemetry, self._gate
        if (
            telemetry is None
            or not self._authority.in_charge
            or self._airspace_update.phase is not None
        ):
            return
        if isinstance(gate.commanded_mode.pending, FlyToNode):
            return  # the report may be of the node before; the vehicle has not confirmed the jump
        node = self._plan.node_of(event.item)
        gate.advance(gate.navigator.update(telemetry, reached_node=node))

    def nothing_heard(self, event: LinkSilent) -> None:
        """The vehicle says nothing."""
        self._context.silent_s = event.silent_s
        news = self._silence.news(event.silent_s)
        if news is not None:
            self._context.say(news)

    def confirmed(self, event: CommandConfirmed) -> None:
        """It follows; if that was the hold before hands are off, it is let go."""
        self._gate.confirmed(event.action)
        self._authority.check()
