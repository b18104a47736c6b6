"""What the autopilot watches besides its flight: the ground station, the companion, the battery."""

from __future__ import annotations

from typing import Final

from sitl.px4sim.motion.battery import Battery, BatteryWarning
from sitl.px4sim.safety.failsafe import STICK_LOSS_ACTIONS, Action, Cause
from sitl.px4sim.state.notice import Severity
from sitl.px4sim.state.px4_modes import FlightMode
from sitl.px4sim.state.situation import Situation

GROUND_STATION: Final = 6  # MAV_TYPE_GCS
COMPANION: Final = 18  # MAV_TYPE_ONBOARD_CONTROLLER
_HEARD_FOR_S: Final = 2.0  # PX4's links report a heartbeat for so long after it came

_BATTERY_TEXTS: Final = {
    BatteryWarning.LOW: ("Low battery", "check_battery_low", Severity.CRITICAL),
    BatteryWarning.CRITICAL: ("Critical battery", "check_battery_critical", Severity.CRITICAL),
    BatteryWarning.EMERGENCY: (
        "Emergency battery level",
        "check_battery_emergency",
        Severity.EMERGENCY,
    ),
}
_BATTERY_CAUSES: Final = {
    BatteryWarning.LOW: Cause.BATTERY_LOW,
    BatteryWarning.CRITICAL: Cause.BATTERY_CRITICAL,
    BatteryWarning.EMERGENCY: Cause.BATTERY_EMERGENCY,
}
# By COM_LOW_BAT_ACT: warning only, return, land, return then land; at critical and at emergency.
_BATTERY_ACTIONS: Final = {
    0: (Action.WARN, Action.WARN),
    1: (Action.RTL, Action.RTL),
    2: (Action.LAND, Action.LAND),
    3: (Action.RTL, Action.LAND),
}
_STICK_EXCEPTIONS: Final = {  # bits of COM_RCL_EXCEPT
    FlightMode.AUTO_MISSION: 1,
    FlightMode.AUTO_LOITER: 2,
    FlightMode.AUTO_TAKEOFF: 2,
    FlightMode.OFFBOARD: 4,
}
_LINK_ACTIONS: Final = {1: Action.HOLD, 2: Action.RTL, 3: Action.LAND, 5: Action.TERMINATE}


class Watchdog:
    """Notices what gets lost or low; `step` returns the failsafes to be triggered.

    Attributes:
        ground_station_lost: True until one was heard, and after it fell silent.
    """

    def __init__(self, time_scale: float) -> None:
        self._heard_for_s = _HEARD_FOR_S * time_scale  # in simulated seconds
        self._ground_station_s: float | None = None  # its last heartbeat, simulated time
        self._companion_s: float | None = None  # its last heartbeat; None: never there
        self._companion_lost = False  # only said: PX4 has no failsafe for it
        self._sticks = False  # heard at the last look
        self._sticks_since_arming = False  # then or later: only their loss is a failsafe
        self.ground_station_lost = True
        self._warning = BatteryWarning.NONE  # the battery's at the last look
        self._warning_at_arming = BatteryWarning.NONE  # only a worse one acts

    def heard(self, kind: int, situation: Situation) -> None:
        """A HEARTBEAT came in; `kind` is its MAV_TYPE."""
        if kind == GROUND_STATION:
            if self.ground_station_lost and self._ground_station_s is not None:
                situation.say("GCS connection regained", "commander_dl_regained")
            self.ground_station_lost, self._ground_station_s = False, situation.time_s
        elif kind == COMPANION:
            if self._companion_lost:
                situation.say("Onboard controller regained", "commander_onboard_ctrl_regained")
            self._companion_lost, self._companion_s = False, situation.time_s

    def armed(self) -> None:
        """The motors start: a battery that is low already, or a lack of sticks, is no news."""
        self._warning_at_arming = self._warning
        self._sticks_since_arming = self._sticks

    def sticks(
        self, intended: FlightMode, situation: Situation, *, present: bool
    ) -> list[tuple[Action, Cause]]:
        """Look whether a pilot's sticks came or went."""
        if present == self._sticks:
            return []
        self._sticks = present
        if present:
            self._sticks_since_arming = True
            return []
        situation.say("", "commander_rc_lost")
        exception = _STICK_EXCEPTIONS.get(intended, 0)
        if int(situation.parameters["COM_RCL_EXCEPT"]) & exception or not self._sticks_since_arming:
            return []
        choice = int(situation.parameters["NAV_RCL_ACT"])
        return [(STICK_LOSS_ACTIONS.get(choice, Action.NONE), Cause.MANUAL_CONTROL_LOST)]

    def step(self, battery: Battery, situation: Situation) -> list[tuple[Action, Cause]]:
        """Look at everything."""
        actions = self._watch_links(situation)
        if battery.warning != self._warning:
            self._warning = battery.warning
            actions += self._on_battery(battery.warning, situation)
        return actions

    def refuses_arming(self, situation: Situation) -> bool:
        """With a failsafe on its loss, PX4 wants a ground station before it arms."""
        wanted = situation.parameters["NAV_DLL_ACT"] > 0
        if wanted and self.ground_station_lost:
            situation.say("Preflight Fail: No connection to the GCS", severity=Severity.WARNING)
            return True
        return False

    def _watch_links(self, situation: Situation) -> list[tuple[Action, Cause]]:
        parameters, now_s = situation.parameters, situation.time_s
        if self._companion_s is not None and not self._companion_lost:
            limit_s = parameters.limited("COM_OBC_LOSS_T", 0.0, 3600.0) + self._heard_for_s
            if now_s - self._companion_s > limit_s:
                self._companion_lost = True
                situation.say(
                    "Connection to mission computer lost",
                    "commander_mission_comp_lost",
                    Severity.CRITICAL,
                )
        if self._ground_station_s is not None and not self.ground_station_lost:
            limit_s = parameters.limited("COM_DL_LOSS_T", 0.0, 3600.0) + self._heard_for_s
            if now_s - self._ground_station_s > limit_s:
                self.ground_station_lost = True
                situation.say(
                    "Connection to ground station lost",
                    "commander_gcs_lost",
                    Severity.INFO,
                    Severity.WARNING,
                )
                action = _LINK_ACTIONS.get(int(parameters["NAV_DLL_ACT"]), Action.NONE)
                return [(action, Cause.GCS_LOST)]
        return []

    def _on_battery(
        self, warning: BatteryWarning, situation: Situation
    ) -> list[tuple[Action, Cause]]:
        if warning is BatteryWarning.NONE:
            return []
        text, event, severity = _BATTERY_TEXTS[warning]
        situation.say(text, event, severity)
        action = Action.WARN
        if warning > self._warning_at_arming and warning is not BatteryWarning.LOW:
            choice = int(situation.parameters["COM_LOW_BAT_ACT"])
            critical, emergency = _BATTERY_ACTIONS.get(choice, _BATTERY_ACTIONS[0])
            action = critical if warning is BatteryWarning.CRITICAL else emergency
        return [(action, _BATTERY_CAUSES[warning])]
