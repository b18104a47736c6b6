"""What follows from a telemetry update: the most severe finding first, and only then the mission.

Two tables, read from the top. `FINDINGS` has what a telemetry update may show: the first found is
followed, and nothing below it. Its last row flies the mission, in `STEPS`: each is taken, in this
order, until one reports that the rest waits. docs/state-machine.md prints both.
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
    """One telemetry, and what shows at once.

    Attributes:
        telemetry: With the charge that is believed.
        moved: What follows home having been moved just now; None: it was not.
        ours: The vehicle flies, or is to take off, by our commands.
        flies: It is in the air with its motors armed.
        order: One that it seems to follow, and that is not ours; None: none shows.
    """

    telemetry: Telemetry
    moved: Response | None
    ours: bool
    flies: bool
    order: ForeignOrder | None


@dataclass(slots=True, eq=False)
class TelemetryHandler:
    """Takes every telemetry update of a flight in.

    Args:
        context: What is known of the flight.
        gate: What was commanded to the vehicle.
        navigator: Flies legs.
        exploration: Which waypoints are near.
        states: What is flown in each state.
        phase: Whether it has taken off, landed, or fallen.
        home: Where home is, and whether the altitude is in doubt.
        monitor: Orders of others, and breaches.
        returns: When the mission ends.
        lag: Whether this program itself stood still.
        deviations: What follows from what is off.
        authority: Gives the vehicle away.
        airspace_update: Zones that change.
        commands: What waits for its time.
        standstill: Watches over all of it.
        pilot_arms: The pilot arms: if the vehicle is disarmed again on the ground, it waits on.
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

    def received(self, telemetry: Telemetry) -> None:
        """Follow the first of `FINDINGS` that it shows."""
        context = self._context
        telemetry = self._with_believed_charge(telemetry)
        context.received(telemetry)
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
        """The same, with the charge that is believed; one that jumps is announced."""
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
        """Wait while an order only seems to show, and plan anew what that kept back."""
        interlocks = self._context.interlocks
        interlocks.put(Anomaly.FOREIGN_ORDER, raised=order is not None)
        if order is None and interlocks.take_deferred():
            self._context.retry_in(0.0)

    # What a telemetry update may show.

    def over(self, situation: Situation) -> bool:
        """It is on the ground, disarmed, after having been armed."""
        ends = Signal.GROUNDED in self._context.task.spec.on
        return ends and not self._phase.flies and self._phase.over(situation.telemetry)

    def fallen(self, _: Situation) -> str | None:
        """Its motors were stopped in the air; where, as text."""
        return None if self._phase.flies else self._phase.killed_now()

    def taken(self, situation: Situation) -> bool:
        """It flies in a mode that we did not request, or by a failsafe.

        On the ground the autopilot changes its mode by itself, when it disarms. A failsafe may act
        in the very mode that we requested: a fence holds a vehicle that hovers in Hold.
        """
        chosen = situation.telemetry.failsafe or situation.telemetry.mode not in self._gate.modes
        return situation.ours and situation.flies and chosen

    def sent_elsewhere(self, situation: Situation) -> str | None:
        """It surely follows an order that is not ours; which, as text."""
        return (
            situation.order.words if situation.order is not None and situation.order.sure else None
        )

    def waits_for_hold(self, _: Situation) -> bool:
        """It is being released, or the plan on board is being compared."""
        authority = self._context.authority
        return authority.releasing is not None or authority.plan_check is not None

    def breach(self, situation: Situation) -> str | None:
        """It is in a zone, or outside of a fence; as text."""
        if not situation.ours:
            return None
        return self._monitor.breach(situation.telemetry, self._context.airspace.exempt_zones)

    def takes_off(self, _: Situation) -> bool:
        """The mission has not begun in the air."""
        return self._context.task.state is State.READY

    def is_not_ours(self, _: Situation) -> bool:
        """A pilot or a failsafe has it."""
        return self._context.task.state is State.PASSIVE

    def is_ours(self, situation: Situation) -> bool:
        """It flies its mission."""
        return situation.ours

    # What follows.

    def end(self, _situation: Situation, _found: bool) -> None:
        """The flight is over, or everything begins anew."""
        if self._pilot_arms and self._context.task.state is State.READY and self._phase.again():
            self._states.ready.disarmed()
        else:
            self._context.signal(Signal.GROUNDED)

    def announce_fallen(self, _situation: Situation, where: str) -> None:
        """Nothing can be done for it."""
        self._authority.fallen(where)

    def give_away(self, situation: Situation, _found: bool) -> None:
        """Hands off: the pilot or a failsafe flies it."""
        self._authority.taken(situation.telemetry)

    def follow_order(self, _situation: Situation, order: str) -> None:
        """Hands off: a pilot or a ground station sends it elsewhere."""
        self._authority.take_over(ControlHolder.PILOT, order, IN_YOUR_HANDS)

    def wait_for_hold(self, situation: Situation, _found: bool) -> None:
        """On with releasing it, or with the comparison."""
        self._authority.wait(situation.telemetry)

    def release(self, _situation: Situation, where: str) -> None:
        """It holds, and hands are off."""
        self._authority.give_up(f"{where} is not resumed by itself", FLY_OUT)

    def watch_take_off(self, situation: Situation, _found: bool) -> None:
        """Observe as a pilot takes off, or lead the climb."""
        context, telemetry = self._context, situation.telemetry
        if telemetry.in_air and not context.authority.handed_over:
            self._authority.observe(telemetry)
        elif telemetry.in_air:
            status = context.inputs.update(telemetry)
            if status is not INPUTS_NOMINAL:  # the climb ends above home by itself
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
        """Announce what the pilot may not see."""
        self._authority.observe(situation.telemetry)
        self._deviations.forget()

    def fly(self, situation: Situation, _found: bool) -> None:
        """Take the `STEPS`, until one reports that the rest waits."""
        for step in STEPS:
            if step.waits(self, situation):
                self._gate.mission_waits()
                return

    # The steps: each returns whether those below it wait.

    def check_inputs(self, situation: Situation) -> bool:
        """Missing inputs are announced, and the vehicle holds; battery and time run on.

        So does the state's timer, unless zones are being changed.
        """
        status = self._context.inputs.update(situation.telemetry)
        return status is not INPUTS_NOMINAL and self._deviations.inputs_missing(
            status, situation.telemetry
        )

    def keep_to_plan(self, situation: Situation) -> bool:
        """Deviations of altitude, clearance, speed, wind, home: the table in `deviations`."""
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
        """Waypoints nearby are noted as passed."""
        exploration, here = self._exploration, situation.telemetry.position
        exploration.is_at(here)
        if math.dist(here, exploration.checked_from) >= exploration.recheck_m:
            exploration.note_nearby(here, self._context.now_s)
        return False

    def come_home_in_time(self, situation: Situation) -> bool:
        """The battery, the mission's duration and the way home."""
        self._returns.check(situation.telemetry)
        return False

    def wait_for_interlocks(self, situation: Situation) -> bool:
        """Zone updates and climbs proceed; other interlocks wait."""
        context, climb = self._context, self._gate.climb
        if context.interlocks.is_raised(Anomaly.FOREIGN_ORDER):
            return True  # a hold would end the order of a pilot before it is known as such
        if context.airspace.change is not None:
            self._airspace_update.go_on(situation.telemetry)
            return True
        if climb.climb is not None and climb.go_on(situation.telemetry, self._gate.last):
            if climb.climb is None:
                self._navigator.follow(context.task.handler.replan())
            elif climb.stuck(situation.telemetry):
                self._authority.give_up(
                    "the climb to the mission's altitude does not go on", CLIMB_BY_HAND
                )
            return True
        return context.interlocks.is_raised(*OFF_PLAN)

    def end_the_state_in_time(self, _: Situation) -> bool:
        """State timeouts, and requested points that wait for another state."""
        self._gate.mission_goes_on()
        ends_s = self._context.task.ends_s
        over = ends_s is not None and self._context.now_s >= ends_s
        if over or self._commands.later is not None:
            if self._context.left_s == 0.0:
                self._context.signal(Signal.TIMER)
            self._commands.now_what_waited()
        return False

    def fly_on(self, situation: Situation) -> bool:
        """The next leg, if it is due."""
        motion = self._navigator.update(situation.telemetry)
        if motion is not None or self._context.task.way.progress is not Progress.FLYING:
            self._navigator.advance(motion)
        return False

    def try_again(self, _: Situation) -> bool:
        """Motions that failed before are retried."""
        task = self._context.task
        if task.retry_at_s is not None and not self._gate.pending and self._context.take_retry():
            self._navigator.follow(task.handler.retry())
        return False


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that a telemetry update may show.

    Attributes:
        name: By which docs/state-machine.md knows it.
        shows: What it is, as text.
        found: Whether it shows, or what; None or False: it does not.
        then: Follows it.
        does: What that is, as text.
        why: Why it comes after the rows above it and before those below.
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
        "it is on the ground and disarmed after it was armed",
        TelemetryHandler.over,
        TelemetryHandler.end,
        "the flight is over; if it has not flown, the program waits for the pilot to arm again",
        "nothing can be commanded any more",
    ),
    Finding(
        "FALLEN",
        "its motors were stopped in the air",
        TelemetryHandler.fallen,
        TelemetryHandler.announce_fallen,
        "an alarm; nothing is commanded",
        "whoever controls it, no command can help",
    ),
    Finding(
        "TAKEN",
        "it flies in a mode that was not commanded, or a failsafe acts",
        TelemetryHandler.taken,
        TelemetryHandler.give_away,
        "hands off at once",
        "the pilot has priority over every motion below",
    ),
    Finding(
        "SENT_ELSEWHERE",
        "for 1.5 s its plan item, or in Hold its target, has been foreign",
        TelemetryHandler.sent_elsewhere,
        TelemetryHandler.follow_order,
        "hands off at once",
        "this also shows a pilot, but only after 1.5 s; the mode shows one at once",
    ),
    Finding(
        "WAITS_FOR_HOLD",
        "it is being released, or the plan on board is being compared",
        TelemetryHandler.waits_for_hold,
        TelemetryHandler.wait_for_hold,
        "the hold is repeated until it is confirmed; then release, or the mission continues",
        "a breach would only release it, too",
    ),
    Finding(
        "BREACH",
        "it is in a no-fly zone (not one just drawn over it), or outside a fence",
        TelemetryHandler.breach,
        TelemetryHandler.release,
        "hold, then release, with an alarm",
        "no leg may begin there",
    ),
    Finding(
        "TAKES_OFF",
        "the mission has not begun in the air",
        TelemetryHandler.takes_off,
        TelemetryHandler.watch_take_off,
        "the climb is monitored, and continued to the mission's altitude",
        "the rows below apply to a flying mission",
    ),
    Finding(
        "NOT_OURS",
        "a pilot or a failsafe controls it",
        TelemetryHandler.is_not_ours,
        TelemetryHandler.observe,
        "missing inputs are announced, and breaches if its position is known",
        "only the companion flies the mission",
    ),
    Finding(
        "OURS",
        "it flies its mission",
        TelemetryHandler.is_ours,
        TelemetryHandler.fly,
        "the steps below",
        "nothing more severe applies",
    ),
)
"""The first that is found is followed, and nothing below it."""


