"""The simulated vehicle's motion, wind, and estimation errors."""

from sitl.px4sim.motion.disturbances import EstimateErrors, Wind, WindSettings
from sitl.px4sim.motion.dynamics import GRAVITY_M_S2, MotionDemand, Multirotor
from sitl.px4sim.motion.guidance import (
    Direct,
    Setpoint,
    SetpointKind,
    SpeedLimits,
    braking_distance,
    wanted_velocity,
)

__all__ = [
    "GRAVITY_M_S2",
    "Direct",
    "EstimateErrors",
    "MotionDemand",
    "Multirotor",
    "Setpoint",
    "SetpointKind",
    "SpeedLimits",
    "Wind",
    "WindSettings",
    "braking_distance",
    "wanted_velocity",
]
