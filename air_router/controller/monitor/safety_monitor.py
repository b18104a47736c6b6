"""What telemetry shows that we have not decided: breaches, another's orders.

Pure; each sentence that comes back is for the pilot and the operator.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.monitor.flight_phase import ALTITUDE_M
from air_router.controller.motion.command_gate import CommandedMode
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.mission import Mission
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point

FOREIGN_ORDER_S: Final = 1.5
"""How long an order that is not ours has to show: our own shows late on a slow link."""

FOREIGN_TARGET_M: Final = 4.0
"""A target so far from ours is not ours; the autopilot's position estimate wanders less."""

BRAKED_S: Final = 3.0
"""After so long in Hold the place that it hovers at is where we stopped it."""

HOVERS_M: Final = 2.0
"""A vehicle that was stopped and is nearer than this to the target that it reports hovers there.

One that is farther off reports the target of before the stop: its stream may be late."""

HOVERS_M_S: Final = 1.0
"""A vehicle that is faster than this has not stopped yet."""

BRAKING_M: Final = 15.0
"""It stops nearer than this to where it is then; a place farther off is another's order."""

_ELSEWHERE: Final = "a pilot or ground station gave it another place to go to"


class EventKind(Enum):
    """What was found."""

    GOOD = "the mission may go on"
    FOREIGN_ORDER = "the vehicle follows an order that is not ours"
    BREACH = "in a no-fly zone or outside a fence"


class MonitorEvent(NamedTuple):
    """A sign, and what to say about it."""

    kind: EventKind
    words: str = ""  # announced


_GOOD: Final = MonitorEvent(EventKind.GOOD)


@dataclass(slots=True, eq=False)
class SafetyMonitor:
    """Looks at every telemetry of a vehicle that flies by our commands.

    Args:
        context: The mission and its airspace.
        plan: The plan on board, for the autopilot's item numbers.
    """

    _context: MissionContext
    _plan: FlightPlan
    _foreign_since_s: float | None = None  # an order that is not ours shows
    _jump: tuple[FlyToNode, int] | None = None  # the last commanded, and its plan item
    _held: tuple[HoldHere, float, Point | None] | None = None  # hold, since when, target
    # Nothing is near this place, so far, among the zones of this mission.
    _clear: tuple[Point, float, Mission] | None = None

    @property
    def doubts(self) -> bool:
        """Whether an order that is not ours shows, if not for long enough to be sure of it."""
        return self._foreign_since_s is not None

    def look(
        self, telemetry: Telemetry, commanded_mode: CommandedMode, leaving: Collection[str] = ()
    ) -> MonitorEvent:
        """What keeps the mission from going on now, the gravest first.

        To be in a zone of `leaving` is no breach: it was drawn over the vehicle, which leaves it.
        """
        foreign = self._foreign_order(telemetry, commanded_mode)
        if foreign is None:
            self._foreign_since_s = None
        else:
            order, told_s = foreign
            if self._foreign_since_s is None:
                self._foreign_since_s = telemetry.told_s
            shown_s = telemetry.told_s - self._foreign_since_s
            # One message, that may be of before our own order, is no proof.
            if told_s < shown_s and shown_s >= FOREIGN_ORDER_S:
                return MonitorEvent(EventKind.FOREIGN_ORDER, order)
        breach = self.breach(telemetry, leaving)
        return _GOOD if breach is None else MonitorEvent(EventKind.BREACH, breach)

    def breach(self, telemetry: Telemetry, leaving: Collection[str] = ()) -> str | None:
        """Whether the vehicle in the air is in a no-fly zone or outside a fence."""
        here, mission, clear = telemetry.position, self._context.mission, self._clear
        if not telemetry.in_air:
            return None
        if clear is not None and clear[2] is mission and math.dist(here, clear[0]) < clear[1]:
            return None
        # What is near neither below nor above is near at no altitude.
        everywhere = (mission.climb_airspace, mission.above_airspace)
        clear_m = min(airspace.distance_m(here) for airspace in everywhere)
        self._clear = (here, clear_m, mission)
        inside = mission.airspace_at(telemetry.altitude_m).holders(here)
        holders = [name for name in inside if name not in leaving]
        return f"breach of {', '.join(holders)}" if holders else None

    def _foreign_order(
        self, telemetry: Telemetry, commanded_mode: CommandedMode
    ) -> tuple[str, float] | None:
        """An order that is not ours and needed no other mode, and the age of what shows it.

        A pilot who pauses or sends the vehicle elsewhere while it hovers in Hold by our command
        changes no mode, and one who jumps to another plan item in Mission mode neither.
        """
        if commanded_mode.pending is not None or not telemetry.in_air:
            return None
        order, ages = None, telemetry.ages
        match commanded_mode.last:
            case FlyToNode() as jump if telemetry.mode is FlightMode.MISSION:
                if self._jump is None or self._jump[0] is not jump:
                    self._jump = (jump, self._plan.item_of(jump.node))
                if telemetry.item not in {None, self._jump[1]}:
                    return "a pilot or ground station chose another plan item", ages.item_s
            case FlyToPoint(position=position) if telemetry.mode is FlightMode.HOLD:
                order = _elsewhere(telemetry, position)
            case HoldHere() as hold if telemetry.mode is FlightMode.HOLD:
                order = self._moved_from_hold(hold, telemetry)
        return None if order is None else (order, ages.target_s)

    def _moved_from_hold(self, hold: HoldHere, telemetry: Telemetry) -> str | None:
        if self._held is None or self._held[0] is not hold:
            self._held = (hold, telemetry.told_s, None)
        _, since_s, place = self._held
        if place is not None:
            return _elsewhere(telemetry, place)
        if telemetry.told_s - since_s >= BRAKED_S:
            target, speed_m_s = telemetry.target, math.hypot(*telemetry.velocity_m_s)
            off_m = 0.0 if target is None else math.dist(target, telemetry.position)
            if off_m > BRAKING_M:
                return _ELSEWHERE
            if off_m <= HOVERS_M and speed_m_s <= HOVERS_M_S:
                self._held = (hold, since_s, target)
        return None


def _elsewhere(telemetry: Telemetry, ours: Point) -> str | None:
    target = telemetry.target
    if target is None or math.dist(target, ours) <= FOREIGN_TARGET_M:
        return None
    return _ELSEWHERE


def low(mission: Mission, telemetry: Telemetry) -> bool:
    """Whether the vehicle is below the mission's altitude, where no leg was checked."""
    altitude_m = mission.altitude_above_home_m
    return telemetry.altitude_m < altitude_m - min(ALTITUDE_M, altitude_m / 2)


def why_not_resumed(mission: Mission, telemetry: Telemetry | None) -> str | None:
    """Why a flight that the operator asks to be resumed cannot be, as it is now; None if it can."""
    if telemetry is None or not telemetry.in_air:
        return "the vehicle is on the ground: start the mission anew"
    holders = mission.airspace_at(telemetry.altitude_m).holders(telemetry.position)
    reasons = {
        "a failsafe of the autopilot acts: choose Hold first": telemetry.failsafe,
        f"it flies in {telemetry.mode.value} mode: choose Hold first": telemetry.mode
        not in {FlightMode.HOLD, FlightMode.MISSION},
        "GPS has no fix: wait for it": not telemetry.fix,
        f"it is in {', '.join(holders)}: fly it out by hand first": bool(holders),
        f"it is {telemetry.altitude_m:.0f} m above home, in the layer of another UAV: descend to "
        f"{mission.altitude_above_home_m:.0f} m first": telemetry.altitude_m > mission.layer_top_m,
    }
    return next((reason for reason, holds in reasons.items() if holds), None)
