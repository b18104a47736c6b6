"""Checks the flight against its plan: altitude, clearance, speed, charge and time.

Every telemetry update is checked while the vehicle flies its mission. `deviations` has the
responses in one table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from air_router.controller.conditions import ConditionsWatch
from air_router.controller.limits import (
    ALTITUDE_DISAGREES_M,
    ALTITUDE_JUMP_CLIMB_M_S,
    ALTITUDE_JUMP_M,
    BACK_AT_ALTITUDE_S,
    CLEARANCE_NOISE_M,
    CLEARANCE_REPEATED_M,
    NEARER_ALTITUDE_M,
    OFF_ALTITUDE_HOME_S,
    OFF_ALTITUDE_M,
    OFF_ALTITUDE_S,
    OVERSPEED,
    OVERSPEED_M_S,
    OVERSPEED_S,
    UNDERSPEED,
    UNDERSPEED_LEG_M,
    UNDERSPEED_S,
)
from air_router.controller.model import (
    Anomaly,
    FlyToNode,
    FlyToPoint,
    HoldHere,
    MissionContext,
    Signal,
    State,
)
from air_router.controller.motion import CommandGate, below
from air_router.controller.safety_monitor import Deviation, HomeWatch, Response
from air_router.controller.states import HomeReachability
from air_router.mission import Mission
from air_router.routing import LANDING_MARGIN, WayHome, names_of
from air_router.vehicle import (
    BE_READY,
    BE_READY_AT_HOME,
    FLY_OUT,
    NO_OTHER_SPEED,
    TOO_MUCH_WIND,
    WATCH_HEIGHT,
    Instruction,
    Telemetry,
)
from geo.frame import Point


@dataclass(slots=True, eq=False)
class HeightWatch:
    """Checks that the vehicle is at the mission's altitudes.

    Args:
        context: The mission's altitudes.
    """

    _context: MissionContext
    _before: tuple[float, float] | None = None  # time, altitude above sea level
    _out_m: float = 0.0  # smallest recent distance from its altitudes
    _out_since_s: float | None = None  # since when it has come no nearer
    _off_since_s: float | None = None  # time of the announcement
    _back_since_s: float | None = None  # at its altitudes again since

    def update(self, telemetry: Telemetry) -> Deviation | None:
        """The deviation when the altitude jumps, is off, or has recovered."""
        band, now_s, before = self._context.airspace.mission.cruise, telemetry.time_s, self._before
        altitude_m = telemetry.altitude_m
        # Independent of home, which PX4 corrects by a meter or two.
        amsl_m = altitude_m if telemetry.altitude_amsl_m is None else telemetry.altitude_amsl_m
        self._before = (now_s, amsl_m)
        slack_m = max(
            OFF_ALTITUDE_M - self._context.airspace.mission.planner.vertical_margin_m, 0.0
        )
        out_m = max(band.lower_m - altitude_m, altitude_m - band.upper_m, slack_m) - slack_m
        gained_m = 0.0 if before is None else amsl_m - before[1]
        passed_s = 0.0 if before is None else max(now_s - before[0], 0.0)
        if abs(gained_m) > ALTITUDE_JUMP_M + ALTITUDE_JUMP_CLIMB_M_S * passed_s:
            words = f"the altitude jumped from {altitude_m - gained_m:.0f} to {altitude_m:.0f} m"
            if out_m == 0.0:
                return Deviation(Response.HOLD, words, WATCH_HEIGHT)
            self._off_since_s, self._back_since_s = now_s, None
            return Deviation(Response.WAIT, words, WATCH_HEIGHT, anomaly=Anomaly.ALTITUDE_JUMP)
        if self._off_since_s is not None:
            return self._while_off(telemetry, out_m, self._off_since_s)
        if out_m == 0.0 or self._out_since_s is None or out_m < self._out_m - NEARER_ALTITUDE_M:
            self._out_m, self._out_since_s = out_m, now_s
            return None
        if now_s - self._out_since_s < OFF_ALTITUDE_S:
            return None
        self._off_since_s, self._back_since_s = now_s, None
        return Deviation(Response.HOLD, f"too {self._off(altitude_m)}", WATCH_HEIGHT, counts=True)

    def _while_off(
        self, telemetry: Telemetry, out_m: float, off_since_s: float
    ) -> Deviation | None:
        now_s = telemetry.time_s
        if out_m == 0.0:
            if self._back_since_s is None:
                self._back_since_s = now_s
            if now_s - self._back_since_s < BACK_AT_ALTITUDE_S:
                return None
            self._off_since_s = self._out_since_s = None
            return Deviation(
                Response.BACK,
                f"at {telemetry.altitude_m:.0f} m again",
                None,
                anomaly=Anomaly.ALTITUDE_JUMP,
            )
        self._back_since_s = None
        if now_s - off_since_s < OFF_ALTITUDE_HOME_S:
            return None
        self._off_since_s = math.inf  # only once, until it has recovered
        return Deviation(
            Response.HOME,
            f"too {self._off(telemetry.altitude_m)}",
            WATCH_HEIGHT,
            anomaly=Anomaly.ALTITUDE_JUMP,
        )

    def _off(self, altitude_m: float) -> str:
        band = self._context.airspace.mission.cruise
        side = "low" if altitude_m < band.lower_m else "high"
        flown = f"{band.lower_m:.0f} to {band.upper_m:.0f} m is flown"
        return f"{side}: {altitude_m:.0f} m above home, {flown}"

    def forget(self) -> None:
        """Reset: the vehicle does not fly its mission now."""
        self._before = self._out_since_s = self._off_since_s = self._back_since_s = None


@dataclass(slots=True, eq=False)
class ClearanceWatch:
    """Checks that the vehicle keeps the clearance from zones and fence.

    Args:
        context: The zones and fences in force.
    """

    _context: MissionContext
    _announced_m: float | None = 0.0  # last announced clearance left; None: kept
    # Clearance left at a place, whether at the cruise altitudes (zones differ elsewhere), mission.
    _clearance_left: tuple[float, Point, bool, Mission] | None = None

    def update(self, telemetry: Telemetry) -> Deviation | None:
        """The deviation when the vehicle comes too near to a zone or fence, or nearer still."""
        here = telemetry.position
        mission, altitude_m = self._context.airspace.mission, telemetry.altitude_m
        cruises = mission.cruises_at(altitude_m)
        if self._clearance_left is not None:
            clear_m, there, cruised, checked_mission = self._clearance_left
            if checked_mission is not mission:
                self._announced_m = 0.0  # a zone may have been drawn near to the vehicle
            elif cruises and cruised and math.dist(here, there) < clear_m:
                return None
        airspace = mission.airspace_at(altitude_m)
        clearance_left_m, name = airspace.clearance_left_m(here)
        self._clearance_left = (clearance_left_m, here, cruises, mission)
        announced_m = self._announced_m
        if clearance_left_m >= -CLEARANCE_NOISE_M:
            if clearance_left_m >= 0.0:
                self._announced_m = None
            return None
        if announced_m is not None and clearance_left_m > announced_m - CLEARANCE_REPEATED_M:
            return None
        self._announced_m = clearance_left_m
        required_m = airspace.required_m(name)
        left_m = max(clearance_left_m + required_m, 0.0)
        words = f"too near to {names_of((name,))}: {left_m:.1f} m, {required_m:g} m are required"
        if announced_m is not None:
            return Deviation(Response.ANNOUNCE, words, FLY_OUT, alarms=True)
        return Deviation(Response.HOLD, words, BE_READY, counts=True)

    def forget(self) -> None:
        """Reset: the vehicle does not fly its mission now."""
        self._announced_m, self._clearance_left = 0.0, None


@dataclass(slots=True, eq=False)
class SpeedWatch:
    """Checks that the vehicle flies at the commanded speed.

    Args:
        context: The commanded speed.
        gate: The last command.
    """

    _context: MissionContext
    _gate: CommandGate
    _fast_since_s: float | None = None  # faster than commanded
    _fast_announced: bool = True  # announced, or braking after a pilot's flight
    _slow_since_s: float | None = None  # slower than commanded, on this leg
    _slow_announced: bool = False  # until it is faster again

    def update(self, telemetry: Telemetry) -> Deviation | None:
        """The deviation when the vehicle flies faster or much slower than commanded."""
        commanded_m_s = self._context.airspace.mission.speed_m_s
        speed_m_s = math.hypot(*telemetry.velocity_m_s)
        self._slow_announced &= speed_m_s < commanded_m_s * (1.0 + UNDERSPEED) / 2.0
        if speed_m_s > UNDERSPEED * commanded_m_s:
            self._slow_since_s = None
        if speed_m_s > OVERSPEED * commanded_m_s + OVERSPEED_M_S:
            return self._fast(telemetry, speed_m_s)
        self._fast_since_s, self._fast_announced = None, False
        if speed_m_s <= UNDERSPEED * commanded_m_s:
            return self._slow(telemetry, speed_m_s)
        return None

    def _fast(self, telemetry: Telemetry, speed_m_s: float) -> Deviation | None:
        if self._fast_since_s is None:
            self._fast_since_s = telemetry.time_s
        if self._fast_announced or telemetry.time_s - self._fast_since_s < OVERSPEED_S:
            return None
        self._fast_announced = True
        commanded_m_s = self._context.airspace.mission.speed_m_s
        words = (
            f"it flies at {speed_m_s:.1f} m/s, but {commanded_m_s:.1f} m/s were commanded: "
            "another ground station changed its speed, or the wind carries it"
        )
        if isinstance(self._gate.last, HoldHere):  # it brakes for another reason
            return Deviation(Response.ANNOUNCE, words, NO_OTHER_SPEED)
        return Deviation(Response.HOLD, words, NO_OTHER_SPEED, counts=True)

    def _slow(self, telemetry: Telemetry, speed_m_s: float) -> Deviation | None:
        leg, mission, far = self._gate.last, self._context.airspace.mission, False
        if self._gate.pending is None and isinstance(leg, FlyToNode | FlyToPoint):
            up_m = mission.altitude_of(leg.node) if isinstance(leg, FlyToNode) else leg.altitude_m
            climbs = below(up_m, telemetry)  # PX4 climbs before it flies to an item
            far = math.dist(telemetry.position, leg.position) > UNDERSPEED_LEG_M and not climbs
        if not far:
            self._slow_since_s = None
            return None
        if self._slow_since_s is None:
            self._slow_since_s = telemetry.time_s
        if self._slow_announced or telemetry.time_s - self._slow_since_s < UNDERSPEED_S:
            return None
        self._slow_announced = True
        words = f"it flies only at {speed_m_s:.1f} m/s, not {mission.speed_m_s:.1f} m/s"
        return Deviation(Response.ANNOUNCE, words, TOO_MUCH_WIND)

    def forget(self) -> None:
        """Reset: the vehicle does not fly its mission now; it may brake after a pilot's flight."""
        self._fast_since_s = self._slow_since_s = None
        self._fast_announced = True