@dataclass(frozen=True, slots=True)
class Step:
    """One of the things that are done with each telemetry of a mission that flies.

    Attributes:
        name: By which docs/state-machine.md knows it.
        waits: Does it; whether the steps below wait.
        when: When they do, as text; empty: never.
        why: Why it comes after the steps above it and before those below.
    """

    name: str
    waits: Callable[[TelemetryHandler, Situation], bool]
    when: str
    why: str


STEPS: Final = (
    Step(
        "INPUTS",
        TelemetryHandler.check_inputs,
        "an input that legs need is missing",
        "all steps below need them",
    ),
    Step(
        "PLAN_KEPT",
        TelemetryHandler.keep_to_plan,
        "",
        "it raises interlocks, and needs a position",
    ),
    Step(
        "WAYPOINTS_NEAR",
        TelemetryHandler.note_nearby,
        "",
        "searches use it",
    ),
    Step(
        "HOME_IN_TIME",
        TelemetryHandler.come_home_in_time,
        "",
        "battery and time run while the mission waits below",
    ),
    Step(
        "INTERLOCKS",
        TelemetryHandler.wait_for_interlocks,
        "an interlock is active, or the vehicle climbs first",
        "meanwhile no leg begins and no state times out; requests and coming home still work",
    ),
    Step(
        "STATE_TIMER",
        TelemetryHandler.end_the_state_in_time,
        "",
        "an expired state begins no other leg",
    ),
    Step("NEXT_LEG", TelemetryHandler.fly_on, "", "a new state has already commanded its leg"),
    Step(
        "TRY_AGAIN",
        TelemetryHandler.try_again,
        "",
        "no retry while a command from the steps above is pending",
    ),
)
"""Taken in this order, until one reports that the rest waits."""
