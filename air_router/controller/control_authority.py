"""Releases the vehicle to a pilot or a failsafe, and takes it back when the operator resumes.

If this program itself gives up (the vehicle is in a zone, another plan is on board), it first
commands a hold, because the vehicle still flies one of our legs. It repeats the hold until the
vehicle follows or the pilot takes over. It does the same while a plan uploaded by a ground station
is compared with ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.limits import (
    FAILSAFE_LATE_S,
    LINK_SILENCE_ALARM_S,
    LINK_SILENCE_ANNOUNCED_S,
    LINK_SILENCE_BY_HAND_S,
    PLAN_COMPARED_S,
    POSITION_UNKNOWN_S,
    RELEASE_HOLDS,
    REPEATED_AFTER_S,
)
from air_router.controller.model import (
    Anomaly,
    ControlHolder,
    HoldHere,
    MissionContext,
    PlanOwner,
    Signal,
    State,
)
from air_router.controller.motion import MODES, RETRY_S, CommandGate, Navigator
from air_router.controller.safety_monitor import SafetyMonitor
from air_router.mission import Mission
from air_router.vehicle import (
    CHECK_LINK,
    CHECK_SENDERS,
    CHOOSE_AGAIN,
    CONNECT_ANOTHER,
    FLIGHT_MODE_S,
    FLY_OUT,
    IN_YOUR_HANDS,
    KEEP_CLEAR,
    LAND_BY_HAND,
    NO_UPLOADS,
    RESUME_AGAIN,
    SEPARATE_TWINS,
    TAKE_OVER_BLIND,
    TAKE_OVER_NOW,
    TAKE_WHERE_IT_HOLDS,
    UPLOAD_OURS,
    WATCH_FAILSAFE,
    FlightMode,
    Instruction,
    LinkSilent,
    MavlinkSpoofed,
    PlanCompared,
    PlanReplaced,
    PlanTried,
    Telemetry,
    WrongVehicle,
)

NOT_TAKEN: Final = "not flown by hand"
"""Subject of the alarm after this program gave up, until a pilot chooses a mode."""

POSITION_UNKNOWN: Final = "position unknown"
"""Subject of the alarm while PX4 flies the vehicle without knowing its position."""

_BY_HAND: Final = frozenset({FlightMode.POSITION, FlightMode.ALTITUDE, FlightMode.OTHER})
"""Modes in which the pilot flies by sight."""


def why_not_resumed(mission: Mission, telemetry: Telemetry | None) -> str | None:
    """Why a flight cannot be resumed as the operator requests; None if it can."""
    if telemetry is None or not telemetry.in_air:
        return "the vehicle is on the ground: start the mission again"
    zones = mission.airspace_at(telemetry.altitude_m).zones_at(telemetry.position)
    reasons = {
        "a failsafe of the autopilot acts: choose Hold first": telemetry.failsafe,
        f"it flies in {telemetry.mode.value} mode: choose Hold first": telemetry.mode
        not in {FlightMode.HOLD, FlightMode.MISSION},
        "GPS has no fix: wait for it": not telemetry.fix,
        f"it is in {', '.join(zones)}: fly it out by hand first": bool(zones),
        f"it is {telemetry.altitude_m:.0f} m above home, in the layer of another UAV: descend to "
        f"{mission.altitude_above_home_m:.0f} m first": telemetry.altitude_m > mission.layer_top_m,
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


@dataclass(slots=True)
class RateLimitedAnnouncer:
    """Announces a condition at once, repeats it at intervals, and announces its end."""

    _what: str | None = None  # the last announcement; None: over
    _announced_s: float = 0.0  # time of the last announcement

    def update(self, what: str | None, now_s: float) -> str | None:
        """Return the text to announce now; None: nothing is due."""
        if what == self._what and (what is None or now_s < self._announced_s + REPEATED_AFTER_S):
            return None
        before, self._what, self._announced_s = self._what, what, now_s
        return f"over: {before}" if what is None else what


@dataclass(slots=True, eq=False)
class ControlAuthority:
    """Releases the vehicle and takes it back. `Authority` in the context has who commands it.

    Args:
        context: Receives the signals that the pilot flies, or that this program does again.
        gate: Commands holds.
        navigator: Resumes what the state requests.
        monitor: Finds breaches to announce while a pilot flies.
    """

    _context: MissionContext
    _gate: CommandGate
    _navigator: Navigator
    _monitor: SafetyMonitor
    _instruction: Instruction = TAKE_WHERE_IT_HOLDS  # for the pending release
    _compared_by_s: float = 0.0  # deadline of the comparison
    _holds: int = 0  # hold commands sent before the release
    _hold_again_s: float = 0.0  # next hold command, vehicle's clock
    _chosen: tuple[FlightMode, float] | None = None  # the mode of the take-over, and when
    _crossing: FlightMode | None = None  # mode of a command under way at the take-over
    _breaches: RateLimitedAnnouncer = field(
        default_factory=RateLimitedAnnouncer
    )  # while another flies
    _failsafe: FlightMode | None = None  # last announced mode of PX4's failsafe
    _unknown_since_s: float | None = None  # position unknown since, vehicle's clock
    _silence_announced_s: float = -math.inf  # length of the silence last announced
    _mode_s: float | None = None  # age of the mode after a silence; None: not received

    # Releasing the vehicle.

    def give_up(self, why: str, instruction: Instruction) -> None:
        """Command a hold, then hands off; both wait until it is known who commands the vehicle.

        Args:
            why: The reason, as text.
            instruction: The pilot's action.
        """
        self._instruction = instruction
        if self._context.inputs.silent:
            self._context.alarm(
                f"{why}: hold is sent once the flight mode is received", instruction
            )
        self._context.authority.release(why)
        self._holds = 0
        holds = self._gate.pending is None and isinstance(self._gate.last, HoldHere)
        # Another hold would override what a pilot has just chosen.
        if not (holds and self._context.interlocks.is_raised(Anomaly.FOREIGN_ORDER)):
            self._hold_at_last(why)

    def _hold_at_last(self, why: str) -> None:
        self._holds += not self._context.inputs.silent  # no hold is sent while it is silent
        self._hold_again_s = self._context.now_s + RETRY_S
        self._gate.command(HoldHere(why))

    def check(self) -> None:
        """Repeat a lost hold, or release the vehicle."""
        context, gate = self._context, self._gate
        if gate.pending is not None:
            return
        holds = isinstance(gate.last, HoldHere)
        if context.authority.plan_check is not None:
            if context.now_s >= self._compared_by_s:
                self._differs(f"{context.authority.plan_check}, and cannot be read")
            elif not holds and context.now_s >= self._hold_again_s:
                self._hold_at_last(context.authority.plan_check)
        elif context.authority.releasing is not None:
            if holds:
                self._complete_release(context.authority.releasing)
            elif self._holds >= RELEASE_HOLDS:
                self._complete_release(
                    f"{context.authority.releasing}; it did not follow the hold command"
                )
            elif context.now_s >= self._hold_again_s:
                self._hold_at_last(context.authority.releasing)

    def _complete_release(self, why: str) -> None:
        self._context.authority.released()
        if self._context.knows(Signal.TAKEN_OVER):
            self._context.authority.take(ControlHolder.PILOT)
            self._context.alarm(f"hands off: {why}", self._instruction)
            self._context.signal(Signal.TAKEN_OVER)
            self._context.alarms.stand(
                NOT_TAKEN,
                "the vehicle hovers, and is not flown by hand",
                self._instruction,
                now_s=self._context.now_s,
                since_s=self._context.now_s,
            )

    def taken(self, telemetry: Telemetry, *, crossed: bool = True) -> None:
        """Hands off: the vehicle flies in a mode that we did not request, or by a failsafe.

        Args:
            telemetry: Telemetry with that mode.
            crossed: An unconfirmed command of ours may still be under way.
        """
        pending = self._gate.pending if crossed else None
        self._crossing = None if pending is None else MODES[type(pending)]
        who = ControlHolder.FAILSAFE if telemetry.failsafe else ControlHolder.PILOT
        self._chosen = (telemetry.mode, self._context.now_s)
        failsafe = who is ControlHolder.FAILSAFE
        self._failsafe = telemetry.mode if failsafe else None
        instruction = WATCH_FAILSAFE if failsafe else IN_YOUR_HANDS
        self.take_over(who, f"{who.value} chose {telemetry.mode.value} mode", instruction)

    def observe(self, telemetry: Telemetry) -> None:
        """Announce what a flying pilot may not see, and a failsafe that shows late."""
        context = self._context
        mode, taken_s = self._chosen or (telemetry.mode, -math.inf)
        late = telemetry.mode is mode and context.now_s - taken_s <= FAILSAFE_LATE_S
        if telemetry.failsafe and late and context.authority.taken_by is ControlHolder.PILOT:
            context.authority.take(ControlHolder.FAILSAFE)
            self._failsafe = mode
            context.warn(
                f"it was {ControlHolder.FAILSAFE.value} that chose {mode.value} mode",
                WATCH_FAILSAFE,
            )
        self._check_failsafe(telemetry)
        if telemetry.mode is not FlightMode.HOLD:
            context.over(NOT_TAKEN)  # a pilot or a failsafe flies the vehicle
        if (
            telemetry.mode is self._crossing is not mode
            and context.now_s - taken_s <= FAILSAFE_LATE_S
        ):
            self._crossing = None
            context.alarm(
                f"{telemetry.mode.value} mode followed {mode.value} mode: our command was "
                "still under way",
                CHOOSE_AGAIN,
            )
        self._check_inputs(telemetry)
        if self._is_lost(telemetry):
            return  # a breach cannot be detected either
        breach = self._monitor.breach(telemetry)
        update = self._breaches.update(breach, context.now_s)
        if update is not None and breach is not None:
            context.alarm(update, FLY_OUT)
        elif update is not None:
            context.inform(update)

    def _check_failsafe(self, telemetry: Telemetry) -> None:
        """Announce a failsafe or its next mode: PX4 holds for some seconds, then returns."""
        mode, before = telemetry.mode, self._failsafe
        if self._context.authority.wrong_vehicle is not None:
            return  # the mode may be the other vehicle's
        if not telemetry.failsafe:
            self._failsafe = before if mode is before else None  # the same failsafe flickers
        elif telemetry.in_air and mode is not before and mode not in _BY_HAND:
            self._failsafe = mode
            failsafe = ControlHolder.FAILSAFE.value
            text = f"{failsafe} chose {mode.value} mode"
            if before is not None:
                text = f"{failsafe} changed from {before.value} to {mode.value} mode"
            self._context.alarm(text, WATCH_FAILSAFE)

    def _is_lost(self, telemetry: Telemetry) -> bool:
        """Whether the position is unknown; raise an alarm while PX4 flies the vehicle."""
        context, why = self._context, self._monitor.position_unknown(telemetry)
        if why is None:
            self._unknown_since_s = None
            again = "the vehicle's position is known again"
            context.over(POSITION_UNKNOWN, again if telemetry.in_air else "")
            return False
        since_s = self._unknown_since_s
        since_s = self._unknown_since_s = telemetry.received_s if since_s is None else since_s
        if telemetry.mode in _BY_HAND:
            context.over(POSITION_UNKNOWN)
        elif telemetry.received_s - since_s >= POSITION_UNKNOWN_S:
            context.alarm_until_over(
                POSITION_UNKNOWN,
                f"the vehicle's position is not known: {why}; it may be in a zone",
                TAKE_OVER_BLIND,
                lasting="the vehicle's position has not been known",
                since_s=since_s,
            )
        return True

    def wait(self, telemetry: Telemetry) -> None:
        """Continue the release, or the comparison of the plan."""
        self._check_inputs(telemetry)  # without inputs a hold may not be sent
        self._gate.mission_waits()
        self.check()

    def _check_inputs(self, telemetry: Telemetry) -> None:
        for announcement in self._context.inputs.update(telemetry).announcements:
            self._context.announce(announcement.what, announcement.instruction)

    def link_silent(self, event: LinkSilent) -> None:
        """Announce that the vehicle is silent, and repeat it at intervals."""
        context, silent_s = self._context, event.silent_s
        if not 0.0 < context.silent_s <= silent_s:  # a new silence
            self._silence_announced_s = -math.inf
        context.silent_for(silent_s)
        if context.in_charge and context.in_air:
            self._gate.mission_waits()
        if silent_s >= max(self._silence_announced_s + REPEATED_AFTER_S, LINK_SILENCE_ANNOUNCED_S):
            self._silence_announced_s = silent_s
            text = f"nothing received from the vehicle for {silent_s:.0f} s"
            if silent_s < LINK_SILENCE_ALARM_S:
                context.warn(text, CHECK_LINK)
            elif silent_s < LINK_SILENCE_BY_HAND_S:
                context.alarm(text, CHECK_LINK)
            else:
                context.alarm(text, TAKE_OVER_NOW)

    def link_restored(self, event: object) -> bool:
        """Whether an event ends a silence: telemetry whose flight mode was received since.

        Other messages may be received first, and a pilot may have chosen another mode meanwhile. A
        mode that has been missing for long enough also ends the silence, as does an old one that is
        not ours.
        """
        if not isinstance(event, Telemetry):
            return True
        mode_s, before_s = event.ages.mode_s, self._mode_s
        announced = mode_s == 0.0 or (before_s is not None and mode_s < before_s)
        chosen = event.failsafe or event.mode not in self._gate.modes
        if not announced and mode_s < FLIGHT_MODE_S and not (chosen and self._context.in_charge):
            self._mode_s = mode_s
            return False
        self._mode_s = None
        self._context.silent_for(0.0)
        return True

    def take_over(self, who: ControlHolder, why: str, instruction: Instruction) -> None:
        """Hands off: a pilot or a failsafe flies from now on.

        Args:
            who: Who took over.
            why: The reason, as text.
            instruction: The pilot's action.
        """
        context = self._context
        if not context.knows(Signal.TAKEN_OVER):
            return
        context.authority.take(who)
        if who is ControlHolder.FAILSAFE:
            context.alarm(f"hands off: {why}", instruction)
        else:
            context.warn(f"hands off: {why}", instruction)
        context.signal(Signal.TAKEN_OVER)

    def fallen(self, why: str) -> None:
        """Hands off: the motors were stopped in the air."""
        self._context.authority.take(None)
        self._context.alarm(f"hands off: {why}", KEEP_CLEAR)
        if self._context.knows(Signal.TAKEN_OVER):
            self._context.signal(Signal.TAKEN_OVER)

    def another_vehicle(self, event: WrongVehicle) -> None:
        """Respond to a vehicle on the link that is no multicopter with PX4, or is one again.

        Nothing is commanded, not even a hold: it may be another vehicle with the same system id and
        its own pilot.
        """
        context, why = self._context, event.why_not
        before = context.authority.wrong_vehicle
        context.authority.vehicle_is_wrong(why)
        if why is None:
            if before is not None:
                context.inform("only a multicopter with PX4 is on the link again")
            return
        if context.task.state is State.READY and not context.in_air:
            instruction = SEPARATE_TWINS if event.twins else CONNECT_ANOTHER
            context.alarm(why, instruction)
            context.task.stay(why)
            context.signal(Signal.GROUNDED)
            return
        instruction = SEPARATE_TWINS if event.twins else LAND_BY_HAND
        if before is None:
            context.alarm(why, instruction)
        if context.in_charge:
            self.take_over(ControlHolder.PILOT, why, instruction)

    def spoofed(self, event: MavlinkSpoofed) -> None:
        """Announce a sender that poses as the vehicle; its messages are ignored."""
        self._context.warn(
            f"{event.count} MAVLink messages posed as the vehicle without its signature, "
            "and were ignored",
            CHECK_SENDERS,
        )

    # The plan on board.

    def plan_replaced(self, event: PlanReplaced) -> None:
        """A ground station uploaded a plan or a fence: hold until it is compared with ours.

        The current leg may lead into a zone now, and PX4 chooses the item to fly to. A landing
        needs no plan.
        """
        context = self._context
        context.authority.plan_is(PlanOwner.REPLACED)
        what = f"the {'fence' if event.only_fence else 'plan'} on board was replaced"
        context.warn(f"{what}; comparing it with this mission's", NO_UPLOADS)
        flies_plan = context.in_charge and context.task.state is not State.LAND
        self._compared_by_s = context.now_s + PLAN_COMPARED_S
        self._hold_again_s = context.now_s + RETRY_S
        if flies_plan and context.authority.releasing is None:
            context.authority.check_plan(what)
            if context.task.state is State.READY:
                context.authority.stop(what)
            self._gate.stop()
            self._gate.hold(what)

    def plan_tried(self, event: PlanTried) -> None:
        """Announce an upload by another station that PX4 refuses for now."""
        self._context.warn(f"{event.who} tries to upload a plan, which PX4 refuses now", NO_UPLOADS)

    def plan_compared(self, event: PlanCompared) -> None:
        """Resume if the plan is equivalent to ours; otherwise hands off."""
        context = self._context
        if event.difference is not None:
            self._differs(f"another plan is on board ({event.difference})")
            return
        context.authority.plan_is(PlanOwner.OURS)
        again = "the plan on board is equivalent to this mission's"
        if context.authority.plan_check is None:
            context.inform(again)
            return
        context.authority.plan_checked()
        held = context.authority.held
        if held is not None:  # no leg may start there, whatever the plan
            context.authority.end_stop()
            context.alarm(f"{again}; holding: {held.why}", held.instruction)
            return
        context.inform(f"{again}: {'going on' if context.in_air else 'choose Mission to take off'}")
        context.interlocks.climb_first()  # it may have descended, or was stopped in its climb
        if not context.in_air:
            return
        if context.task.state is State.READY:  # it was stopped in its climb
            self._gate.ours_in_the_air()
            context.signal(Signal.AIRBORNE)
        else:
            self._navigator.follow(context.task.handler.replan())

    def _differs(self, why: str) -> None:
        """Respond to another plan on board."""
        context = self._context
        context.authority.plan_is(PlanOwner.ANOTHER)
        telemetry = context.telemetry
        if context.task.state is State.READY and telemetry is not None and not telemetry.armed:
            context.task.stay(why)
            context.signal(Signal.GROUNDED)
        elif context.task.state is State.READY and not context.in_charge:
            self.take_over(ControlHolder.PILOT, why, UPLOAD_OURS)
        elif context.task.state in {State.LAND, State.PASSIVE}:
            context.warn(why, UPLOAD_OURS)
            context.authority.plan_checked()
            self._navigator.follow(context.task.handler.replan())  # a landing needs no plan
        elif context.in_charge and context.authority.releasing is None:
            self.give_up(why, TAKE_WHERE_IT_HOLDS)

    # Taking it back.

    def why_not_back(self, *, flies_plan: bool = True) -> str | None:
        """What has to be done before the vehicle can be taken back; None: nothing.

        Args:
            flies_plan: The vehicle is to fly the plan on board; else it flies to position
                setpoints.
        """
        telemetry = self._context.telemetry
        if telemetry is None:
            return "nothing was received from the vehicle: wait for it"
        if self._context.authority.wrong_vehicle is not None:
            return f"{self._context.authority.wrong_vehicle}: land it by hand"
        why = why_not_resumed(self._context.airspace.mission, telemetry)
        why = why or self._gate.climb.why_not(telemetry)
        if why is not None or not flies_plan:
            return why
        if self._context.authority.on_board is PlanOwner.REPLACED:
            return "the plan on board is being read: request it again in a moment"
        if self._context.authority.on_board is PlanOwner.ANOTHER:
            return (
                "another plan is on board: 'resume upload' uploads this mission's and resumes, "
                "'home' comes home without it"
            )
        return None

    @property
    def way_back(self) -> str:
        """How the operator can have the vehicle taken back."""
        return self.why_not_back() or "'resume' takes it back, 'home' brings it home"

    def resume(self, *, upload: bool = False) -> str | None:
        """Resume a flight that was released, or that an earlier companion left.

        Args:
            upload: Upload our plan first; another one may be on board.

        Returns why not; None: it is resumed.
        """
        why = self.why_not_back(flies_plan=not upload)
        if why is not None:
            self._context.warn(f"not resumed: {why}", RESUME_AGAIN)
            return why
        self._context.inform("resumed: the mission continues from here")
        self._take_back()
        ready = self._context.task.state is State.READY
        self._context.signal(Signal.AIRBORNE if ready else Signal.RESUMED)
        return None

    def take_home(self) -> None:
        """Take the vehicle back to come home, whatever plan is on board, after `why_not_back`."""
        if self._context.authority.on_board is not PlanOwner.OURS:
            self._gate.fly_points(instead=True)
            # The legs keep clear of the zones; the fence on board stays, and the vehicle is in no
            # zone.
            self._context.airspace.finish_change()
        self._take_back()

    def _take_back(self) -> None:
        self._context.alarms.end_all()
        self._failsafe = None
        self._gate.ours_in_the_air()
        self._context.authority.take(None)
        self._gate.assume(self._context.last_telemetry.mode)
        self._context.interlocks.climb_first()
