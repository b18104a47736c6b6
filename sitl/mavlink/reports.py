"""What the vehicle reports unrequested: texts, the progress of its mission, and its health.

STATUSTEXT goes only to a ground station that is there, and never late. MISSION_CURRENT and
MISSION_ITEM_REACHED are sent on each link, as PX4's mission manager does. A health report is a
summary of the arming checks, one EVENT for each check that is not passed, and a summary of the
components' health; it comes at most every two seconds, and on request.
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Final

from sitl.mavlink.codec import Outgoing
from sitl.px4sim import (
    Autopilot,
    FlightMode,
    MissionType,
    Notice,
    Px4Behaviour,
    Severity,
    missing_receivers,
    receivers_forbid_arming,
)

_WINDOW_S: Final = 2.5
_AGE_S: Final = 5.0
_CHUNK: Final = 50
_MOST: Final = 50


class TextChannel:
    """Keeps texts for up to 5 s until the link receives a ground station's heartbeat.

    Args:
        time_scale: Simulated seconds per wall-clock second, in which heartbeats come.
    """

    def __init__(self, time_scale: float) -> None:
        self._window_s = _WINDOW_S * time_scale  # simulated; within it the station counts as there
        self._texts: deque[tuple[float, Notice]] = deque(maxlen=_MOST)  # with the time of each
        self._received_s = -math.inf  # its last heartbeat, simulated time
        self._identifier = 0  # of the next STATUSTEXT, by which its chunks are joined

    def on_ground_station(self, now_s: float) -> None:
        """A heartbeat of a ground station came in on the link."""
        self._received_s = now_s

    def add(self, notice: Notice, now_s: float) -> None:
        """Queue the text of an announcement."""
        if notice.text:
            self._texts.append((now_s, notice))

    def take(self, now_s: float) -> list[Outgoing]:
        """The messages to be sent now."""
        if not self._texts or now_s - self._received_s > self._window_s:
            return []
        messages: list[Outgoing] = []
        for queued_s, notice in self._texts:
            if now_s - queued_s <= _AGE_S:
                messages.extend(self._chunks(notice))
        self._texts.clear()
        return messages

    def _chunks(self, notice: Notice) -> list[Outgoing]:
        data = notice.status_text.encode("ascii", "replace")
        chunks = [data[start : start + _CHUNK] for start in range(0, len(data), _CHUNK)]
        if len(data) % _CHUNK == 0:
            chunks.append(b"")  # a text ends with the first chunk that is not full
        text = {"severity": notice.severity, "id": self._identifier}
        self._identifier = (self._identifier + 1) & 0xFFFF
        return [
            Outgoing("STATUSTEXT", text | {"text": chunk, "chunk_seq": number})
            for number, chunk in enumerate(chunks)
        ]


def worded_as(notice: Notice, behaviour: Px4Behaviour) -> Notice:
    """The announcement in the text of a version of PX4."""
    event, text = behaviour.texts.get(notice.event, (notice.event, notice.text))
    return replace(notice, event=event, text=text if notice.text else "")


_NO_MISSION, _NOT_STARTED, _ACTIVE, _PAUSED, _COMPLETE = range(1, 6)  # MISSION_STATE
_MODE_ACTIVE, _MODE_SUSPENDED = 1, 2
_ACTIVE_MODES: Final = frozenset(
    {FlightMode.AUTO_MISSION, FlightMode.AUTO_TAKEOFF, FlightMode.AUTO_LAND}
)
_UNKNOWN_TOTAL: Final = 65535
_REPEATS: Final = 10
_PERIOD_S: Final = 1.0


class MissionReporter:
    """Once a second, and at once when the current item changes or an item is reached.

    MISSION_ITEM_REACHED is repeated ten times after it was sent first.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._state = _NO_MISSION  # MISSION_STATE; stays where no rule fits
        self._current = 0  # item of the last MISSION_CURRENT
        self._reached = -1  # item of the last MISSION_ITEM_REACHED; -1: none
        self._repeats = 0  # of that message
        self._next_s = -math.inf  # simulated time of the next report without a change

    def step(self, now_s: float) -> list[Outgoing]:
        """The messages that are due now."""
        mission = self._autopilot.mission
        messages: list[Outgoing] = []
        if mission.index != self._current:
            self._current = mission.index
            messages.append(self._mission_current())
        if mission.reached != self._reached:
            self._reached, self._repeats = mission.reached, 0
            if mission.reached >= 0:
                messages.append(_item_reached(mission.reached))
        if not messages and now_s >= self._next_s:
            self._next_s = now_s + _PERIOD_S
            messages.append(self._mission_current())
            if self._reached >= 0 and self._repeats < _REPEATS:
                self._repeats += 1
                messages.append(_item_reached(self._reached))
        return messages

    def _mission_current(self) -> Outgoing:
        plan = self._autopilot.plan
        active = self._autopilot.mode in _ACTIVE_MODES
        count = len(plan.items(MissionType.MISSION))
        self._renew_state(count, active=active)
        reported = self._autopilot.behaviour.reports_mission_state
        return Outgoing(
            "MISSION_CURRENT",
            {
                "seq": self._current,
                "total": count or _UNKNOWN_TOTAL,
                "mission_state": self._state if reported else 0,
                "mission_mode": (_MODE_ACTIVE if active else _MODE_SUSPENDED) if reported else 0,
                "mission_id": plan.identifier(MissionType.MISSION),
                "fence_id": plan.identifier(MissionType.FENCE),
                "rally_points_id": plan.identifier(MissionType.RALLY),
            },
        )

    def _renew_state(self, count: int, *, active: bool) -> None:
        mission = self._autopilot.mission
        if count == 0 or not mission.valid:
            self._state = _NO_MISSION
        elif mission.finished:
            self._state = _COMPLETE
        elif active:
            self._state = _ACTIVE
        elif mission.reached >= 0:
            self._state = _PAUSED
        elif mission.index < 1:
            self._state = _NOT_STARTED


