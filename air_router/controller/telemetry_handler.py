"""Decides what to do after each telemetry update: the most severe finding first, the mission last.

Two tables, read from the top. `FINDINGS` lists the conditions that telemetry may show. Only the
first true one is handled. The last finding flies the mission: it runs `STEPS` in order until one
blocks the rest. docs/state-machine.md prints both tables.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

from air_router.controller.airspace_update import AirspaceUpdate
from air_router.controller.command_handler import CommandHandler
from air_router.controller.control_authority import ControlAuthority
from air_router.controller.deviations import Deviations
from air_router.controller.envelope import ReturnMonitor
from air_router.controller.lag_monitor import LagMonitor
from air_router.controller.model import (
    OFF_PLAN,
    Anomaly,
    ControlHolder,
    MissionContext,
    Progress,
    Signal,
    State,
)
from air_router.controller.motion import CommandGate, Navigator
from air_router.controller.safety_monitor import (
    FlightPhase,
    ForeignOrder,
    HomeWatch,
    Response,
    SafetyMonitor,
)
from air_router.controller.standstill import Standstill
from air_router.controller.states import Exploration, StateHandlers
from air_router.vehicle import (
    BE_READY_AT_HOME,
    CHARGE_BELIEVED_S,
    CLIMB_BY_HAND,
    FLY_OUT,
    IN_YOUR_HANDS,
    INPUTS_NOMINAL,
    WATCH_BATTERY,
    BatteryWatch,
    Telemetry,
)


class Situation(NamedTuple):
    """One telemetry update with what follows directly from it.

    Attributes:
        telemetry: With the filtered charge; see `BatteryWatch`.
        moved: Response to a change of home in this update; None: home did not change.
        ours: This program commands the vehicle, in flight or for take-off.
        flies: The vehicle is armed and in the air.
        order: A foreign command that the vehicle seems to follow; None: no sign of one.
    """

    telemetry: Telemetry
    moved: Response | None
    ours: bool
    flies: bool
    order: ForeignOrder | None


@dataclass(slots=True, eq=False)
class TelemetryHandler:
    """Handles every telemetry update of a flight.

    Args:
        context: State of the flight.
        gate: Sends motions, and keeps the last one sent.
        navigator: Plans and flies routes.
        exploration: Remembers which waypoints were near.
        states: The handler of each state.
        phase: Detects take-off, landing, and motors stopped in the air.
        home: Checks home's position and the altitude.
        monitor: Detects foreign commands, and breaches of zones and fences.
        returns: Decides when the vehicle comes home.
        lag: Detects that this program itself stalled.
        deviations: Responds to deviations from the plan.
        authority: Hands the vehicle over and releases it.
        airspace_update: Changes zones in flight.
        commands: Handles requests; some wait for a later state.
        standstill: Announces a vehicle that does not move as commanded.
        pilot_arms: Whether the pilot arms the vehicle; if it is then disarmed on the ground, the
            mission waits.
    """

    _context: MissionContext
    _gate: CommandGate
    _navigator: Navigator
    _exploration: Exploration
    _states: StateHandlers
    _phase: FlightPhase
    _home: HomeWatch
    _monitor: SafetyMonitor
    _returns: ReturnMonitor
    _lag: LagMonitor
    _deviations: Deviations
    _authority: ControlAuthority
    _airspace_update: AirspaceUpdate
    _commands: CommandHandler
    _standstill: Standstill
    _pilot_arms: bool
    _battery: BatteryWatch = field(default_factory=BatteryWatch)

    def store(self, telemetry: Telemetry) -> Telemetry:
        """Store telemetry with the filtered charge in the context, and return it.

        Called with all telemetry, also with what is received first after a silence.
        """
        telemetry = self._with_believed_charge(telemetry)
        self._context.received(telemetry)
        return telemetry

    def received(self, telemetry: Telemetry) -> None:
        """Handle the first of `FINDINGS` that is true for stored telemetry."""
        context = self._context
        self._phase.note(telemetry)
        self._lag.note(telemetry)
        self._home.note(telemetry)
        moved = self._home.update(telemetry) if telemetry.in_air else None
        flies = telemetry.in_air and telemetry.armed
        ours = context.in_charge
        order = self._monitor.foreign_order(telemetry) if ours else None
        self._suspect(order)
        situation = Situation(telemetry, moved, ours, flies, order)
        for finding in FINDINGS:
            found = finding.found(self, situation)
            if found is not None and found is not False:
                finding.then(self, situation, found)
                break
        self._standstill.update(telemetry, ours=flies and context.in_charge)

    def _with_believed_charge(self, telemetry: Telemetry) -> Telemetry:
        """The telemetry with the filtered charge; announces a jump."""
        battery, before = self._battery, self._battery.doubted
        charge = battery.take(telemetry)
        if charge == telemetry.battery:
            return telemetry
        if before is None and battery.doubted is not None and telemetry.in_air:
            self._context.warn(
                f"the charge jumped from {charge:.0%} to {battery.doubted:.0%}: it is accepted if "
                f"that lasts for {CHARGE_BELIEVED_S:.0f} s",
                WATCH_BATTERY,
            )
        return replace(telemetry, battery=charge)

    def _suspect(self, order: ForeignOrder | None) -> None:
        """Raise the interlock for a suspected foreign command; replan when it clears."""
        interlocks = self._context.interlocks
        interlocks.put(Anomaly.FOREIGN_ORDER, raised=order is not None)
        if order is None and interlocks.take_deferred():
            self._context.retry_in(0.0)

    # Conditions that a telemetry update may show.

    def over(self, situation: Situation) -> bool:
        """The vehicle is on the ground and disarmed, after it was armed."""
        ends = Signal.GROUNDED in self._context.task.spec.on
        return ends and not self._phase.flies and self._phase.over(situation.telemetry)

    def fallen(self, _: Situation) -> str | None:
        """Where the motors were stopped in the air, as text; None: they were not."""
        return None if self._phase.flies else self._phase.killed_now()

    def taken(self, situation: Situation) -> bool:
        """The vehicle flies in a mode that this program did not request, or PX4 is in a failsafe.

        On the ground PX4 itself changes the mode when it disarms. A failsafe may use the requested
        mode: a fence failsafe in Hold stays in Hold.
        """
        chosen = situation.telemetry.failsafe or situation.telemetry.mode not in self._gate.modes
        return situation.ours and situation.flies and chosen

    def sent_elsewhere(self, situation: Situation) -> str | None:
        """The confirmed foreign command, as text; None: there is none."""
        return (
            situation.order.words if situation.order is not None and situation.order.sure else None
        )

    def waits_for_hold(self, _: Situation) -> bool:
        """The vehicle is being released, or its plan is being compared."""
        authority = self._context.authority
        return authority.releasing is not None or authority.plan_check is not None

    def breach(self, situation: Situation) -> str | None:
        """The zone that the vehicle is in, or the fence that it is outside, as text; or None."""
        if not situation.ours:
            return None
        return self._monitor.breach(situation.telemetry, self._context.airspace.exempt_zones)

    def takes_off(self, _: Situation) -> bool:
        """The mission has not begun in the air yet."""
        return self._context.task.state is State.READY

    def is_not_ours(self, _: Situation) -> bool:
        """A pilot or a failsafe flies the vehicle."""
        return self._context.task.state is State.PASSIVE

    def is_ours(self, situation: Situation) -> bool:
        """The vehicle flies its mission."""
        return situation.ours

    # Responses.

    def end(self, _situation: Situation, _found: bool) -> None:
        """End the flight, or wait for the pilot to arm again."""
        if self._pilot_arms and self._context.task.state is State.READY and self._phase.again():
            self._states.ready.disarmed()
        else:
            self._context.signal(Signal.GROUNDED)

    def announce_fallen(self, _situation: Situation, where: str) -> None:
        """Announce the fall; no command can help."""
        self._authority.fallen(where)

    def give_away(self, situation: Situation, _found: bool) -> None:
        """Hands off: the pilot or a failsafe flies the vehicle."""
        self._authority.taken(situation.telemetry)

    def follow_order(self, _situation: Situation, order: str) -> None:
        """Hands off: a pilot or a ground station sent the vehicle elsewhere."""
        self._authority.take_over(ControlHolder.PILOT, order, IN_YOUR_HANDS)

    def wait_for_hold(self, situation: Situation, _found: bool) -> None:
        """Continue the release or the comparison."""
        self._authority.wait(situation.telemetry)

    def release(self, _situation: Situation, where: str) -> None:
        """Hold, then hands off."""
        self._authority.give_up(f"{where} is not resumed by itself", FLY_OUT)

    def watch_take_off(self, situation: Situation, _found: bool) -> None:
        """Observe the pilot's take-off, or control the climb."""
        context, telemetry = self._context, situation.telemetry
        if telemetry.in_air and not context.authority.handed_over:
            self._authority.observe(telemetry)
        elif telemetry.in_air:
            status = context.inputs.update(telemetry)
            if status is not INPUTS_NOMINAL:  # PX4 ends the climb above home without commands
                self._deviations.inputs_missing(status, telemetry)
        if context.task.state is State.READY:
            self._states.ready.watch(telemetry)
        climbs = (
            context.task.state is State.READY and context.authority.handed_over and telemetry.in_air
        )
        if climbs:
            self._returns.end_if_due(telemetry)
        if situation.moved is Response.HOLD and context.in_charge:
            context.come_home("home was moved in the climb", BE_READY_AT_HOME)

    def observe(self, situation: Situation, _found: bool) -> None:
        """Announce conditions that the pilot may not notice."""
        self._authority.observe(situation.telemetry)
        self._deviations.forget()

    def fly(self, situation: Situation, _found: bool) -> None:
        """Run the `STEPS` until one blocks the rest."""
        for step in STEPS:
            if step.waits(self, situation):
                self._gate.mission_waits()
                return

    # The steps: each returns whether it blocks those below it.

    def check_inputs(self, situation: Situation) -> bool:
        """Announce missing inputs and hold; battery and duration are still checked.

        The state's timer keeps running, unless zones are being changed.
        """
        status = self._context.inputs.update(situation.telemetry)
        return status is not INPUTS_NOMINAL and self._deviations.inputs_missing(
            status, situation.telemetry
        )

    def keep_to_plan(self, situation: Situation) -> bool:
        """Respond to deviations: altitude, clearance, speed, wind, home (table in `deviations`)."""
        context, climb = self._context, self._gate.climb.climb
        cruises = context.task.spec.cruises and context.airspace.change is None and climb is None
        if situation.moved is not None:
            self._deviations.home_moved(situation.moved, cruises=cruises)
        if not cruises:
            self._deviations.forget()
        elif not context.interlocks.is_raised(Anomaly.FOREIGN_ORDER):
            self._deviations.follow(situation.telemetry)
        if self._home.in_doubt and context.task.spec.cruises:
            self._airspace_update.altitude_doubted(situation.telemetry)
        return False

    def note_nearby(self, situation: Situation) -> bool:
        """Remember which waypoints are near."""
        exploration, here = self._exploration, situation.telemetry.position
        exploration.is_at(here)
        search, altitude_m = self._states.search.search, situation.telemetry.altitude_m
        search.links.update(here, altitude_m, search.targets, self._context.now_s)
        if math.dist(here, exploration.checked_from) >= exploration.recheck_m:
            exploration.note_nearby(here, self._context.now_s)
        return False

    def come_home_in_time(self, situation: Situation) -> bool:
        """Check the battery, the mission's duration and the way home."""
        self._returns.check(situation.telemetry)
        return False

    def wait_for_interlocks(self, situation: Situation) -> bool:
        """Continue a zone update or a climb; wait for all other interlocks."""
        context, climb = self._context, self._gate.climb
        if context.interlocks.is_raised(Anomaly.FOREIGN_ORDER):
            return True  # a hold might override a pilot's command that is not confirmed yet
        if context.airspace.change is not None:
            self._airspace_update.continue_change(situation.telemetry)
            return True
        if climb.climb is not None and climb.continues(situation.telemetry, self._gate.last):
            if climb.climb is None:
                self._navigator.follow(context.task.handler.replan())
            elif climb.stuck(situation.telemetry):
                self._authority.give_up(
                    "the climb to the mission's altitude has stopped", CLIMB_BY_HAND
                )
            return True
        return context.interlocks.is_raised(*OFF_PLAN)

    def end_the_state_in_time(self, _: Situation) -> bool:
        """End the state when its timer expires; carry out deferred requests."""
        self._gate.mission_goes_on()
        ends_s = self._context.task.ends_s
        over = ends_s is not None and self._context.now_s >= ends_s
        if over or self._commands.deferred is not None:
            if self._context.left_s == 0.0:
                self._context.signal(Signal.TIMER)
            self._commands.handle_deferred()
        return False

    def fly_on(self, situation: Situation) -> bool:
        """Send the next leg when it is due."""
        motion = self._navigator.update(situation.telemetry)
        if motion is not None or self._context.task.way.progress is not Progress.FLYING:
            self._navigator.advance(motion)
        return False

    def try_again(self, _: Situation) -> bool:
        """Retry what failed before."""
        task = self._context.task
        if task.retry_at_s is not None and not self._gate.pending and self._context.take_retry():
            self._navigator.follow(task.handler.retry())
        return False


