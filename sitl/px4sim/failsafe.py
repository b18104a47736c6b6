"""PX4's failsafes: what it watches, what forces another mode on it, and how the pilot gets out.

A failsafe acts when its condition appears, not while it lasts; a mode command ends it ("the pilot
took over"), and then the same condition does nothing until it appears anew.
"""

from collections.abc import Collection
from enum import IntEnum
from typing import Final

from sitl.px4sim.estimation import FEWEST_SATELLITES
from sitl.px4sim.state import FlightMode, Situation

GROUND_STATION: Final = 6  # MAV_TYPE_GCS
COMPANION: Final = 18  # MAV_TYPE_ONBOARD_CONTROLLER
_HEARTBEAT_VALID_S: Final = 2.0  # PX4's links report a heartbeat for so long after it came


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
_HOLDS: Final = frozenset({Action.HOLD, Action.LAND})
_WARNINGS: Final = {
    Cause.BATTERY_LOW: "commander_failsafe_enter_low_bat",
    Cause.BATTERY_CRITICAL: "commander_failsafe_enter_crit_bat_warn",
    Cause.BATTERY_EMERGENCY: "commander_failsafe_enter_crit_low_bat_warn",
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
                situation.announce(_WARNINGS[cause])
            return
        before, was_acting = self._worst()[0], self.acting
        self._active.append((action, cause))
        if action <= before:
            return
        delay_s = situation.parameters.limited("COM_FAIL_ACT_T", 0.0, 25.0)
        if action in (Action.RTL, Action.LAND) and not was_acting and delay_s > 0:
            self._delayed_until_s = situation.time_s + delay_s
            values = intended.custom_mode, action, round(delay_s), cause
            situation.announce("commander_failsafe_enter_hold", *values)
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
            situation.announce("failsafe_rc_override")

    def end(self, causes: Collection[Cause]) -> None:
        """Hold and Land for one of these causes are over: before 1.16 they end with their cause."""
        self._active = [
            each for each in self._active if each[1] not in causes or each[0] not in _HOLDS
        ]

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
        mode = intended.custom_mode
        if action is Action.DESCEND:
            situation.announce("commander_failsafe_enter_autopilot_disengaged", mode, action, cause)
        elif cause is Cause.GENERIC:
            situation.announce("commander_failsafe_enter_generic", mode, action)
        else:
            situation.announce("commander_failsafe_enter", mode, action, cause)


_EMPTY_V, _FULL_V = 14.4, 16.2
_THRESHOLDS: Final = ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR")  # fractions


class BatteryWarning(IntEnum):
    """battery_status.warning; one more is BATTERY_STATUS.charge_state."""

    NONE = 0
    LOW = 1
    CRITICAL = 2
    EMERGENCY = 3


class Battery:
    """That of PX4's simulator: it drains evenly while armed, and is full again when disarmed.

    Attributes:
        remaining: State of charge from 1 (full) to 0.
        warning: The worst level since arming: in flight PX4 never takes a warning back.
    """

    def __init__(self) -> None:
        self.remaining = 1.0
        self.warning = BatteryWarning.NONE

    def step(self, step_s: float, situation: Situation) -> None:
        """Drain for some seconds: in SIM_BAT_DRAIN it is empty, at SIM_BAT_MIN_PCT it stops."""
        parameters = situation.parameters
        if not situation.armed:
            self.remaining, self.warning = 1.0, BatteryWarning.NONE
            return
        drained = self.remaining - step_s / max(parameters["SIM_BAT_DRAIN"], 1.0)
        least = max(parameters["SIM_BAT_MIN_PCT"] / 100.0, 0.0)
        self.remaining = max(drained, min(least, self.remaining))
        level = BatteryWarning(sum(self.remaining < parameters[name] for name in _THRESHOLDS))
        self.warning = max(self.warning, level)

    @property
    def voltage_v(self) -> float:
        """Of four cells, falling evenly."""
        return _EMPTY_V + (_FULL_V - _EMPTY_V) * self.remaining


# By COM_LOW_BAT_ACT: warning only, return, land, return then land; at critical and at emergency.
_BATTERY_ACTIONS: Final = {
    0: (Action.WARN, Action.WARN),
    1: (Action.RTL, Action.RTL),
    2: (Action.LAND, Action.LAND),
    3: (Action.RTL, Action.LAND),
}
_LOSS_ACTIONS: Final = {  # by NAV_RCL_ACT, NAV_DLL_ACT
    1: Action.HOLD,
    2: Action.RTL,
    3: Action.LAND,
    5: Action.TERMINATE,
    6: Action.DISARM,
}
_HOLD_WITHOUT_FAILSAFE: Final = 7  # NAV_RCL_ACT
_RECEIVER_ACTIONS: Final = {1: Action.RTL, 2: Action.LAND, 3: Action.TERMINATE}
_NEVER_TERMINATES: Final = 121212  # CBRK_FLIGHTTERM
_STICK_EXCEPTIONS: Final = {  # bits of COM_RCL_EXCEPT
    FlightMode.AUTO_MISSION: 1,
    FlightMode.AUTO_LOITER: 2,
    FlightMode.AUTO_TAKEOFF: 2,
}

Alarm = tuple[Action, Cause]
"""A failsafe to be triggered."""


def missing_receivers(situation: Situation) -> int:
    """How many satellite receivers have no fix of those that PX4 requires (SYS_HAS_NUM_GNSS).

    There is one here.
    """
    required = round(situation.parameters.get("SYS_HAS_NUM_GNSS", 0))
    with_fix = int(situation.parameters["SIM_GPS_USED"] >= FEWEST_SATELLITES)
    return max(required - with_fix, 0)


def receivers_forbid_arming(situation: Situation) -> bool:
    """Whether it does not arm for the lack of them: if it would act on that in flight."""
    acts = situation.parameters.get("COM_GNSSLOSS_ACT", 0) > 0
    return acts and missing_receivers(situation) > 0


class AltitudeLoss:
    """Notices that the vehicle falls more than FD_ALT_LOSS below its setpoint: from 1.18 on."""

    def __init__(self) -> None:
        # AMSL, since it is below its setpoint; and since when it is too far below that.
        self._highest_m: float | None = None
        self._lost_s: float | None = None

    def step(self, situation: Situation) -> Alarm | None:
        """Check the altitude; returns the alarm that is due, if any."""
        threshold_m = situation.parameters.get("FD_ALT_LOSS", 0.0)
        target_m = situation.setpoint.held_altitude_m
        here_m, now_s = situation.altitude_m, situation.time_s
        if threshold_m <= 0.0 or target_m is None or here_m >= target_m or not situation.armed:
            self._highest_m = self._lost_s = None
            return None
        highest_m = here_m if self._highest_m is None else self._highest_m
        self._highest_m = max(here_m, min(highest_m, target_m))
        if self._highest_m - here_m <= threshold_m:
            self._lost_s = None
            return None
        self._lost_s = now_s if self._lost_s is None else self._lost_s
        if now_s - self._lost_s < situation.parameters["FD_ALT_LOSS_T"]:
            return None
        may = int(situation.parameters["CBRK_FLIGHTTERM"]) != _NEVER_TERMINATES
        return (Action.TERMINATE if may else Action.WARN), Cause.GENERIC


class Watchdog:
    """Notices what gets lost or low besides its flight: ground station, companion, sticks, battery.

    Args:
        time_scale: How much faster than the wall clock the simulation is meant to run.
        companion_s: A companion is lost after so long, of the wall clock; None: COM_OBC_LOSS_T.

    Attributes:
        battery: It drains with every step.
        ground_station_lost: True until its first heartbeat, and after its heartbeats stopped.
    """

    def __init__(self, time_scale: float, *, companion_s: float | None = None) -> None:
        # in simulated seconds; None: by COM_OBC_LOSS_T
        self._companion_loss_s = None if companion_s is None else companion_s * time_scale
        self.battery = Battery()
        self.ground_station_lost = True
        self._heartbeat_valid_s = _HEARTBEAT_VALID_S * time_scale  # in simulated seconds
        self._ground_station_s: float | None = None  # its last heartbeat, simulated time
        self._companion_s: float | None = None  # its last heartbeat; None: never there
        self._companion_lost = False  # PX4 reports it and has no failsafe for it
        self._sticks = False  # present at the last check
        self._sticks_since_arming = False  # then or later: only their loss is a failsafe
        self._warning = BatteryWarning.NONE  # the battery's at the last check
        self._warning_at_arming = BatteryWarning.NONE  # only a worse one acts
        self._receivers_missing = False  # of satellites, at the last check

    def on_heartbeat(self, kind: int, situation: Situation) -> None:
        """A HEARTBEAT came in; `kind` is its MAV_TYPE."""
        if kind == GROUND_STATION:
            if self.ground_station_lost and self._ground_station_s is not None:
                situation.announce("commander_dl_regained")
            self.ground_station_lost, self._ground_station_s = False, situation.time_s
        elif kind == COMPANION:
            if self._companion_lost:
                situation.announce("commander_onboard_ctrl_regained")
            self._companion_lost, self._companion_s = False, situation.time_s

    def armed(self) -> None:
        """The motors start: a battery that is low by then, or missing sticks, raise no alarm."""
        self._warning_at_arming = self._warning
        self._sticks_since_arming = self._sticks

    def over(self) -> list[Cause]:
        """The causes that are none now, of links that can come back."""
        here = {
            Cause.GCS_LOST: not self.ground_station_lost,
            Cause.MANUAL_CONTROL_LOST: self._sticks,
        }
        return [cause for cause, is_here in here.items() if is_here]

    def misses_ground_station(self, situation: Situation) -> bool:
        """With a failsafe on its loss, PX4 wants a ground station before it arms."""
        return situation.parameters["NAV_DLL_ACT"] > 0 and self.ground_station_lost

    def step(
        self, step_s: float, intended: FlightMode, situation: Situation, *, sticks: bool
    ) -> list[Alarm]:
        """Check everything; `sticks`: whether a pilot's are received."""
        self.battery.step(step_s, situation)
        alarms: list[Alarm] = []
        if sticks != self._sticks:
            self._sticks = sticks
            alarms += self._on_sticks(intended, situation)
        self._watch_companion(situation)
        alarms += self._watch_ground_station(situation)
        alarms += self._watch_receivers(situation)
        if self.battery.warning != self._warning:
            self._warning = self.battery.warning
            alarms += self._on_battery(self._warning, situation)
        return alarms

    def _on_sticks(self, intended: FlightMode, situation: Situation) -> list[Alarm]:
        if self._sticks:
            self._sticks_since_arming = True
            return []
        situation.announce("commander_rc_lost")
        excepted = int(situation.parameters["COM_RCL_EXCEPT"]) & _STICK_EXCEPTIONS.get(intended, 0)
        if excepted or not self._sticks_since_arming:
            return []
        number = int(situation.parameters["NAV_RCL_ACT"])
        holds = number == _HOLD_WITHOUT_FAILSAFE and intended.needs_pilot and situation.armed
        if holds and situation.parameters.behaviour.holds_without_sticks:
            situation.request_mode(FlightMode.AUTO_LOITER)
            situation.announce("commander_rc_loss_hold_no_failsafe")
        action = _LOSS_ACTIONS.get(number, Action.NONE)
        return [(action, Cause.MANUAL_CONTROL_LOST)]

    def _watch_companion(self, situation: Situation) -> None:
        if self._companion_s is None or self._companion_lost:
            return
        patience_s = self._companion_loss_s
        if patience_s is None:
            patience_s = situation.parameters.limited("COM_OBC_LOSS_T", 0.0, 3600.0)
        if situation.time_s - self._companion_s > patience_s + self._heartbeat_valid_s:
            self._companion_lost = True
            situation.announce("commander_mission_comp_lost")

    def _watch_ground_station(self, situation: Situation) -> list[Alarm]:
        if self._ground_station_s is None or self.ground_station_lost:
            return []
        limit_s = (
            situation.parameters.limited("COM_DL_LOSS_T", 0.0, 3600.0) + self._heartbeat_valid_s
        )
        if situation.time_s - self._ground_station_s <= limit_s:
            return []
        self.ground_station_lost = True
        situation.announce("commander_gcs_lost")
        action = _LOSS_ACTIONS.get(int(situation.parameters["NAV_DLL_ACT"]), Action.NONE)
        return [(action, Cause.GCS_LOST)]

    def _watch_receivers(self, situation: Situation) -> list[Alarm]:
        before, self._receivers_missing = self._receivers_missing, missing_receivers(situation) > 0
        if before or not self._receivers_missing:
            return []
        number = int(situation.parameters["COM_GNSSLOSS_ACT"])
        return [(_RECEIVER_ACTIONS.get(number, Action.WARN), Cause.GENERIC)]

    def _on_battery(self, warning: BatteryWarning, situation: Situation) -> list[Alarm]:
        if warning is BatteryWarning.NONE:
            return []
        cause = Cause[f"BATTERY_{warning.name}"]
        situation.announce(f"check_{cause.name.lower()}")
        action = Action.WARN
        if warning > self._warning_at_arming and warning is not BatteryWarning.LOW:
            choice = int(situation.parameters["COM_LOW_BAT_ACT"])
            critical, emergency = _BATTERY_ACTIONS.get(choice, _BATTERY_ACTIONS[0])
            action = critical if warning is BatteryWarning.CRITICAL else emergency
        return [(action, cause)]
