"""The simulated autopilot, which behaves like PX4 1.15 to 1.18. Pure."""

from sitl.px4sim.autopilot import HOME_AFTER_S, Autopilot
from sitl.px4sim.commands import DO_SET_MODE, CommandResult, Commands, Params
from sitl.px4sim.estimation import FEWEST_SATELLITES
from sitl.px4sim.failsafe import GROUND_STATION, missing_receivers, receivers_forbid_arming
from sitl.px4sim.flight_modes import Sticks
from sitl.px4sim.parameters import BATTERY_MINUTES, DEFAULTS, Parameters, defaults
from sitl.px4sim.plan_store import (
    CAPACITY,
    Command,
    MissionItem,
    MissionType,
    PlanStore,
    Refusal,
    UploadResult,
    checksum,
    stored_item,
)
from sitl.px4sim.state import FlightMode, MapProjection, Notice, Severity, StartPosition
from sitl.px4sim.used_params import unused_param_of_command, unused_param_of_item
from sitl.px4sim.versions import BEHAVIOURS, RECORDED, USUAL, Px4Behaviour

__all__ = [
    "BATTERY_MINUTES",
    "BEHAVIOURS",
    "CAPACITY",
    "DEFAULTS",
    "DO_SET_MODE",
    "FEWEST_SATELLITES",
    "GROUND_STATION",
    "HOME_AFTER_S",
    "RECORDED",
    "USUAL",
    "Autopilot",
    "Command",
    "CommandResult",
    "Commands",
    "FlightMode",
    "MapProjection",
    "MissionItem",
    "MissionType",
    "Notice",
    "Parameters",
    "Params",
    "PlanStore",
    "Px4Behaviour",
    "Refusal",
    "Severity",
    "StartPosition",
    "Sticks",
    "UploadResult",
    "checksum",
    "defaults",
    "missing_receivers",
    "receivers_forbid_arming",
    "stored_item",
    "unused_param_of_command",
    "unused_param_of_item",
]