@dataclass(frozen=True, slots=True)
class Finding:
    """A condition that a telemetry update may show.

    Attributes:
        name: Its name in docs/state-machine.md.
        shows: The condition, as text.
        found: Evaluates the condition; None or False: it is not true.
        then: Responds to it.
        does: The response, as text.
        why: Why it comes after the rows above and before those below.
    """

    name: str
    shows: str
    found: Callable[[TelemetryHandler, Situation], Any]
    then: Callable[[TelemetryHandler, Situation, Any], None]
    does: str
    why: str


FINDINGS: Final = (
    Finding(
        "OVER",
        "it is on the ground and disarmed, after it was armed",
        TelemetryHandler.over,
        TelemetryHandler.end,
        "the flight is over; before take-off a pilot may arm again, and the mission waits for that",
        "no command has an effect anymore",
    ),
    Finding(
        "FALLEN",
        "its motors were stopped in the air",
        TelemetryHandler.fallen,
        TelemetryHandler.announce_fallen,
        "an alarm; nothing is commanded",
        "no command of the pilot or the companion can help",
    ),
    Finding(
        "TAKEN",
        "it flies in a mode that we did not request, or PX4 is in a failsafe",
        TelemetryHandler.taken,
        TelemetryHandler.give_away,
        "hands off at once",
        "the pilot's choice overrides everything that we are about to do",
    ),
    Finding(
        "SENT_ELSEWHERE",
        "for 1.5 s it has followed a plan item, or a target in Hold, that another station set",
        TelemetryHandler.sent_elsewhere,
        TelemetryHandler.follow_order,
        "hands off at once",
        "this also reveals a pilot, but takes 1.5 s to confirm; the mode above does so at once",
    ),
    Finding(
        "WAITS_FOR_HOLD",
        "it is being released, or the plan on board is being compared",
        TelemetryHandler.waits_for_hold,
        TelemetryHandler.wait_for_hold,
        "hold is sent until PX4 reports it; then it is released, or the mission is replanned",
        "the mission has ended or is in doubt; a breach would only release the vehicle, too",
    ),
    Finding(
        "BREACH",
        "it is in a no-fly zone (except one just drawn over it), or outside a fence",
        TelemetryHandler.breach,
        TelemetryHandler.release,
        "it holds, and is released with an alarm",
        "no leg may start there",
    ),
    Finding(
        "TAKES_OFF",
        "the mission has not begun in the air",
        TelemetryHandler.takes_off,
        TelemetryHandler.watch_take_off,
        "the climb is monitored, and continued to the mission's altitude",
        "the rows below apply only to a mission in flight",
    ),
    Finding(
        "NOT_OURS",
        "a pilot or a failsafe flies it",
        TelemetryHandler.is_not_ours,
        TelemetryHandler.observe,
        "missing inputs are announced, and breaches if the position is known",
        "the mission is flown only while we command the vehicle",
    ),
    Finding(
        "OURS",
        "it flies its mission",
        TelemetryHandler.is_ours,
        TelemetryHandler.fly,
        "the steps below are run",
        "nothing more severe is true",
    ),
)
"""Only the first true finding is handled."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step of handling telemetry while the mission flies.

    Attributes:
        name: Its name in docs/state-machine.md.
        waits: Runs the step; returns whether it blocks the steps below.
        when: When it blocks them, as text; empty: never.
        why: Why it comes after the steps above and before those below.
    """

    name: str
    waits: Callable[[TelemetryHandler, Situation], bool]
    when: str
    why: str


