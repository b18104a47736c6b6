"""PX4's failsafes, arming and disarming.

What forces another mode on the vehicle, and how the pilot gets out of it; the reasons that PX4
names, and when it disarms by itself. Pure. A failsafe acts when its condition appears, not while
it lasts; a mode command ends it ("the pilot took over"), and then the same condition does nothing
until it appears anew.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from sitl.px4sim.state.notice import Severity
from sitl.px4sim.state.parameters import Parameters
from sitl.px4sim.state.px4_modes import FlightMode
from sitl.px4sim.state.situation import Situation


class Action(IntEnum):
    """What a failsafe does; the greater one wins. Numbers are those of PX4's events."""

    NONE = 0
    WARN = 1
    FALLBACK_POSITION = 2
    FALLBACK_ALTITUDE = 3
    HOLD = 5
    RTL = 6
    LAND = 7
    DESCEND = 8
    DISARM = 9
    TERMINATE = 10


# By NAV_RCL_ACT, which also stands in for COM_OBL_RC_ACT's stick modes where there are no sticks.
STICK_LOSS_ACTIONS: Final[Mapping[int, Action]] = {
    1: Action.HOLD,
    2: Action.RTL,
    3: Action.LAND,
    5: Action.TERMINATE,
    6: Action.DISARM,
}


class Cause(IntEnum):
    """Why; numbers are those of PX4's events."""

    GENERIC = 0
    MANUAL_CONTROL_LOST = 1
    GCS_LOST = 2
    BATTERY_LOW = 3
    BATTERY_CRITICAL = 4
    BATTERY_EMERGENCY = 5


_MODES: Final = {
    Action.FALLBACK_POSITION: FlightMode.POSCTL,
    Action.FALLBACK_ALTITUDE: FlightMode.ALTCTL,
    Action.HOLD: FlightMode.AUTO_LOITER,
    Action.RTL: FlightMode.AUTO_RTL,
    Action.LAND: FlightMode.AUTO_LAND,
    Action.DESCEND: FlightMode.AUTO_LAND,
    Action.DISARM: FlightMode.TERMINATION,
    Action.TERMINATE: FlightMode.TERMINATION,
}
_WARNINGS: Final = {
    Cause.BATTERY_LOW: ("commander_failsafe_enter_low_bat", Severity.WARNING),
    Cause.BATTERY_CRITICAL: ("commander_failsafe_enter_crit_bat_warn", Severity.CRITICAL),
    Cause.BATTERY_EMERGENCY: ("commander_failsafe_enter_crit_low_bat_warn", Severity.EMERGENCY),
}


@dataclass(frozen=True, slots=True)
class _Active:
    action: Action
    cause: Cause