@dataclass(slots=True, eq=False)
class Envelope:
    """Checks altitude, clearance, speed and conditions together.

    Args:
        context: The mission.
        gate: The last command to the vehicle.
        home: Compares the receiver's altitude.
    """

    _context: MissionContext
    _gate: CommandGate
    _home: HomeWatch
    _height: HeightWatch = field(init=False)
    _clearance: ClearanceWatch = field(init=False)
    _speed: SpeedWatch = field(init=False)
    _conditions: ConditionsWatch = field(init=False)
    _updated: bool = False  # the previous telemetry was checked

    def __post_init__(self) -> None:
        self._height = HeightWatch(self._context)
        self._clearance = ClearanceWatch(self._context)
        self._speed = SpeedWatch(self._context, self._gate)
        self._conditions = ConditionsWatch(self._context)

    def update(self, telemetry: Telemetry) -> tuple[Deviation, ...]:
        """The deviations that begin or end in this telemetry."""
        self._updated = True
        in_doubt = abs(self._home.receiver_off_m) >= ALTITUDE_DISAGREES_M
        conditions, accuracy_m = self._conditions, telemetry.accuracy_m
        planned_m = self._context.airspace.mission.planner.position_accuracy_m
        poor = accuracy_m is not None and accuracy_m > planned_m
        rough = conditions.waits or poor or telemetry.wind_m_s is not None
        found = (
            self._height.update(telemetry),
            self._home.deviation(telemetry) if in_doubt else None,
            self._clearance.update(telemetry),
            self._speed.update(telemetry),
            conditions.update(telemetry) if rough else None,
        )
        return tuple(filter(None, found))

    def forget(self) -> None:
        """Reset all checks: the vehicle does not fly its mission now."""
        if self._updated:
            self._updated = False
            for watch in (self._height, self._clearance, self._speed, self._conditions):
                watch.forget()


