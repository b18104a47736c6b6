"""Detects what this program did not command: landing, a moved home, foreign commands, breaches.

Pure. The returned texts are for the pilot and the operator.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from enum import Enum
from statistics import median
from typing import Final, NamedTuple

from air_router.controller.limits import (
    ALTITUDE_AVERAGE_S,
    ALTITUDE_DISAGREES_HOME_M,
    ALTITUDE_DISAGREES_M,
    ALTITUDE_SAMPLE_M,
    ALTITUDE_SAMPLE_S,
    BRAKED_S,
    DISARMED_S,
    FOREIGN_ORDER_S,
    FOREIGN_TARGET_M,
    HOLD_STOPS_M,
    HOME_MOVED_AGAIN_M,
    HOVERS_M,
    HOVERS_M_S,
    KILLED_M,
    OLD_POSITION_S,
    ORDER_STALE_S,
    PX4_SETS_HOME_S,
    REST_M,
    REST_S,
    TWINS_S,
)
from air_router.controller.model import (
    Anomaly,
    FlyToNode,
    FlyToPoint,
    HoldHere,
    MissionContext,
    Motion,
    PlanOwner,
    State,
)
from air_router.controller.motion import MODES, CommandGate
from air_router.mission import FlightPlan, Mission
from air_router.vehicle import (
    NO_FIX,
    NO_OTHER_HOME,
    RETURN_ELSEWHERE,
    WATCH_HEIGHT,
    FlightMode,
    HomeMove,
    Instruction,
    Telemetry,
)
from geo.frame import Point

_ELSEWHERE: Final = "a pilot or ground station gave it another place to go to"


@dataclass(slots=True, eq=False)
class FlightPhase:
    """Tracks arming, lift-off and touch-down.

    Args:
        context: Notes that the pilot hands the flight over.
        gate: Accepts Mission mode at the hand-over.

    Attributes:
        flies: In the air with its motors on, by the last telemetry.
        killed: Where the motors were stopped in the air, as text; None: they were not.
    """

    _context: MissionContext
    _gate: CommandGate
    flies: bool = False
    killed: str | None = None
    _flew: bool = False  # it was in the air
    _was_armed: bool = False  # since the hand-over
    _fall_pending: bool = False  # the fall is not announced yet
    _rest: tuple[float, float] = (0.0, 0.0)  # last altitude change: altitude, time
    _up_s: float = -math.inf  # when it was last armed or in the air, vehicle's clock

    def note(self, telemetry: Telemetry) -> None:
        """Update from telemetry; a vehicle armed in Mission mode is handed over."""
        flew = self.flies
        self.flies = telemetry.armed and telemetry.in_air and not telemetry.terminated
        if not (self.flies and flew):
            self._fall(telemetry, flew=flew)
        self._flew |= telemetry.in_air
        self._was_armed |= telemetry.armed
        if telemetry.armed or telemetry.in_air:
            self._up_s = telemetry.received_s
        ready = self._context.task.state is State.READY and not self._context.authority.handed_over
        if ready and telemetry.armed and telemetry.mode is FlightMode.MISSION:
            self._context.authority.hand_over()
            self._gate.assume(FlightMode.MISSION)
            if self._context.authority.on_board is PlanOwner.REPLACED:
                self._context.authority.check_plan("the plan on board was replaced")

    def _fall(self, telemetry: Telemetry, *, flew: bool) -> None:
        """Detect a fall: PX4 reports within a second that a vehicle disarmed in the air has landed.

        With another vehicle on the link, that vehicle may have reported it from the ground.
        """
        if self._context.authority.wrong_vehicle is not None:
            return
        motors = telemetry.armed and not telemetry.terminated
        if flew and not motors and telemetry.altitude_m > KILLED_M:
            how = "flight terminated" if telemetry.armed else "disarmed"
            self.killed = f"{how} in the air at {telemetry.altitude_m:.0f} m above home"
            self._fall_pending = True
            self._rest = (telemetry.altitude_m, telemetry.time_s)
        elif self.flies:
            self.killed = None  # it flies again
        elif abs(telemetry.altitude_m - self._rest[0]) >= REST_M:
            self._rest = (telemetry.altitude_m, telemetry.time_s)

    def killed_now(self) -> str | None:
        """Where the motors were stopped in the air, as text; reports it once."""
        pending, self._fall_pending = self._fall_pending, False
        return self.killed if pending else None

    def over(self, telemetry: Telemetry) -> bool:
        """Whether the flight is over: disarmed after it was armed, and not falling.

        If no HEARTBEAT is received anymore, a vehicle on the ground after a flight counts as
        disarmed. With two vehicles on the link both must have been on the ground for `TWINS_S`,
        since they report in turns.
        """
        if self._context.authority.wrong_vehicle is not None:
            return self._was_armed and telemetry.received_s - self._up_s >= TWINS_S
        if self.killed is not None:
            down = telemetry.received_s - self._rest[1] >= REST_S
            return down and not telemetry.armed
        if telemetry.ages.armed_s >= DISARMED_S and self._flew:
            return not telemetry.in_air
        return self._was_armed and not telemetry.armed

    def again(self) -> bool:
        """Whether it was only armed and disarmed; then the take-off starts over."""
        if self._flew:
            return False
        self._was_armed = False
        self._context.authority.begin_anew()
        self._gate.forget_commands()
        return True

    def ending(self, *, landed_by_us: bool) -> str:
        """How the flight ended, as text."""
        context = self._context
        if self.killed is not None:
            return self.killed
        if landed_by_us:
            return f"landed {context.task.ending.place if context.task.ending else 'at home'}"
        if context.authority.stopped_why is not None:
            why = context.authority.stopped_why
            return f"{why} as it took off; it is on the ground: start the mission again"
        if self._flew:
            return "landed, but not by our command"
        return f"{context.task.stayed_why}, before take-off"


class Response(Enum):
    """The response to a deviation."""

    ANNOUNCE = "it is announced only"
    HOLD = "it holds, and resumes when it hovers"
    WAIT = "it holds until the deviation is over"
    BACK = "the deviation is over: the mission resumes"
    HOME = "it comes home"


class Deviation(NamedTuple):
    """A deviation to announce, and the response.

    Attributes:
        response: What the vehicle does.
        words: The announcement; empty: none.
        instruction: Action of the pilot or the operator; None: the deviation is over.
        counts: After several holds for such deviations the vehicle comes home instead.
        alarms: The pilot has to act now.
        anomaly: The interlock raised by the response WAIT and cleared by any other.
    """

    response: Response
    words: str
    instruction: Instruction | None
    counts: bool = False
    alarms: bool = False
    anomaly: Anomaly | None = None


@dataclass(slots=True, eq=False)
class HomeWatch:
    """Monitors PX4's home, and compares PX4's altitude with the satellite receiver's.

    Attributes:
        receiver_off_m: Smoothed drift of the receiver's altitude from PX4's since the take-off.
        in_doubt: One of the two altitudes is far off, and it is unknown which. Stays set.
    """

    _context: MissionContext
    receiver_off_m: float = 0.0
    in_doubt: bool = False
    _first: list[float] = field(default_factory=list)  # differences in the first seconds
    _first_at_s: float = math.inf  # time of the first of them, vehicle's clock
    _receiver_at_s: float = 0.0  # time of the previous telemetry
    _receiver_announced_m: float = 0.0  # the largest limit announced
    _announced: HomeMove | None = None  # the last announced move of home
    # When and why PX4 last may have set home on its own; vehicle's clock.
    _px4_sets: tuple[float, str] = (-math.inf, "")

    def note(self, telemetry: Telemetry) -> None:
        """Note when PX4 may set home on its own: at each lift-off, and later corrections.

        A vehicle that touched down and is in the air again has lifted off.
        """
        if not telemetry.in_air or not telemetry.armed:
            self._px4_sets = (telemetry.time_s, "as it lifted off or touched down")
        elif not telemetry.fix:
            self._px4_sets = (telemetry.time_s, "while GPS has no fix")

    def update(self, telemetry: Telemetry) -> Response | None:
        """Announce a change of home since the last announcement; return the response."""
        if telemetry.gps_amsl_m is not None and telemetry.altitude_amsl_m is not None:
            off_m = telemetry.gps_amsl_m - telemetry.altitude_amsl_m
            now_s = telemetry.time_s
            self._first_at_s = min(self._first_at_s, now_s)
            if now_s < self._first_at_s + ALTITUDE_AVERAGE_S:
                self._first.append(off_m)
            else:
                passed_s = min(max(now_s - self._receiver_at_s, 0.0), ALTITUDE_SAMPLE_S)
                newest_m = off_m - median(self._first) - self.receiver_off_m
                share = 1.0 - math.exp(-passed_s / ALTITUDE_AVERAGE_S)
                self.receiver_off_m += share * max(
                    -ALTITUDE_SAMPLE_M, min(newest_m, ALTITUDE_SAMPLE_M)
                )
            self._receiver_at_s = now_s
        moved, announced, context = telemetry.home_moved, self._announced, self._context
        if moved is None:
            self._announced = None
            if announced is None:
                return None
            context.inform("home is back in its place")
            return Response.BACK
        if announced is not None and math.dist(moved, announced) < HOME_MOVED_AGAIN_M:
            return None
        self._announced = moved
        amsl_m = telemetry.altitude_amsl_m
        before_m = None if amsl_m is None else amsl_m - telemetry.altitude_m
        sets_s, reason = self._px4_sets
        again = announced is not None and abs(moved.up_m - announced.up_m) < HOME_MOVED_AGAIN_M
        more = "; heights count from the take-off as before"
        if not moved.changes_heights:
            more = "; the autopilot's own Return flies there"
        elif again:
            more = ""  # a horizontal move has its own announcement
        where = moved.words(before_m)
        if telemetry.time_s - sets_s < PX4_SETS_HOME_S:
            context.warn(
                f"home was set again {reason}, as PX4 does on its own: {where}{more}",
                RETURN_ELSEWHERE,
            )
        else:
            context.warn(f"home was moved: {where}{more}", NO_OTHER_HOME)
        if again or not moved.changes_heights:
            return Response.ANNOUNCE
        return Response.HOLD

    def deviation(self, telemetry: Telemetry) -> Deviation | None:
        """The deviation if the receiver's altitude has drifted past a further limit."""
        if abs(self.receiver_off_m) >= ALTITUDE_DISAGREES_HOME_M:
            self.in_doubt = True
        for limit_m, response in (
            (ALTITUDE_DISAGREES_HOME_M, Response.HOME),
            (ALTITUDE_DISAGREES_M, Response.ANNOUNCE),
        ):
            if abs(self.receiver_off_m) >= limit_m > self._receiver_announced_m:
                self._receiver_announced_m = limit_m
                words = (
                    f"the altitude is in doubt: {telemetry.altitude_m:.0f} m by the autopilot, "
                    f"{telemetry.altitude_m + self.receiver_off_m:.0f} m by the satellites"
                )
                return Deviation(response, words, WATCH_HEIGHT)
        return None


