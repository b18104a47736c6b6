"""Which version of PX4 the simulated autopilot behaves as, and what that changes.

The other files of this room have the behaviour of `RECORDED`; this one has how others differ,
as far as the conversations of `sitl conform` show it on a binary.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from air_router.vehicle.px4 import NEWEST, Version

Values = Mapping[str, int | float]


@dataclass(frozen=True, slots=True)
class Px4Behaviour:
    """The differences among versions.

    Attributes:
        version: Of PX4.
        patch: The number behind it, of the binary that it was compared with.
        answers_mode_twice: DO_SET_MODE is acknowledged at once, and when it is decided.
        rejects_unknown_mode: A mode that does not exist is rejected, in place of being passed over.
        reports_mission_state: In MISSION_CURRENT: mission_state and mission_mode.
        requests_int: The items of an upload are requested by MISSION_REQUEST_INT from the first on.
        moves_hold_without_flag: DO_REPOSITION without its change-mode flag moves the place of Hold.
        mode_ends_termination: A mode command ends a termination by command.
        holds_end_with_cause: Hold and Land of a failsafe end when their cause does, not only with a
            mode command.
        answers_aliens: A command for another system or component is answered FAILED.
        takes_system_0: A command for system 0 is taken as one for all.
        answers_failure_injection: INJECT_FAILURE is acknowledged.
        names_absent_parameters: By PARAM_ERROR.
        overrides_by_speed: Sticks take over by their speed (MAN_OVERRIDE_SPD), not by their
            deflection (COM_RC_OVERRIDE, COM_RC_STICK_OV).
        answers_old_requests: Messages are also requested by commands of their own, such as
            REQUEST_AUTOPILOT_CAPABILITIES.
        refuses_unused_params: Of commands and mission items; else they are passed over.
        repeats_count: MISSION_COUNT of a download, until an item is requested.
        mode_by_first_sticks: Sticks that come before any mode command choose Position.
        holds_without_sticks: NAV_RCL_ACT 7 changes to Hold, without a failsafe.
        companion_s: After so long without a heartbeat a companion is lost; None: COM_OBC_LOSS_T.
        shows_intended_in_termination: A failsafe's termination shows in system_status alone; else
            as the mode, too.
        breach_text: The text of a breach of the fence.
        texts: Events with another name or text, by 1.17's event: the name there, and its text.
        without: Parameters that it does not have.
        values: Parameters that 1.17 does not have, and those with another default.
    """

    version: Version
    patch: int = 0
    answers_mode_twice: bool = True
    rejects_unknown_mode: bool = False
    reports_mission_state: bool = True
    requests_int: bool = True
    moves_hold_without_flag: bool = False
    mode_ends_termination: bool = False
    holds_end_with_cause: bool = False
    answers_aliens: bool = False
    takes_system_0: bool = False
    answers_failure_injection: bool = False
    names_absent_parameters: bool = False
    overrides_by_speed: bool = False
    answers_old_requests: bool = True
    refuses_unused_params: bool = False
    repeats_count: bool = False
    mode_by_first_sticks: bool = True
    holds_without_sticks: bool = False
    companion_s: float | None = None
    shows_intended_in_termination: bool = False
    breach_text: str = "Geofence: approaching or outside geofence"
    texts: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    without: frozenset[str] = frozenset()
    values: Values = field(default_factory=dict)

    @property
    def number(self) -> int:
        """As AUTOPILOT_VERSION has it: a release."""
        major, minor = self.version
        return major << 24 | minor << 16 | self.patch << 8 | 0xFF


_LOW_BEFORE_1_16: Final = "Low battery level"  # whatever level
_REMOVED_IN_1_18: Final = frozenset({"COM_RC_OVERRIDE", "COM_RC_STICK_OV", "COM_OBC_LOSS_T"})
_NEW_IN_1_18: Final[Values] = {
    "MAN_OVERRIDE_SPD": 1.0,
    "COM_GNSSLOSS_ACT": 0,
    "COM_FLTMODE_BOOT": 4,
    "FD_ALT_LOSS": 0.0,
    "FD_ALT_LOSS_T": 1.0,
    "SYS_HAS_NUM_GNSS": 0,
    "MPC_AUTO_NUDGING": 0,
    "NAV_ACC_RAD": 10.0,
}

BEHAVIOURS: Final[Mapping[Version, Px4Behaviour]] = {
    each.version: each
    for each in (
        Px4Behaviour(
            (1, 15),
            patch=4,
            answers_mode_twice=False,
            reports_mission_state=False,
            requests_int=False,
            mode_ends_termination=True,
            holds_end_with_cause=True,
            values={"COM_LOW_BAT_ACT": 2},
            breach_text="Geofence violation: approaching or outside geofence",
            answers_aliens=True,
            texts={
                "check_battery_low": ("check_battery_low", _LOW_BEFORE_1_16),
                "check_battery_critical": ("check_battery_low", _LOW_BEFORE_1_16),
                "check_battery_emergency": ("check_battery_low", _LOW_BEFORE_1_16),
                "commander_failsafe_enter_autopilot_disengaged": (
                    "commander_failsafe_enter_generic",
                    "Failsafe activated",
                ),
            },
        ),
        Px4Behaviour((1, 16), patch=2, reports_mission_state=False, requests_int=False),
        Px4Behaviour((1, 17)),
        Px4Behaviour(
            (1, 18),
            answers_mode_twice=False,
            rejects_unknown_mode=True,
            moves_hold_without_flag=True,
            takes_system_0=True,
            answers_failure_injection=True,
            names_absent_parameters=True,
            overrides_by_speed=True,
            answers_old_requests=False,
            shows_intended_in_termination=True,
            refuses_unused_params=True,
            repeats_count=True,
            mode_by_first_sticks=False,
            holds_without_sticks=True,
            companion_s=5.0,
            texts={
                "mavlink_mission_op_timeout": (
                    "mavlink_mission_sync_timeout",
                    "Mission sync timeout",
                ),
                "check_battery_emergency": (
                    "check_battery_emergency",
                    "System does not support shutdown",
                ),
            },
            without=_REMOVED_IN_1_18,
            values=_NEW_IN_1_18,
        ),
    )
}
"""By version: all that were flown."""

RECORDED: Final[Version] = (1, 17)
"""The version on which the behaviour of this room, its parameters and the conversations were
recorded; the others are described by how they differ."""

USUAL: Final[Version] = NEWEST
"""The version of the simulated autopilot where none is chosen: the newest."""
