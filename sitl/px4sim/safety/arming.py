"""Arming and disarming: the reasons PX4 names, and when it disarms by itself."""

from __future__ import annotations

from enum import IntEnum

from sitl.px4sim.state.parameters import Parameters


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
