"""What telemetry shows that we have not decided: landing, home moved, others' orders, breaches.

Pure; each sentence that comes back is for the pilot and the operator.
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
    """What has been seen of arming, lift-off and touch-down.

    Args:
        context: Receives the signal when the pilot hands the flight over to us.
        gate: Takes it over in Mission mode.

    Attributes:
        flies: In the air with its motors on, as it reported last.
        killed: Where its motors were stopped in the air, as text, if they were.
    """

    _context: MissionContext
    _gate: CommandGate
    flies: bool = False
    killed: str | None = None
    _flew: bool = False  # seen in the air
    _was_armed: bool = False  # since the hand-over
    _news: bool = False  # its motors were stopped, and that is not announced yet
    _rest: tuple[float, float] = (0.0, 0.0)  # altitude that stays the same, and since when
    _up_s: float = -math.inf  # when it was armed or in the air last, vehicle's clock

    def note(self, telemetry: Telemetry) -> None:
        """Take a telemetry update in; armed in Mission mode the vehicle is handed over."""
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
        """PX4 reports within a second that a vehicle disarmed in the air has landed.

        Where another vehicle is on the link, one that stands on the ground may have said it.
        """
        if self._context.authority.wrong_vehicle is not None:
            return
        motors = telemetry.armed and not telemetry.terminated
        if flew and not motors and telemetry.altitude_m > KILLED_M:
            how = "flight terminated" if telemetry.armed else "disarmed"
            self.killed = f"{how} in the air at {telemetry.altitude_m:.0f} m above home"
            self._news = True
            self._rest = (telemetry.altitude_m, telemetry.time_s)
        elif self.flies:
            self.killed = None  # and it flies again
        elif abs(telemetry.altitude_m - self._rest[0]) >= REST_M:
            self._rest = (telemetry.altitude_m, telemetry.time_s)

    def killed_now(self) -> str | None:
        """Where its motors were stopped in the air, as text; reports it once."""
        news, self._news = self._news, False
        return self.killed if news else None

    def over(self, telemetry: Telemetry) -> bool:
        """Whether it is disarmed after having been armed: then it is down, unless it falls.

        Where no HEARTBEAT tells it any more, what is on the ground after a flight is disarmed. With
        two vehicles on the link none may have flown for as long as both report by turns.
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
        """Whether it was only armed and disarmed again; then everything begins anew."""
        if self._flew:
            return False
        self._was_armed = False
        self._context.authority.begin_anew()
        self._gate.let_go()
        return True

    def ending(self, *, landed_by_us: bool) -> str:
        """How it ended, as text."""
        context = self._context
        if self.killed is not None:
            return self.killed
        if landed_by_us:
            return f"landed {context.task.ending.place if context.task.ending else 'at home'}"
        if context.authority.stopped_why is not None:
            why = context.authority.stopped_why
            return f"{why} as it took off; it is on the ground: start the mission anew"
        if self._flew:
            return "landed, but not by our command"
        return f"{context.task.stayed_why}, before take-off"


class Response(Enum):
    """What follows something that is off what was planned."""

    ANNOUNCE = "nothing but words"
    HOLD = "it holds, and goes on when it stands"
    WAIT = "it holds until the deviation is over"
    BACK = "the deviation is over: what waited goes on"
    HOME = "it comes home"


class Deviation(NamedTuple):
    """What to announce, and what to do about it.

    Attributes:
        response: What follows.
        words: Announced; empty: nothing is.
        instruction: What the pilot or the operator does; None: it is over.
        counts: Held for again and again, the vehicle comes home instead.
        alarms: The pilot has to act now.
        anomaly: The interlock that it raises, with the response WAIT, or clears, with any other.
    """

    response: Response
    words: str
    instruction: Instruction | None
    counts: bool = False
    alarms: bool = False
    anomaly: Anomaly | None = None


