"""What telemetry shows to be off what was planned: home moved, height, clearance, speed. Pure.

Each deviation is told when it begins. What follows is in this table; nothing follows while a pilot
flies, zones are being changed, or the vehicle lands.

| deviation | begins | what follows |
|---|---|---|
| home moved up or down | at once | hold, then on in the planned height, by points |
| home moved to a side | at once | it is told: only the autopilot's own Return flies there |
| too low or too high | 4 s off the altitudes of the mission | hold, then back to them and on |
| the altitude jumps: within them, or off them | at once | hold, then on; hold until it is back |
| one of the last two | 30 s | home |
| the satellites' altitude leaves the autopilot's by 3.5 m | for some seconds | it is told |
| by 6 m | for some seconds | home: which of both is right? |
| nearer to a zone or the fence than the clearance | at once | hold, then away from there and on |
| faster than commanded | for 2 s | hold, then on at the commanded speed |
| much slower | for 5 s of a leg | it is told |
| one of these, a third time within 3 minutes | at once | home |
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Final, NamedTuple

from air_router.controller.model.actions import FlyToNode, FlyToPoint, HoldHere
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.motion.command_gate import CommandedMode
from air_router.mission.mission import Mission
from air_router.routing.departure import names_of
from air_router.vehicle.height_frame import HomeMove
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point

OFF_M: Final = 5.0
"""How far off its altitudes a vehicle may be at least, whatever margin the mission keeps: PX4
corrects the altitude of home by more than 2 m while it flies."""

OFF_S: Final = 4.0
"""How long the vehicle is off its altitudes, and comes no nearer, before that is told."""

BACK_S: Final = 2.0
"""It counts as back after so long."""

OFF_HOME_S: Final = 30.0
"""After so long off its altitudes it comes home."""

_NEARER_M: Final = 0.5
"""A climb or descent that gains so much goes on."""

JUMP_M: Final = 2.5
CLIMB_M_S: Final = 6.0
"""An altitude that changes by more than this, on top of what a climb at that speed makes in the
time, has not been flown."""

_HOME_AGAIN_M: Final = 2.0
"""A home that was told to be moved is told again when it is so much elsewhere."""

NOISE_M: Final = 0.25
"""What a position wanders by is no loss of clearance."""

_NEARER_STILL_M: Final = 1.0
"""A clearance that was lost is told again when so much more of it is."""

DOUBT_M: Final = 3.5
DOUBT_HOME_M: Final = 6.0
"""The altitude of a receiver with a fix is good to about 2 m; what is planned, to 5 m."""

_AVERAGE_S: Final = 4.0

FASTER_M_S: Final = 0.5
FASTER: Final = 1.1
FAST_S: Final = 2.0
"""A gust makes a vehicle no faster than this for so long."""

SLOW: Final = 0.6
SLOW_S: Final = 5.0
SLOW_M: Final = 10.0
"""A leg of which more than this is left is flown faster than this share, after some seconds."""

TIMES: Final = 3
WITHIN_S: Final = 180.0
"""What has happened so often in that time will happen again."""


class Response(Enum):
    """What follows a deviation."""

    TELL = "nothing but words"
    HOLD = "it holds, and goes on when it stands"
    WAIT = "it holds until the deviation is over"
    BACK = "the deviation is over: what waited goes on"
    HOME = "it comes home"


class Deviation(NamedTuple):
    """What to say, and what to do about it."""

    response: Response
    words: str  # announced


@dataclass(slots=True, eq=False)
class Deviations:
    """Looks at every telemetry.

    Attributes:
        waits: Its altitude has jumped, and it holds until that is over: no leg is begun.
    """

    _context: MissionContext
    waits: bool = False
    _home_told: HomeMove | None = None  # where home was moved to, as announced
    _before: tuple[float, float] | None = None  # time, altitude above sea level
    # The altitude of the satellite receiver beside the autopilot's, since the take-off.
    _receiver_began_m: float | None = None
    _receiver_off_m: float = 0.0  # how far apart they drifted, smoothed
    _receiver_at_s: float = 0.0  # of the telemetry before
    _receiver_told_m: float = 0.0  # the greatest limit announced
    _out_m: float = 0.0  # the least that it was off its altitudes lately
    _out_since_s: float | None = None  # since when it came no nearer
    _off_since_s: float | None = None  # when it was announced
    _back_since_s: float | None = None  # within its altitudes again since
    _spare_told_m: float | None = 0.0  # None: the clearance is kept
    # So much was to spare there: below (-1), at or above (1) the cruise altitudes of that mission.
    _spare: tuple[float, Point, int, Mission] | None = None
    _fast_since_s: float | None = None  # faster than commanded
    _fast_told: bool = True  # announced, or braking from a pilot's flight
    _slow_since_s: float | None = None  # slower than commanded, on this leg
    _slow_told: bool = False  # until it is faster again
    _times: deque[float] = field(default_factory=partial(deque, maxlen=TIMES))  # holds, when

    def home(self, telemetry: Telemetry) -> Deviation | None:
        """Whether the autopilot's home was moved since it was told last, in any state."""
        if telemetry.gps_amsl_m is not None and telemetry.altitude_amsl_m is not None:
            off_m = telemetry.gps_amsl_m - telemetry.altitude_amsl_m
            if self._receiver_began_m is None:
                self._receiver_began_m, self._receiver_at_s = off_m, telemetry.time_s
            passed_s = max(telemetry.time_s - self._receiver_at_s, 0.0)
            share = 1.0 - math.exp(-passed_s / _AVERAGE_S)
            self._receiver_off_m += share * (off_m - self._receiver_began_m - self._receiver_off_m)
            self._receiver_at_s = telemetry.time_s
        moved, told = telemetry.home_moved, self._home_told
        if moved is None:
            self._home_told = None
            return None if told is None else Deviation(Response.BACK, "home is back in its place")
        if told is not None and math.dist(moved, told) < _HOME_AGAIN_M:
            return None
        self._home_told = moved
        amsl_m = telemetry.altitude_amsl_m
        before_m = None if amsl_m is None else amsl_m - telemetry.altitude_m
        words = f"home was moved: {moved.words(before_m)}"
        if not moved.changes_heights:
            return Deviation(Response.TELL, f"{words}; the autopilot's own Return flies there")
        if told is not None and abs(moved.up_m - told.up_m) < _HOME_AGAIN_M:
            return Deviation(Response.TELL, words)  # its place is told in a message of its own
        return Deviation(Response.HOLD, f"{words}; heights count from the take-off as before")

    def look(self, telemetry: Telemetry, commanded_mode: CommandedMode) -> list[Deviation]:
        """What is off now, on a vehicle that flies its mission by our commands."""
        found = (
            self._height(telemetry),
            self._in_doubt(telemetry) if abs(self._receiver_off_m) >= DOUBT_M else None,
            self._clearance(telemetry),
            self._speed(telemetry, commanded_mode),
        )
        return [*filter(None, found)]

    def forget(self) -> None:
        """It does not fly its mission by our commands just now."""
        self.waits = False
        self._before = self._out_since_s = self._fast_since_s = self._slow_since_s = None
        self._fast_told = True  # it may come out of another's flight, and brakes
        self._off_since_s = self._back_since_s = None
        self._spare_told_m, self._spare = 0.0, None

    # Height.

    def _height(self, telemetry: Telemetry) -> Deviation | None:
        band, now_s, before = self._context.mission.cruise, telemetry.time_s, self._before
        altitude_m = telemetry.altitude_m
        # With nothing in it of home, which the autopilot corrects by a metre or two.
        amsl_m = altitude_m if telemetry.altitude_amsl_m is None else telemetry.altitude_amsl_m
        self._before = (now_s, amsl_m)
        slack_m = max(OFF_M - self._context.mission.planner.vertical_margin_m, 0.0)
        out_m = max(band.lower_m - altitude_m, altitude_m - band.upper_m, slack_m) - slack_m
        gained_m = 0.0 if before is None else amsl_m - before[1]
        if before is not None and abs(gained_m) > JUMP_M + CLIMB_M_S * max(now_s - before[0], 0.0):
            words = f"the altitude jumped from {altitude_m - gained_m:.0f} to {altitude_m:.0f} m"
            if out_m == 0.0:
                return Deviation(Response.HOLD, words)
            self.waits = True
            self._off_since_s, self._back_since_s = now_s, None
            return Deviation(Response.WAIT, words)
        if self._off_since_s is not None:
            return self._while_off(telemetry, out_m, self._off_since_s)
        if out_m == 0.0 or self._out_since_s is None or out_m < self._out_m - _NEARER_M:
            self._out_m, self._out_since_s = out_m, now_s
            return None
        if now_s - self._out_since_s < OFF_S:
            return None
        self._off_since_s, self._back_since_s = now_s, None
        return self._again(now_s, f"too {self._off(altitude_m)}")

    def _while_off(
        self, telemetry: Telemetry, out_m: float, off_since_s: float
    ) -> Deviation | None:
        now_s = telemetry.time_s
        if out_m == 0.0:
            if self._back_since_s is None:
                self._back_since_s = now_s
            if now_s - self._back_since_s < BACK_S:
                return None
            self.waits, self._off_since_s, self._out_since_s = False, None, None
            return Deviation(Response.BACK, f"at {telemetry.altitude_m:.0f} m again")
        self._back_since_s = None
        if now_s - off_since_s < OFF_HOME_S:
            return None
        self.waits, self._off_since_s = False, math.inf  # once, until it is back
        return Deviation(Response.HOME, f"too {self._off(telemetry.altitude_m)}")

    def _off(self, altitude_m: float) -> str:
        band = self._context.mission.cruise
        side = "low" if altitude_m < band.lower_m else "high"
        return (
            f"{side}: {altitude_m:.0f} m above home, {band.lower_m:.0f} to {band.upper_m:.0f} m "
            "is flown"
        )

    # Clearance.

    def _clearance(self, telemetry: Telemetry) -> Deviation | None:
        here = telemetry.position
        mission, altitude_m = self._context.mission, telemetry.altitude_m
        side = (altitude_m > mission.cruise.upper_m) - (altitude_m < mission.cruise.lower_m)
        if self._spare is not None:
            spare_m, there, at, among = self._spare
            if among is not mission:
                self._spare_told_m = 0.0  # a zone may have been drawn near to the vehicle
            elif at == side and math.dist(here, there) < spare_m:
                return None
        airspace = mission.airspace_at(altitude_m)
        spare_m, name = airspace.spare_m(here)
        self._spare = (spare_m, here, side, mission)
        told_m = self._spare_told_m
        if spare_m >= -NOISE_M:
            if spare_m >= 0.0:
                self._spare_told_m = None
            return None
        if told_m is not None and spare_m > told_m - _NEARER_STILL_M:
            return None
        self._spare_told_m = spare_m
        kept_m = airspace.kept_m(name)
        left_m = max(spare_m + kept_m, 0.0)
        words = f"too near to {names_of((name,))}: {left_m:.1f} m, {kept_m:g} m are to be kept"
        if told_m is not None:
            return Deviation(Response.TELL, words)
        return self._again(telemetry.time_s, words)

    # Speed.

    def _speed(self, telemetry: Telemetry, commanded_mode: CommandedMode) -> Deviation | None:
        commanded_m_s = self._context.mission.speed_m_s
        speed_m_s = math.hypot(*telemetry.velocity_m_s)
        self._slow_told &= speed_m_s < commanded_m_s * (1.0 + SLOW) / 2.0
        if speed_m_s > SLOW * commanded_m_s:
            self._slow_since_s = None
        if speed_m_s > FASTER * commanded_m_s + FASTER_M_S:
            return self._fast(telemetry, commanded_mode, speed_m_s)
        self._fast_since_s, self._fast_told = None, False
        if speed_m_s <= SLOW * commanded_m_s:
            return self._slow(telemetry, commanded_mode, speed_m_s)
        return None

    def _fast(
        self, telemetry: Telemetry, commanded_mode: CommandedMode, speed_m_s: float
    ) -> Deviation | None:
        if self._fast_since_s is None:
            self._fast_since_s = telemetry.time_s
        if self._fast_told or telemetry.time_s - self._fast_since_s < FAST_S:
            return None
        self._fast_told = True
        words = (
            f"it flies {speed_m_s:.1f} m/s and was told {self._context.mission.speed_m_s:.1f} m/s: "
            "another ground station changed its speed, or the wind carries it"
        )
        if isinstance(commanded_mode.last, HoldHere):  # for another reason; it brakes
            return Deviation(Response.TELL, words)
        return self._again(telemetry.time_s, words)

    def _slow(
        self, telemetry: Telemetry, commanded_mode: CommandedMode, speed_m_s: float
    ) -> Deviation | None:
        leg = commanded_mode.last
        far = (
            commanded_mode.pending is None
            and isinstance(leg, FlyToNode | FlyToPoint)
            and math.dist(telemetry.position, leg.position) > SLOW_M
        )
        if not far:
            self._slow_since_s = None
            return None
        if self._slow_since_s is None:
            self._slow_since_s = telemetry.time_s
        if self._slow_told or telemetry.time_s - self._slow_since_s < SLOW_S:
            return None
        self._slow_told = True
        commanded_m_s = self._context.mission.speed_m_s
        words = f"it flies only {speed_m_s:.1f} m/s and was told {commanded_m_s:.1f} m/s"
        return Deviation(Response.TELL, words)

    def _in_doubt(self, telemetry: Telemetry) -> Deviation | None:
        """Whether the satellites' altitude has left the autopilot's."""
        for limit_m, response in ((DOUBT_HOME_M, Response.HOME), (DOUBT_M, Response.TELL)):
            if abs(self._receiver_off_m) >= limit_m > self._receiver_told_m:
                self._receiver_told_m = limit_m
                words = (
                    f"the altitude is in doubt: {telemetry.altitude_m:.0f} m by the autopilot, "
                    f"{telemetry.altitude_m + self._receiver_off_m:.0f} m by the satellites"
                )
                return Deviation(response, words)
        return None

    def _again(self, now_s: float, words: str) -> Deviation:
        self._times.append(now_s)
        if len(self._times) == TIMES and now_s - self._times[0] <= WITHIN_S:
            self._times.clear()
            return Deviation(Response.HOME, words)
        return Deviation(Response.HOLD, words)
