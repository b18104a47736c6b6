"""The one way to command the vehicle: past all that may stand against a motion, or to hold.

A hold always leaves (while the flight mode is not heard: only one that the operator asks for). None
is requested while a foreign command is active, unless inputs or zones demand it. What keeps a
leg, or a landing, from leaving stands in `interlocks`. Past those two things leave instead of it: a
hold, where a jump would not show which order is followed; the climb, where the vehicle was taken
over, or stopped, below its altitude. Both are followed by a plan made anew.

The mode that the autopilot reports is the only truth about who has the vehicle. While a command is
under way (or has failed) the vehicle may be in the mode before it or in the one that it requests;
once it is confirmed only in that one. Any other mode was chosen by a pilot or a failsafe.

Commands arrive when they arrive: between the decision on a leg and the vehicle's turn lies a link,
and machines that may be busy. Until then it follows the command before, to the end of its
present leg.
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
    """Commands motions, and keeps what became of them. Where to, its callers know.

    Args:
        context: The vehicle's messages, and all that may stand against a motion.
        plan: The plan on board, for the autopilot's item numbers.

    Attributes:
        setpoints: What the vehicle was reported, and may follow any moment.
        reaction_s: For how long the vehicle flies on as it does before it follows a command.
        pending: The command that the vehicle has neither confirmed nor failed to follow.
        last: The command that the vehicle follows or was sent; None when it did not.
        modes: The flight modes that our commands explain.
        ends: Those in which the vehicle may be when the newest motion leaves: another was chosen by
            a pilot since that was decided, the motion's own mode among them.
        refused_jumps: How many jumps within the plan it did not follow, one after the other.
        by_points: Nodes are flown to as any other point, because it does not fly its plan.
        blocked: What kept the mission back last, until a motion leaves or the state changes.
        waits_why: The reason to hover where no way is clear, as announced last.
        climb: What a vehicle that is low flies instead of a leg.
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
    _wait_announced_s: float = -math.inf  # when, vehicle's clock
    _explained: frozenset[FlightMode] = frozenset()  # `modes` without the newest motion's
    _assumed: frozenset[FlightMode] = frozenset()  # by what was confirmed, or begun, last

    def __post_init__(self) -> None:
        mission = self._context.airspace.mission
        self.climb = InitialClimb(self._context)
        self.setpoints = PendingSetpoints(mission.planner.acceptance_radius_m, mission.speed_m_s)

    def momentum(self, telemetry: Telemetry, age_s: float = 0.0) -> Momentum:
        """What the vehicle flies on by itself, in the time since it published this included."""
        reaction_s, speed_m_s = self.reaction_s + age_s, self.setpoints.speed_m_s
        rest = stopping_point(telemetry, reaction_s)
        return Momentum(rest, telemetry.velocity_m_s, speed_m_s, reaction_s)

    @property
    def leaves_s(self) -> float:
        """A motion that is decided on now has left so long after the telemetry of the decision.

        Else it is checked in its turn from a newer one. What a command takes on its way it takes in
        about equal parts before and after it leaves.
        """
        return POSITION_EVERY_S + max(0.0, self.reaction_s - REACTION_S) / 2

    # Commands.

    def command(self, motion: Motion) -> MotionOutcome | Blocked:
        """Have the vehicle do this, if nothing stands against it; a hold is sent in any case.

        Returns what became of it.
        """
        context = self._context
        if isinstance(motion, HoldHere):
            return self.send(motion)
        if rows := raised(context):
            return self._block(motion, rows)
        self.blocked = None
        if isinstance(motion, FlyToNode) and self._jump_uncertain(motion):
            context.task.way.brake()
            self.send(HoldHere("an order from before may be under way; stopping to look again"))
            return MotionOutcome.INSTEAD
        if not context.interlocks.climb_required:
            return self.send(motion)
        allowed = self.climb.first(motion, self.last, self.reaction_s)
        if isinstance(allowed, NoClimb):
            return self.wait_here(allowed.why, CLIMB_BY_HAND)
        return self.send(allowed)

    def _block(self, motion: Motion, rows: Sequence[Interlock]) -> Blocked:
        """The motion stays. The first row decides what follows; any may have it come back."""
        context, first = self._context, rows[0]
        blocked = self._waits_for(first)
        if any(row.defers for row in rows):
            context.interlocks.defer_motion()
        if first.repeats_landing and isinstance(motion, LandHere):
            context.retry_in(RETRY_S)
        if first.calls_off(context):
            self.stop()  # else it would be at the end of its leg unwatched
            if context.airspace.change is ZoneChange.UPLOADING or self.last is not None:
                context.airspace.stop_first()
                self.hold("zones are being changed")
        return blocked

    def mission_goes_on(self) -> None:
        """Nothing keeps it waiting: what does next counts from its own begin."""
        self.blocked = None

    def way_found(self) -> None:
        """There is a way: the next reason to wait for one is announced."""
        self.waits_why = None

    def fly_points(self, *, instead: bool) -> None:
        """Nodes are flown to as any other point from now on, or as items of the plan again."""
        self.by_points = instead

    def reacts_within(self, reaction_s: float) -> None:
        """The vehicle follows a command after so long at most, on its clock."""
        self.reaction_s = reaction_s

    def mission_waits(self) -> None:
        """No motion is wanted while a row is raised that holds the vehicle; a landing goes on."""
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
        """What keeps the mission from what it wants; None if nothing does now."""
        found = self.blocked
        return found if found is not None and found.by.raised(self._context) else None

    def send(self, motion: Motion) -> MotionOutcome:
        """The same, whatever stands against it.

        A hold only the operator requests while it is not known whose the vehicle is.
        """
        pending, context = self.pending, self._context
        requested = context.task.state is State.HOLD
        unheard = context.inputs.silent or context.silent_s > 0.0
        if isinstance(motion, HoldHere) and unheard and not requested:
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
        """Stop, unless that is what the vehicle was commanded last."""
        if isinstance(self.last, HoldHere):
            return MotionOutcome.UNDER_WAY
        return self.send(HoldHere(why))

    def stop(self) -> None:
        """Go nowhere from now on."""
        self._context.task.head_for(None)

    def _jump_uncertain(self, jump: FlyToNode) -> bool:
        """Whether a jump would not show which of several orders is followed."""
        if not self.setpoints.under_way(jump):
            return False
        telemetry = self._context.telemetry
        shows = (
            telemetry is not None
            and telemetry.mode is FlightMode.MISSION
            and telemetry.item == self._plan.item_of(jump.node)
        )
        return shows or self.setpoints.given_up(jump)

    # Waiting.

    def wait_for_way(self, refusal: str) -> MotionOutcome:
        """Hover where no way is clear, unless it waits for another already."""
        if self._context.task.retry_at_s is not None:
            if self.last is not None:  # else it was not followed, and is commanded after the pause
                self.hold(refusal)
            return MotionOutcome.WAITS
        return self.wait_here(refusal, FLY_OUT_OR_RELOAD)

    def wait_here(self, why: str, instruction: Instruction) -> MotionOutcome:
        """Hover where no way is clear, announce that once, and check again in a moment."""
        now_s = self._context.now_s
        if why != self.waits_why and now_s >= self._wait_announced_s + ANNOUNCE_AGAIN_S:
            self.waits_why, self._wait_announced_s = why, now_s
            self._context.warn(f"holding: {why}", instruction)
        self.hold(why)
        self._context.retry_in(RETRY_S)
        return MotionOutcome.WAITS

    # What became of them.

    def assume(self, mode: FlightMode) -> None:
        """Take the vehicle in the mode that the pilot (or the start) put it in."""
        self.pending = None
        self.modes = self._assumed = frozenset({mode})

    def ours_in_the_air(self) -> None:
        """The vehicle in the air flies by our commands from now on."""
        context = self._context
        context.authority.fly()
        if context.task.airborne_s is None:
            context.task.fly_since(context.now_s)

    def confirmed(self, event: CommandConfirmed) -> None:
        """The vehicle follows; an older command's late confirmation changes no mode."""
        motion = event.action
        if motion is self.pending:
            self.assume(MODES[type(motion)])
            if isinstance(motion, FlyToNode):
                self.refused_jumps = 0
        elif self.pending is not None:  # what was decided on meanwhile leaves out of its mode
            self._assumed = frozenset({MODES[type(motion)]})
        self.setpoints.confirmed(motion)

    def failed(self, event: CommandFailed) -> None:
        """The vehicle did not follow: once more in a moment, unless it was reported another since.

        What was not sent, because it flew on meanwhile, is checked anew as soon as it may stand.
        """
        if event.action is not self.pending:
            return
        self.pending = self.last = None
        if not event.sent:  # so its mode would be a pilot's
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

    def let_go(self) -> None:
        """The pilot flies."""
        self.stop()
        self.blocked = None
        self.setpoints.forget()
        self.pending = self.last = None
        self.modes = self._assumed = frozenset()