def _item_reached(sequence: int) -> Outgoing:
    return Outgoing("MISSION_ITEM_REACHED", {"seq": sequence})


_EVERY_S: Final = 2.05
_CHECK_S: Final = 0.1  # PX4 runs its checks ten times a second
_ATTITUDE_AFTER_S: Final = 2.5
_POSITION_AFTER_S: Final = 4.2
_ALL_MODES: Final = 0xFFFFFFFF
_USUAL_MODES: Final = 0x807F3AB0  # that a quadrotor with a position can fly
_MISSION: Final = 1 << 3
_OFFBOARD: Final = 1 << 14
_STICKS: Final = 1 << 0 | 1 << 1 | 1 << 2 | 1 << 10 | 1 << 15
_WITHOUT_POSITION: Final = _USUAL_MODES & 0x80003A80 | 0x00010000

# health_component_t
_SYSTEM: Final = 1 << 20  # PX4's simulator has an error in it, without a check that names it
_REMOTE_CONTROL: Final = 1 << 7
_PRESENT: Final = 0x38021C0A
_MODES: Final = 20


@dataclass(frozen=True, slots=True)
class _Check:
    """A check that is not passed: its event, modes that it concerns, component's number, more."""

    event: str
    modes: int
    component: int
    arguments: tuple[int, ...] = ()


_NO_FIX: Final = "check_gnss_receiver_no_fix"
_OFFLINE: Final = "check_gnss_receiver_offline"
_RECEIVER: Final = 3
_NO_ATTITUDE: Final = _Check("check_modes_attitude", 0x007ED17E, 16)
_NO_LOCAL: Final = _Check("check_modes_local_pos", 0x007E007C, 17)
_NO_GLOBAL: Final = _Check("check_modes_global_pos", 0x00000038, 24)
_MISSION_UNFIT: Final = _Check("check_modes_mission", _MISSION, _MODES)
_NO_SETPOINTS: Final = _Check("check_modes_offboard_signal", _OFFBOARD, _MODES)
_NO_STICKS: Final = _Check("check_modes_manual_control", _ALL_MODES, 7)
_NO_STATION: Final = _Check("check_rc_dl_no_dllink", _ALL_MODES, 12)