STEPS: Final = (
    Step(
        "INPUTS",
        TelemetryHandler.check_inputs,
        "too few inputs are received to fly on",
        "every step below depends on the inputs",
    ),
    Step(
        "PLAN_KEPT",
        TelemetryHandler.keep_to_plan,
        "",
        "it raises interlocks; by now the position is known",
    ),
    Step(
        "WAYPOINTS_NEAR",
        TelemetryHandler.note_nearby,
        "",
        "it only collects data for searches",
    ),
    Step(
        "HOME_IN_TIME",
        TelemetryHandler.come_home_in_time,
        "",
        "battery and duration count also while the mission waits",
    ),
    Step(
        "INTERLOCKS",
        TelemetryHandler.wait_for_interlocks,
        "an interlock is raised, or the vehicle climbs first",
        "no leg starts and no state times out; requests and the return are still handled",
    ),
    Step(
        "STATE_TIMER",
        TelemetryHandler.end_the_state_in_time,
        "",
        "a state whose timer has expired starts no further leg",
    ),
    Step("NEXT_LEG", TelemetryHandler.fly_on, "", "a new state has already sent its first leg"),
    Step(
        "TRY_AGAIN",
        TelemetryHandler.try_again,
        "",
        "no retry while a command from the steps above is pending",
    ),
)
"""Run in this order, until one blocks the rest."""