class Due(NamedTuple):
    """Why the vehicle comes home now, with the pilot's action; None: a normal end."""

    why: str
    instruction: Instruction | None = None


@dataclass(slots=True, eq=False)
class ReturnMonitor:
    """Decides when the vehicle comes home, and announces that there is no way home.

    Args:
        context: The charge and the time in the air.
        reachability: Checks whether zones leave a way home.
    """

    _context: MissionContext
    _reachability: HomeReachability
    _way_home: WayHome = field(default_factory=WayHome)

    @property
    def need_home(self) -> float | None:
        """The charge needed to fly home from here; None: unknown, or coming home already."""
        return self._way_home.need_now if self._context.knows(Signal.COME_HOME) else None

    def check(self, telemetry: Telemetry) -> None:
        """Come home if it is due; announce that there is no way home."""
        context, reachability = self._context, self._reachability
        if context.task.state is not State.LAND and (
            telemetry.time_s >= reachability.next_check_s
            or reachability.walls is not None
            or reachability.checked_router is not context.airspace.router
        ):
            reachability.update(telemetry, due=context.task.state is State.HOME)
        if Signal.COME_HOME in context.task.spec.on:
            self.end_if_due(telemetry)

    def end_if_due(self, telemetry: Telemetry) -> None:
        """Come home if the battery or the time demands it."""
        due = self.due(telemetry)
        if due is not None:
            self._context.come_home(due.why, due.instruction)

    def due(self, telemetry: Telemetry, *, by_time: bool = True) -> Due | None:
        """Why the vehicle must come home now, for battery or time; None: it need not."""
        context, mission, charge = self._context, self._context.airspace.mission, telemetry.battery
        need_home = None
        if context.pace.endurance_s is not None:
            need_home = self._way_home.need(telemetry, context.airspace.router)
        if mission.at_reserve(charge):
            return Due(f"battery at {charge:.0%}", BE_READY_AT_HOME)
        if charge is not None and need_home is not None and charge <= need_home + LANDING_MARGIN:
            return Due(
                f"battery at {charge:.0%}: the way home takes {need_home:.0%}, "
                f"{LANDING_MARGIN:.0%} must be left after landing",
                BE_READY_AT_HOME,
            )
        if not by_time:
            return None
        task = context.task
        airborne_s = 0.0 if task.airborne_s is None else context.now_s - task.airborne_s
        if mission.duration_s is not None and airborne_s >= mission.duration_s:
            return Due(f"mission duration ({mission.duration_s:.0f} s) reached")
        over = task.home_by_s is not None and context.now_s >= task.home_by_s
        if over and mission.latest_start is not None:
            return Due("the active hours of its selected no-fly zones are over")
        return None
