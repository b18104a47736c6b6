"""What the controller watches for: the end of the take-off, reasons to return, silence."""

from __future__ import annotations

import math
from enum import Enum
from typing import Final

from air_router.mission.mission import Mission
from air_router.routing.return_planner import LANDING_MARGIN
from air_router.vehicle.vehicle import FlightMode, Telemetry

ALTITUDE_M: Final = 2.0
"""PX4 corrects its home altitude in flight, so that an altitude above home is good to this."""

HOME_TOLERANCE_M: Final = 20.0
"""The vehicle must start this close to the mission's home, or it is another place's mission."""

_TOLD_S: Final = 10.0
"""How often something that goes on is told."""


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


def reason_to_return(
    mission: Mission, telemetry: Telemetry, airborne_s: float, need_home: float | None = None
) -> str | None:
    """Why the vehicle comes home now; None to stay out.

    Args:
        mission: its battery reserve and duration.
        telemetry: the vehicle's charge.
        airborne_s: seconds since take-off.
        need_home: the charge that flying home from here and landing takes, if that is known.
    """
    charge = telemetry.battery
    if charge is not None and charge <= mission.battery_reserve:
        return f"battery at {charge:.0%}"
    if charge is not None and need_home is not None and charge <= need_home + LANDING_MARGIN:
        return (
            f"battery at {charge:.0%}: the way home takes {need_home:.0%}, "
            f"{LANDING_MARGIN:.0%} are to be left on the ground"
        )
    if mission.duration_s is not None and airborne_s >= mission.duration_s:
        return f"{mission.duration_s:.0f} s of mission are over"
    return None


class Reminder:
    """What goes on is told at once, then now and then, and that it is over."""

    def __init__(self) -> None:
        self._what: str | None = None
        self._told_s = 0.0

    def news(self, what: str | None, now_s: float) -> str | None:
        """What to tell at this time, where this goes on; None: no news."""
        if what == self._what and (what is None or now_s < self._told_s + _TOLD_S):
            return None
        before, self._what, self._told_s = self._what, what, now_s
        return f"over: {before}" if what is None else what


class Silence:
    """What is told of a vehicle that is not heard: at once, then now and then."""

    def __init__(self) -> None:
        self._told_s = 0.0

    def heard(self) -> None:
        """The vehicle is heard: what follows is another silence."""
        self._told_s = 0.0

    def news(self, silent_s: float) -> str | None:
        """What to tell after `silent_s` wall-clock seconds without a word; None: no news."""
        if silent_s < self._told_s:
            self.heard()  # meanwhile
        if self._told_s > 0.0 and silent_s < self._told_s + _TOLD_S:
            return None
        self._told_s = silent_s
        return f"nothing heard from the vehicle for {silent_s:.0f} s"
