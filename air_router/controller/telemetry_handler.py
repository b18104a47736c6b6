"""What follows from a telemetry: the gravest matter first, and only then the mission.

Two tables, read from the top. `MATTERS` has what a telemetry may show: the first that is found is
followed, and nothing below it. Its last row flies the mission, in `STEPS`: each is taken, in this
order, until one says that the rest waits. docs/state-machine.md prints both.
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
    ControlHolder,
    Doubt,
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
    CALM,
    CHARGE_BELIEVED_S,
    CLIMB_BY_HAND,
    FLY_OUT,
    IN_YOUR_HANDS,
    WATCH_BATTERY,
    BatteryWatch,
    Telemetry,
)


class Seen(NamedTuple):
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
    """Takes every telemetry of a flight in.

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
        """Follow the first of `MATTERS` that it shows."""
        context = self._context
        telemetry = self._with_believed_charge(telemetry)
        context.received(telemetry)
        self._phase.note(telemetry)
        self._lag.note(telemetry)
        self._home.note(telemetry)
        moved = self._home.look(telemetry) if telemetry.in_air else None
        flies = telemetry.in_air and telemetry.armed
        ours = context.in_charge
        order = self._monitor.foreign_order(telemetry) if ours else None
        self._suspect(order)
        seen = Seen(telemetry, moved, ours, flies, order)
        for matter in MATTERS:
            found = matter.found(self, seen)
            if found is not None and found is not False:
                matter.then(self, seen, found)
                break
        self._standstill.look(telemetry, ours=flies and context.in_charge)

    def _with_believed_charge(self, telemetry: Telemetry) -> Telemetry:
        """The same, with the charge that is believed; one that jumps is told."""
        battery, before = self._battery, self._battery.doubted
        charge = battery.take(telemetry)
        if charge == telemetry.battery:
            return telemetry
        if before is None and battery.doubted is not None and telemetry.in_air:
            self._context.warn(
                f"the charge jumped from {charge:.0%} to {battery.doubted:.0%}: it is believed if "
                f"that lasts for {CHARGE_BELIEVED_S:.0f} s",
                WATCH_BATTERY,
            )
        return replace(telemetry, battery=charge)

    def _suspect(self, order: ForeignOrder | None) -> None:
        """Wait while an order only seems to show, and plan anew what that kept back."""
        interlocks = self._context.interlocks
        interlocks.put(Doubt.FOREIGN_ORDER, raised=order is not None)
        if order is None and interlocks.take_deferred():
            self._context.retry_in(0.0)

    # What a telemetry may show.

    def over(self, seen: Seen) -> bool:
        """It is on the ground, disarmed, after having been armed."""
        ends = Signal.GROUNDED in self._context.task.spec.on
        return ends and not self._phase.flies and self._phase.over(seen.telemetry)

    def fallen(self, _: Seen) -> str | None:
        """Its motors were stopped in the air; where, in words."""
        return None if self._phase.flies else self._phase.killed_now()

    def taken(self, seen: Seen) -> bool:
        """It flies in a mode that we did not ask for, or by a failsafe.

        On the ground the autopilot changes its mode by itself, when it disarms. A failsafe may act
        in the very mode that we asked for: a fence holds a vehicle that hovers in Hold.
        """
        chosen = seen.telemetry.failsafe or seen.telemetry.mode not in self._gate.modes
        return seen.ours and seen.flies and chosen

    def sent_elsewhere(self, seen: Seen) -> str | None:
        """It surely follows an order that is not ours; which, in words."""
        return seen.order.words if seen.order is not None and seen.order.sure else None

    def waits_for_hold(self, _: Seen) -> bool:
        """It is being released, or the plan on board is being compared."""
        authority = self._context.authority
        return authority.releasing is not None or authority.plan_check is not None

    def breach(self, seen: Seen) -> str | None:
        """It is in a zone, or outside of a fence; in words."""
        if not seen.ours:
            return None
        return self._monitor.breach(seen.telemetry, self._context.airspace.exempt_zones)

    def takes_off(self, _: Seen) -> bool:
        """The mission has not begun in the air."""
        return self._context.task.state is State.READY

    def is_not_ours(self, _: Seen) -> bool:
        """A pilot or a failsafe has it."""
        return self._context.task.state is State.PASSIVE

    def is_ours(self, seen: Seen) -> bool:
        """It flies its mission."""
        return seen.ours

    # What follows.

    def end(self, _seen: Seen, _found: bool) -> None:
        """The flight is over, or everything begins anew."""
        if self._pilot_arms and self._context.task.state is State.READY and self._phase.again():
            self._states.ready.disarmed()
        else:
            self._context.signal(Signal.GROUNDED)

    def say_fallen(self, _seen: Seen, where: str) -> None:
        """Nothing can be done for it."""
        self._authority.fallen(where)

    def give_away(self, seen: Seen, _found: bool) -> None:
        """Hands off: the pilot or a failsafe flies it."""
        self._authority.taken(seen.telemetry)

    def follow_order(self, _seen: Seen, order: str) -> None:
        """Hands off: a pilot or a ground station sends it elsewhere."""
        self._authority.take_over(ControlHolder.PILOT, order, IN_YOUR_HANDS)

    def wait_for_hold(self, seen: Seen, _found: bool) -> None:
        """On with releasing it, or with the comparison."""
        self._authority.wait(seen.telemetry)

    def release(self, _seen: Seen, where: str) -> None:
        """It holds, and hands are off."""
        self._authority.give_up(f"{where} is not resumed by itself", FLY_OUT)

    def watch_take_off(self, seen: Seen, _found: bool) -> None:
        """Look on as a pilot takes off, or lead the climb."""
        context, telemetry = self._context, seen.telemetry
        if telemetry.in_air and not context.authority.handed_over:
            self._authority.look_on(telemetry)
        elif telemetry.in_air:
            status = context.inputs.look(telemetry)
            if status is not CALM:  # the climb ends above home by itself
                self._deviations.inputs_missing(status, telemetry)
        if context.task.state is State.READY:
            self._states.ready.watch(telemetry)
        climbs = (
            context.task.state is State.READY and context.authority.handed_over and telemetry.in_air
        )
        if climbs:
            self._returns.end_if_due(telemetry)
        if seen.moved is Response.HOLD and context.in_charge:
            context.come_home("home was moved in the climb", BE_READY_AT_HOME)

    def look_on(self, seen: Seen, _found: bool) -> None:
        """Say what the pilot may not see."""
        self._authority.look_on(seen.telemetry)
        self._deviations.forget()

    def fly(self, seen: Seen, _found: bool) -> None:
        """Take the `STEPS`, until one says that the rest waits."""
        for step in STEPS:
            if step.waits(self, seen):
                self._gate.mission_waits()
                return

    # The steps: each says whether those below it wait.

    def look_at_inputs(self, seen: Seen) -> bool:
        """Missing inputs are announced and held for; battery and time go on.

        So does the state's timer, unless zones are being changed.
        """
        status = self._context.inputs.look(seen.telemetry)
        return status is not CALM and self._deviations.inputs_missing(status, seen.telemetry)

    def keep_to_plan(self, seen: Seen) -> bool:
        """Deviations (altitude, clearance, speed, wind, home): the table in `deviations`."""
        context, climb = self._context, self._gate.climb.climb
        cruises = context.task.spec.cruises and context.airspace.change is None and climb is None
        if seen.moved is not None:
            self._deviations.home_moved(seen.moved, cruises=cruises)
        if not cruises:
            self._deviations.forget()
        elif not context.interlocks.up(Doubt.FOREIGN_ORDER):
            self._deviations.follow(seen.telemetry)
        if self._home.in_doubt and context.task.spec.cruises:
            self._airspace_update.altitude_doubted(seen.telemetry)
        return False

    def look_around(self, seen: Seen) -> bool:
        """Which waypoints are near is remembered."""
        exploration, here = self._exploration, seen.telemetry.position
        exploration.is_at(here)
        search, now_s = self._states.search.search, self._context.now_s
        search.links.update(here, seen.telemetry.altitude_m, search.targets, now_s)
        if math.dist(here, exploration.looked_from) >= exploration.alike_m:
            exploration.look_around(here, self._context.now_s)
        return False

    def come_home_in_time(self, seen: Seen) -> bool:
        """The battery, the mission's duration and the way home."""
        self._returns.check(seen.telemetry)
        return False

    def wait_for_interlocks(self, seen: Seen) -> bool:
        """Zones that change, and a climb, go on here; other interlocks are waited for."""
        context, climb = self._context, self._gate.climb
        if context.interlocks.up(Doubt.FOREIGN_ORDER):
            return True  # a hold would end the order of a pilot before it is known as such
        if context.airspace.change is not None:
            self._airspace_update.go_on(seen.telemetry)
            return True
        if climb.climb is not None and climb.go_on(seen.telemetry, self._gate.last):
            if climb.climb is None:
                self._navigator.follow(context.task.handler.replan())
            elif climb.stuck(seen.telemetry):
                self._authority.give_up(
                    "the climb to the mission's altitude does not go on", CLIMB_BY_HAND
                )
            return True
        return context.interlocks.up(*OFF_PLAN)

    def end_the_state_in_time(self, _: Seen) -> bool:
        """The state's time is over, or points wait for another state."""
        self._gate.mission_goes_on()
        ends_s = self._context.task.ends_s
        over = ends_s is not None and self._context.now_s >= ends_s
        if over or self._commands.later is not None:
            if self._context.left_s == 0.0:
                self._context.signal(Signal.TIMER)
            self._commands.now_what_waited()
        return False

    def fly_on(self, seen: Seen) -> bool:
        """The next leg, when it is time for it."""
        motion = self._navigator.update(seen.telemetry)
        if motion is not None or self._context.task.way.progress is not Progress.FLYING:
            self._navigator.advance(motion)
        return False

    def try_again(self, _: Seen) -> bool:
        """What could not be done before."""
        task = self._context.task
        if task.retry_at_s is not None and not self._gate.pending and self._context.take_retry():
            self._navigator.follow(task.handler.retry())
        return False


