"""Satellite positioning, and how long the estimate lives without it.

PX4's simulated receiver has no fix with fewer than four satellites (SIM_GPS_USED). The estimator
then goes on by itself for EKF2_NOAID_TOUT, ever worse; after that no mode that needs a position can
be flown. With a fix again it takes two seconds.
"""

from typing import Final

from sitl.px4sim.motion.disturbances import EstimateErrors
from sitl.px4sim.motion.dynamics import Multirotor
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
        self._look_at_receiver(step_s, errors, situation)
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

    def _look_at_receiver(
        self, step_s: float, errors: EstimateErrors, situation: Situation
    ) -> None:
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
            situation.say("", "check_estimator_gnss_fusion_stopped")

    def _recover(self, errors: EstimateErrors, situation: Situation) -> None:
        self._lost_s = self._regained_s = None
        if not self.fused:
            situation.say("", "check_estimator_gnss_fusion_started")
        self.fused = situation.position_valid = True
        errors.recover()
