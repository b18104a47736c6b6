"""The health and arming report: what PX4 says, in EVENTs for programs, when its checks change.

A report is a summary of the arming checks, one event for each check that is not passed, and a
summary of the components' health. It comes at most every two seconds, and when it is asked for.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.state.notice import Notice, Severity
from sitl.px4sim.state.px4_modes import FlightMode

_EVERY_S: Final = 2.05
_LOOK_S: Final = 0.1  # PX4 runs its checks ten times a second
_ATTITUDE_AFTER_S: Final = 2.5
_POSITION_AFTER_S: Final = 4.2
_FOR_PROGRAMS: Final = 8  # log level "protocol"
_ALL_MODES: Final = 0xFFFFFFFF
_USUAL_MODES: Final = 0x807F3AB0  # that a quadrotor with a position can fly
_MISSION: Final = 1 << 3
_OFFBOARD: Final = 1 << 14
_STICKS: Final = 1 << 0 | 1 << 1 | 1 << 2 | 1 << 10 | 1 << 15
_WITHOUT_POSITION: Final = _USUAL_MODES & 0x80003A80 | 0x00010000

# health_component_t
_GLOBAL_POSITION: Final = 1 << 24
_LOCAL_POSITION: Final = 1 << 17
_ATTITUDE: Final = 1 << 16
_SYSTEM: Final = 1 << 20
_REMOTE_CONTROL: Final = 1 << 7
_PRESENT: Final = 0x38021C0A


@dataclass(frozen=True, slots=True)
class _Check:
    """A check that is not passed: its event, level, modes that it concerns, component's number."""

    event: str
    severity: Severity
    modes: int
    component: int


_NO_ATTITUDE: Final = _Check("check_modes_attitude", Severity.CRITICAL, 0x007ED17E, 16)
_NO_LOCAL: Final = _Check("check_modes_local_pos", Severity.ERROR, 0x007E007C, 17)
_NO_GLOBAL: Final = _Check("check_modes_global_pos", Severity.ERROR, 0x00000038, 24)
_NO_MISSION: Final = _Check("check_modes_mission", Severity.INFO, _MISSION, 20)
_NO_SETPOINTS: Final = _Check("check_modes_offboard_signal", Severity.ERROR, _OFFBOARD, 20)
_NO_STICKS: Final = _Check("check_modes_manual_control", Severity.WARNING, _ALL_MODES, 7)
_NO_STATION: Final = _Check("check_rc_dl_no_dllink", Severity.INFO, _ALL_MODES, 12)


class HealthReport:
    """Watches the checks of an autopilot."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._told: tuple[tuple[_Check, ...], int] | None = None
        self._next_s = _EVERY_S

    def step(self) -> list[Notice]:
        """The events of a report that is due; to be called after every step."""
        now_s = self._autopilot.time_s
        asked, self._autopilot.report_asked = self._autopilot.report_asked, False
        if now_s < self._next_s and not asked:
            return []
        checks = self._checks(now_s)
        modes = self._modes(checks)
        if (checks, modes) == self._told and not asked:
            self._next_s = now_s + _LOOK_S
            return []
        self._told, self._next_s = (checks, modes), now_s + _EVERY_S
        errors = _SYSTEM  # PX4's simulator has it so, without a check that says why
        for check in checks:
            if check.severity <= Severity.ERROR and check.component != _MISSION_COMPONENT:
                errors |= 1 << check.component
        warnings = _REMOTE_CONTROL if _NO_STICKS in checks else 0
        summary = struct.pack("<BIIII", 0, errors, warnings, self._can_arm(modes), modes)
        return [
            _notice("commander_arming_check_summary", _FOR_PROGRAMS, summary),
            *(
                _notice(
                    check.event,
                    check.severity,
                    struct.pack("<IB", check.modes, check.component),
                )
                for check in checks
            ),
            _notice(
                "commander_health_summary", _FOR_PROGRAMS, struct.pack("<BIII", 0, _PRESENT, 0, 0)
            ),
        ]

    def _checks(self, now_s: float) -> tuple[_Check, ...]:
        autopilot = self._autopilot
        can_fly, situation = autopilot.modes.can_fly, autopilot.situation
        lost = now_s < _POSITION_AFTER_S or not situation.position_valid
        open_checks = {
            _NO_ATTITUDE: now_s < _ATTITUDE_AFTER_S,
            _NO_LOCAL: lost,
            _NO_GLOBAL: lost,
            _NO_MISSION: not can_fly(FlightMode.AUTO_MISSION, situation),
            _NO_SETPOINTS: not can_fly(FlightMode.OFFBOARD, situation),
            _NO_STICKS: not can_fly(FlightMode.POSCTL, situation),
            _NO_STATION: autopilot.watchdog.ground_station_lost,
        }
        return tuple(check for check, is_open in open_checks.items() if is_open)

    def _can_arm(self, modes: int) -> int:
        """The modes in which it may be armed; what forbids it forbids it in all of them."""
        autopilot = self._autopilot
        wanted = autopilot.parameters["NAV_DLL_ACT"] > 0
        alone = wanted and autopilot.watchdog.ground_station_lost
        return 0 if autopilot.guard.violated or autopilot.terminated or alone else modes

    def _modes(self, checks: tuple[_Check, ...]) -> int:
        modes = _WITHOUT_POSITION if _NO_LOCAL in checks else _USUAL_MODES
        if _NO_MISSION not in checks and _NO_LOCAL not in checks:
            modes |= _MISSION
        if _NO_SETPOINTS not in checks:
            modes |= _OFFBOARD
        if _NO_STICKS not in checks:
            modes |= _STICKS
        return modes


_MISSION_COMPONENT: Final = 20


def _notice(event: str, level: int, arguments: bytes) -> Notice:
    return Notice(Severity.INFO, "", event, level, arguments)
