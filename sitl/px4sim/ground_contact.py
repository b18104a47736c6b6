"""Leaving the ground, coming back to it, and when PX4 disarms there by itself."""

from enum import Enum
from typing import Final

from sitl.px4sim.motion.dynamics import MotionDemand, Multirotor
from sitl.px4sim.motion.guidance import SetpointKind
from sitl.px4sim.state import Situation

_LIFT_OFF_M: Final = 0.05
_RAMP_M_S: Final = 0.08
_TOUCHED_S: Final = 1.0
_STAY: Final = frozenset({SetpointKind.IDLE, SetpointKind.LAND})


class ArmingReason(Enum):
    """Why the motors were started or stopped: number in PX4's events, words of its texts."""

    COMMAND = (4, "external command")
    MISSION_START = (5, "mission start")
    LANDED = (6, "landing")
    NO_TAKEOFF = (7, "auto preflight disarming")

    def __init__(self, number: int, words: str) -> None:
        self.argument = bytes((number,))
        self.words = words


class GroundContact:
    """Spool-up and thrust ramp before a take-off, detection of take-off and landing."""

    def __init__(self) -> None:
        self._armed_s = 0.0  # when it was armed last, simulated time
        self._landed_s: float | None = None  # None: it has not flown since it was armed
        self._ramp_s: float | None = None  # start of MPC_TKO_RAMP_T; None: no take-off asked
        self._touched_s: float | None = None  # on the ground since then, not found landed yet

    def armed(self, now_s: float) -> None:
        """The motors start."""
        self._armed_s, self._ramp_s, self._landed_s = now_s, None, None

    def hold_down(self, situation: Situation) -> MotionDemand | None:
        """What the vehicle does while it is not free to fly yet; None once it is."""
        if situation.landed and situation.setpoint.kind in _STAY:
            self._ramp_s = None
            return MotionDemand(up_m_s=-0.5)
        if self._ramp_s is None:
            if not situation.landed:
                return None
            self._ramp_s = max(self._armed_s + _spool_up_s(situation), situation.time_s)
        since_s = situation.time_s - self._ramp_s
        if since_s < 0:
            return MotionDemand(up_m_s=-0.5)
        if since_s < situation.parameters.limited("MPC_TKO_RAMP_T", 0.0, 5.0):
            return MotionDemand(up_m_s=_RAMP_M_S)
        return None

    def detect(self, airframe: Multirotor, situation: Situation) -> bool:
        """Renew `situation.landed`; True at the moment of a take-off."""
        if situation.landed:
            if airframe.up_m <= _LIFT_OFF_M:
                return False
            situation.landed, self._landed_s = False, None
            situation.took_off_s = situation.time_s
            situation.say("Takeoff detected", "commander_takeoff_detected")
            return True
        if not airframe.on_ground:
            self._touched_s = None
        elif self._touched_s is None:
            self._touched_s = situation.time_s
        elif situation.time_s - self._touched_s > _TOUCHED_S:
            situation.landed, self._ramp_s, self._touched_s = True, None, None
            self._landed_s = situation.time_s
            situation.say("Landing detected", "commander_landing_detected")
        return False

    def disarm_due(self, situation: Situation, *, in_mission: bool) -> ArmingReason | None:
        """Whether an armed vehicle on the ground is to be disarmed now; `in_mission` may go on."""
        limited, now_s = situation.parameters.limited, situation.time_s
        if self._landed_s is not None:
            limit_s = limited("COM_DISARM_LAND", -1.0, 3600.0)
            due = 0 < limit_s <= now_s - self._landed_s and not in_mission
            return ArmingReason.LANDED if due else None
        limit_s = limited("COM_DISARM_PRFLT", -1.0, 3600.0)
        waited_s = now_s - self._armed_s - _spool_up_s(situation)
        return ArmingReason.NO_TAKEOFF if 0 < limit_s <= waited_s else None


def _spool_up_s(situation: Situation) -> float:
    return situation.parameters.limited("COM_SPOOLUP_TIME", 0.0, 30.0)
