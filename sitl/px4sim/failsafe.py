"""PX4's failsafes: what forces another mode on the vehicle, and how the pilot gets out of it.

A failsafe acts when its condition appears, not while it lasts; a mode command ends it ("the pilot
took over"), and then the same condition does nothing until it appears anew.
"""

import struct
from enum import IntEnum
from typing import Final

from sitl.px4sim.state import FlightMode, Severity, Situation


class Action(IntEnum):
    """What a failsafe does; the greater one wins. Numbers are those of PX4's events."""

    NONE = 0
    WARN = 1
    FALLBACK_ALTITUDE = 3
    HOLD = 5
    RTL = 6
    LAND = 7
    DESCEND = 8
    DISARM = 9
    TERMINATE = 10


class Cause(IntEnum):
    """Why; numbers are those of PX4's events."""

    GENERIC = 0
    MANUAL_CONTROL_LOST = 1
    GCS_LOST = 2
    BATTERY_LOW = 3
    BATTERY_CRITICAL = 4
    BATTERY_EMERGENCY = 5


_MODES: Final = {
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


class Failsafe:
    """Which failsafe acts."""

    def __init__(self) -> None:
        # Until a mode command or disarming, even if it is over.
        self._active: list[tuple[Action, Cause]] = []
        self._fallback = Action.NONE  # of an intended mode that cannot be flown now
        self._delayed_until_s: float | None = None  # end of COM_FAIL_ACT_T's Hold

    @property
    def acting(self) -> bool:
        """Whether the vehicle flies in a mode that was not chosen."""
        return self._worst()[0] > Action.WARN

    def mode(self, intended: FlightMode) -> FlightMode:
        """The mode to fly in, given the one that the user chose last."""
        if self._delayed_until_s is not None:
            return FlightMode.AUTO_LOITER
        return _MODES.get(self._worst()[0], intended)

    def trigger(
        self, action: Action, cause: Cause, intended: FlightMode, situation: Situation
    ) -> None:
        """A condition has just appeared.

        Return and Land are preceded by COM_FAIL_ACT_T seconds of Hold, unless a failsafe acts
        already, so that the pilot can take over.
        """
        if action is Action.NONE or not situation.armed:
            return
        if action is Action.WARN:
            if cause in _WARNINGS:
                event, severity = _WARNINGS[cause]
                situation.say("", event, severity)
            return
        before, was_acting = self._worst()[0], self.acting
        self._active.append((action, cause))
        if action <= before:
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
        elif self._delayed_until_s is None:
            self._announce(intended, situation)

    def fall_back(self, action: Action, intended: FlightMode, situation: Situation) -> None:
        """What the mode itself wants, which cannot be flown any more; ends as soon as it can."""
        if not situation.armed:
            action = Action.NONE
        before, self._fallback = self._worst()[0], action
        if action > max(before, Action.WARN) and self._delayed_until_s is None:
            self._announce(intended, situation)

    def step(self, intended: FlightMode, situation: Situation) -> None:
        """Let the seconds of Hold before a greater action run out."""
        if self._delayed_until_s is not None and situation.time_s >= self._delayed_until_s:
            self._delayed_until_s = None
            self._announce(intended, situation)

    def taken_over(self, situation: Situation) -> None:
        """The user commanded a mode: whatever acts ends, except a termination."""
        if self.acting and self._worst()[0] is not Action.TERMINATE:
            self.reset()
            situation.say("", "failsafe_rc_override")

    def reset(self) -> None:
        """Nothing acts any more: the motors stopped, or the pilot took over."""
        self._active.clear()
        self._fallback = Action.NONE
        self._delayed_until_s = None

    def _worst(self) -> tuple[Action, Cause]:
        fallback = (self._fallback, Cause.GENERIC)
        return max((fallback, *self._active), key=lambda active: active[0])

    def _announce(self, intended: FlightMode, situation: Situation) -> None:
        action, cause = self._worst()
        event = "commander_failsafe_enter"
        arguments = struct.pack("<IBB", intended.custom_mode, action, cause)
        if action is Action.DESCEND:
            event = "commander_failsafe_enter_autopilot_disengaged"
        elif cause is Cause.GENERIC:
            event, arguments = "commander_failsafe_enter_generic", arguments[:-1]
        situation.say("Failsafe activated", event, Severity.CRITICAL, arguments=arguments)
