"""The only way to command the vehicle. The gate checks every motion; a hold always passes.

If the flight mode is not received, only the operator's hold is sent. While the vehicle seems to
follow a foreign command, a hold is sent only for missing inputs or zones. `interlocks` lists what
blocks a leg or a landing. If nothing blocks it, the gate may still send another motion first: a
hold, if telemetry could not show which of several jumps the vehicle follows; a climb, if the
vehicle was taken over or stopped below its altitude. The mission is replanned after both.

Only the flight mode that PX4 reports shows who commands the vehicle. While a command is pending (or
has failed), the vehicle may be in the mode before it or in the mode it requests. After the
confirmation only the requested mode is ours. A pilot or a failsafe chose any other mode.

Commands arrive late: the link and busy computers lie between a decision and the vehicle. Until then
the vehicle follows the previous command, to the end of its current leg.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from air_router.controller.model import (
    CommandConfirmed,
    CommandFailed,
    FlyToNode,
    HoldHere,
    LandHere,
    MissionContext,
    Motion,
    State,
    ZoneChange,
)
from air_router.controller.motion.initial_climb import InitialClimb, NoClimb
from air_router.controller.motion.interlocks import Blocked, Interlock, MotionOutcome, raised
from air_router.controller.motion.limits import (
    ANNOUNCE_AGAIN_S,
    JUMPS,
    POSITION_EVERY_S,
    REACTION_S,
    RETRY_S,
)
from air_router.controller.motion.setpoints import MODES, PendingSetpoints, stopping_point
from air_router.mission import FlightPlan
from air_router.routing import Momentum
from air_router.vehicle import (
    CHECK_LINK,
    CLIMB_BY_HAND,
    FLY_OUT_OR_RELOAD,
    READ_PX4,
    FlightMode,
    Instruction,
    Telemetry,
)


@dataclass(slots=True, eq=False)
class CommandGate:
    """Sends motions and tracks their outcome. Callers choose the destination.

    Args:
        context: Telemetry, and everything that may block a motion.
        plan: The plan on board, for the autopilot's item numbers.

    Attributes:
        setpoints: The motions commanded to the vehicle that it may follow at any moment.
        reaction_s: Delay before the vehicle follows a command.
        pending: The command that the vehicle has neither confirmed nor failed to follow.
        last: The last command sent; None after it failed.
        modes: The flight modes that follow from our commands.
        ends: The flight modes that the newest motion may end. If the vehicle is in another mode by
            then, even in the motion's own, a pilot has chosen it.
        refused_jumps: Number of consecutive plan jumps that the vehicle did not follow.
        by_points: Nodes are flown to by DO_REPOSITION, because the vehicle does not fly its
            plan.
        blocked: The last blocking interlock, until a motion is sent or the state changes.
        waits_why: The last announced reason to hover without a clear way; None: a motion was
            commanded since.
        climb: The climb that a vehicle below its altitude flies before a leg.
    """

    _context: MissionContext
    _plan: FlightPlan
    setpoints: PendingSetpoints = field(init=False)
    climb: InitialClimb = field(init=False)
    reaction_s: float = REACTION_S
    pending: Motion | None = None
    last: Motion | None = None
    modes: frozenset[FlightMode] = frozenset()
    ends: frozenset[FlightMode] = frozenset()
    refused_jumps: int = 0
    by_points: bool = False
    blocked: Blocked | None = None
    waits_why: str | None = None
    _wait_announced_s: float = -math.inf  # vehicle's clock
    _explained: frozenset[FlightMode] = frozenset()  # `modes` without the newest motion's
    _assumed: frozenset[FlightMode] = frozenset()  # by the last confirmed or assumed motion

    def __post_init__(self) -> None:
        mission = self._context.airspace.mission
        self.climb = InitialClimb(self._context)
        self.setpoints = PendingSetpoints(mission.planner.acceptance_radius_m, mission.speed_m_s)

    def momentum(self, telemetry: Telemetry, age_s: float = 0.0) -> Momentum:
        """How far the vehicle coasts, including the age of its telemetry."""
        reaction_s, speed_m_s = self.reaction_s + age_s, self.setpoints.speed_m_s
        rest = stopping_point(telemetry, reaction_s)
        return Momentum(rest, telemetry.velocity_m_s, speed_m_s, reaction_s)

    @property
    def leaves_s(self) -> float:
        """Longest time between the telemetry of a decision and its motion being sent.

        A later motion is checked again with newer telemetry. About half of a command's delay lies
        before it is sent, half after.
        """
        return POSITION_EVERY_S + max(0.0, self.reaction_s - REACTION_S) / 2

    # Commands.

    def command(self, motion: Motion) -> MotionOutcome | Blocked:
        """Command a motion unless an interlock blocks it; a hold is always sent.

        Returns the outcome.
        """
        context = self._context
        if isinstance(motion, HoldHere):
            return self.send(motion)
        if rows := raised(context):
            return self._block(motion, rows)
        self.blocked = None
        if isinstance(motion, FlyToNode) and self._jump_uncertain(motion):
            context.task.way.brake()
            self.send(HoldHere("an earlier command may still be under way; stopping to plan again"))
            return MotionOutcome.INSTEAD
        if context.interlocks.climb_required:
            allowed = self.climb.first(motion, self.last, self.reaction_s)
            if isinstance(allowed, NoClimb):
                return self.wait_here(allowed.why, CLIMB_BY_HAND)
            motion = allowed
        self.waits_why = None  # there is a way: the next reason to wait is announced
        return self.send(motion)

    def _block(self, motion: Motion, rows: Sequence[Interlock]) -> Blocked:
        """Block the motion. The first row decides what follows; any row may defer the motion."""
        context, first = self._context, rows[0]
        blocked = self._waits_for(first)
        if any(row.defers for row in rows):
            context.interlocks.defer_motion()
        if first.repeats_landing and isinstance(motion, LandHere):
            context.retry_in(RETRY_S)
        if first.calls_off(context):
            self.stop()  # else the vehicle would reach the end of its leg unmonitored
            if context.airspace.change is ZoneChange.UPLOADING or self.last is not None:
                context.airspace.stop_first()
                self.hold("zones are being changed")
        return blocked

    def mission_goes_on(self) -> None:
        """Nothing blocks the mission: the next blocking row starts its own time."""
        self.blocked = None

    def fly_points(self, *, instead: bool) -> None:
        """Fly to nodes by DO_REPOSITION from now on, or as items of the plan again."""
        self.by_points = instead
        if not instead:
            self.refused_jumps = 0  # they concern the plan that was on board before

    def reacts_within(self, reaction_s: float) -> None:
        """Set the longest delay before the vehicle follows a command, on its clock."""
        self.reaction_s = reaction_s

    def mission_waits(self) -> None:
        """Note the first raised row while the mission requests no motion; a landing continues."""
        if isinstance(self.last, LandHere):
            return
        if rows := raised(self._context):
            self._waits_for(rows[0])

    def _waits_for(self, row: Interlock) -> Blocked:
        blocked = self.blocked
        if blocked is None or blocked.by is not row:
            blocked = self.blocked = Blocked(row, self._context.now_s)
        return blocked

    def waits_for(self) -> Blocked | None:
        """The interlock that blocks the mission; None if none does now."""
        found = self.blocked
        return found if found is not None and found.by.raised(self._context) else None

    def send(self, motion: Motion) -> MotionOutcome:
        """Send a motion without checking the interlocks.

        While it is unknown who commands the vehicle, only a hold requested by the operator is sent.
        """
        pending, context = self.pending, self._context
        requested = context.task.state is State.HOLD
        not_received = context.inputs.silent or context.silent_s > 0.0
        if isinstance(motion, HoldHere) and not_received and not requested:
            return MotionOutcome.MAY_BE_TAKEN
        if motion == pending or (isinstance(motion, HoldHere) and isinstance(pending, HoldHere)):
            return MotionOutcome.UNDER_WAY
        self.pending = self.last = motion
        shown = frozenset() if context.telemetry is None else {context.telemetry.mode}
        self.ends = self._assumed | shown
        self._explained = self.modes
        self.modes |= {MODES[type(motion)]}
        self.setpoints.sent(motion)
        context.actions.append(motion)
        return MotionOutcome.SENT

    def hold(self, why: str) -> MotionOutcome:
        """Hold, unless that was the last command."""
        if isinstance(self.last, HoldHere):
            return MotionOutcome.UNDER_WAY
        return self.send(HoldHere(why))

    def stop(self) -> None:
        """Drop the current goal."""
        self._context.task.head_for(None)

    def _jump_uncertain(self, jump: FlyToNode) -> bool:
        """Whether telemetry after a jump could not show which of several commands is followed."""
        if not self.setpoints.under_way(jump):
            return False
        telemetry = self._context.telemetry
        shows = (
            telemetry is not None
            and telemetry.mode is FlightMode.MISSION
            and telemetry.item == self._plan.item_of(jump.node)
        )
        return shows or self.setpoints.given_up(jump)

    # Waiting for a clear way.

    def wait_for_way(self, refusal: str) -> MotionOutcome:
        """Hover without a clear way, unless a retry is already scheduled."""
        if self._context.task.retry_at_s is not None:
            if self.last is not None:  # else the last one failed and is sent after the pause
                self.hold(refusal)
            return MotionOutcome.WAITS
        return self.wait_here(refusal, FLY_OUT_OR_RELOAD)

    def wait_here(self, why: str, instruction: Instruction) -> MotionOutcome:
        """Hover without a clear way, announce the reason once, and retry soon."""
        now_s = self._context.now_s
        if why != self.waits_why and now_s >= self._wait_announced_s + ANNOUNCE_AGAIN_S:
            self.waits_why, self._wait_announced_s = why, now_s
            self._context.warn(f"holding: {why}", instruction)
        self.hold(why)
        self._context.retry_in(RETRY_S)
        return MotionOutcome.WAITS

    # Outcomes.

    def assume(self, mode: FlightMode) -> None:
        """Accept the mode that the pilot (or the start) has chosen as ours."""
        self.pending = None
        self.modes = self._assumed = frozenset({mode})

    def ours_in_the_air(self) -> None:
        """From now on this program commands the vehicle in the air."""
        context = self._context
        context.authority.fly()
        if context.task.airborne_s is None:
            context.task.fly_since(context.now_s)

    def confirmed(self, event: CommandConfirmed) -> None:
        """The vehicle follows a motion. A late confirmation of an older one changes no mode."""
        motion = event.action
        if motion is self.pending:
            self.assume(MODES[type(motion)])
            if isinstance(motion, FlyToNode):
                self.refused_jumps = 0
        elif self.pending is not None:  # the newer motion is sent from this mode
            self._assumed = frozenset({MODES[type(motion)]})
        self.setpoints.confirmed(motion)

    def failed(self, event: CommandFailed) -> None:
        """The vehicle did not follow: retry soon, unless another motion was commanded since.

        A motion that was not sent, because the vehicle had moved on, is planned again sooner.
        """
        if event.action is not self.pending:
            return
        self.pending = self.last = None
        if not event.sent:  # its mode could only be a pilot's choice
            self.modes = self._explained
        self.refused_jumps += event.sent and isinstance(event.action, FlyToNode)
        if event.sent:
            self._context.warn(f"the vehicle did not follow: {event.reason}", CHECK_LINK)
        else:
            self._context.inform(f"not sent: {event.reason}")
        if self.refused_jumps >= JUMPS and not self.by_points:
            self.fly_points(instead=True)
            self._context.warn("the plan on board is not flown: flying to points instead", READ_PX4)
        self._context.retry_in(RETRY_S if event.sent else RETRY_S / 2)

    def forget_commands(self) -> None:
        """Hands off: forget everything commanded."""
        self.stop()
        self.blocked = None
        self.setpoints.forget()
        self.pending = self.last = None
        self.modes = self._assumed = frozenset()