@dataclass(frozen=True, slots=True)
class Matter:
    """Something that a telemetry may show.

    Attributes:
        name: By which docs/state-machine.md knows it.
        shows: What it is, in words.
        found: Whether it shows, or what; None or False: it does not.
        then: Follows it.
        does: What that is, in words.
        why: Why it comes after the rows above it and before those below.
    """

    name: str
    shows: str
    found: Callable[[TelemetryHandler, Seen], Any]
    then: Callable[[TelemetryHandler, Seen, Any], None]
    does: str
    why: str


MATTERS: Final = (
    Matter(
        "OVER",
        "it is on the ground, disarmed, after it was armed",
        TelemetryHandler.over,
        TelemetryHandler.end,
        "the flight is over; it waits on if it has not flown and the pilot arms",
        "nothing can be commanded any more",
    ),
    Matter(
        "FALLEN",
        "its motors were stopped in the air",
        TelemetryHandler.fallen,
        TelemetryHandler.say_fallen,
        "an alarm; nothing is commanded",
        "a pilot's or ours, nothing can be done for it",
    ),
    Matter(
        "TAKEN",
        "it flies in a mode that we did not ask for, or by a failsafe",
        TelemetryHandler.taken,
        TelemetryHandler.give_away,
        "hands off at once",
        "the vehicle belongs to the pilot, whatever we are about to do",
    ),
    Matter(
        "SENT_ELSEWHERE",
        "for 1.5 s its plan item, or in Hold its target, has been none of ours",
        TelemetryHandler.sent_elsewhere,
        TelemetryHandler.follow_order,
        "hands off at once",
        "so does this show a pilot, but it takes time to be sure; the mode above does not",
    ),
    Matter(
        "WAITS_FOR_HOLD",
        "it is being released, or the plan on board is being compared",
        TelemetryHandler.waits_for_hold,
        TelemetryHandler.wait_for_hold,
        "a hold is repeated until it shows; then it is released, or the mission planned again",
        "the mission is over or in doubt; a breach below would release it, too",
    ),
    Matter(
        "BREACH",
        "it is in a no-fly zone or outside a fence; zones just drawn over it do not count",
        TelemetryHandler.breach,
        TelemetryHandler.release,
        "it holds, and is released with an alarm",
        "no leg may begin there",
    ),
    Matter(
        "TAKES_OFF",
        "the mission has not begun in the air",
        TelemetryHandler.takes_off,
        TelemetryHandler.watch_take_off,
        "the climb is watched, and led on to the mission's altitude",
        "all below is about a mission that flies",
    ),
    Matter(
        "NOT_OURS",
        "a pilot or a failsafe has it",
        TelemetryHandler.is_not_ours,
        TelemetryHandler.look_on,
        "missing inputs are announced, and breaches while its position is known",
        "only what is ours flies the mission",
    ),
    Matter(
        "OURS",
        "it flies its mission",
        TelemetryHandler.is_ours,
        TelemetryHandler.fly,
        "the steps below",
        "nothing graver shows",
    ),
)
"""The first that is found is followed, and nothing below it."""


