"""The state HOLD: hovers on request, changes altitude on request, and resumes the mission."""

from __future__ import annotations

import math
from dataclasses import dataclass

from air_router.controller.model import (
    OFF_PLAN,
    Anomaly,
    FlyToNode,
    FlyToPoint,
    Hover,
    MissionContext,
    Refusal,
    Rest,
    Signal,
    State,
    StateHandler,
    Wanted,
)
from air_router.controller.motion import ALTITUDE_M, CommandGate, stopping_point
from air_router.controller.states.goto_state import GotoState, GotoTask
from air_router.controller.states.search_state import SearchState
from air_router.routing import STANDING_M_S
from air_router.vehicle import REQUEST_AGAIN


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """What the vehicle was doing before the hold, to be resumed.

    Attributes:
        state: The state of the mission.
        explores: The vehicle flew the waypoints in order.
        robot: The robot that was sought or hovered over; None in other states.
        goto_task: The remaining points.
        left_s: Remaining time of the state's timer; None if it did not run.
    """

    state: State
    explores: bool
    robot: str | None
    goto_task: GotoTask | None
    left_s: float | None


@dataclass(slots=True, eq=False)
class HoldState(StateHandler):
    """Stops the vehicle, or lets it end its leg if that is as near; resumes later.

    Args:
        context: Telemetry, task and interlocks.
        gate: Commands the hold.
        goto_state: Resumes the flight to points.
        search_state: Resumes the search for a robot.
    """

    _context: MissionContext
    _gate: CommandGate
    _goto_state: GotoState
    _search_state: SearchState
    _held: ResumePoint | None = None
    _altitude_m: float | None = None  # requested since it stopped

    def stop(self, by: str) -> None:
        """Hold, as `by` requested; the current state can be resumed with its remaining time."""
        context, goto_task = self._context, self._goto_state.goto_task
        task, explores = context.task, context.task.spec.explores
        self._held = ResumePoint(
            context.task.state, explores, task.robot, goto_task, context.left_s
        )
        context.inform(f"holding, requested by {by}")
        context.signal(Signal.HOLD)

    def resume(self, by: str) -> str:
        """Resume what was held, as `by` requested; return what the vehicle does, as text."""
        held, context = self._held, self._context
        assert held is not None  # noqa: S101 - what HOLD is entered with
        if held.state is State.HOME:
            context.come_home(f"{by}'s request", by_request=True)
            return "it comes home"
        if held.state is State.GOTO and held.goto_task is not None:
            self._goto_state.set_out(held.goto_task, held.left_s)
            return "it flies on to the remaining points"
        if held.robot is not None:
            self._search_state.seek(held.robot)
            return f"it seeks {held.robot} again"
        if held.explores and held.left_s is not None:
            context.task.carry(held.left_s)
        context.signal(Signal.RESUMED)
        return "it resumes"

    @property
    def only_altitudes(self) -> str:
        """Which altitudes are allowed, and how to allow others."""
        low_m, high_m = self._context.airspace.mission.altitudes_m
        flown = f"{low_m:g} m" if low_m == high_m else f"{low_m:g} to {high_m:g} m"
        return f"only {flown} above home is flown; 'altitudes_m' in the mission allows others"

    def why_no_climb(self, altitude_m: float) -> tuple[Refusal, str] | None:
        """Why the vehicle may not change to another altitude above home; None if it may."""
        low_m, high_m = self._context.airspace.mission.altitudes_m
        if not low_m <= altitude_m <= high_m:
            return Refusal.ALTITUDE, self.only_altitudes
        if self._context.task.state is not State.HOLD:
            return Refusal.BUSY, "its altitude is changed while it hovers: request 'hold' first"
        context, gate = self._context, self._gate
        if context.interlocks.is_raised(Anomaly.FOREIGN_ORDER):
            return (
                Refusal.BUSY,
                "it may be following a foreign command; request it again in a moment",
            )
        off = context.interlocks.first_raised(*OFF_PLAN)
        if off is not None:
            return Refusal.BUSY, f"{off}; request it again once that is over"
        telemetry = context.last_telemetry
        moves = math.hypot(*telemetry.velocity_m_s) >= STANDING_M_S
        if moves or gate.pending or gate.setpoints.open(telemetry):
            return Refusal.BUSY, "it does not hover yet; request it again in a moment"
        return None

    def climb(self, altitude_m: float) -> None:
        """Climb or descend in place; all zones between the mission's altitudes apply."""
        self._altitude_m = altitude_m
        self._gate.command(self._level(altitude_m))

    def stay(self) -> bool:
        """Stop a climb or descent; return whether there was one."""
        climbs, self._altitude_m = self._altitude_m is not None, None
        if climbs:
            self._gate.hold("hold was requested")
        return climbs

    def _level(self, altitude_m: float) -> FlyToPoint:
        """Straight up or down from where the vehicle stops."""
        place = stopping_point(self._context.last_telemetry, self._gate.reaction_s)
        return FlyToPoint(place, altitude_m)

    def replan(self) -> Wanted:
        """Fly to the altitude, if one was requested."""
        if self._altitude_m is None:
            return Rest("it hovers here")
        return self._level(self._altitude_m)

    def begin(self) -> Wanted:
        """Stop the vehicle."""
        self._altitude_m = None
        return Hover("hold was requested", at_leg_end=self._stops_anyway())

    def retry(self) -> Wanted:
        """Continue an interrupted climb or descent; give up one that the vehicle did not follow."""
        altitude_m, here_m = self._altitude_m, self._context.last_telemetry.altitude_m
        under_way = altitude_m is not None and abs(here_m - altitude_m) > ALTITUDE_M
        if under_way and self._gate.last is not None:
            return self.replan()
        if under_way:
            self._context.warn(
                f"it holds at {here_m:.0f} m above home: it did not follow the command to "
                f"{altitude_m:g} m",
                REQUEST_AGAIN,
            )
        return self.begin()

    def _stops_anyway(self) -> bool:
        """Whether the current leg ends no farther away than braking would now.

        A hold near the end of a leg makes the vehicle stop later, perhaps outside the checked area.
        """
        gate, telemetry = self._gate, self._context.telemetry
        last = gate.last
        if gate.pending or telemetry is None or not isinstance(last, FlyToNode | FlyToPoint):
            return False
        here = telemetry.position
        rest = stopping_point(telemetry, gate.reaction_s)
        return math.dist(here, last.position) <= math.dist(here, rest)
