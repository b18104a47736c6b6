"""Leaving the ground and coming back to it."""

from __future__ import annotations

from typing import Final

from sitl.px4sim.motion.dynamics import MotionDemand, Multirotor
from sitl.px4sim.motion.guidance import SetpointKind
from sitl.px4sim.state.situation import Situation

_LIFT_OFF_M: Final = 0.05
_RAMP_M_S: Final = 0.08
_TOUCHED_S: Final = 1.0
_STAY: Final = frozenset({SetpointKind.IDLE, SetpointKind.LAND})


class GroundContact:
    """Spool-up and thrust ramp before a take-off, detection of take-off and landing.

    Attributes:
        armed_s: When it was armed last, simulated time.
        landed_s: When it landed; None if it has not flown since it was armed.
    """

    def __init__(self) -> None:
        self.armed_s = 0.0
        self._ramp_s: float | None = None  # start of MPC_TKO_RAMP_T; None: no take-off asked
        self._touched_s: float | None = None  # on the ground since then, not found landed yet
        self.landed_s: float | None = None

    def armed(self, now_s: float) -> None:
        """The motors start."""
        self.armed_s, self._ramp_s, self.landed_s = now_s, None, None

    def hold_down(self, situation: Situation) -> MotionDemand | None:
        """What the vehicle does while it is not free to fly yet; None once it is."""
        if situation.landed and situation.setpoint.kind in _STAY:
            self._ramp_s = None
            return MotionDemand(up_m_s=-0.5)
        if self._ramp_s is None:
            if not situation.landed:
                return None
            spool_up_s = situation.parameters.limited("COM_SPOOLUP_TIME", 0.0, 30.0)
            self._ramp_s = max(self.armed_s + spool_up_s, situation.time_s)
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
            situation.landed, self.landed_s = False, None
            situation.took_off_s = situation.time_s
            situation.say("Takeoff detected", "commander_takeoff_detected")
            return True
        if not airframe.on_ground:
            self._touched_s = None
        elif self._touched_s is None:
            self._touched_s = situation.time_s
        elif situation.time_s - self._touched_s > _TOUCHED_S:
            situation.landed, self._ramp_s, self._touched_s = True, None, None
            self.landed_s = situation.time_s
            situation.say("Landing detected", "commander_landing_detected")
        return False
