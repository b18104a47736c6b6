"""MAVLink commands as PX4 1.17 executes them, and the results it acknowledges them with."""

import logging
import math
from collections.abc import Callable
from enum import IntEnum
from typing import Final

from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.estimation import ArmingReason
from sitl.px4sim.plan_store import MissionType, positive
from sitl.px4sim.state import FlightMode, UnsupportedAutoModeError, requested_mode

_log = logging.getLogger(__name__)

DO_SET_MODE: Final = 176  # MAV_CMD
_FORCE: Final = 21196
_GROUND_STATION_COMPONENT: Final = 190


class CommandResult(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


Params = tuple[float, float, float, float, float, float, float]
"""param1..7; 5 and 6 are degrees where they are a place, NaN where they are nothing."""


class Commands:
    """Carries out what concerns the vehicle, not the link."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._handlers: dict[int, Callable[[Params], CommandResult]] = {  # by MAV_CMD
            20: self._return,
            21: self._land,
            22: self._take_off,
            178: self._change_speed,
            179: self._set_home,
            185: self._terminate,
            192: self._reposition,
            246: self._reboot,
            300: self._start_mission,
            400: self._arm,
            401: self._report_checks,
        }

    def execute(self, command: int, params: Params, component_id: int) -> CommandResult:
        """Execute a component's MAV_CMD; returns the result for COMMAND_ACK."""
        if command == DO_SET_MODE:
            return self._set_mode(params, announce=component_id == _GROUND_STATION_COMPONENT)
        handler = self._handlers.get(command)
        if handler is None:
            _log.warning("command %d is not known here: answered UNSUPPORTED", command)
            return CommandResult.UNSUPPORTED
        return handler(params)

    def _mode(
        self, mode: FlightMode, *, forced: bool = False, announce: bool = True
    ) -> CommandResult:
        if self._autopilot.request_mode(mode, forced=forced):
            return CommandResult.ACCEPTED
        if announce:
            self._autopilot.situation.announce("commander_modeswitch_not_avail", mode=mode.label)
        return CommandResult.TEMPORARILY_REJECTED

    def _set_mode(self, params: Params, *, announce: bool) -> CommandResult:
        base_mode, main, sub = (_byte(value) for value in params[:3])
        try:
            mode = requested_mode(base_mode, main, sub)
        except UnsupportedAutoModeError:
            self._autopilot.situation.announce("commander_unsupported_auto_mode")
            return CommandResult.TEMPORARILY_REJECTED
        if mode is None:
            if self._autopilot.behaviour.rejects_unknown_mode:
                return CommandResult.TEMPORARILY_REJECTED
            return CommandResult.ACCEPTED
        return self._mode(mode, forced=mode is FlightMode.AUTO_LAND, announce=announce)

    def _return(self, _: Params) -> CommandResult:
        return self._announced(self._mode(FlightMode.AUTO_RTL), "commander_rtl")

    def _land(self, _: Params) -> CommandResult:
        result = self._mode(FlightMode.AUTO_LAND, forced=True)
        return self._announced(result, "commander_landing_current_pos")

    def _announced(self, result: CommandResult, event: str) -> CommandResult:
        """Announce the event if the command was accepted."""
        if result is CommandResult.ACCEPTED:
            self._autopilot.situation.announce(event)
        return result

    def _take_off(self, params: Params) -> CommandResult:
        self._autopilot.modes.takeoff.request(params[6])
        return self._mode(FlightMode.AUTO_TAKEOFF)

    def _change_speed(self, params: Params) -> CommandResult:
        self._autopilot.situation.speed_m_s = positive(params[1])
        return CommandResult.ACCEPTED

    def _set_home(self, params: Params) -> CommandResult:
        autopilot, situation = self._autopilot, self._autopilot.situation
        latitude, longitude, altitude = params[4:]
        if params[0] > 0.5:
            autopilot.set_home(situation.here, situation.altitude_m)
        elif all(map(math.isfinite, (latitude, longitude, altitude))):
            autopilot.set_home(situation.projection.to_local(latitude, longitude), altitude)
        else:
            return CommandResult.DENIED
        return CommandResult.ACCEPTED

    def _terminate(self, params: Params) -> CommandResult:
        wanted = params[0] > 0.5
        done = wanted and self._autopilot.terminate()
        return CommandResult.ACCEPTED if done else CommandResult.DENIED

    def _reposition(self, params: Params) -> CommandResult:
        """The altitude is always AMSL, whatever the frame.

        Without the change-mode flag it is UNSUPPORTED, or from 1.18 on DENIED outside of Hold.
        """
        holds = self._autopilot.mode is FlightMode.AUTO_LOITER
        if params[1] != 1:
            if not self._autopilot.behaviour.moves_hold_without_flag:
                return CommandResult.UNSUPPORTED
            if not holds:
                return CommandResult.DENIED
        speed, flag, _, _, latitude, longitude, altitude = params
        accepted = CommandResult.ACCEPTED
        result = self._mode(FlightMode.AUTO_LOITER) if flag == 1 else accepted
        if result is CommandResult.ACCEPTED:
            placed = math.isfinite(latitude) and math.isfinite(longitude)
            projection = self._autopilot.situation.projection
            self._autopilot.reposition(
                projection.to_local(latitude, longitude) if placed else None,
                altitude if math.isfinite(altitude) else None,
                positive(speed),
            )
        return result

    def _start_mission(self, params: Params) -> CommandResult:
        autopilot = self._autopilot
        if not autopilot.mission.valid:
            autopilot.situation.announce("commander_mission_start_denied_no_mission")
            return CommandResult.DENIED
        first, count = params[0], len(autopilot.plan.items(MissionType.MISSION))
        if not math.isfinite(first) or not -1 <= first < count:
            return CommandResult.DENIED
        if first >= 0:
            autopilot.plan.set_current(int(first))
        started = autopilot.request_mode(FlightMode.AUTO_MISSION)
        started = started and autopilot.arm(ArmingReason.MISSION_START)
        return CommandResult.ACCEPTED if started else CommandResult.TEMPORARILY_REJECTED

    def _arm(self, params: Params) -> CommandResult:
        action, forced = params[0], params[1] == _FORCE
        if math.isfinite(action) and round(action) == 1:
            done = self._autopilot.arm()
        elif math.isfinite(action) and round(action) == 0:
            done = self._autopilot.disarm(forced=forced)
        else:
            return CommandResult.UNSUPPORTED
        return CommandResult.ACCEPTED if done else CommandResult.TEMPORARILY_REJECTED

    def _report_checks(self, _: Params) -> CommandResult:
        self._autopilot.report_requested = True
        return CommandResult.ACCEPTED

    def _reboot(self, params: Params) -> CommandResult:
        if params[0] == 0:
            return CommandResult.ACCEPTED
        _log.warning("a reboot was requested: not simulated, answered DENIED")
        return CommandResult.DENIED


def _byte(value: float) -> int:
    return int(value) & 0xFF if math.isfinite(value) else 0