@dataclass(slots=True, eq=False)
class HomeWatch:
    """Watches the autopilot's home, and the altitude of a receiver beside it.

    Attributes:
        receiver_off_m: How far the altitude of the satellite receiver has drifted from the
            autopilot's since the take-off, smoothed.
        in_doubt: One of the two altitudes is far off, and it is not known which; that stays so.
    """

    _context: MissionContext
    receiver_off_m: float = 0.0
    in_doubt: bool = False
    _first: list[float] = field(default_factory=list)  # how far off in the first seconds
    _first_at_s: float = math.inf
    _receiver_at_s: float = 0.0  # of the telemetry before
    _receiver_announced_m: float = 0.0  # the greatest limit announced
    _announced: HomeMove | None = None  # where home was moved to, as announced
    # When PX4 had a reason last to set home anew itself, and which; vehicle's clock.
    _px4_sets: tuple[float, str] = (-math.inf, "")

    def note(self, telemetry: Telemetry) -> None:
        """Take in whether PX4 itself may set home: it does at each lift-off, and corrects it.

        One that has touched down and is up again counts as lifted off.
        """
        if not telemetry.in_air or not telemetry.armed:
            self._px4_sets = (telemetry.time_s, "as it lifted off or touched down")
        elif not telemetry.fix:
            self._px4_sets = (telemetry.time_s, "while GPS has no fix")

    def update(self, telemetry: Telemetry) -> Response | None:
        """Whether home was moved since it was announced last, in any state; says so."""
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
            more = ""  # its place is announced in a message of its own
        where = moved.words(before_m)
        if telemetry.time_s - sets_s < PX4_SETS_HOME_S:
            context.warn(
                f"home was set anew {reason}, as PX4 does itself: {where}{more}", RETURN_ELSEWHERE
            )
        else:
            context.warn(f"home was moved: {where}{more}", NO_OTHER_HOME)
        if again or not moved.changes_heights:
            return Response.ANNOUNCE
        return Response.HOLD

    def anomaly(self, telemetry: Telemetry) -> Deviation | None:
        """Whether the satellites' altitude has left the autopilot's, by more than was reported."""
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
    """An order that the vehicle seems to follow, and that is not ours.

    Attributes:
        words: Whose it may be.
        sure: It has shown for long enough.
    """

    words: str
    sure: bool


