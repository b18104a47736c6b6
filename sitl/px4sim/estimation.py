"""What the autopilot believes: its place, by satellites, and whether it stands on the ground.

PX4's simulated receiver has no fix with fewer than four satellites (SIM_GPS_USED). The estimator
then goes on by itself for EKF2_NOAID_TOUT, ever worse; after that no mode that needs a position can
be flown. With a fix again it takes two seconds.
"""

from enum import Enum
from typing import Final

from sitl.px4sim.motion import EstimateErrors, MotionDemand, Multirotor, SetpointKind
from sitl.px4sim.state import Situation

FEWEST_SATELLITES: Final = 4
_STOPPED_S: Final = 7.0
_RECOVERY_S: Final = 2.0


class Positioning:
    """Whether there is a fix.

    Attributes:
        fused: Whether the estimator uses the receiver.
    """

    def __init__(self) -> None:
        self._lost_s: float | None = None  # when the fix went; None: there is one, and it is used
        self._regained_s: float | None = None  # fix again since then, not fused yet
        self.fused = True

    def step(
        self, step_s: float, errors: EstimateErrors, airframe: Multirotor, situation: Situation
    ) -> None:
        """Let time pass; renews what the autopilot believes of place, velocity and heading."""
        situation.time_s += step_s
        errors.step(step_s, in_air=not situation.landed)
        self._check_receiver(step_s, errors, situation)
        situation.north_m = airframe.north_m + errors.north_m
        situation.east_m = airframe.east_m + errors.east_m
        # The local frame's height is that of the ground where the vehicle was started.
        situation.altitude_m = situation.ground_altitude_m + airframe.up_m + errors.altitude_m
        situation.velocity_m_s = (
            airframe.velocity_north_m_s,
            airframe.velocity_east_m_s,
            airframe.velocity_up_m_s,
        )
        situation.heading_rad = airframe.yaw_rad

    def _check_receiver(self, step_s: float, errors: EstimateErrors, situation: Situation) -> None:
        now_s = situation.time_s
        if situation.parameters["SIM_GPS_USED"] < FEWEST_SATELLITES:
            self._lost_s = now_s if self._lost_s is None else self._lost_s
            self._regained_s = None
        elif self._lost_s is not None:
            self._regained_s = now_s if self._regained_s is None else self._regained_s
            if now_s - self._regained_s >= _RECOVERY_S:
                self._recover(errors, situation)
        if self._lost_s is None:
            return
        errors.coast(step_s)
        lost_for_s = now_s - self._lost_s
        patience_s = situation.parameters.limited("EKF2_NOAID_TOUT", 5e5, 1e7) / 1e6
        situation.position_valid = lost_for_s < patience_s
        if self.fused and lost_for_s > _STOPPED_S:
            self.fused = False
            situation.announce("check_estimator_gnss_fusion_stopped")

    def _recover(self, errors: EstimateErrors, situation: Situation) -> None:
        self._lost_s = self._regained_s = None
        if not self.fused:
            situation.announce("check_estimator_gnss_fusion_started")
        self.fused = situation.position_valid = True
        errors.recover()


_LIFT_OFF_M: Final = 0.05
_RAMP_M_S: Final = 0.08
_TOUCHED_S: Final = 1.0
_STAY: Final = frozenset({SetpointKind.IDLE, SetpointKind.LAND})


class ArmingReason(Enum):
    """Why the motors were started or stopped: number in PX4's events, text in its messages."""

    COMMAND = (4, "external command")
    MISSION_START = (5, "mission start")
    LANDED = (6, "landing")
    NO_TAKEOFF = (7, "auto preflight disarming")

    def __init__(self, number: int, text: str) -> None:
        self.number, self.text = number, text


class GroundContact:
    """Leaving the ground, coming back to it, and when PX4 disarms there by itself.

    Before a take-off are spool-up and thrust ramp.
    """

    def __init__(self) -> None:
        self._armed_s = 0.0  # when it was armed last, simulated time
        self._landed_s: float | None = None  # None: it has not flown since it was armed
        self._ramp_s: float | None = None  # start of MPC_TKO_RAMP_T; None: no take-off requested
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
            situation.announce("commander_takeoff_detected")
            return True
        if not airframe.on_ground:
            self._touched_s = None
        elif self._touched_s is None:
            self._touched_s = situation.time_s
        elif situation.time_s - self._touched_s > _TOUCHED_S:
            situation.landed, self._ramp_s, self._touched_s = True, None, None
            self._landed_s = situation.time_s
            situation.announce("commander_landing_detected")
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