class HealthReport:
    """Watches the checks of an autopilot."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._reported: tuple[list[_Check], int] | None = None  # checks, modes
        self._next_s = _EVERY_S  # simulated time of the next check

    def step(self) -> list[Notice]:
        """The events of a report that is due; to be called after every step."""
        now_s = self._autopilot.time_s
        requested, self._autopilot.report_requested = self._autopilot.report_requested, False
        if now_s < self._next_s and not requested:
            return []
        checks = self._checks(now_s)
        modes = self._modes(checks)
        if (checks, modes) == self._reported and not requested:
            self._next_s = now_s + _CHECK_S
            return []
        self._reported, self._next_s = (checks, modes), now_s + _EVERY_S
        return _report(checks, modes, self._can_arm(modes))

    def _checks(self, now_s: float) -> list[_Check]:
        autopilot, situation = self._autopilot, self._autopilot.situation
        can_fly = autopilot.modes.can_fly
        lost = now_s < _POSITION_AFTER_S or not situation.position_valid
        checks = {
            _NO_ATTITUDE: now_s < _ATTITUDE_AFTER_S,
            _NO_LOCAL: lost,
            _NO_GLOBAL: lost,
            _MISSION_UNFIT: not can_fly(FlightMode.AUTO_MISSION, situation),
            _NO_SETPOINTS: True,
            _NO_STICKS: not can_fly(FlightMode.POSCTL, situation),
            _NO_STATION: autopilot.watchdog.ground_station_lost,
        }
        open_ones = [check for check, is_open in checks.items() if is_open]
        return open_ones + self._missing_receivers()

    def _missing_receivers(self) -> list[_Check]:
        """One for each satellite receiver that is required; only the first exists."""
        situation = self._autopilot.situation
        missing = missing_receivers(situation)
        required = round(situation.parameters.get("SYS_HAS_NUM_GNSS", 0))
        modes = _ALL_MODES if receivers_forbid_arming(situation) else 0
        return [
            _Check(_NO_FIX if number == 0 else _OFFLINE, modes, _RECEIVER, (number,))
            for number in range(required - missing, required)
        ]

    def _can_arm(self, modes: int) -> int:
        """The modes in which it may be armed; what forbids it forbids it in all of them."""
        autopilot = self._autopilot
        alone = autopilot.watchdog.misses_ground_station(autopilot.situation)
        forbidden = alone or receivers_forbid_arming(autopilot.situation)
        return 0 if autopilot.fence.violated or autopilot.terminated or forbidden else modes

    def _modes(self, checks: list[_Check]) -> int:
        """Those that can be flown."""
        modes = _WITHOUT_POSITION if _NO_LOCAL in checks else _USUAL_MODES
        if _MISSION_UNFIT not in checks and _NO_LOCAL not in checks:
            modes |= _MISSION
        if _NO_STICKS not in checks:
            modes |= _STICKS
        return modes


def _notice_of(check: _Check) -> Notice:
    """What concerns no mode is a warning."""
    notice = Notice.of(check.event, check.modes, check.component, *check.arguments)
    return notice if check.modes else replace(notice, severity=Severity.WARNING)


def _report(checks: list[_Check], modes: int, can_arm: int) -> list[Notice]:
    failed = [_notice_of(check) for check in checks]
    errors = _SYSTEM
    for check, notice in zip(checks, failed, strict=True):
        if notice.severity <= Severity.ERROR and check.component != _MODES:
            errors |= 1 << check.component
    warnings = _REMOTE_CONTROL if _NO_STICKS in checks else 0
    return [
        Notice.of("commander_arming_check_summary", 0, errors, warnings, can_arm, modes),
        *failed,
        Notice.of("commander_health_summary", 0, _PRESENT, 0, 0),
    ]