@dataclass(slots=True, eq=False)
class SafetyMonitor:
    """Checks every telemetry update of a vehicle that flies by our commands.

    Args:
        context: The mission and its airspace.
        gate: The last command to the vehicle.
        plan: The plan on board, for the autopilot's item numbers.
    """

    _context: MissionContext
    _gate: CommandGate
    _plan: FlightPlan
    _foreign_since_s: float | None = None  # an order that is not ours shows
    _known: tuple[Motion, ...] = ()  # the orders of ours that the vehicle may follow
    _known_since_s: float = -math.inf  # since when, vehicle's clock
    _followed_jump: tuple[FlightMode, FlyToNode, int | None] | None = (
        None  # seen to fly to that item
    )
    # hold, since when, target, its altitude
    _held: tuple[HoldHere, float, Point | None, float | None] | None = None
    # Nothing is near this place, so far, among the zones of this mission.
    _clear: tuple[Point, float, Mission] | None = None

    def foreign_order(self, telemetry: Telemetry) -> ForeignOrder | None:
        """The order that the vehicle seems to follow and that is not ours; None if there is none.

        A pilot who pauses or sends the vehicle elsewhere while it hovers in Hold by our command
        changes no mode, and one who jumps to another plan item in Mission mode neither. While an
        order of ours waits, or is not confirmed, the vehicle may follow that or any before it.
        """
        gate, ages, order = self._gate, telemetry.ages, None
        last = gate.last if gate.pending is None else None
        as_commanded = self._followed_jump == (telemetry.mode, gate.last, telemetry.item)
        if telemetry.in_air and not as_commanded:
            order = self._order_of_others(telemetry, last)
        report_age_s = ages.item_s if telemetry.mode is FlightMode.MISSION else ages.target_s
        known = tuple(gate.setpoints.all_known)
        if known != self._known:
            self._known, self._known_since_s = known, telemetry.received_s
        # While ours waits, an earlier report may be of an order that is void by now.
        before = telemetry.received_s - report_age_s < self._known_since_s
        old = gate.pending is not None and before and self._foreign_since_s is None
        if order is None or report_age_s >= ORDER_STALE_S or old:
            self._foreign_since_s = None
            return None
        if self._foreign_since_s is None:
            self._foreign_since_s = telemetry.received_s
        shown_s = telemetry.received_s - self._foreign_since_s
        # One message, that may be of before our own order, is no proof.
        return ForeignOrder(order, sure=report_age_s < shown_s and shown_s >= FOREIGN_ORDER_S)

    def _order_of_others(self, telemetry: Telemetry, last: Motion | None) -> str | None:
        """What the vehicle follows in the mode of our order, and that is another; None if not."""
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
            case None:  # it did not follow: it may do so yet, or goes on with what was before
                ours = [m for m in self._gate.setpoints.all_known if MODES[type(m)] is mode]
                # However often it was commanded to hold, it holds since the first time.
                holds = [motion for motion in ours if isinstance(motion, HoldHere)]
                ours = [motion for motion in ours if motion not in holds[1:]]
                found = [self._order_of_others(telemetry, motion) for motion in ours]
                return found[-1] if found and all(found) else None
        return None

    def _moved_from_hold(self, hold: HoldHere, telemetry: Telemetry) -> str | None:
        if self._held is None or self._held[0] is not hold:
            self._held = (hold, telemetry.received_s, None, None)
        _, since_s, place, altitude_m = self._held
        if place is not None:
            return _elsewhere(telemetry, place, altitude_m)
        if telemetry.ages.position_s >= OLD_POSITION_S:
            return None  # where its target lies from here is not known
        if telemetry.received_s - since_s >= BRAKED_S:
            target, speed_m_s = telemetry.target, math.hypot(*telemetry.velocity_m_s)
            off_m = 0.0 if target is None else math.dist(target, telemetry.position)
            if off_m > HOLD_STOPS_M:
                return _ELSEWHERE
            if off_m <= HOVERS_M and speed_m_s <= HOVERS_M_S:
                self._held = (hold, since_s, target, telemetry.target_altitude_m)
        return None

    def position_unknown(self, telemetry: Telemetry) -> str | None:
        """Why it is not known where the vehicle in the air is; None if it is.

        Without satellites PX4 goes on with what it makes of its other sensors, which drifts by
        hundreds of metres a minute.
        """
        accuracy_m, kept_m = (
            telemetry.accuracy_m or 0.0,
            self._context.airspace.mission.planner.clearance_m,
        )
        position_s = telemetry.ages.position_s
        if not telemetry.in_air:
            return None
        if not telemetry.fix:
            return NO_FIX
        if accuracy_m > kept_m:
            return f"satellites good to {accuracy_m:.0f} m only, and zones are kept from {kept_m:g}"
        if position_s >= OLD_POSITION_S:
            return f"position not heard for {position_s:.0f} s"
        return None

    def breach(self, telemetry: Telemetry, exempt_zones: Collection[str] = ()) -> str | None:
        """Whether the vehicle in the air is in a no-fly zone or outside a fence, as far as known.

        Where it is not known where it is, an input is missing, which is held for and alarmed of.
        """
        here, mission, clear = telemetry.position, self._context.airspace.mission, self._clear
        if not telemetry.in_air or self.position_unknown(telemetry) is not None:
            return None
        if clear is not None and clear[2] is mission and math.dist(here, clear[0]) < clear[1]:
            return None
        # What is near neither below nor above is near at no altitude.
        everywhere = (mission.climb_airspace, mission.above_airspace)
        clear_m = min(airspace.distance_m(here) for airspace in everywhere)
        self._clear = (here, clear_m, mission)
        lands = self._context.task.state is State.LAND  # into what is below, too
        airspace = mission.climb_airspace if lands else mission.airspace_at(telemetry.altitude_m)
        holders = [name for name in airspace.zones_at(here) if name not in exempt_zones]
        return f"breach of {', '.join(holders)}" if holders else None


def _elsewhere(telemetry: Telemetry, ours: Point, altitude_m: float | None) -> str | None:
    return None if telemetry.bound_for(ours, altitude_m, FOREIGN_TARGET_M) else _ELSEWHERE