class Failsafe:
    """Which failsafe acts."""

    def __init__(self) -> None:
        self._active: list[_Active] = []  # until a mode command or disarming, even if it is over
        self._fallback = Action.NONE  # of an intended mode that cannot be flown now
        self._delayed_until_s: float | None = None  # end of COM_FAIL_ACT_T's Hold

    @property
    def acting(self) -> bool:
        """Whether the vehicle flies in a mode that was not chosen."""
        return self._worst().action > Action.WARN

    def mode(self, intended: FlightMode) -> FlightMode:
        """The mode to fly in, given the one that the user chose last."""
        if self._delayed_until_s is not None:
            return FlightMode.AUTO_LOITER
        return _MODES.get(self._worst().action, intended)

    def trigger(
        self, action: Action, cause: Cause, intended: FlightMode, situation: Situation
    ) -> None:
        """A condition has just appeared.

        Return and Land are preceded by COM_FAIL_ACT_T seconds of Hold, unless a failsafe acts
        already, so that the pilot can take over.
        """
        before = self._worst()
        if action is Action.NONE or not situation.armed:
            return
        if action is Action.WARN:
            if cause in _WARNINGS:
                event, severity = _WARNINGS[cause]
                situation.say("", event, severity)
            return
        was_acting = self.acting
        self._active.append(_Active(action, cause))
        if action <= before.action:
            return
        delay_s = situation.parameters.limited("COM_FAIL_ACT_T", 0.0, 25.0)
        if action in (Action.RTL, Action.LAND) and not was_acting and delay_s > 0:
            self._delayed_until_s = situation.time_s + delay_s
            situation.say(
                f"Failsafe activated: entering Hold for {delay_s:.0f} seconds",
                "commander_failsafe_enter_hold",
                Severity.CRITICAL,
                arguments=struct.pack("<IBHB", intended.custom_mode, action, round(delay_s), cause),
            )
            return
        if self._delayed_until_s is None:
            self._announce(intended, situation)

    def fall_back(self, action: Action, intended: FlightMode, situation: Situation) -> None:
        """What the mode itself wants, which cannot be flown any more; ends as soon as it can."""
        if not situation.armed:
            action = Action.NONE
        before, self._fallback = self._worst().action, action
        if action > max(before, Action.WARN) and self._delayed_until_s is None:
            self._announce(intended, situation)

    def step(self, intended: FlightMode, situation: Situation) -> None:
        """Let the seconds of Hold before a greater action run out."""
        if self._delayed_until_s is not None and situation.time_s >= self._delayed_until_s:
            self._delayed_until_s = None
            self._announce(intended, situation)

    def taken_over(self, situation: Situation) -> None:
        """The user commanded a mode: whatever acts ends, except a termination."""
        if not self.acting or self._worst().action is Action.TERMINATE:
            return
        self._active.clear()
        self._fallback = Action.NONE
        self._delayed_until_s = None
        situation.say("", "failsafe_rc_override")

    def disarmed(self) -> None:
        """The motors stopped: nothing acts any more."""
        self._active.clear()
        self._fallback = Action.NONE
        self._delayed_until_s = None

    def _worst(self) -> _Active:
        fallback = _Active(self._fallback, Cause.GENERIC)
        if not self._active:
            return fallback
        return max((fallback, *self._active), key=lambda active: active.action)

    def _announce(self, intended: FlightMode, situation: Situation) -> None:
        worst = self._worst()
        if worst.action is Action.DESCEND:
            event = "commander_failsafe_enter_autopilot_disengaged"
            arguments = struct.pack("<IBB", intended.custom_mode, worst.action, worst.cause)
        elif worst.cause is Cause.GENERIC:
            event = "commander_failsafe_enter_generic"
            arguments = struct.pack("<IB", intended.custom_mode, worst.action)
        else:
            event = "commander_failsafe_enter"
            arguments = struct.pack("<IBB", intended.custom_mode, worst.action, worst.cause)
        situation.say("Failsafe activated", event, Severity.CRITICAL, arguments=arguments)


class ArmingReason(IntEnum):
    """Why the motors were started or stopped; numbers are those of PX4's events."""

    COMMAND = 4
    MISSION_START = 5
    LANDED = 6
    NO_TAKEOFF = 7

    @property
    def words(self) -> str:
        """As in "Armed by ..."."""
        return _WORDS[self]


_WORDS = {
    ArmingReason.COMMAND: "external command",
    ArmingReason.MISSION_START: "mission start",
    ArmingReason.LANDED: "landing",
    ArmingReason.NO_TAKEOFF: "auto preflight disarming",
}


def disarm_due(
    parameters: Parameters, *, armed_for_s: float, landed_for_s: float | None, in_mission: bool
) -> ArmingReason | None:
    """Whether an armed vehicle on the ground is to be disarmed now.

    Args:
        parameters: On board.
        armed_for_s: Seconds since arming.
        landed_for_s: Seconds since the landing; None if it has not flown since it was armed.
        in_mission: Whether a mission is under way, which may take off again.
    """
    if landed_for_s is not None:
        limit_s = parameters.limited("COM_DISARM_LAND", -1.0, 3600.0)
        return ArmingReason.LANDED if 0 < limit_s <= landed_for_s and not in_mission else None
    limit_s = parameters.limited("COM_DISARM_PRFLT", -1.0, 3600.0)
    spool_up_s = parameters.limited("COM_SPOOLUP_TIME", 0.0, 30.0)
    return ArmingReason.NO_TAKEOFF if 0 < limit_s <= armed_for_s - spool_up_s else None