@dataclass(frozen=True, slots=True)
class Step:
    """One of the things that are done with each telemetry of a mission that flies.

    Attributes:
        name: By which docs/state-machine.md knows it.
        waits: Does it; whether the steps below wait.
        when: When they do, in words; empty: never.
        why: Why it comes after the steps above it and before those below.
    """

    name: str
    waits: Callable[[TelemetryHandler, Seen], bool]
    when: str
    why: str


STEPS: Final = (
    Step(
        "INPUTS",
        TelemetryHandler.look_at_inputs,
        "too few inputs come to fly on by",
        "all that follows is judged by them",
    ),
    Step(
        "PLAN_KEPT",
        TelemetryHandler.keep_to_plan,
        "",
        "it raises what INTERLOCKS waits for; by now the position is known",
    ),
    Step(
        "WAYPOINTS_NEAR",
        TelemetryHandler.look_around,
        "",
        "it only remembers, for searches",
    ),
    Step(
        "HOME_IN_TIME",
        TelemetryHandler.come_home_in_time,
        "",
        "battery and time go on while the mission waits below",
    ),
    Step(
        "INTERLOCKS",
        TelemetryHandler.wait_for_interlocks,
        "a row of `INTERLOCKS` is raised, or it climbs first",
        "no leg begins and no state times out meanwhile; requests and coming home still do",
    ),
    Step(
        "STATE_TIMER",
        TelemetryHandler.end_the_state_in_time,
        "",
        "a state whose time is over begins no other leg",
    ),
    Step(
        "NEXT_LEG", TelemetryHandler.fly_on, "", "a state that has just changed has already set out"
    ),
    Step(
        "TRY_AGAIN",
        TelemetryHandler.try_again,
        "",
        "nothing is retried while a command from the steps above is pending",
    ),
)
"""Taken in this order, until one says that the rest waits."""