class ForeignOrder(NamedTuple):
    """A foreign command that the vehicle seems to follow.

    Attributes:
        words: Who may have sent it.
        sure: It has been visible for long enough.
    """

    words: str
    sure: bool


@dataclass(slots=True, eq=False)
class SafetyMonitor:
    """Checks every telemetry update of a vehicle that this program commands.

    Args:
        context: The mission and its airspace.
        gate: The last command to the vehicle.
        plan: The plan on board, for the autopilot's item numbers.
    """

    _context: MissionContext
    _gate: CommandGate
    _plan: FlightPlan
    _foreign_since_s: float | None = None  # a foreign command is visible since
    _known: tuple[Motion, ...] = ()  # our commands that the vehicle may follow
    _known_since_s: float = -math.inf  # unchanged since, vehicle's clock
    _followed_jump: tuple[FlightMode, FlyToNode, int | None] | None = (
        None  # the vehicle was seen to follow it
    )
    # hold, since when, target, altitude of the target
    _held: tuple[HoldHere, float, Point | None, float | None] | None = None
    # Place, distance to the nearest zone of this mission.
    _clear: tuple[Point, float, Mission] | None = None

    def foreign_order(self, telemetry: Telemetry) -> ForeignOrder | None:
        """The foreign command that the vehicle seems to follow; None if there is none.

        The mode does not change if a pilot pauses or redirects a vehicle that hovers in Hold by our
        command, or jumps to another plan item in Mission mode. While a command of ours is pending,
        the vehicle may follow it or any earlier one.
        """
        gate, ages, order = self._gate, telemetry.ages, None
        last = gate.last if gate.pending is None else None
        as_commanded = self._followed_jump == (telemetry.mode, gate.last, telemetry.item)
        if telemetry.in_air and not as_commanded:
            order = self._foreign_command(telemetry, last)
        report_age_s = ages.item_s if telemetry.mode is FlightMode.MISSION else ages.target_s
        known = tuple(gate.setpoints.all_known)
        if known != self._known:
            self._known, self._known_since_s = known, telemetry.received_s
        # While our command is pending, an earlier report may concern a command that is void now.
        before = telemetry.received_s - report_age_s < self._known_since_s
        old = gate.pending is not None and before and self._foreign_since_s is None
        if order is None or report_age_s >= ORDER_STALE_S or old:
            self._foreign_since_s = None
            return None
        if self._foreign_since_s is None:
            self._foreign_since_s = telemetry.received_s
        shown_s = telemetry.received_s - self._foreign_since_s
        # A single message may predate our own command, so it is no proof.
        return ForeignOrder(order, sure=report_age_s < shown_s and shown_s >= FOREIGN_ORDER_S)

    def _foreign_command(self, telemetry: Telemetry, last: Motion | None) -> str | None:
        """The foreign command that the vehicle follows in the mode of our own; None: none."""
        mode = telemetry.mode
        match last:
            case FlyToNode() as jump if mode is FlightMode.MISSION:
                if telemetry.item not in {None, self._plan.item_of(jump.node)}:
                    return "a pilot or ground station chose another plan item"
                self._followed_jump = (mode, jump, telemetry.item)
            case FlyToPoint(position, altitude_m) if mode is FlightMode.HOLD:
                return _elsewhere(telemetry, position, altitude_m)
            case HoldHere() as hold if mode is FlightMode.HOLD:
                return self._moved_from_hold(hold, telemetry)
            case None:  # it failed: it may still be followed, or an earlier one is
                ours = [m for m in self._gate.setpoints.all_known if MODES[type(m)] is mode]
                # Of several holds only the first matters.
                holds = [motion for motion in ours if isinstance(motion, HoldHere)]
                ours = [motion for motion in ours if motion not in holds[1:]]
                found = [self._foreign_command(telemetry, motion) for motion in ours]
                return found[-1] if found and all(found) else None
        return None

    def _moved_from_hold(self, hold: HoldHere, telemetry: Telemetry) -> str | None:
        if self._held is None or self._held[0] is not hold:
            self._held = (hold, telemetry.received_s, None, None)
        _, since_s, place, altitude_m = self._held
        if place is not None:
            return _elsewhere(telemetry, place, altitude_m)
        if telemetry.ages.position_s >= OLD_POSITION_S:
            return None  # the target's distance is unknown
        if telemetry.received_s - since_s >= BRAKED_S:
            target, speed_m_s = telemetry.target, math.hypot(*telemetry.velocity_m_s)
            off_m = 0.0 if target is None else math.dist(target, telemetry.position)
            if off_m > HOLD_STOPS_M:
                return _ELSEWHERE
            if off_m <= HOVERS_M and speed_m_s <= HOVERS_M_S:
                self._held = (hold, since_s, target, telemetry.target_altitude_m)
        return None

    def position_unknown(self, telemetry: Telemetry) -> str | None:
        """Why the position of the vehicle in the air is unknown; None if it is known.

        Without satellites PX4 estimates its position from other sensors, which drifts by hundreds
        of meters a minute.
        """
        accuracy_m, clearance_m = (
            telemetry.accuracy_m or 0.0,
            self._context.airspace.mission.planner.clearance_m,
        )
        position_s = telemetry.ages.position_s
        if not telemetry.in_air:
            return None
        if not telemetry.fix:
            return NO_FIX
        if accuracy_m > clearance_m:
            return f"GPS accuracy {accuracy_m:.0f} m, and the clearance is {clearance_m:g} m"
        if position_s >= OLD_POSITION_S:
            return f"position not received for {position_s:.0f} s"
        return None

    def breach(self, telemetry: Telemetry, exempt_zones: Collection[str] = ()) -> str | None:
        """Which zone the vehicle in the air is in, or which fence it is outside, as far as known.

        An unknown position is a missing input, with its own hold and alarm.
        """
        here, mission, clear = telemetry.position, self._context.airspace.mission, self._clear
        if not telemetry.in_air or self.position_unknown(telemetry) is not None:
            return None
        if clear is not None and clear[2] is mission and math.dist(here, clear[0]) < clear[1]:
            return None
        # A place that is clear below and above is clear at every altitude.
        everywhere = (mission.climb_airspace, mission.above_airspace)
        clear_m = min(airspace.distance_m(here) for airspace in everywhere)
        self._clear = (here, clear_m, mission)
        lands = self._context.task.state is State.LAND  # also into zones below
        airspace = mission.climb_airspace if lands else mission.airspace_at(telemetry.altitude_m)
        zones = [name for name in airspace.zones_at(here) if name not in exempt_zones]
        return f"breach of {', '.join(zones)}" if zones else None


def _elsewhere(telemetry: Telemetry, ours: Point, altitude_m: float | None) -> str | None:
    return None if telemetry.bound_for(ours, altitude_m, FOREIGN_TARGET_M) else _ELSEWHERE
