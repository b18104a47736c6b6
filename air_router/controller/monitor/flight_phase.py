"""How a mission gets off the ground, how a flight counts as over, and how silence is told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

from air_router.mission.mission import Mission
from air_router.vehicle.vehicle import FlightMode, Telemetry

ALTITUDE_M: Final = 2.0
"""PX4 corrects its home altitude in flight, so that an altitude above home is good to this."""

HOME_TOLERANCE_M: Final = 20.0
"""The vehicle must start this close to the mission's home, or it is another place's mission."""

_TOLD_S: Final = 10.0
"""How often something that goes on is told."""


DISARMED_S: Final = 10.0
"""A landed vehicle of which no HEARTBEAT has come for so long counts as disarmed."""

CLIMB_S: Final = 20.0
KILLED_M: Final = 3.0
"""Disarmed in the air lower than this it has landed, for all that an altitude above home tells."""

REST_M: Final = 0.5
REST_S: Final = 2.0
"""What fell is down when its altitude has changed by less than this in that time."""

PROGRESS_M: Final = 0.5
"""A climb that gains less than this in that time does not go on; PX4 takes off at 1.5 m/s."""


@dataclass(slots=True)
class FlightPhase:
    """What has been seen of arming, lift-off and touch-down.

    Attributes:
        handed_over: Armed in Mission mode: the pilot who did that gave the flight to us.
        airborne_s: When the mission began in the air, on the vehicle's clock.
        flies: In the air with its motors on, as it said last.
        killed: Where its motors were stopped in the air, in words, if they were.
        stayed_why: Why it ended before take-off, if it does.
        landing_place: Where we have it land, in words.
    """

    handed_over: bool = False
    airborne_s: float | None = None
    flies: bool = False
    killed: str | None = None
    stayed_why: str = "disarmed"
    landing_place: str = "at home"
    _flew: bool = False  # seen in the air
    _was_armed: bool = False  # since the hand-over
    _news: bool = False  # it was killed, and not said yet
    _rest: tuple[float, float] = (0.0, 0.0)  # altitude that stays the same, and since when
    _highest: tuple[float, float] | None = None  # altitude of the climb, and when

    def note(self, telemetry: Telemetry) -> bool:
        """Take in what the vehicle says of itself; True when it is handed over to us just now."""
        flew = self.flies
        self.flies = telemetry.armed and telemetry.in_air and not telemetry.terminated
        if not (self.flies and flew):
            self._fall(telemetry, flew=flew)
        self._flew |= telemetry.in_air
        self._was_armed |= telemetry.armed
        before = self.handed_over
        self.handed_over |= telemetry.armed and telemetry.mode is FlightMode.MISSION
        return self.handed_over and not before

    def _fall(self, telemetry: Telemetry, *, flew: bool) -> None:
        """PX4 says of a vehicle that was disarmed in the air within a second that it has landed."""
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
        """Where its motors were stopped in the air, in words; says so once."""
        news, self._news = self._news, False
        return self.killed if news else None

    def over(self, telemetry: Telemetry) -> bool:
        """Whether it is disarmed after having been armed: then it is down, unless it falls.

        Where no HEARTBEAT tells it any more, what is on the ground after a flight is disarmed.
        """
        if self.killed is not None:
            down = telemetry.told_s - self._rest[1] >= REST_S
            return down and not telemetry.armed
        if telemetry.ages.armed_s >= DISARMED_S and self._flew:
            return not telemetry.in_air
        return self._was_armed and not telemetry.armed

    def again(self) -> bool:
        """Whether it was only armed and disarmed again; then everything begins anew."""
        if self._flew:
            return False
        self.handed_over = self._was_armed = False
        self._highest = None
        return True

    def resumed(self, now_s: float) -> None:
        """A flight that was under way before us, or given away, is ours from now on."""
        self.handed_over = True
        if self.airborne_s is None:
            self.airborne_s = now_s

    def stuck(self, telemetry: Telemetry) -> bool:
        """Whether the climb that was handed over to us has not gone on for some time."""
        if not (self.handed_over and telemetry.in_air):
            return False
        if self._highest is None or telemetry.altitude_m > self._highest[0] + PROGRESS_M:
            self._highest = (telemetry.altitude_m, telemetry.time_s)
        return telemetry.time_s - self._highest[1] >= CLIMB_S

    def ending(self, *, landed_by_us: bool) -> str:
        """How it ended, in words."""
        if self.killed is not None:
            return self.killed
        if landed_by_us:
            return f"landed {self.landing_place}"
        if self._flew:
            return "landed, but not by our command"
        return f"{self.stayed_why}, before take-off"


class TakeOff(Enum):
    """How far the take-off is."""

    TO_COME = "on the ground, climbing above home, or not in Mission mode"
    COMPLETE = "in Mission mode at the mission's altitude"
    MISPLACED = "in Mission mode, low and away from home: PX4 flies home from there unchecked"
    TOO_HIGH = "in Mission mode, in the layer of another UAV, or above it"


HELD: Final = {
    TakeOff.MISPLACED: "Mission was chosen low and away from home; land, and start there",
    TakeOff.TOO_HIGH: "Mission was chosen in another UAV's layer; descend, then have it resumed",
}
"""Take-offs that are not led on, and what the pilot should do."""


def take_off(mission: Mission, telemetry: Telemetry) -> TakeOff:
    """Where the take-off stands, whether we lead it or a pilot.

    It is complete at the mission's altitude, wherever that is: from there on every leg is checked
    from where the vehicle is. Lower, and farther from home than it may stand, it is no take-off of
    this mission: a pilot who flew away by hand has chosen Mission mode. Where several UAVs fly it
    may be too high: on its first leg it would come down through the layers of others.
    """
    if not (telemetry.in_air and telemetry.mode is FlightMode.MISSION):
        return TakeOff.TO_COME
    if telemetry.altitude_m > mission.layer_top_m:
        return TakeOff.TOO_HIGH
    altitude_m = mission.altitude_above_home_m
    if telemetry.altitude_m >= altitude_m - min(ALTITUDE_M, altitude_m / 2):
        return TakeOff.COMPLETE
    away_m = math.dist(telemetry.position, mission.home)
    return TakeOff.MISPLACED if away_m > HOME_TOLERANCE_M else TakeOff.TO_COME


def why_not_started(before: Telemetry, now: Telemetry, *, armed: bool) -> str | None:
    """What the pilot has done with a vehicle that was to be started by us; None if nothing.

    Args:
        before: as it was when it was found.
        now: as it is.
        armed: it was armed by us.
    """
    if now.in_air or (now.armed and not armed):
        return "the pilot has armed the vehicle"
    if now.mode not in {before.mode, FlightMode.HOLD, FlightMode.MISSION}:
        return f"the pilot chose {now.mode.value} mode meanwhile"
    return None


@dataclass(slots=True)
class Reminder:
    """What goes on is told at once, then now and then, and that it is over."""

    _what: str | None = None  # announced last; None: over
    _told_s: float = 0.0  # when it was announced last

    def news(self, what: str | None, now_s: float) -> str | None:
        """What to tell at this time, where this goes on; None: no news."""
        if what == self._what and (what is None or now_s < self._told_s + _TOLD_S):
            return None
        before, self._what, self._told_s = self._what, what, now_s
        return f"over: {before}" if what is None else what


@dataclass(slots=True)
class SilenceReminder:
    """What is told of a vehicle that is not heard: at once, then now and then.

    Attributes:
        told_s: How long this silence was when it was told last; 0 once the vehicle is heard.
    """

    told_s: float = 0.0

    def news(self, silent_s: float) -> str | None:
        """What to tell after `silent_s` wall-clock seconds without a word; None: no news."""
        if silent_s < self.told_s:
            self.told_s = 0.0  # it was heard meanwhile
        if self.told_s > 0.0 and silent_s < self.told_s + _TOLD_S:
            return None
        self.told_s = silent_s
        return f"nothing heard from the vehicle for {silent_s:.0f} s"
