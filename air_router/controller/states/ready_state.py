"""The state READY: the take-off to the mission's altitude, by this program or by a pilot."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from air_router.controller.model import (
    HandoverHold,
    HoldHere,
    MissionContext,
    PlanOwner,
    Signal,
    StateHandler,
)
from air_router.controller.motion import ClimbWatch, CommandGate, below
from air_router.controller.states.limits import HOME_TOLERANCE_M
from air_router.vehicle import (
    BE_READY_AT_HOME,
    DESCEND,
    LAND_AND_START_AGAIN,
    FlightMode,
    Telemetry,
)


class TakeOff(Enum):
    """The stage of the take-off."""

    TO_COME = "on the ground, climbing above home, or not in Mission mode"
    COMPLETE = "in Mission mode at the mission's altitude"
    MISPLACED = "in Mission mode, low and away from home: PX4 flies home from there unchecked"
    TOO_HIGH = "in Mission mode, in the layer of another UAV, or above it"


HELD: Final = {
    TakeOff.MISPLACED: HandoverHold(
        "Mission was chosen low and away from home", LAND_AND_START_AGAIN
    ),
    TakeOff.TOO_HIGH: HandoverHold("Mission was chosen in another UAV's layer", DESCEND),
}
"""Take-offs that are not continued, with the pilot's instruction."""


def take_off(context: MissionContext, telemetry: Telemetry) -> TakeOff:
    """The stage of a take-off, by this program or by a pilot.

    The take-off is complete at the mission's altitude, at any position: from then on every leg is
    checked from the vehicle's position. Mission mode chosen below that, and farther from home than
    a vehicle may start, is no take-off of this mission: a pilot flew away by hand. With several
    UAVs the vehicle may also be too high: its first leg would descend through other UAVs' layers.
    """
    if not (telemetry.in_air and telemetry.mode is FlightMode.MISSION):
        return TakeOff.TO_COME
    mission = context.airspace.mission
    if telemetry.altitude_m > context.layer_top_m:
        return TakeOff.TOO_HIGH
    if not below(mission.altitude_above_home_m, telemetry):
        return TakeOff.COMPLETE
    away_m = math.dist(telemetry.position, mission.home)
    return TakeOff.MISPLACED if away_m > HOME_TOLERANCE_M else TakeOff.TO_COME


@dataclass(slots=True, eq=False)
class ReadyState(StateHandler):
    """Monitors the take-off; it may hold the vehicle or end the mission.

    Args:
        context: Knows whether the flight was handed over; receives the signal that it is at
            altitude.
        gate: Commands a hold.
    """

    _context: MissionContext
    _gate: CommandGate
    _rise: ClimbWatch = field(default_factory=ClimbWatch)

    def why_not_started(self, before: Telemetry, *, armed: bool) -> str | None:
        """Why the vehicle cannot be started: what a pilot or ground station did meanwhile.

        Args:
            before: Telemetry at the time the vehicle was found.
            armed: This program armed the vehicle.
        """
        context = self._context
        if context.authority.on_board is not PlanOwner.OURS:
            return "a ground station has uploaded another plan or fence"
        now = context.telemetry
        if now is None:
            return None
        if now.in_air or (now.armed and not armed):
            return "the pilot has armed the vehicle"
        if now.mode not in {before.mode, FlightMode.HOLD, FlightMode.MISSION}:
            return f"the pilot chose {now.mode.value} mode meanwhile"
        return None

    def disarmed(self) -> None:
        """The vehicle was armed and disarmed on the ground; the pilot may start again."""
        self._rise = ClimbWatch()
        self._context.inform("disarmed before take-off: still waiting for the pilot to arm")

    def watch(self, telemetry: Telemetry) -> None:
        """Start the mission at its altitude; hold after a take-off that it cannot continue."""
        context, gate = self._context, self._gate
        stage = take_off(context, telemetry)
        if stage is TakeOff.COMPLETE:
            gate.assume(FlightMode.MISSION)
            gate.ours_in_the_air()
            context.signal(Signal.AIRBORNE)
        elif stage in HELD and gate.pending is None:
            held = HELD[stage]
            context.authority.hold(held)
            context.alarm_until_over(
                held.why,
                f"holding: {held.why}",
                held.instruction,
                lasting=f"holding: {held.why},",
                since_s=context.now_s,
            )
            gate.command(HoldHere(stage.value))
        elif context.authority.held is None and self._stuck(telemetry) and gate.pending is None:
            context.come_home("the climb has stopped", BE_READY_AT_HOME)

    def _stuck(self, telemetry: Telemetry) -> bool:
        """Whether a climb that was handed over has made no progress for some time."""
        rises = self._context.authority.handed_over and telemetry.in_air
        return rises and self._rise.stuck(telemetry)
